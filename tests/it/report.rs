//! The page of `sinew report`: its data equal those of the tables.

use std::io::Read;

use base64::Engine;
use serde_json::Value as Json;
use sinew::internals::tables::{self, Values};

use super::cli::{sinew, text};
use sinew::internals::report::svg;
use sinew::internals::study::Study;

use super::support::{SMALL, folder, root};

/// The text of a page, and the data embedded in it.
fn unpacked(page: &std::path::Path) -> (String, Json) {
    let html = std::fs::read_to_string(page).unwrap();
    let data = html.split_once("<script id=\"data\" type=\"application/octet-stream\">").unwrap().1;
    let packed = base64::engine::general_purpose::STANDARD.decode(data.split_once('<').unwrap().0).unwrap();
    let mut json = String::new();
    flate2::read::GzDecoder::new(&packed[..]).read_to_string(&mut json).unwrap();
    let report = serde_json::from_str(&json).unwrap();
    (html, report)
}

#[test]
fn the_page_holds_every_number_of_the_tables() {
    let folder = folder(&[("study.toml", SMALL)]);
    assert_eq!(sinew(&["run", "study.toml"], folder.path()).status.code(), Some(0));
    let made = sinew(&["report", "results/small", "--compare", "results/small"], folder.path());
    assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
    let results = folder.path().join("results/small");
    let (html, report) = unpacked(&results.join("report.html"));
    assert!(!html.contains("{{") && !html.contains("src=\"http"), "nothing is left open or fetched");
    for name in ["jobs", "regularity", "muscles", "iterations", "spectrum"] {
        let table = tables::read(name, &results.join(format!("{name}.parquet"))).unwrap();
        let columns = report["tables"][name]["columns"].as_array().unwrap();
        assert_eq!(report["tables"][name]["rows"], table.rows());
        for ((column, values), shown) in table.columns.iter().zip(columns) {
            assert_eq!(shown["name"], *column);
            for row in 0..table.rows() {
                let found = match values {
                    Values::Text(v) => {
                        let word = shown["at"][row].as_i64().unwrap();
                        let word = usize::try_from(word).ok().map(|word| shown["words"][word].as_str().unwrap());
                        assert_eq!(word, v[row].as_deref(), "{name}.{column} {row}");
                        continue;
                    }
                    _ => &shown["values"][row],
                };
                match values {
                    Values::Number(v) => assert_eq!(found.as_f64(), v[row], "{name}.{column} {row}"),
                    Values::Integer(v) => assert_eq!(found.as_i64(), v[row], "{name}.{column} {row}"),
                    Values::Flag(v) => assert_eq!(found.as_bool(), v[row], "{name}.{column} {row}"),
                    Values::Text(_) => unreachable!(),
                }
            }
        }
    }
    assert_eq!(report["beside"]["changes"].as_array().unwrap().len(), 0);
}

#[test]
fn a_folder_without_finished_jobs_has_a_page_and_one_without_a_manifest_an_error() {
    let folder = folder(&[("study.toml", SMALL)]);
    assert_eq!(sinew(&["run", "study.toml"], folder.path()).status.code(), Some(0));
    let results = folder.path().join("results/small");
    for name in ["jobs", "regularity", "muscles", "iterations", "spectrum", "optima", "sensitivities"] {
        let _ = std::fs::remove_file(results.join(format!("{name}.parquet")));
    }
    assert_eq!(sinew(&["report", "results/small"], folder.path()).status.code(), Some(0));
    assert_eq!(unpacked(&results.join("report.html")).1["tables"].as_object().unwrap().len(), 0);
    let none = sinew(&["report", "."], folder.path());
    assert!(none.status.code() == Some(2) && text(&none.stderr).contains("manifest.json"));
}

#[test]
fn figures_are_svg_files_that_say_where_they_come_from() {
    let text_of = SMALL.replace("[sweep.grid]", "trajectories = true\n[sweep.grid]");
    let folder = folder(&[("study.toml", &text_of)]);
    assert_eq!(sinew(&["run", "study.toml", "--out", "out"], folder.path()).status.code(), Some(0));
    let made = sinew(&["report", "out", "--svg", "--job", "3"], folder.path());
    assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
    let study = Study::load(&folder.path().join("study.toml")).unwrap();
    let mut names = Vec::new();
    for file in std::fs::read_dir(folder.path().join("out/figures")).unwrap().map(|file| file.unwrap()) {
        let figure = std::fs::read_to_string(file.path()).unwrap();
        let xml = roxmltree::Document::parse(&figure).unwrap();
        let said =
            |tag: &str| xml.descendants().find(|node| node.tag_name().name() == tag).and_then(|node| node.text());
        let shapes = xml.descendants().filter(|node| node.tag_name().name() == "path").count();
        assert!(shapes > 3 && !figure.contains("NaN") && said("title").is_some(), "{file:?}");
        assert!(said("desc").unwrap().contains(&study.hash()), "{file:?}");
        names.push(file.file_name().into_string().unwrap());
    }
    for name in
        ["Tendon", "mean_force_n-over-mu-All_muscles", "peak_activation-over-bounds-All_muscles", "job-3-force_n"]
    {
        assert!(names.contains(&format!("{name}.svg")), "{name}: {names:?}");
    }
    let none = sinew(&["report", "out", "--svg", "--job", "99"], folder.path());
    assert!(none.status.code() == Some(2) && text(&none.stderr).contains("number 99"), "{}", text(&none.stderr));
}

#[test]
fn the_gallery_is_of_the_shipped_studies_as_they_are() {
    let readme = std::fs::read_to_string(root().join("results/README.md")).unwrap();
    let mut count = 0;
    for file in std::fs::read_dir(root().join("data/gallery")).unwrap().map(|file| file.unwrap()) {
        let name = file.file_name().into_string().unwrap();
        let Some((study, _)) = name.strip_suffix(".svg").and_then(|name| name.split_once('-')) else { continue };
        let figure = std::fs::read_to_string(file.path()).unwrap();
        let study = Study::load(&root().join(format!("studies/{study}.toml"))).unwrap();
        for said in [study.hash(), svg::drawing_code_hash()] {
            assert!(figure.contains(&said), "{name} is not of {said}: data/gallery/make.sh makes it anew");
        }
        assert!(readme.contains(&format!("../data/gallery/{name}")), "{name} is not in the README");
        count += 1;
    }
    assert_eq!(count, readme.matches("](../data/gallery/").count(), "all images of the README are there");
}
