//! Finished jobs on disk: one JSON line each, appended and synced as the jobs finish.
//!
//! A folder may contain several such files, one per writer: `finished.jsonl` for a run on one machine,
//! `finished.I-of-N….jsonl` for shards. Readers combine all of them; of two lines for the same job, the later one
//! counts. A line begins with a header, which states how the job ended and contains a hash of header and outcome.
//! Folders of many jobs thus open fast, and damage is detected.

use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::Shard;
use crate::SOLVER;
use crate::error::{Error, Result};
use crate::files::partial;
use crate::names::counted;
use crate::outcome::{Outcome, Status};
use crate::terminal::note;

const OUTCOME: &[u8] = b",\"outcome\":";

/// How a finished job ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    pub job_id: String,
    pub status: Status,
    /// Version of the solver, see `build.rs`.
    pub solver: String,
    /// Whether it was retried by continuation from a neighbour, with success or without.
    pub retried: bool,
    /// When it finished, ms since 1970.
    pub time_ms: u64,
    /// Length of the outcome's text in bytes.
    length: usize,
    /// Hash of the header, with this field empty, and the outcome's text.
    check: String,
}

impl Header {
    /// The beginning of the line, up to the outcome's text.
    fn text(&self) -> Vec<u8> {
        let mut text = serde_json::to_vec(self).expect("a header is plain data");
        text.pop(); // its closing brace comes after the outcome
        text.extend_from_slice(OUTCOME);
        text
    }

    /// Whether the hash is that of this header and the outcome's text `body`.
    fn is_of(&self, body: &[u8]) -> bool {
        let plain = Header { check: String::new(), ..self.clone() };
        // Older versions hashed the outcome's text only.
        self.check == hash(&[&plain.text(), body]) || self.check == hash(&[body])
    }
}

struct StoredJob {
    header: Header,
    file: usize,
    /// Where the outcome's text begins.
    offset: u64,
}

struct OwnFile {
    /// Index in [`Store::files`].
    place: usize,
    file: File,
    /// Where its last complete line ends.
    end: u64,
}

/// The finished jobs of a folder.
#[derive(Default)]
pub struct Store {
    files: Vec<PathBuf>,
    entries: HashMap<String, StoredJob>,
    /// The file that this process writes to.
    own: Option<OwnFile>,
    /// The file last read from. Only one is open at a time: there may be more shards than files that a process may
    /// open.
    reading: Option<(usize, File)>,
    /// Number of damaged lines, which were skipped.
    pub damaged: usize,
}

/// The line of a finished job. Whatever the clock says, its time is later than `after` (ms since 1970), the time of the
/// line that it replaces.
pub fn line(job_id: &str, outcome: &Outcome, retried: bool, after: u64) -> Vec<u8> {
    let body = serde_json::to_vec(outcome).expect("rows are plain data");
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_millis() as u64);
    let mut header = Header {
        job_id: job_id.to_owned(),
        status: outcome.job.status,
        solver: SOLVER.to_owned(),
        retried,
        time_ms: now.max(after.saturating_add(1)),
        length: body.len(),
        check: String::new(),
    };
    header.check = hash(&[&header.text(), &body]);
    let mut line = header.text();
    line.extend_from_slice(&body);
    line.extend_from_slice(b"}\n");
    line
}

const BUSY: &str = "another run is using this folder; wait for it to end, or choose another --out";

fn hash(parts: &[&[u8]]) -> String {
    let mut hasher = blake3::Hasher::new();
    parts.iter().for_each(|part| {
        hasher.update(part);
    });
    hasher.finalize().to_hex()[..16].to_owned()
}

/// The beginning of every line.
const BEGIN: &[u8] = b"{\"job_id\":\"";

/// Length of the longest header, bytes.
const MAX_HEADER: usize = 1024;

