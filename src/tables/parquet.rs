//! Tables to and from Parquet. The only file that knows polars.

use std::fs::File;
use std::path::Path;

use polars::prelude::{
    Column, DataFrame, DataType, KeyValueMetadata, NamedFrom, ParquetCompression, ParquetReader, ParquetWriter,
    SerReader, Series,
};

use super::{Table, Values};
use crate::error::{Error, Result};

/// Writes a table as one Parquet file (zstd), with `metadata` as the file's key–value metadata. The file appears whole
/// or not at all.
pub fn write(table: &Table, path: &Path, metadata: &[(String, String)]) -> Result<()> {
    let columns: Vec<Column> = table
        .columns
        .iter()
        .map(|(name, values)| {
            let name = name.as_str().into();
            match values {
                Values::Number(v) => {
                    Series::new(name, v.iter().map(|x| x.filter(|x| x.is_finite())).collect::<Vec<_>>())
                }
                Values::Integer(v) => Series::new(name, v),
                Values::Flag(v) => Series::new(name, v),
                Values::Text(v) => Series::new(name, v),
            }
            .into()
        })
        .collect();
    let mut frame = DataFrame::new_infer_height(columns).map_err(|e| Error::table("build", path, e))?;
    let partial = path.with_extension("parquet.part");
    let file = File::create(&partial).map_err(|e| Error::io("create", &partial, e))?;
    ParquetWriter::new(&file)
        .with_compression(ParquetCompression::Zstd(None))
        .with_key_value_metadata(Some(KeyValueMetadata::from_static(metadata.to_vec())))
        .finish(&mut frame)
        .map_err(|e| Error::table("write", path, e))?;
    file.sync_all().map_err(|e| Error::io("write", &partial, e))?;
    std::fs::rename(&partial, path).map_err(|e| Error::io("write", path, e))
}

/// Reads a table back.
pub fn read(name: &'static str, path: &Path) -> Result<Table> {
    let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
    let frame = ParquetReader::new(file).finish().map_err(|e| Error::table("read", path, e))?;
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
