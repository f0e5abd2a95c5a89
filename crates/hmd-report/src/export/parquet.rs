//! A table as Parquet: zstd, a row group for every few thousand rows, units and sources in the file's metadata.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;

use super::csv::units;
use super::table::{Head, Kind, Value};
use super::{ExportError, Sources, Table};
use hmd_storage::output_file::OutputFile;

/// Rows held in memory until a row group is written.
const ROWS: usize = 8192;

/// Writes one file.
pub struct ParquetTable {
    /// For messages.
    file: String,
    writer: SerializedFileWriter<File>,
    output: OutputFile,
    heads: Vec<Head>,
    /// Values by column.
    held: Vec<Vec<Value>>,
}

impl ParquetTable {
    /// Begins a file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn new(path: &Path, heads: Vec<Head>) -> Result<Self, ExportError> {
        let name = path.display().to_string();
        let io = |source| ExportError::Io {
            file: name.clone(),
            source,
        };
        let output = OutputFile::create(path).map_err(io)?;
        let file = output.handle().map_err(io)?;
        Self::over(name.clone(), file, output, heads).map_err(|source| ExportError::Parquet { file: name, source })
    }

    fn over(name: String, file: File, output: OutputFile, heads: Vec<Head>) -> Result<Self, ParquetError> {
        let fields = heads
            .iter()
            .map(|head| Ok(Arc::new(field(head)?)))
            .collect::<Result<_, ParquetError>>()?;
        let schema = Type::group_type_builder("hmd").with_fields(fields).build()?;
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(Default::default()))
            .set_created_by(concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned())
            .build();
        Ok(Self {
            file: name,
            writer: SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))?,
            output,
            held: vec![Vec::new(); heads.len()],
            heads,
        })
    }

    fn failed(&self) -> impl Fn(ParquetError) -> ExportError + use<> {
        let file = self.file.clone();
        move |source| ExportError::Parquet {
            file: file.clone(),
            source,
        }
    }

    fn write_group(&mut self) -> Result<(), ParquetError> {
        let mut group = self.writer.next_row_group()?;
        for (head, values) in self.heads.iter().zip(&mut self.held) {
            let Some(mut column) = group.next_column()? else { break };
            write_column(&mut column, head.kind, std::mem::take(values))?;
            column.close()?;
        }
        group.close()?;
        Ok(())
    }
}

impl Table for ParquetTable {
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError> {
        for (column, value) in self.held.iter_mut().zip(row) {
            column.push(value);
        }
        if self.held[0].len() >= ROWS {
            let failed = self.failed();
            self.write_group().map_err(failed)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>, sources: &Sources) -> Result<(), ExportError> {
        let failed = self.failed();
        if !self.held[0].is_empty() {
            self.write_group().map_err(&failed)?;
        }
        for (key, text) in [
            ("units", serde_json::to_string(&units(&self.heads))?),
            ("sources", serde_json::to_string(sources)?),
            ("pandas", serde_json::to_string(&pandas_types(&self.heads))?),
        ] {
            self.writer
                .append_key_value_metadata(KeyValue::new(key.to_owned(), text));
        }
        self.writer.close().map_err(failed)?;
        let Self { file, output, .. } = *self;
        output.put_in_place().map_err(|source| ExportError::Io { file, source })
    }
}

/// What pandas makes of the columns, in the form of its metadata for Parquet: flags are `boolean`, whether or not one is absent. Without it
/// they would be `bool` or, beside an absent one, `object`.
///
/// Source: pandas developer guide, "Storing pandas DataFrame objects in Apache Parquet format".
fn pandas_types(heads: &[Head]) -> serde_json::Value {
    let flags = heads.iter().filter(|head| head.kind == Kind::Flag);
    let flags = flags.map(|Head { name, .. }| {
        serde_json::json!({
            "name": name, "field_name": name, "pandas_type": "bool", "numpy_type": "boolean", "metadata": null
        })
    });
    serde_json::json!({ "index_columns": [], "column_indexes": [], "columns": flags.collect::<Vec<_>>() })
}

fn field(head: &Head) -> Result<Type, ParquetError> {
    let (physical, logical) = match head.kind {
        Kind::Time => (Physical::INT64, Some(LogicalType::timestamp(true, TimeUnit::NANOS))),
        Kind::Count | Kind::Signed => (Physical::INT64, None),
        Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Kind::Flag => (Physical::BOOLEAN, None),
        Kind::Number => (Physical::DOUBLE, None),
    };
    let repetition = if head.kind.may_be_absent() {
        Repetition::OPTIONAL
    } else {
        Repetition::REQUIRED
    };
    Type::primitive_type_builder(head.name, physical)
        .with_logical_type(logical)
        .with_repetition(repetition)
        .build()
}

/// Values of one kind; the heads say of which.
fn write_column(column: &mut SerializedColumnWriter<'_>, kind: Kind, values: Vec<Value>) -> Result<(), ParquetError> {
    match kind {
        Kind::Time | Kind::Count | Kind::Signed => {
            let values: Vec<i64> = values.into_iter().filter_map(integer).collect();
            column.typed::<Int64Type>().write_batch(&values, None, None)?;
        }
        Kind::Text => {
            let text = |value| {
                if let Value::Text(text) = value {
                    Some(ByteArray::from(text.into_bytes()))
                } else {
                    None
                }
            };
            let values: Vec<ByteArray> = values.into_iter().filter_map(text).collect();
            column.typed::<ByteArrayType>().write_batch(&values, None, None)?;
        }
        Kind::Flag => {
            let flag = |value: &Value| {
                if let Value::Flag(flag) = value { *flag } else { None }
            };
            let present: Vec<i16> = values.iter().map(|value| i16::from(flag(value).is_some())).collect();
            let values: Vec<bool> = values.iter().filter_map(flag).collect();
            column.typed::<BoolType>().write_batch(&values, Some(&present), None)?;
        }
        Kind::Number => {
            let number = |value: &Value| {
                if let Value::Number(number) = value {
                    *number
                } else {
                    None
                }
            };
            let present: Vec<i16> = values.iter().map(|value| i16::from(number(value).is_some())).collect();
            let values: Vec<f64> = values.iter().filter_map(number).collect();
            column
                .typed::<DoubleType>()
                .write_batch(&values, Some(&present), None)?;
        }
    }
    Ok(())
}

/// Times and counts stay below 2^63 for as long as stamps do: until the year 2262.
fn integer(value: Value) -> Option<i64> {
    match value {
        Value::Time(n) | Value::Count(n) => Some(i64::try_from(n).unwrap_or(i64::MAX)),
        Value::Signed(n) => Some(n),
        _ => None,
    }
}