/// The header at the beginning of a line, and where the outcome begins in it.
fn parse(line: &[u8]) -> Option<(Header, usize)> {
    let split = line.windows(OUTCOME.len()).take(MAX_HEADER).position(|window| window == OUTCOME)?;
    let mut head = line[..split].to_vec();
    head.push(b'}');
    Some((serde_json::from_slice(&head).ok()?, split + OUTCOME.len()))
}

/// The header of the line that begins at `offset`, and where its outcome begins; `None` if the line is incomplete or
/// damaged.
fn line_at(file: &mut File, offset: u64, size: u64) -> std::io::Result<Option<(Header, u64)>> {
    let mut begin = vec![0; MAX_HEADER.min((size - offset) as usize)];
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(&mut begin)?;
    let Some((header, start)) = parse(&begin) else { return Ok(None) };
    let body = offset + start as u64;
    if header.length as u64 > size.saturating_sub(body + 2) {
        return Ok(None);
    }
    let mut rest = vec![0; header.length + 2];
    file.seek(SeekFrom::Start(body))?;
    if let Err(error) = file.read_exact(&mut rest) {
        // The file was truncated in the meantime.
        return if error.kind() == ErrorKind::UnexpectedEof { Ok(None) } else { Err(error) };
    }
    Ok((rest.ends_with(b"}\n") && header.is_of(&rest[..header.length])).then_some((header, body)))
}

/// Where the line at `offset` ends, just after its `\n`; `None` if it has none.
fn end_of_line(file: &mut File, offset: u64) -> std::io::Result<Option<u64>> {
    file.seek(SeekFrom::Start(offset))?;
    let mut line = Vec::new();
    BufReader::new(file).read_until(b'\n', &mut line)?;
    Ok(line.ends_with(b"\n").then(|| offset + line.len() as u64))
}

impl Store {
    /// Reads the finished jobs of a folder, and writes nothing.
    pub fn read(folder: &Path) -> Result<Self> {
        Self::read_all(&Self::paths(folder)?)
    }

    /// Opens the store for writing, by this process only.
    ///
    /// # Errors
    /// If another run is using this folder. (Shards share it, each with its own file.)
    ///
    /// With `discard` existing results are removed, after it has made sure that nothing else speaks of them.
    pub fn open(folder: &Path, shard: Option<Shard>, discard: Option<&dyn Fn() -> Result<()>>) -> Result<Self> {
        let fresh = discard.is_some();
        let (own, mut file) = Self::own(folder, shard)?;
        let paths = Self::paths(folder)?;
        if fresh {
            let others: Vec<&PathBuf> = paths.iter().filter(|path| **path != own).collect();
            if let Some(held) = others.iter().find(|path| is_locked(path)) {
                return Err(Error::io("remove", held, std::io::Error::other(BUSY)));
            }
            discard.map_or(Ok(()), |discard| discard())?;
            for path in others {
                std::fs::remove_file(path).map_err(|e| Error::io("remove", path, e))?;
            }
            file.set_len(0).map_err(|e| Error::io("empty", &own, e))?;
        }
        let others: Vec<PathBuf> = paths.into_iter().filter(|path| !fresh && *path != own).collect();
        let mut store = Self::read_all(&others)?;
        let end = store.scan(own.clone(), &mut file)?;
        // An incomplete last line would corrupt the next one.
        file.set_len(end).map_err(|e| Error::io("repair", &own, e))?;
        store.own = Some(OwnFile { place: store.files.len() - 1, file, end });
        if store.damaged > 0 {
            let (count, folder) = (store.damaged, folder.display());
            note(&format!("note: {} in {folder}: their jobs run again", counted(count, "damaged line")));
        }
        Ok(store)
    }

    fn read_all(paths: &[PathBuf]) -> Result<Self> {
        let mut store = Self::default();
        for path in paths {
            let mut file = File::open(path).map_err(|e| Error::io("open", path, e))?;
            store.scan(path.clone(), &mut file)?;
        }
        Ok(store)
    }

