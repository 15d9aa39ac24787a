//! Any text as a motion of the planar arm: the first byte says of which kind.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use sinew::error::SourceFile;
use sinew::model::Model;
use sinew::motion::MotionTable;

static MODEL: LazyLock<Model> = LazyLock::new(|| {
    let text = include_str!("../../data/models/arm.toml").to_owned();
    sinew::study::load_model(&SourceFile { path: "arm.toml".into(), text }).unwrap().1
});

fuzz_target!(|input: (u8, &str)| {
    let ending = ["mot", "sto", "csv"][usize::from(input.0) % 3];
    let file = SourceFile { path: format!("motion.{ending}").into(), text: input.1.to_owned() };
    let _ = MotionTable::from_file(&file, &MODEL);
});
