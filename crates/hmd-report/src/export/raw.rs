//! Logs -> the samples in them, as the monitor takes them in: decoded and continued, nothing cut or filled.

use std::path::Path;
use std::sync::Arc;

use super::table::raw_row;
use super::{ExportError, Sources, Table};
use hmd_core::config::Config;
use hmd_core::demux::Demux;
use hmd_core::frame::BusNames;
use hmd_core::outbox::AssembledSample;
use hmd_core::pipeline::Losses;
use hmd_core::record::Status;
use hmd_ingest::Loss;
use hmd_ingest::file::open_mapped;

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
    for log in logs {
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
            write(&mut *table, demux.take_samples(), &mut exported)?;
        }
        names = source.into_bus_names();
        demux.finish();
        write(&mut *table, demux.take_samples(), &mut exported)?;
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

fn write(
    table: &mut dyn Table,
    taken: Vec<AssembledSample>,
    exported: &mut ExportedSamples,
) -> Result<(), ExportError> {
    for AssembledSample {
        actuator,
        rate,
        sample,
        conditions,
    } in taken
    {
        table.row(raw_row(&actuator.name, rate, &sample, &conditions))?;
        exported.rows += 1;
    }
    Ok(())
}