    /// Whether a file looks like one written by a run: it is empty, or begins with a line, complete or not.
    pub fn is_own(path: &Path) -> bool {
        let mut begin = Vec::new();
        let read = File::open(path).and_then(|file| file.take(BEGIN.len() as u64).read_to_end(&mut begin));
        read.is_ok() && BEGIN.starts_with(&begin)
    }

    /// The files of finished jobs in a folder, sorted by name.
    pub fn paths(folder: &Path) -> Result<Vec<PathBuf>> {
        let entries = std::fs::read_dir(folder).map_err(|e| Error::io("read", folder, e))?;
        let mut paths: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(is_name))
            .collect();
        paths.sort();
        Ok(paths)
    }

    /// The locked file of this process. A shard takes a new file if another process (perhaps of a lost node) still
    /// holds its own.
    fn own(folder: &Path, shard: Option<Shard>) -> Result<(PathBuf, File)> {
        for attempt in 1.. {
            let name = match shard {
                None => "finished.jsonl".to_owned(),
                Some(shard) if attempt == 1 => format!("finished.{}-of-{}.jsonl", shard.index, shard.count),
                Some(shard) => format!("finished.{}-of-{}.{attempt}.jsonl", shard.index, shard.count),
            };
            let path = folder.join(name);
            let file = OpenOptions::new()
                .create(true)
                .read(true)
                .write(true)
                .truncate(false)
                .open(&path)
                .map_err(|e| Error::io("open", &path, e))?;
            match file.try_lock() {
                Ok(()) => return Ok((path.clone(), unshared(&path, file).map_err(|e| Error::io("copy", &path, e))?)),
                Err(TryLockError::WouldBlock) if shard.is_none() => {
                    return Err(Error::io("open", &path, std::io::Error::other(BUSY)));
                }
                Err(TryLockError::WouldBlock) => {}
                // Some network file systems do not support locks: use a file name that nobody else would choose.
                Err(TryLockError::Error(_)) => {
                    let part = shard.map_or("all".to_owned(), |shard| format!("{}-of-{}", shard.index, shard.count));
                    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_nanos());
                    let path = folder.join(format!("finished.{part}.{}-{now}.jsonl", std::process::id()));
                    let file = OpenOptions::new().create_new(true).read(true).write(true).open(&path);
                    return file.map(|file| (path.clone(), file)).map_err(|e| Error::io("create", &path, e));
                }
            }
        }
        unreachable!("some attempt gets its lock")
    }

    /// Whether any run has started to store results in the folder.
    pub fn has_files(&self) -> bool {
        !self.files.is_empty()
    }

    /// Whether some process is writing to the folder.
    pub fn is_in_use(folder: &Path) -> bool {
        Self::paths(folder).is_ok_and(|paths| paths.iter().any(|path| is_locked(path)))
    }

    /// Reads all lines of a file. Returns where the last complete one ends.
    fn scan(&mut self, path: PathBuf, file: &mut File) -> Result<u64> {
        let failed = |e| Error::io("read", &path, e);
        let size = file.metadata().map_err(failed)?.len();
        let place = self.files.len();
        let mut end = 0;
        while end < size {
            match line_at(file, end, size).map_err(failed)? {
                Some((header, offset)) => {
                    end = offset + header.length as u64 + 2;
                    self.insert(StoredJob { header, file: place, offset });
                }
                None => {
                    self.damaged += 1;
                    match end_of_line(file, end).map_err(failed)? {
                        Some(next) => end = next,
                        None => break,
                    }
                }
            }
        }
        self.files.push(path);
        Ok(end)
    }

    fn insert(&mut self, entry: StoredJob) {
        let known = self.entries.get(&entry.header.job_id);
        // Within a file, the lines are in chronological order.
        let later = |known: &StoredJob| known.file == entry.file || known.header.time_ms <= entry.header.time_ms;
        if known.is_none_or(later) {
            self.entries.insert(entry.header.job_id.clone(), entry);
        }
    }

    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    pub fn get(&self, job_id: &str) -> Option<&Header> {
        self.entries.get(job_id).map(|entry| &entry.header)
    }

    /// The outcome of a finished job.
    pub fn outcome(&mut self, job_id: &str) -> Result<Option<Outcome>> {
        let Some(entry) = self.entries.get(job_id) else { return Ok(None) };
        let path = &self.files[entry.file];
        let failed = |e| Error::io("read", path, e);
        let file = match &mut self.reading {
            Some((place, file)) if *place == entry.file => file,
            other => &mut other.insert((entry.file, File::open(path).map_err(failed)?)).1,
        };
        let mut body = vec![0; entry.header.length];
        file.seek(SeekFrom::Start(entry.offset)).and_then(|_| file.read_exact(&mut body)).map_err(failed)?;
        let damaged = |e: String| failed(std::io::Error::other(format!("job {job_id}: {e}")));
        if !entry.header.is_of(&body) {
            return Err(damaged("its line was changed on disk; run the study again to recompute it".to_owned()));
        }
        serde_json::from_slice(&body).map(Some).map_err(|e| damaged(e.to_string()))
    }

    /// Writes the lines of finished jobs and syncs them to disk. If that fails, writes them one by one, as far as
    /// possible.
    pub fn add(&mut self, lines: &[Vec<u8>]) -> Result<()> {
        match self.append(lines) {
            Err(_) if lines.len() > 1 => lines.chunks(1).try_for_each(|line| self.append(line)),
            result => result,
        }
    }

    /// Writes all of the lines, or none.
    fn append(&mut self, lines: &[Vec<u8>]) -> Result<()> {
        let OwnFile { place, file, end } = self.own.as_mut().expect("the store is open for writing");
        let (place, mut offset) = (*place, *end);
        let written = file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| file.write_all(&lines.concat()))
            .and_then(|()| file.sync_data());
        if let Err(error) = written {
            let _ = file.set_len(offset); // leave no partial line
            return Err(Error::io("write", &self.files[place], error));
        }
        *end += lines.iter().map(|line| line.len() as u64).sum::<u64>();
        for line in lines {
            let (header, start) = parse(line).expect("a line made by `line`");
            let entry = StoredJob { header, file: place, offset: offset + start as u64 };
            self.entries.insert(entry.header.job_id.clone(), entry);
            offset += line.len() as u64;
        }
        Ok(())
    }
}

