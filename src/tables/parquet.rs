//! Writes tables to Parquet and reads them back. The only file that uses polars.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use polars::prelude::{
    BatchedWriter, Column, CompatLevel, DataFrame, DataType, KeyValueMetadata, NamedFrom, ParquetCompression,
    ParquetReader, ParquetWriter, SchemaExt, SerReader, Series,
};
use polars_parquet::read::read_metadata;
use polars_parquet::write::schema_to_metadata_key;

use super::{Table, Values};
use crate::error::{Error, Result};
use crate::files::partial;

/// Key of the metadata that names the study of a table.
pub const STUDY: &str = "sinew.study";

/// A file that remembers its first write error, which polars does not always report.
struct Output {
    file: File,
    failure: Arc<OnceLock<io::ErrorKind>>,
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes).inspect_err(|e| {
            if e.kind() != io::ErrorKind::Interrupted {
                let _ = self.failure.set(e.kind());
            }
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Writes a Parquet file (zstd) from several tables with the same columns. The file appears whole or not at all.
pub struct Writer {
    path: PathBuf,
    partial: PathBuf,
    metadata: Vec<(String, String)>,
    /// Created with the first table, since that has the columns.
    file: Option<(File, BatchedWriter<BufWriter<Output>>)>,
    failure: Arc<OnceLock<io::ErrorKind>>,
    rows: usize,
}

impl Writer {
    /// `metadata` becomes the file's key–value metadata.
    pub fn new(path: &Path, metadata: Vec<(String, String)>) -> Self {
        Self { path: path.to_owned(), partial: partial(path), metadata, file: None, failure: Arc::default(), rows: 0 }
    }

    /// Adds the rows of a table.
    pub fn append(&mut self, table: &Table) -> Result<()> {
        let columns: Vec<Column> = table.columns.iter().map(|(name, values)| column(name, values)).collect();
        let frame = DataFrame::new_infer_height(columns).map_err(|e| Error::table("build", &self.path, e))?;
        if self.file.is_none() {
            let file = File::create(&self.partial).map_err(|e| Error::io("create", &self.partial, e))?;
            let handle = file.try_clone().map_err(|e| Error::io("create", &self.partial, e))?;
            let writer = ParquetWriter::new(BufWriter::new(Output { file, failure: self.failure.clone() }))
                .with_compression(ParquetCompression::Zstd(None))
                .with_key_value_metadata(Some(KeyValueMetadata::from_static(self.metadata_of(&frame))))
                .batched(frame.schema())
                .map_err(|e| Error::table("write", &self.path, e))?;
            self.file = Some((handle, writer));
        }
        let (_, writer) = self.file.as_mut().expect("made above");
        self.rows += table.rows();
        writer.write_batch(&frame).map_err(|e| self.failed(e))
    }

    /// The file's metadata, with a schema in which text is plain UTF-8. By default polars declares string views: older
    /// readers cannot open such files, and newer ones cannot filter, sort or join them.
    fn metadata_of(&self, frame: &DataFrame) -> Vec<(String, String)> {
        let plain = schema_to_metadata_key(&frame.schema().to_arrow(CompatLevel::oldest()));
        let schema = plain.value.map(|value| (plain.key.to_string(), value.to_string()));
        self.metadata.iter().cloned().chain(schema).collect()
    }

    /// Completes the file and moves it into place. Returns its number of rows.
    pub fn finish(mut self) -> Result<usize> {
        if let Some((file, writer)) = self.file.take() {
            writer.finish().map_err(|e| self.failed(e))?;
            // Dropping it writes the rest of the buffer.
            drop(writer);
            if self.failure.get().is_some() {
                return Err(self.failed("the last part is missing"));
            }
            file.sync_all().map_err(|e| Error::io("write", &self.partial, e))?;
            std::fs::rename(&self.partial, &self.path).map_err(|e| Error::io("write", &self.path, e))?;
        }
        Ok(self.rows)
    }

    /// The error of a failed write: the one that the file remembers, or else that of polars.
    fn failed(&self, says: impl std::fmt::Display) -> Error {
        match self.failure.get() {
            Some(kind) => Error::io("write", &self.path, (*kind).into()),
            None => Error::table("write", &self.path, says),
        }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // After `finish`, there is no partial file any more.
        let _ = std::fs::remove_file(&self.partial);
    }
}

fn column(name: &str, values: &Values) -> Column {
    let name = name.into();
    match values {
        Values::Number(v) => Series::new(name, v.iter().map(|x| x.filter(|x| x.is_finite())).collect::<Vec<_>>()),
        Values::Integer(v) => Series::new(name, v),
        Values::Flag(v) => Series::new(name, v),
        Values::Text(v) => Series::new(name, v),
    }
    .into()
}

/// Whether a file is a table of a study: if so, its metadata name the study.
pub fn is_of_study(path: &Path) -> bool {
    let metadata = || {
        let mut file = File::open(path).ok()?;
        // As in `read`, a damaged file may make the reader panic.
        let read = || read_metadata(&mut file).ok();
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).ok()?
    };
    let pairs = metadata().and_then(|metadata| metadata.key_value_metadata().clone()).unwrap_or_default();
    pairs.iter().any(|pair| pair.key == STUDY)
}

/// Reads a table back.
pub fn read(name: &'static str, path: &Path) -> Result<Table> {
    let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
    // A damaged file may make the reader panic; that becomes an ordinary error.
    let frame = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| ParquetReader::new(file).finish()))
        .unwrap_or_else(|_| Err(polars::prelude::PolarsError::ComputeError("the file is damaged".into())))
        .map_err(|e| Error::table("read", path, e))?;
    let bad = |e: polars::prelude::PolarsError| Error::table("read", path, e);
    let mut columns = Vec::new();
    for column in frame.columns() {
        let series = column.as_materialized_series();
        let values = match series.dtype() {
            DataType::Float64 => Values::Number(series.f64().map_err(bad)?.iter().collect()),
            DataType::Int64 => Values::Integer(series.i64().map_err(bad)?.iter().collect()),
            DataType::Boolean => Values::Flag(series.bool().map_err(bad)?.iter().collect()),
            DataType::String => Values::Text(series.str().map_err(bad)?.iter().map(|t| t.map(str::to_owned)).collect()),
            other => {
                return Err(Error::table(
                    "read",
                    path,
                    format!("column `{}` has the unsupported type {other}", column.name()),
                ));
            }
        };
        columns.push((column.name().to_string(), values));
    }
    Ok(Table { name, columns })
}
