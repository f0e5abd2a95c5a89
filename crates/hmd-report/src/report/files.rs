//! Recorded files -> what they say of each actuator, of themselves, and events.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

use prost::Message;

use super::history::{History, hours_of_all, is_elapsed, requirement};
use super::replacements::{Maintenance, SERIAL};
use super::units::{Part, by_unit};
use ema_models::FaultId;
use hmd_core::config::Config;
use hmd_core::health::Levels;
use hmd_core::history::ReplacedPart;
use hmd_core::levels_text::levels_from_text;
use hmd_core::record::{Health, Log, Record, Rul, Sensors, Status, Window};
use hmd_ingest::file::open_recorded;
use hmd_storage::mcap::{McapLoss, McapMessages, NoWindows};
use hmd_storage::mcap_writer::METADATA_NAME;
use hmd_storage::recover::RECOVERED_NAME;

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
    #[error(transparent)]
    Empty(NoWindows),
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
    /// Parts of the file were damaged, or of the one that it was recovered from.
    pub damaged: bool,
    /// Start of its newest window, UTC ns; 0 without any.
    pub newest_ns: u64,
}

/// Levels that windows were assessed by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedLevels {
    /// Damage levels of the faults, in the order of [`FaultId::ALL`].
    pub levels: [Levels; FaultId::COUNT],
    /// `rul.critical_h`: an actuator is critical whose 10 % quantile of the hours left is below this.
    pub critical_h: f64,
    /// Whether some file says others.
    pub differ: bool,
    /// Whether every file says its own.
    pub are_said_by_all: bool,
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
    /// Why there is no window, where there is none.
    pub(super) nothing: NoWindows,
}