/// Whether a name is `finished.jsonl`, `finished.I-of-N….jsonl`, or `finished.all….jsonl` (where locks are not
/// supported).
fn is_name(name: &str) -> bool {
    let Some(inner) = name.strip_prefix("finished.").and_then(|name| name.strip_suffix("jsonl")) else { return false };
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit() || b == b'-');
    let mut parts = inner.trim_end_matches('.').split('.');
    let is_shard = |part: &str| part.split_once("-of-").is_some_and(|(i, n)| is_number(i) && is_number(n));
    let first = parts.next().unwrap_or_default();
    (first.is_empty() || first == "all" || is_shard(first)) && parts.all(is_number)
}

/// The file itself if `path` is its only name. If it has others, as in a backup by hard links, a copy replaces it here.
fn unshared(path: &Path, mut file: File) -> std::io::Result<File> {
    if file.metadata()?.nlink() < 2 {
        return Ok(file);
    }
    let partial = partial(path);
    let mut copy = OpenOptions::new().create_new(true).read(true).write(true).open(&partial)?;
    copy.lock()?;
    std::io::copy(&mut file, &mut copy)?;
    copy.sync_all()?;
    std::fs::rename(&partial, path)?;
    Ok(copy)
}

/// Whether another process has locked a file of finished jobs, to write to it.
fn is_locked(path: &Path) -> bool {
    std::fs::File::open(path).is_ok_and(|file| matches!(file.try_lock_shared(), Err(std::fs::TryLockError::WouldBlock)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(reason: &str) -> Outcome {
        Outcome::failed(Status::Stalled, reason)
    }

    #[test]
    fn lines_come_back_whatever_happens_to_the_last() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path(), None, None).unwrap();
        store.add(&[line("a", &outcome("one"), false, 0), line("b", &outcome("two"), false, 0)]).unwrap();
        store.add(&[line("a", &outcome("three"), true, 0)]).unwrap();
        assert_eq!(store.outcome("a").unwrap(), Some(outcome("three")));
        drop(store);
        let path = folder.path().join("finished.jsonl");
        let whole = std::fs::read(&path).unwrap();
        let ends: Vec<usize> = (0..whole.len()).filter(|&i| whole[i] == b'\n').map(|i| i + 1).collect();
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let mut store = Store::open(folder.path(), None, None).unwrap();
            let kept = ends.iter().filter(|&&end| end <= cut).count();
            let expected = ["", "one", "one", "three"][kept];
            assert_eq!(store.outcome("a").unwrap().and_then(|o| o.job.error).unwrap_or_default(), expected);
            assert_eq!(store.outcome("b").unwrap().is_some(), kept >= 2);
            store.add(&[line("c", &outcome("new"), false, 0)]).unwrap();
            drop(store);
            let mut store = Store::read(folder.path()).unwrap();
            assert_eq!((store.damaged, store.outcome("c").unwrap()), (0, Some(outcome("new"))));
        }
    }

    #[test]
    fn a_changed_byte_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("finished.jsonl");
        let whole = line("a", &outcome("one"), false, 0);
        let header = parse(&whole).unwrap().0;
        for i in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[i] ^= 1;
            std::fs::write(&path, &bytes).unwrap();
            let mut store = Store::read(folder.path()).unwrap();
            // If the outcome can still be read, it and its header are as written.
            if let Some(found) = store.outcome("a").unwrap() {
                assert_eq!(found, outcome("one"), "byte {i}");
                assert_eq!(store.get("a").unwrap(), &header, "byte {i}");
            }
        }
    }

    #[test]
    fn a_later_line_counts_whatever_the_clocks_say() {
        let folder = tempfile::tempdir().unwrap();
        let shard = |index| Some(Shard { index, count: 2 });
        let mut ahead = Store::open(folder.path(), shard(0), None).unwrap();
        ahead.add(&[line("a", &outcome("one"), false, u64::MAX / 2)]).unwrap(); // a clock far ahead
        let after = ahead.get("a").unwrap().time_ms;
        drop(ahead);
        let mut store = Store::open(folder.path(), None, None).unwrap();
        store.add(&[line("a", &outcome("two"), true, after)]).unwrap();
        drop(store);
        assert_eq!(Store::read(folder.path()).unwrap().outcome("a").unwrap(), Some(outcome("two")));
    }

    #[test]
    fn shards_write_side_by_side_and_a_held_file_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let shard = |index| Some(Shard { index, count: 2 });
        let mut one = Store::open(folder.path(), shard(0), None).unwrap();
        let mut two = Store::open(folder.path(), shard(1), None).unwrap();
        let mut again = Store::open(folder.path(), shard(0), None).unwrap();
        one.add(&[line("a", &outcome("one"), false, 0)]).unwrap();
        two.add(&[line("b", &outcome("two"), false, 0)]).unwrap();
        again.add(&[line("c", &outcome("three"), false, 0)]).unwrap();
        let store = Store::read(folder.path()).unwrap();
        assert!(["a", "b", "c"].iter().all(|id| store.get(id).is_some()));
        assert!(Store::is_in_use(folder.path()));
        assert!(Store::open(folder.path(), None, Some(&|| Ok(()))).is_err(), "files in use are not discarded");
        drop((one, two, again));
        assert!(!Store::is_in_use(folder.path()));
    }
}
