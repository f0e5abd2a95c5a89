//! A table as comma-separated values, with its metadata beside it as JSON.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::table::{Head, Value};
use super::{ExportError, Sources, Table};

/// Writes `FILE` and, at the end, `FILE.metadata.json`.
pub struct CsvTable {
    writer: ::csv::Writer<File>,
    heads: Vec<Head>,
    metadata: PathBuf,
}

impl CsvTable {
    /// Begins a file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn new(path: &Path, heads: Vec<Head>) -> Result<Self, ExportError> {
        let file = File::create(path).map_err(|source| ExportError::Io {
            file: path.display().to_string(),
            source,
        })?;
        let mut writer = ::csv::Writer::from_writer(file);
        writer.write_record(heads.iter().map(|head| head.name))?;
        let mut metadata = path.as_os_str().to_owned();
        metadata.push(".metadata.json");
        Ok(Self {
            writer,
            heads,
            metadata: metadata.into(),
        })
    }
}

impl Table for CsvTable {
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError> {
        let cells = row.into_iter().map(|value| match value {
            Value::Time(n) | Value::Count(n) => n.to_string(),
            Value::Signed(n) => n.to_string(),
            Value::Text(text) => text,
            Value::Flag(flag) => flag.to_string(),
            Value::Number(number) => number.map_or_else(String::new, |number| number.to_string()),
        });
        Ok(self.writer.write_record(cells)?)
    }

    fn finish(mut self: Box<Self>, sources: &Sources) -> Result<(), ExportError> {
        let io = |source| ExportError::Io {
            file: self.metadata.display().to_string(),
            source,
        };
        self.writer.flush().map_err(io)?;
        let metadata = serde_json::json!({ "units": units(&self.heads), "sources": sources });
        std::fs::write(&self.metadata, serde_json::to_string_pretty(&metadata)? + "\n").map_err(io)
    }
}

/// The unit of each column that has one.
pub(super) fn units(heads: &[Head]) -> serde_json::Map<String, serde_json::Value> {
    let with_unit = heads.iter().filter(|head| !head.unit.is_empty());
    with_unit.map(|head| (head.name.to_owned(), head.unit.into())).collect()
}
