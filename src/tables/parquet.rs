//! Tables to and from Parquet. The only file that knows polars.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use polars::prelude::{
    BatchedWriter, Column, DataFrame, DataType, KeyValueMetadata, NamedFrom, ParquetCompression, ParquetReader,
    ParquetWriter, SerReader, Series,
};

use super::{Table, Values};
use crate::error::{Error, Result};

/// A Parquet file (zstd) in the making, table after table of one kind; it appears whole or not at all.
pub struct Writer {
    path: PathBuf,
    partial: PathBuf,
    metadata: Vec<(String, String)>,
    /// The file begins with the first table, which has the columns.
    file: Option<(File, BatchedWriter<BufWriter<File>>)>,
    rows: usize,
}

impl Writer {
    /// `metadata` become the file's key–value metadata.
    pub fn new(path: &Path, metadata: Vec<(String, String)>) -> Self {
        Self {
            path: path.to_owned(),
            partial: path.with_extension(format!("parquet.{}.part", std::process::id())),
            metadata,
            file: None,
            rows: 0,
        }
    }

    /// Adds the rows of a table.
    pub fn append(&mut self, table: &Table) -> Result<()> {
        let columns: Vec<Column> = table.columns.iter().map(|(name, values)| column(name, values)).collect();
        let frame = DataFrame::new_infer_height(columns).map_err(|e| Error::table("build", &self.path, e))?;
        if self.file.is_none() {
            let file = File::create(&self.partial).map_err(|e| Error::io("create", &self.partial, e))?;
            let handle = file.try_clone().map_err(|e| Error::io("create", &self.partial, e))?;
            let writer = ParquetWriter::new(BufWriter::new(file))
                .with_compression(ParquetCompression::Zstd(None))
                .with_key_value_metadata(Some(KeyValueMetadata::from_static(self.metadata.clone())))
                .batched(frame.schema())
                .map_err(|e| Error::table("write", &self.path, e))?;
            self.file = Some((handle, writer));
        }
        let (_, writer) = self.file.as_mut().expect("made above");
        self.rows += table.rows();
        writer.write_batch(&frame).map_err(|e| Error::table("write", &self.path, e))
    }

    /// Ends the file and puts it in its place. Returns its number of rows.
    pub fn finish(self) -> Result<usize> {
        if let Some((file, writer)) = self.file {
            let length = writer.finish().map_err(|e| Error::table("write", &self.path, e))?;
            // What the buffer still holds is written now, errors lost: the length tells.
            drop(writer);
            let is_whole = |file: File| match file.metadata()?.len() {
                written if written == length => file.sync_all(),
                written => Err(io::Error::other(format!("{written} of {length} bytes written"))),
            };
            is_whole(file).map_err(|e| Error::io("write", &self.partial, e))?;
            std::fs::rename(&self.partial, &self.path).map_err(|e| Error::io("write", &self.path, e))?;
        }
        Ok(self.rows)
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

/// Reads a table back.
pub fn read(name: &'static str, path: &Path) -> Result<Table> {
    let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
    // A damaged file may make the reader panic: an error like any other.
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
                return Err(Error::table("read", path, format!("column `{}` has the type {other}", column.name())));
            }
        };
        columns.push((column.name().to_string(), values));
    }
    Ok(Table { name, columns })
}
