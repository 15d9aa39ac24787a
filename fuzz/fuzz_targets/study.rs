//! Any text as a study of the planar arm: read, and its jobs planned.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sinew::error::SourceFile;
use sinew::study::Study;
use sinew::study::sources::{Sources, parse};

fuzz_target!(|text: &str| {
    let file = |path: &str, text: &str| SourceFile { path: path.into(), text: text.to_owned() };
    let study = file("study.toml", text);
    if let Ok(parsed) = parse(&study) {
        let model = file("arm.toml", include_str!("../../data/models/arm.toml"));
        let motion = file("arm_curl.csv", include_str!("../../data/motions/arm_curl.csv"));
        let _ = Study::from_sources(Sources { study, model, motion }, parsed);
    }
});