impl Files {
    /// Reads files in the order of time. What was replaced by `maintenance` between two recordings begins anew with the later one; what was
    /// replaced after the newest window, and what no window knows of ([`History::entered_since`]), is noted.
    ///
    /// # Errors
    /// A file that cannot be read, or a record that is none. Damaged parts are skipped and given to `report`, each with its
    /// place, and mentioned on the page.
    pub fn read<P: AsRef<Path>>(
        paths: &[P],
        maintenance: &Maintenance<'_>,
        tell: &mut dyn FnMut(&McapLoss),
    ) -> Result<Self, ReportError> {
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
            files.nothing.note(&messages);
            // A copy of what was intact is whole itself.
            source.damaged |= !matches!(messages.verified_metadata(RECOVERED_NAME), Ok(None));
            match messages.verified_metadata(METADATA_NAME) {
                Ok(metadata) => source.metadata = metadata.cloned().unwrap_or_default(),
                Err(loss) => {
                    tell(&loss);
                    source.damaged = true;
                }
            }
            // Of this file alone so far.
            let periods = files.actuators.values().filter_map(History::period_ns);
            source.newest_ns = periods.map(|[_, last]| last).max().unwrap_or(0);
            for (name, mut history) in std::mem::take(&mut files.actuators) {
                let number = |key: &str| source.metadata.get(&format!("{name}.{key}")).cloned();
                let serial = number("serial_number");
                let identity = [("part", number("part_number")), ("serial", serial.clone())];
                let identity = identity.map(|(what, number)| number.map(|number| format!("{what} number {number}")));
                history.identity = identity.into_iter().flatten().collect::<Vec<_>>().join(", ");
                let run = source.metadata.get("run").cloned();
                parts.push(Part {
                    file: source.file.clone(),
                    run,
                    serial,
                    history,
                });
            }
            files.sources.push(source);
        }
        files.actuators = by_unit(parts, maintenance);
        for (name, history) in &files.actuators {
            let replaced = history.replaced_between.iter();
            files
                .events
                .extend(replaced.map(|of| (of.t_ns, format!("{name}: {}", of.noted()))));
        }
        Ok(files)
    }

    /// Whether some file was recorded with another configuration than this one.
    #[must_use]
    pub fn has_other_configuration(&self, config: &Config) -> bool {
        let hash = config.hash();
        let mut hashes = self
            .sources
            .iter()
            .filter_map(|source| source.metadata.get("config_hash"));
        hashes.any(|found| *found != hash)
    }

    /// The levels that the newest of the files that say theirs was recorded with; `None` where no file does.
    #[must_use]
    pub fn recorded_levels(&self) -> Option<RecordedLevels> {
        let of = |source: &Source| {
            let levels = levels_from_text(source.metadata.get("levels")?)?;
            let critical_h = source.metadata.get("critical_h")?.parse::<f64>().ok()?;
            critical_h
                .is_finite()
                .then_some((source.newest_ns, (levels, critical_h)))
        };
        let said: Vec<_> = self.sources.iter().map(of).collect();
        let of_newest = said.iter().flatten().max_by_key(|(newest_ns, _)| *newest_ns)?.1;
        let (levels, critical_h) = of_newest;
        Some(RecordedLevels {
            levels,
            critical_h,
            differ: said.iter().flatten().any(|(_, others)| *others != of_newest),
            are_said_by_all: said.iter().all(Option::is_some),
        })
    }

    /// All actuators by name, or the one of this name.
    ///
    /// # Errors
    /// None, or none of this name.
    pub fn actuators(&self, name: Option<&str>) -> Result<Vec<&History>, ReportError> {
        if self.actuators.is_empty() {
            return Err(ReportError::Empty(self.nothing.clone()));
        }
        let Some(name) = name else {
            return Ok(self.actuators.values().collect());
        };
        // Without a serial number all units of that name.
        let units = format!("{name}{SERIAL}");
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
            *sum = sum.saturating_add(count);
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
            point.replaced = ReplacedPart::in_text(&rul.replaced).collect();
            point.left_h = hours_of_all(&rul);
            point.is_elapsed = is_elapsed(&rul);
            let has_forecast = point.left_h.is_some() && requirement(&rul).is_none();
            point.ends_first = FaultId::from_name(&rul.dominant_fault).filter(|_| has_forecast);
            history.newest.add_rul(rul);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::levels_text::levels_text;

    #[test]
    fn the_levels_are_those_of_the_newest_file_that_says_them() {
        let low = Levels {
            critical: 0.4,
            ..Levels::default()
        };
        let levels = [low; FaultId::COUNT];
        let recorded = |said: &[(u64, Option<f64>)]| {
            let source = |&(newest_ns, critical_h): &(u64, Option<f64>)| {
                let said =
                    critical_h.map(|hours| [("levels", levels_text(&levels)), ("critical_h", hours.to_string())]);
                let metadata = said.into_iter().flatten().map(|(key, text)| (key.to_owned(), text));
                Source {
                    metadata: metadata.collect(),
                    newest_ns,
                    ..Source::default()
                }
            };
            let files = Files {
                sources: said.iter().map(source).collect(),
                ..Files::default()
            };
            let found = files.recorded_levels();
            assert!(found.is_none_or(|found| found.levels == levels));
            found.map(|found| (found.critical_h.to_string(), found.differ, found.are_said_by_all))
        };
        let found = |hours: &str, differ: bool, by_all: bool| Some((hours.to_owned(), differ, by_all));
        assert_eq!(recorded(&[(1, Some(50.0)), (2, Some(50.0))]), found("50", false, true));
        assert_eq!(recorded(&[(1, Some(50.0)), (2, None)]), found("50", false, false));
        // In any order of files.
        assert_eq!(recorded(&[(1, Some(50.0)), (2, Some(0.0))]), found("0", true, true));
        assert_eq!(recorded(&[(2, Some(0.0)), (1, Some(50.0))]), found("0", true, true));
        for said in [&[][..], &[(1, None)], &[(1, Some(f64::NAN))]] {
            assert_eq!(recorded(said), None, "{said:?}");
        }
    }

    #[test]
    fn another_configuration_is_noticed_by_its_hash() {
        let config = Config::default();
        let is_other = |hash: String| {
            let source = Source {
                metadata: [("config_hash".to_owned(), hash)].into(),
                ..Source::default()
            };
            let files = Files {
                sources: vec![source],
                ..Files::default()
            };
            files.has_other_configuration(&config)
        };
        assert_eq!([config.hash(), "00".to_owned()].map(is_other), [false, true]);
    }
}
