//! Which module may use which: the invariants stated in `lib.rs`.

use std::path::Path;

fn sources(folder: &Path) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else {
            found.push((path.to_str().unwrap().to_owned(), std::fs::read_to_string(&path).unwrap()));
        }
    }
    found
}

#[test]
fn one_door_a_crate() {
    let doors = [
        ("clarabel::", "nlp/qp.rs"),
        ("polars::", "tables/parquet.rs"),
        ("rayon::", "run/"),
        ("indicatif::", "run/"),
        ("clap::", "cli/"),
        ("comfy_table::", "cli/"),
    ];
    for (path, text) in sources(&super::support::root().join("src")) {
        for (name, door) in doors {
            assert!(!text.contains(name) || path.contains(door), "{path} knows {name}");
        }
    }
}

#[test]
fn dependencies_point_one_way() {
    let forbidden: [(&str, &[&str]); 7] = [
        ("src/numerics/", &["crate::model", "crate::nlp", "crate::motion", "crate::study", "crate::transcription"]),
        ("src/nlp/", &["crate::model", "crate::motion", "crate::study", "crate::transcription", "crate::run"]),
        ("src/model/", &["crate::nlp", "crate::motion", "crate::study", "crate::run", "crate::tables"]),
        ("src/motion/", &["crate::nlp", "crate::study", "crate::transcription", "crate::run"]),
        ("src/transcription/", &["crate::study", "crate::run", "crate::tables", "crate::solve"]),
        ("src/solve.rs", &["crate::run", "crate::tables", "crate::cli", "std::fs", "println!"]),
        ("src/tables/", &["crate::run", "crate::solve", "crate::cli", "crate::nlp"]),
    ];
    for (path, text) in sources(&super::support::root().join("src")) {
        // Unit tests may use other modules for their fixtures.
        let text = text.split("#[cfg(test)]").next().unwrap();
        for (folder, names) in forbidden {
            for name in names.iter().filter(|_| path.contains(folder)) {
                assert!(!text.contains(name), "{path} knows {name}");
            }
        }
    }
}

#[test]
fn one_place_prints() {
    for (path, text) in sources(&super::support::root().join("src")) {
        let text = text.split("#[cfg(test)]").next().unwrap();
        // The build script communicates with cargo by printing.
        let may = ["terminal.rs", "build.rs"].iter().any(|name| path.ends_with(name)) || path.ends_with(".js");
        assert!(may || !text.contains("println!("), "{path} prints");
    }
}
