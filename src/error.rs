//! Errors before a job starts: bad input and I/O. (A job that fails is not an error, but a row with a status.)

use std::io::Read;
use std::path::{Path, PathBuf};

use miette::{Diagnostic, NamedSource, SourceSpan};
use serde::{Deserialize, Serialize};

pub type Result<T> = std::result::Result<T, Error>;

/// Bad input or I/O; the program ends with exit code 2.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum Error {
    #[error(transparent)]
    #[diagnostic(transparent)]
    Input(Box<InputError>),
    #[error("cannot {action} {}: {cause}", path.display())]
    #[diagnostic(help("{}", hint(cause, path)))]
    Io { action: &'static str, path: PathBuf, cause: std::io::Error },
    #[error("cannot {action} {}: {reason}", path.display())]
    Table { action: &'static str, path: PathBuf, reason: String },
}

/// A mistake at a place in a file: what was found, what is allowed, and how to fix it.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{message}")]
pub struct InputError {
    pub message: String,
    #[source_code]
    pub source_code: NamedSource<String>,
    #[label("{label}")]
    pub span: Option<SourceSpan>,
    pub label: String,
    #[help]
    pub help: Option<String>,
    /// Other mistakes in the same file.
    #[related]
    pub others: Vec<InputError>,
}

impl Error {
    /// Combines several mistakes into one error. `errors` must not be empty.
    pub fn all(errors: impl IntoIterator<Item = Error>) -> Self {
        let mut errors = errors.into_iter();
        let mut first = errors.next().expect("at least one error");
        if let Error::Input(first) = &mut first {
            for error in errors {
                if let Error::Input(mut other) = error {
                    first.others.extend(std::mem::take(&mut other.others));
                    first.others.push(*other);
                }
            }
        }
        first
    }

    pub fn io(action: &'static str, path: &Path, cause: std::io::Error) -> Self {
        Error::Io { action, path: path.to_owned(), cause }
    }

    pub fn table(action: &'static str, path: &Path, reason: impl ToString) -> Self {
        Error::Table { action, path: path.to_owned(), reason: reason.to_string() }
    }
}

/// The remedy for an I/O error.
fn hint(cause: &std::io::Error, path: &Path) -> String {
    match cause.kind() {
        std::io::ErrorKind::NotFound => match nearest_file(path) {
            Some(near) => format!("no such file; did you mean `{}`?", near.display()),
            None => "no such file; paths given in a study file are relative to that file".to_owned(),
        },
        std::io::ErrorKind::PermissionDenied => "check the permissions of the file and its folder".to_owned(),
        std::io::ErrorKind::StorageFull => "free some space and run again: finished jobs are kept".to_owned(),
        _ => "check that the path is correct and readable".to_owned(),
    }
}

/// The file in the same folder with the most similar name, if one is similar.
fn nearest_file(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let folder = path.parent()?;
    let names: Vec<String> = std::fs::read_dir(if folder.as_os_str().is_empty() { Path::new(".") } else { folder })
        .ok()?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .collect();
    nearest(name, names.iter().map(String::as_str).filter(|other| *other != name)).map(|near| folder.join(near))
}

/// The allowed word most similar to a misspelt one, if one is similar.
pub fn nearest<'a>(found: &str, allowed: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    allowed
        .into_iter()
        .map(|word| (strsim::damerau_levenshtein(found, word), word))
        .filter(|&(distance, word)| distance <= 2.max(found.len().max(word.len()) / 3))
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, word)| word)
}

/// Serialises a path as text, with invalid UTF-8 replaced.
///
/// # Errors
/// If the serialiser fails.
pub fn as_text<S: serde::Serializer>(path: &Path, serialiser: S) -> std::result::Result<S::Ok, S::Error> {
    serialiser.serialize_str(&path.to_string_lossy())
}

/// A text file with its path; creates errors that point to places in it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SourceFile {
    #[serde(rename = "file", serialize_with = "as_text")]
    pub path: PathBuf,
    pub text: String,
}

/// Size limit for text files, bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Extensions of files that are read as Latin-1 if they are not UTF-8.
const LATIN_1: [&str; 3] = ["osim", "mot", "sto"];

/// Longest line that is shown with an error, bytes.
const MAX_SHOWN_LINE: usize = 1000;

