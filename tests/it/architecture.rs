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
        ("clarabel::", "nlp/subproblem/qp.rs"),
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

/// All modules of the program: each may use those before it only.
const LAYERS: [&str; 41] = [
    "terminal",
    "deadline",
    "error",
    "names",
    "files",
    "numerics",
    "curves",
    "entries",
    "skeleton",
    "model",
    "motion",
    "settings",
    "opensim",
    "nlp",
    "recruitment",
    "problem",
    "transcription",
    "methods",
    "guess",
    "memory",
    "outcome",
    "plausibility",
    "prepare",
    "warm",
    "solution",
    "uniqueness",
    "mesh_error",
    "near_optimal",
    "analysis",
    "recruited",
    "starts",
    "solve",
    "study",
    "tables",
    "run",
    "compare",
    "table1",
    "report",
    "reference",
    "cli",
    "internals",
];

/// What follows a prefix such as `crate::` in a text, comments and unit tests left out.
fn used(text: &str, prefix: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]").next().unwrap();
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    let parts = lines.flat_map(|line| line.split(prefix).skip(1).map(str::to_owned).collect::<Vec<_>>());
    parts.map(|part| part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()).collect()
}

#[test]
fn dependencies_point_one_way() {
    let src = super::support::root().join("src");
    for (path, text) in sources(&src) {
        let inside = Path::new(&path).strip_prefix(&src).unwrap().to_str().unwrap();
        let own = inside.split('/').next().unwrap().trim_end_matches(".rs");
        if ["lib", "main", "build"].contains(&own) || !path.ends_with(".rs") {
            continue;
        }
        let layer = |name: &str| {
            LAYERS.iter().position(|layer| *layer == name).unwrap_or_else(|| panic!("{path}: `{name}` has no layer"))
        };
        for name in used(&text, "crate::").iter().filter(|name| *name != own && *name != "SOLVER") {
            assert!(layer(name) < layer(own), "{path} uses {name}, which comes after {own}");
        }
    }
}

/// Files of one folder that use one another in a circle cannot be read one after the other.
#[test]
fn files_of_a_folder_do_not_use_one_another_in_circles() {
    let src = super::support::root().join("src");
    let texts: std::collections::BTreeMap<String, String> = (sources(&src).into_iter())
        .filter(|(path, _)| path.ends_with(".rs") && !path.ends_with("/mod.rs"))
        .map(|(path, text)| (path.trim_end_matches(".rs").to_owned(), text))
        .collect();
    // The files beside one that it names with `super::`.
    let beside = |path: &str| -> Vec<String> {
        let folder = path.rsplit_once('/').unwrap().0;
        let names = used(&texts[path], "super::");
        let files = names.iter().map(|name| format!("{folder}/{name}"));
        files.filter(|file| file != path && texts.contains_key(file)).collect()
    };
    for start in texts.keys() {
        let (mut seen, mut open) = (std::collections::BTreeSet::new(), beside(start));
        while let Some(path) = open.pop() {
            assert_ne!(&path, start, "{start} uses itself by way of its neighbours");
            if seen.insert(path.clone()) {
                open.extend(beside(&path));
            }
        }
    }
}

/// What a job's solve consists of neither reads files nor prints, so that it is a function of the job.
#[test]
fn a_solve_is_pure() {
    let src = super::support::root().join("src");
    for name in LAYERS.iter().skip(5).take_while(|name| **name != "study").filter(|name| **name != "opensim") {
        for (path, text) in sources(&src).iter().filter(|(path, _)| path.starts_with(src.join(name).to_str().unwrap()))
        {
            let text = text.split("#[cfg(test)]").next().unwrap();
            assert!(!text.contains("std::fs") && !text.contains("rayon::"), "{path} reads files or starts threads");
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
