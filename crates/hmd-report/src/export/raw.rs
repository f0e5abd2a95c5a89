//! Logs -> the samples in them, as the monitor takes them in: decoded and continued, nothing cut or filled.

use std::path::Path;
use std::sync::Arc;

use super::table::raw_row;
use super::{ExportError, Exported, Sources, Table};
use hmd_core::config::Config;
use hmd_core::demux::Demux;
use hmd_core::frame::BusNames;
use hmd_core::outbox::AssembledSample;
use hmd_ingest::file::open_mapped;

/// Reads the samples of all watched actuators out of logs, in the order of time, into a table of [`raw_heads`].
///
/// [`raw_heads`]: super::raw_heads
///
/// # Errors
/// A log that cannot be read at all, a row that cannot be written.
pub fn export_raw<P: AsRef<Path>>(
    logs: &[P],
    config: Arc<Config>,
    mut table: Box<dyn Table>,
) -> Result<Exported, ExportError> {
    let mut exported = Exported::default();
    let mut demux = Demux::new(config.clone()).collecting_samples();
    let mut names = BusNames::new();
    for log in logs {
        let mut source = open_mapped(log.as_ref(), names, &config)?;
        while let Some(item) = source.next() {
            match item {
                Ok(frame) => demux.push(&frame, source.bus_names()),
                Err(_) => exported.damaged = true,
            }
            demux.take_windows();
            write(&mut *table, demux.take_samples(), &mut exported)?;
        }
        names = source.into_bus_names();
        demux.finish();
        write(&mut *table, demux.take_samples(), &mut exported)?;
    }
    let counts = demux.counts();
    exported.damaged |= counts.malformed + counts.unreadable > 0;
    table.finish(&Sources::new())?;
    Ok(exported)
}

fn write(table: &mut dyn Table, taken: Vec<AssembledSample>, exported: &mut Exported) -> Result<(), ExportError> {
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