impl SourceFile {
    /// Reads a text file of at most [`MAX_BYTES`]. OpenSim's files may be Latin-1.
    ///
    /// # Errors
    /// If the file cannot be read, is larger, or is not UTF-8.
    pub fn read(path: &Path) -> Result<Self> {
        let failed = |e| Error::io("read", path, e);
        let mut bytes = Vec::new();
        // Count the bytes read, because a pipe has no size.
        std::fs::File::open(path).map_err(failed)?.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
        if bytes.len() as u64 > MAX_BYTES {
            let file = Self { path: path.to_owned(), text: String::new() };
            let message = format!("{}: the file is larger than {} MB", path.display(), MAX_BYTES >> 20);
            let help = "no study, model or motion is that large: check that this is the intended file";
            return Err(file.error(None, message, "", Some(help.to_owned())));
        }
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Self { path: path.to_owned(), text }),
            Err(error)
                if path.extension().is_some_and(|ending| LATIN_1.iter().any(|e| ending.eq_ignore_ascii_case(e))) =>
            {
                Ok(Self { path: path.to_owned(), text: error.as_bytes().iter().copied().map(char::from).collect() })
            }
            Err(error) => {
                let line = error.as_bytes()[..error.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
                let file = Self { path: path.to_owned(), text: String::new() };
                Err(file.error(
                    None,
                    format!("{}: line {} is not UTF-8 text", path.display(), line + 1),
                    "",
                    Some("save the file as UTF-8, or check that this is the intended file".to_owned()),
                ))
            }
        }
    }

    /// An error at a byte range of this file. If lines there are too long to be shown, the message names the line
    /// instead.
    pub fn error(
        &self,
        span: Option<std::ops::Range<usize>>,
        message: impl Into<String>,
        label: impl Into<String>,
        help: Option<String>,
    ) -> Error {
        let (mut message, mut text) = (message.into(), String::new());
        let span = span.filter(|span| {
            let line = self.text[..span.start].matches('\n').count();
            let shown = self.text.lines().skip(line.saturating_sub(1)).take(3).map(str::len).max().unwrap_or(0);
            if shown > MAX_SHOWN_LINE {
                message = format!("{}, line {}: {message}", self.path.display(), line + 1);
                return false;
            }
            text.clone_from(&self.text);
            true
        });
        Error::Input(Box::new(InputError {
            message,
            source_code: NamedSource::new(self.path.display().to_string(), text),
            span: span.map(|s| (s.start, s.end.saturating_sub(s.start)).into()),
            label: label.into(),
            help,
            others: Vec::new(),
        }))
    }

    /// The byte range of a line, counted from 1.
    pub fn line_span(&self, line: usize) -> Option<std::ops::Range<usize>> {
        let start = match line {
            0 | 1 => 0,
            _ => self.text.match_indices('\n').nth(line - 2)?.0 + 1,
        };
        let end = self.text[start..].find('\n').map_or(self.text.len(), |n| start + n);
        Some(start..end)
    }

    /// Parses the file as TOML of type `T`.
    ///
    /// # Errors
    /// All unknown keys up to the first mistake of another kind, and that mistake.
    pub fn toml<T: serde::de::DeserializeOwned>(&self) -> Result<T> {
        let mut errors = Vec::new();
        let mut text = self.text.clone();
        loop {
            let error = match toml::from_str(&text) {
                Ok(read) if errors.is_empty() => return Ok(read),
                Ok(_) => break,
                Err(error) => error,
            };
            errors.push(self.toml_error(&error));
            // Blank out a line `key = value` with an unknown key, to find further mistakes.
            let unknown = error.span().filter(|_| error.message().starts_with("unknown field"));
            let Some(line) = unknown.and_then(|span| line_of_key(&text, &span)) else { break };
            text.replace_range(line.clone(), &" ".repeat(line.len()));
        }
        Err(Error::all(errors))
    }

    /// An error of the TOML parser, with a suggestion for a misspelt or missing word.
    pub fn toml_error(&self, error: &toml::de::Error) -> Error {
        let message = error.message().to_owned();
        let mut help = None;
        if message.starts_with("unknown field") || message.starts_with("unknown variant") {
            let words: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
            help = words
                .split_first()
                .and_then(|(found, allowed)| nearest(found, allowed.iter().copied()))
                .map(|near| format!("did you mean `{near}`?"));
        } else if let Some(missing) = message.strip_prefix("missing field ") {
            help = Some(format!("add the key {missing} to this table"));
        }
        self.error(error.span(), message, "here", help)
    }

    /// The byte range of the value at a path in a TOML file, or of the deepest part of the path that exists. A path
    /// enters an array of tables by the `name` of a table, or any array by index.
    pub fn toml_span(&self, path: &[String]) -> Option<std::ops::Range<usize>> {
        use toml::de::{DeTable, DeValue};
        fn step(value: &DeValue<'_>, path: &[String], here: std::ops::Range<usize>) -> std::ops::Range<usize> {
            let Some((key, rest)) = path.split_first() else { return here };
            match value {
                DeValue::Table(table) => match table.iter().find(|(k, _)| k.get_ref() == key) {
                    Some((k, v)) => step(v.get_ref(), rest, k.span().start..v.span().end.max(k.span().end)),
                    None => here,
                },
                DeValue::Array(items) => {
                    let named = |item: &DeValue<'_>| match item {
                        DeValue::Table(t) => t.iter().any(|(k, v)| {
                            k.get_ref() == "name" && matches!(v.get_ref(), DeValue::String(s) if s == key)
                        }),
                        _ => false,
                    };
                    let found = items
                        .iter()
                        .find(|item| named(item.get_ref()))
                        .or_else(|| key.parse::<usize>().ok().and_then(|i| items.get(i)));
                    match found {
                        Some(item) => step(item.get_ref(), rest, item.span()),
                        None => here,
                    }
                }
                _ => here,
            }
        }
        let table = DeTable::parse(&self.text).ok()?;
        let (key, rest) = path.split_first()?;
        let (k, v) = table.get_ref().iter().find(|(k, _)| k.get_ref() == key)?;
        Some(step(v.get_ref(), rest, k.span().start..v.span().end.max(k.span().end)))
    }
}

