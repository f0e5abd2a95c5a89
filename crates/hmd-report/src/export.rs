//! Recorded files -> one table, wide by time, as CSV or Parquet, with units in its metadata. Bounded memory, no clock.

mod csv;
mod parquet;
mod raw;
mod table;

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

use prost::Message;

use hmd_core::record::{Health, Record, Rul, Window};
use hmd_ingest::file::{IngestError, open_recorded};
use hmd_storage::mcap::{McapLoss, McapMessages, NoWindows};
use hmd_storage::mcap_writer::METADATA_NAME;

pub use csv::{CsvTable, metadata_path};
pub use parquet::ParquetTable;
pub use raw::{ExportedSamples, export_raw};
pub use table::{Head, Kind, Origin, TableKind, Value, health_row, raw_heads};

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A file that cannot be read or written.
    #[error("{file}: {source}")]
    Io {
        /// The file.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// A record that is not what its schema says.
    #[error("{file}: {source}")]
    Record {
        /// The file.
        file: String,
        /// Why.
        source: prost::DecodeError,
    },
    /// A row that Parquet cannot take.
    #[error("{file}: {source}")]
    Parquet {
        /// The file.
        file: String,
        /// Why.
        source: ::parquet::errors::ParquetError,
    },
    /// A log that cannot be read at all.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// Files that have no row and could not have any: damaged, of another program, frames alone.
    #[error(transparent)]
    NoWindows(NoWindows),
    /// The names of columns as JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// Takes rows.
pub trait Table {
    /// Adds a row, with a value for each column.
    ///
    /// # Errors
    /// What cannot be written.
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError>;

    /// Writes what is left; `sources` are the metadata of the files that were read.
    ///
    /// # Errors
    /// What cannot be written.
    fn finish(self: Box<Self>, sources: &Sources) -> Result<(), ExportError>;
}

/// A table that is begun with its first row or its end, so that a refused export leaves no file, and none that was there is lost.
pub struct Late<F> {
    begin: Option<F>,
    table: Option<Box<dyn Table>>,
}

impl<F: FnOnce() -> Result<Box<dyn Table>, ExportError>> Late<F> {
    /// The table that `begin` will make.
    pub fn new(begin: F) -> Self {
        Self {
            begin: Some(begin),
            table: None,
        }
    }

    fn begin(&mut self) -> Result<(), ExportError> {
        if let Some(begin) = self.begin.take() {
            self.table = Some(begin()?);
        }
        Ok(())
    }
}

impl<F: FnOnce() -> Result<Box<dyn Table>, ExportError>> Table for Late<F> {
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError> {
        self.begin()?;
        self.table.as_mut().map_or(Ok(()), |table| table.row(row))
    }

    fn finish(mut self: Box<Self>, sources: &Sources) -> Result<(), ExportError> {
        self.begin()?;
        self.table.map_or(Ok(()), |table| table.finish(sources))
    }
}

/// Metadata of each file, by its name and then by key; files of equal names go by their paths as given.
pub type Sources = BTreeMap<String, BTreeMap<String, String>>;

/// What came of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// Rows written.
    pub rows: u64,
    /// Parts of a file could not be read and were passed over.
    pub damaged: bool,
}

/// Reads files in the order of time into a table; `tell` gets what is damaged, each with its place. Whole recordings in which no actuation
/// was recorded make a table without rows.
///
/// # Errors
/// A file that cannot be read, a record that is none, a row that cannot be written; no row for another reason than that.
pub fn export<P: AsRef<Path>>(
    paths: &[P],
    kind: TableKind,
    mut table: Box<dyn Table>,
    tell: &mut dyn FnMut(&McapLoss),
) -> Result<Exported, ExportError> {
    let (mut exported, mut sources) = (Exported::default(), Sources::new());
    let mut nothing = NoWindows::default();
    for (path, file) in paths.iter().zip(distinct_names(paths)) {
        let name = path.as_ref().display().to_string();
        let io = |source| ExportError::Io {
            file: name.clone(),
            source,
        };
        let record = |source| ExportError::Record {
            file: name.clone(),
            source,
        };
        let reader = BufReader::new(open_recorded(path.as_ref()).map_err(io)?);
        let mut messages = McapMessages::of_recording(reader, &name).map_err(io)?;
        // The health of each actuator's newest window, until its remaining life comes.
        let mut waiting: BTreeMap<String, Health> = BTreeMap::new();
        while let Some(message) = messages.next() {
            let message = match message {
                Ok(message) => message,
                Err(loss) => {
                    tell(&loss);
                    exported.damaged = true;
                    continue;
                }
            };
            let data = message.data.as_slice();
            let origin = |actuator: &str| Origin {
                serial_number: messages.serial_number(actuator).unwrap_or_default(),
                file: &file,
            };
            let rows = match (kind, &*message.schema) {
                (TableKind::Health, Health::SCHEMA_NAME) => {
                    let health = Health::decode(data).map_err(record)?;
                    waiting.insert(health.actuator.clone(), health);
                    Vec::new()
                }
                (TableKind::Health, Rul::SCHEMA_NAME) => {
                    let rul = Rul::decode(data).map_err(record)?;
                    let health = waiting
                        .remove(&rul.actuator)
                        .filter(|health| health.window == rul.window);
                    health
                        .map(|health| table::health_row(&health, &rul, origin(&rul.actuator)))
                        .into_iter()
                        .collect()
                }
                (TableKind::Samples, Window::SCHEMA_NAME) => {
                    let window = Window::decode(data).map_err(record)?;
                    table::sample_rows(&window, origin(&window.actuator))
                }
                _ => Vec::new(),
            };
            for row in rows {
                table.row(row)?;
                exported.rows += 1;
            }
        }
        let metadata = messages.verified_metadata(METADATA_NAME).unwrap_or_else(|loss| {
            tell(&loss);
            exported.damaged = true;
            None
        });
        sources.insert(file, metadata.cloned().unwrap_or_default());
        nothing.note(&messages);
    }
    if exported.rows == 0 && !nothing.is_without_actuation() {
        return Err(ExportError::NoWindows(nothing));
    }
    table.finish(&sources)?;
    Ok(exported)
}

/// The name of each file, or its path as given where another file has the same name.
#[must_use]
pub fn distinct_names<P: AsRef<Path>>(paths: &[P]) -> Vec<String> {
    let name = |path: &P| path.as_ref().file_name().unwrap_or_default().to_owned();
    let mut counts = BTreeMap::new();
    for path in paths {
        *counts.entry(name(path)).or_insert(0) += 1;
    }
    let distinct = |path: &P| match counts.get(&name(path)) {
        Some(1) => name(path).to_string_lossy().into_owned(),
        _ => path.as_ref().display().to_string(),
    };
    paths.iter().map(distinct).collect()
}

#[cfg(test)]
mod tests {
    use super::distinct_names;

    #[test]
    fn files_of_equal_names_go_by_their_paths() {
        let names = distinct_names(&["a/x.mcap", "b/x.mcap", "b/y.mcap"]);
        assert_eq!(names, ["a/x.mcap", "b/x.mcap", "y.mcap"]);
    }
}
