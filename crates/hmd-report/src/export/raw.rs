//! Logs -> the samples in them, as the monitor takes them in: decoded and continued, nothing cut or filled.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::table::raw_row;
use super::{ExportError, Origin, Sources, Table, distinct_names};
use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::demux::Demux;
use hmd_core::frame::BusNames;
use hmd_core::outbox::AssembledSample;
use hmd_core::pipeline::Losses;
use hmd_core::record::Status;
use hmd_ingest::Loss;
use hmd_ingest::file::open_mapped;
use hmd_storage::serial_numbers::serial_numbers;

/// What came of an export of samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportedSamples {
    /// Rows written.
    pub rows: u64,
    /// What could not be read, in a sentence; `None` if all was.
    pub lost: Option<String>,
}

/// Reads the samples of all watched actuators out of logs, in the order of time, into a table of [`raw_heads`]; `tell` gets what cannot be
/// read, each with its place.
///
/// [`raw_heads`]: super::raw_heads
///
/// # Errors
/// A log that cannot be read at all, a row that cannot be written.
pub fn export_raw<P: AsRef<Path>>(
    logs: &[P],
    config: Arc<Config>,
    mut table: Box<dyn Table>,
    tell: &mut dyn FnMut(&Loss),
) -> Result<ExportedSamples, ExportError> {
    let mut exported = ExportedSamples::default();
    let (mut losses, mut damaged_places) = (Losses::default(), 0);
    let mut demux = Demux::new(config.clone()).collecting_samples();
    let mut names = BusNames::new();
    for (log, file) in logs.iter().zip(distinct_names(logs)) {
        let of_log = OriginOfLog {
            serial_numbers: serial_numbers(log.as_ref()),
            file,
        };
        let mut source = open_mapped(log.as_ref(), names, &config)?;
        while let Some(item) = source.next() {
            match item {
                Ok(frame) => demux.push(&frame, source.bus_names()),
                Err(loss) => {
                    damaged_places += loss.count_into(&mut losses);
                    tell(&loss);
                }
            }
            demux.take_windows();
            write(&mut *table, demux.take_samples(), &of_log, &mut exported)?;
        }
        names = source.into_bus_names();
        demux.finish();
        write(&mut *table, demux.take_samples(), &of_log, &mut exported)?;
    }
    let counts = demux.counts();
    let status = Status {
        lost_unreadable: losses.unreadable + counts.unreadable,
        lost_damaged: losses.damaged,
        lost_malformed: counts.malformed,
        ..Status::default()
    };
    exported.lost = status.lost_in_logs(damaged_places);
    table.finish(&Sources::new())?;
    Ok(exported)
}

/// Where the samples of a log come from.
struct OriginOfLog {
    /// Serial numbers of its actuators by name, as its writer's configuration said.
    serial_numbers: BTreeMap<String, String>,
    /// Its name among the logs.
    file: String,
}

impl OriginOfLog {
    /// The origin of an actuator's samples; the serial number of the configuration goes before that of the log.
    fn of<'a>(&'a self, actuator: &'a ActuatorConfig) -> Origin<'a> {
        let of_log = || self.serial_numbers.get(&actuator.name);
        let serial_number = actuator.serial_number.as_ref().or_else(of_log);
        Origin {
            serial_number: serial_number.map_or("", String::as_str),
            file: &self.file,
        }
    }
}

fn write(
    table: &mut dyn Table,
    taken: Vec<AssembledSample>,
    of_log: &OriginOfLog,
    exported: &mut ExportedSamples,
) -> Result<(), ExportError> {
    for AssembledSample {
        actuator,
        rate,
        sample,
        conditions,
    } in taken
    {
        table.row(raw_row(
            &actuator.name,
            rate,
            &sample,
            &conditions,
            of_log.of(&actuator),
        ))?;
        exported.rows += 1;
    }
    Ok(())
}