/// The byte range of the line `key = value`, without its line break, if it is complete on its own.
fn line_of_key(text: &str, key: &std::ops::Range<usize>) -> Option<std::ops::Range<usize>> {
    let start = text[..key.start].rfind('\n').map_or(0, |n| n + 1);
    let end = text[key.end..].find('\n').map_or(text.len(), |n| key.end + n);
    let line = &text[start..end];
    let is_whole = text[start..key.start].trim().is_empty() && toml::from_str::<toml::Table>(line).is_ok();
    is_whole.then_some(start..end)
}

/// A mistake in a value, located by its path in a TOML file (`["muscle", "triceps", "optimal_fibre_length"]`).
#[derive(Clone, Debug, PartialEq)]
pub struct Issue {
    pub path: Vec<String>,
    pub message: String,
    pub help: Option<String>,
}

impl Issue {
    pub fn new(path: &[&str], message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { path: path.iter().map(|s| (*s).to_owned()).collect(), message: message.into(), help: Some(help.into()) }
    }

    /// All mistakes in a file as one error. `issues` must not be empty.
    pub fn all_in_file(issues: &[Issue], file: &SourceFile) -> Error {
        Error::all(issues.iter().map(|issue| issue.in_file(file)))
    }

    /// The error at the place of the value in `file`.
    pub fn in_file(&self, file: &SourceFile) -> Error {
        let key = self.path.join(".");
        file.error(file.toml_span(&self.path), format!("{key}: {}", self.message), "here", self.help.clone())
    }
}

/// Collects mistakes, so that all of them can be reported at once.
#[derive(Default)]
pub struct Mistakes(Vec<Issue>);

impl Mistakes {
    /// The checked value if it is valid; otherwise records the mistake.
    pub fn take<T>(&mut self, checked: std::result::Result<T, Issue>) -> Option<T> {
        checked.map_err(|issue| self.0.push(issue)).ok()
    }

    /// The valid ones among the checked values; records the mistakes of the others.
    pub fn all<T>(&mut self, checked: impl Iterator<Item = std::result::Result<T, Issue>>) -> Vec<T> {
        checked.filter_map(|one| self.take(one)).collect()
    }

    pub fn push(&mut self, issue: Issue) {
        self.0.push(issue);
    }

    /// Checks that there are no mistakes so far.
    ///
    /// # Errors
    /// The mistakes recorded so far, which are removed from the collection.
    pub fn none(&mut self) -> std::result::Result<(), Vec<Issue>> {
        if self.0.is_empty() { Ok(()) } else { Err(std::mem::take(&mut self.0)) }
    }
}

/// The first of several mistakes. `issues` must not be empty.
pub fn first(mut issues: Vec<Issue>) -> Issue {
    issues.swap_remove(0)
}
