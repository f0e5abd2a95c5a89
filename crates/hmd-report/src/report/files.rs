//! Recorded files -> what they say of each actuator, of themselves, and events.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

use prost::Message;

use super::history::{History, Replacement, hours_of_all};
use super::units::{Part, by_unit};
use hmd_core::history::{Event, EventKind, Events};
use hmd_core::record::{Health, Log, Record, Rul, Sensors, Status, Window};
use hmd_ingest::file::open_recorded;
use hmd_storage::mcap::{McapLoss, McapMessages};
use hmd_storage::mcap_writer::METADATA_NAME;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file that cannot be read.
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
    /// Files without records of windows.
    #[error(
        "{files}: expected records of windows, found none: no actuation was recorded, or frames alone, of which hmd replay LOG -o OUT.mcap makes records"
    )]
    Empty {
        /// The files.
        files: String,
    },
    /// No such actuator.
    #[error("--actuator: expected one of {known}, found {found:?}")]
    Actuator {
        /// Those that the files have.
        known: String,
        /// What was asked for.
        found: String,
    },
}

/// How one file was made, and what it lost.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Source {
    /// Name of the file.
    pub file: String,
    /// Its metadata: build, configuration, model, seed…
    pub metadata: BTreeMap<String, String>,
    /// Counts at its end.
    pub status: Status,
    /// Parts of the file were damaged.
    pub damaged: bool,
}

/// What some files say: of each actuator, of themselves, and events.
#[derive(Clone, Debug, Default)]
pub struct Files {
    /// By name.
    pub actuators: BTreeMap<String, History>,
    /// In the order of reading.
    pub sources: Vec<Source>,
    /// UTC ns and text.
    pub events: Vec<(u64, String)>,
}

impl Files {
    /// Reads files in the order of time.
    ///
    /// # Errors
    /// A file that cannot be read, or a record that is none. Damaged parts are skipped and given to `report`, each with its
    /// place, and mentioned on the page.
    pub fn read<P: AsRef<Path>>(paths: &[P], tell: &mut dyn FnMut(&McapLoss)) -> Result<Self, ReportError> {
        let (mut files, mut parts) = (Self::default(), Vec::new());
        for path in paths {
            let name = path.as_ref().display().to_string();
            let io = |source| ReportError::Io {
                file: name.clone(),
                source,
            };
            let file = open_recorded(path.as_ref()).map_err(io)?;
            let mut messages = McapMessages::of_recording(BufReader::new(file), &name).map_err(io)?;
            let mut source = Source {
                file: path
                    .as_ref()
                    .file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned(),
                ..Source::default()
            };
            let record = |source| ReportError::Record {
                file: name.clone(),
                source,
            };
            for message in messages.by_ref() {
                let message = match message {
                    Ok(message) => message,
                    Err(loss) => {
                        tell(&loss);
                        source.damaged = true;
                        continue;
                    }
                };
                let data = message.data.as_slice();
                match &*message.schema {
                    Window::SCHEMA_NAME => files.window(Window::decode(data).map_err(record)?),
                    Health::SCHEMA_NAME => files.health(Health::decode(data).map_err(record)?),
                    Rul::SCHEMA_NAME => files.rul(Rul::decode(data).map_err(record)?),
                    Sensors::SCHEMA_NAME => {
                        let sensors = Sensors::decode(data).map_err(record)?;
                        let history = files.entry(&sensors.actuator);
                        history.sensors = sensors;
                    }
                    Status::SCHEMA_NAME => source.status = Status::decode(data).map_err(record)?,
                    Log::SCHEMA_NAME => {
                        let text = Log::decode(data).map_err(record)?.message;
                        files.events.push((message.log_time_ns, text));
                    }
                    _ => {}
                }
            }
            match messages.verified_metadata(METADATA_NAME) {
                Ok(metadata) => source.metadata = metadata.cloned().unwrap_or_default(),
                Err(loss) => {
                    tell(&loss);
                    source.damaged = true;
                }
            }
            // Of this file alone so far.
            for (name, mut history) in std::mem::take(&mut files.actuators) {
                let number = |key: &str| source.metadata.get(&format!("{name}.{key}")).cloned();
                let serial = number("serial_number");
                let identity = [("part", number("part_number")), ("serial", serial.clone())];
                let identity = identity.map(|(what, number)| number.map(|number| format!("{what} number {number}")));
                history.identity = identity.into_iter().flatten().collect::<Vec<_>>().join(", ");
                let run = source.metadata.get("run").cloned();
                parts.push(Part { run, serial, history });
            }
            files.sources.push(source);
        }
        files.actuators = by_unit(parts);
        Ok(files)
    }

    /// Takes over which actuators and parts were replaced after the newest window of each and until now, UTC ns, by the events of a
    /// configuration. One that is still to come changes nothing.
    pub fn note_replacements(&mut self, events: &Events, now_ns: u64) {
        let has_come = |event: &&Event| event.event == EventKind::Reset && event.t_ns <= now_ns;
        for event in events.list.iter().filter(has_come) {
            let Some(history) = self.actuators.get_mut(&event.actuator) else {
                continue;
            };
            let is_after = history.points.iter().all(|point| point.t_start_ns < event.t_ns);
            let is_known = history.replaced_since.iter().any(|known| known.part == event.part);
            if is_after && !is_known {
                history.replaced_since.push(Replacement {
                    part: event.part,
                    t_ns: event.t_ns,
                    note: event.note.clone().unwrap_or_default(),
                });
            }
        }
    }

    /// All actuators by name, or the one of this name.
    ///
    /// # Errors
    /// None, or none of this name.
    pub fn actuators(&self, name: Option<&str>) -> Result<Vec<&History>, ReportError> {
        if self.actuators.is_empty() {
            let files: Vec<&str> = self.sources.iter().map(|source| source.file.as_str()).collect();
            return Err(ReportError::Empty {
                files: files.join(", "),
            });
        }
        let Some(name) = name else {
            return Ok(self.actuators.values().collect());
        };
        // Without a serial number all units of that name.
        let units = format!("{name}, serial ");
        let is_meant = |(of, _): &(&String, &History)| *of == name || of.starts_with(&units);
        let found: Vec<&History> = self
            .actuators
            .iter()
            .filter(is_meant)
            .map(|(_, history)| history)
            .collect();
        if found.is_empty() {
            return Err(ReportError::Actuator {
                known: self.actuators.keys().cloned().collect::<Vec<_>>().join("; "),
                found: name.to_owned(),
            });
        }
        Ok(found)
    }

    fn entry(&mut self, actuator: &str) -> &mut History {
        self.actuators.entry(actuator.to_owned()).or_insert_with(|| History {
            actuator: actuator.to_owned(),
            ..History::default()
        })
    }

    fn window(&mut self, window: Window) {
        let history = self.entry(&window.actuator);
        let counts = [window.samples_expected, window.samples, window.samples_lost];
        for (sum, count) in history.samples.iter_mut().zip(counts) {
            *sum += count;
        }
        if !window.fitted_i_q_a.is_empty() {
            history.fitted = Some(window);
        }
    }

    fn health(&mut self, health: Health) {
        self.entry(&health.actuator).add(health);
    }

    fn rul(&mut self, rul: Rul) {
        let history = self.entry(&rul.actuator);
        if let Some(point) = history.points.last_mut().filter(|point| point.window == rul.window) {
            point.used_h = rul.operating_h;
            point.left_h = hours_of_all(&rul);
            history.note_replaced(&rul.replaced);
            history.newest.1 = rul;
        }
    }
}
