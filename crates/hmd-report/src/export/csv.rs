//! A table as comma-separated values, with its metadata beside it as JSON.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::table::{Head, Value};
use super::{ExportError, Sources, Table};
use hmd_storage::output_file::{self, OutputFile};
use hmd_storage::{no_formula, number_cell};

/// Writes `FILE` and, at the end, `FILE.metadata.json`.
pub struct CsvTable {
    writer: ::csv::Writer<File>,
    output: OutputFile,
    heads: Vec<Head>,
    path: PathBuf,
}

impl CsvTable {
    /// Begins a file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn new(path: &Path, heads: Vec<Head>) -> Result<Self, ExportError> {
        let output = OutputFile::create(path).map_err(|source| failed(path, source))?;
        let file = output.handle().map_err(|source| failed(path, source))?;
        let mut writer = ::csv::Writer::from_writer(file);
        let head = writer.write_record(heads.iter().map(|head| head.name));
        head.map_err(|source| failed(path, source.into()))?;
        Ok(Self {
            writer,
            output,
            heads,
            path: path.to_owned(),
        })
    }
}

impl Table for CsvTable {
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError> {
        let cells = row.into_iter().map(|value| match value {
            Value::Time(n) | Value::Count(n) => n.to_string(),
            Value::Signed(n) => n.to_string(),
            Value::Text(text) => no_formula(&text).into_owned(),
            Value::Flag(flag) => flag.map_or_else(String::new, |flag| flag.to_string()),
            Value::Number(number) => number.map_or_else(String::new, number_cell),
        });
        let written = self.writer.write_record(cells);
        written.map_err(|source| failed(&self.path, source.into()))
    }

    fn finish(mut self: Box<Self>, sources: &Sources) -> Result<(), ExportError> {
        self.writer.flush().map_err(|source| failed(&self.path, source))?;
        let beside = metadata_path(&self.path);
        let metadata = serde_json::json!({ "units": units(&self.heads), "sources": sources });
        let text = serde_json::to_string_pretty(&metadata)? + "\n";
        output_file::write(&beside, text).map_err(|source| failed(&beside, source))?;
        self.output.put_in_place().map_err(|source| failed(&self.path, source))
    }
}

/// `FILE.metadata.json` beside `FILE`.
#[must_use]
pub fn metadata_path(table: &Path) -> PathBuf {
    let mut beside = table.as_os_str().to_owned();
    beside.push(".metadata.json");
    PathBuf::from(beside)
}

fn failed(path: &Path, source: io::Error) -> ExportError {
    ExportError::Io {
        file: path.display().to_string(),
        source,
    }
}

/// The unit of each column that has one.
pub(super) fn units(heads: &[Head]) -> serde_json::Map<String, serde_json::Value> {
    let with_unit = heads.iter().filter(|head| !head.unit.is_empty());
    with_unit.map(|head| (head.name.to_owned(), head.unit.into())).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{ParquetTable, TableKind};
    use super::*;

    #[test]
    fn a_full_disk_is_reported_with_the_name_of_the_table() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["out.csv", "out.parquet"] {
            let path = folder.path().join(name);
            std::os::unix::fs::symlink("/dev/full", &path).unwrap();
            let heads = TableKind::Health.heads();
            let table: Result<Box<dyn Table>, _> = match name {
                "out.csv" => CsvTable::new(&path, heads).map(|table| Box::new(table) as _),
                _ => ParquetTable::new(&path, heads).map(|table| Box::new(table) as _),
            };
            let error = table
                .and_then(|table| table.finish(&Sources::new()))
                .unwrap_err()
                .to_string();
            let place = format!("{}: ", path.display());
            assert!(error.starts_with(&place), "{error}");
        }
    }
}
