//! Any text as an OpenSim model: read, and if it is one, lengths and moment arms in its default pose.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sinew::error::SourceFile;

fuzz_target!(|text: &str| {
    let file = SourceFile { path: "model.osim".into(), text: text.to_owned() };
    if let Ok((_, skeleton)) = sinew::study::load_skeleton(&file) {
        skeleton.lengths_and_moment_arms(&skeleton.default_pose());
        let _ = skeleton.check_study();
    }
});
