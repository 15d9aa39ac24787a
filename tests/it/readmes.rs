//! The READMEs: what they quote from commands is what the commands print, and what they point at is there.

use std::path::Path;

use super::cli::{sinew, text};
use super::support::root;
use sinew::internals::reference::{self, FileKind};
use sinew::internals::tables::schema;

const READMES: [&str; 6] =
    ["README.md", "studies/README.md", "data/README.md", "results/README.md", "src/README.md", "tests/README.md"];

/// How a quoted command begins, on a line of its own.
const BEGIN: &str = "\n<!-- sinew ";

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap()
}

/// Between `<!-- sinew ARGUMENTS -->` and `<!-- end -->` stands what the command prints. With `SINEW_WRITE_DOCS` set the
/// test writes it.
#[test]
fn readmes_quote_what_commands_print() {
    let mut blocks = 0;
    for path in READMES {
        let before = read(path);
        let mut after = String::new();
        let mut rest = before.as_str();
        while let Some(start) = rest.find(BEGIN) {
            let command = &rest[start + BEGIN.len()..];
            let (command, _) = command.split_once(" -->").unwrap();
            let end =
                start + rest[start..].find("<!-- end -->").unwrap_or_else(|| panic!("{path}: {command} has no end"));
            let printed = sinew(&command.split(' ').collect::<Vec<&str>>(), root());
            assert!(printed.status.success(), "{command}: {}", text(&printed.stderr));
            after.push_str(&format!("{}{BEGIN}{command} -->\n{}\n", &rest[..start], text(&printed.stdout).trim_end()));
            rest = &rest[end..];
            blocks += 1;
        }
        after.push_str(rest);
        if std::env::var_os("SINEW_WRITE_DOCS").is_some() {
            std::fs::write(root().join(path), &after).unwrap();
        } else {
            assert!(before == after, "{path} is out of date: SINEW_WRITE_DOCS=1 cargo test --release -- readmes");
        }
    }
    assert_eq!(blocks, 5);
}

/// Every key has a meaning, and so has every column.
#[test]
fn every_key_and_column_is_explained() {
    for kind in [FileKind::Study, FileKind::PlanarModel, FileKind::SpatialModel] {
        for key in reference::keys(kind) {
            assert!(!key.meaning.is_empty(), "{kind:?}: {} in {:?} has no meaning", key.name, key.table);
        }
    }
    for key in reference::settings() {
        assert!(!key.meaning.is_empty() && !key.value.is_empty(), "{}: {key:?}", key.name);
    }
    for table in schema::TABLES {
        assert!(!schema::row_of(table).is_empty());
        for about in schema::columns_of(table) {
            assert!(!about.meaning.is_empty(), "{table}.{} has no meaning", about.name);
            assert!(about.kind != "double" || !about.unit.is_empty(), "{table}.{} has no unit", about.name);
        }
    }
}

#[test]
fn the_readme_is_short_and_links_lead_somewhere() {
    assert!(read("README.md").lines().count() <= 150);
    for path in READMES {
        let (file, folder) = (read(path), Path::new(path).parent().unwrap());
        for link in file.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            let (target, anchor) = link.split_once('#').map_or((link, None), |(target, anchor)| (target, Some(anchor)));
            if target.starts_with("http") {
                continue;
            }
            let there = root().join(folder).join(target);
            let there = if target.is_empty() { root().join(path) } else { there };
            assert!(there.exists(), "{path} points at {link}");
            if let Some(anchor) = anchor {
                let titles = std::fs::read_to_string(&there).unwrap();
                let has = titles.lines().filter(|line| line.starts_with('#')).any(|line| slug(line) == anchor);
                assert!(has, "{path} points at {link}, which has no such title");
            }
        }
    }
}

/// The anchor of a title.
fn slug(title: &str) -> String {
    let words = title.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
    words.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect()
}
