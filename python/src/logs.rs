//! Logs and recorded files as tables, and what a configuration amounts to.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use hmd::commands::recordings::{Wanted, recordings};
use hmd::commands::{check_files, load_config};
use hmd_report::export::{TableKind, export, export_raw, raw_heads};
use hmd_storage::calibration_file::hash_of_models;
use pyo3::prelude::*;

use crate::arrow::{ArrowTable, Shared};
use crate::error::{misuse, raised};

/// Records of files or folders that `hmd` wrote; also whether parts could not be read.
#[pyfunction]
pub(crate) fn read_records(py: Python<'_>, files: Vec<PathBuf>, table: &str) -> PyResult<(ArrowTable, bool)> {
    let kind = match table {
        "health" => TableKind::Health,
        "samples" => TableKind::Samples,
        _ => return Err(misuse(format!("table: expected health or samples, found {table:?}"))),
    };
    let rows = Shared::new(kind.heads());
    let exported = py
        .detach(|| {
            let files = recordings(&files, Wanted::Records)?;
            Ok::<_, anyhow::Error>(export(&files, kind, Box::new(rows.clone()), &mut |_| {})?)
        })
        .map_err(raised)?;
    if exported.rows == 0 && exported.damaged {
        let names: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
        return Err(raised(anyhow::anyhow!(
            "{}: expected records of windows, found none",
            names.join(", ")
        )));
    }
    Ok((rows.into_table()?, exported.damaged))
}

/// Samples of logs, or folders of them; also whether parts could not be read.
#[pyfunction]
pub(crate) fn read_raw(py: Python<'_>, logs: Vec<PathBuf>, config: Option<PathBuf>) -> PyResult<(ArrowTable, bool)> {
    let config = load_config(config.as_deref()).map_err(raised)?;
    let rows = Shared::new(raw_heads());
    let exported = py
        .detach(|| {
            let logs = recordings(&logs, Wanted::Logs)?;
            Ok::<_, anyhow::Error>(export_raw(&logs, Arc::new(config), Box::new(rows.clone()))?)
        })
        .map_err(raised)?;
    Ok((rows.into_table()?, exported.damaged))
}

/// Hash of a checked configuration, that of the calibrations its types are assessed with, and the further files it names.
#[pyfunction]
pub(crate) fn config_identity(config: Option<PathBuf>) -> PyResult<(String, String, Vec<PathBuf>)> {
    let config = load_config(config.as_deref()).map_err(raised)?;
    check_files(&config, &mut |_| {}).map_err(raised)?;
    let actuators = config.actuators().iter();
    let files = actuators.flat_map(|actuator| [&actuator.calibration, &actuator.dbc]);
    let files = files.chain([&config.rul().events]).flatten();
    let files = files.map(|file| config.resolve(file)).collect();
    Ok((config.hash(), hash_of_models(&config), files))
}

/// Serial numbers of the actuators of a log, as its writer's configuration said.
#[pyfunction]
pub(crate) fn serial_numbers(log: PathBuf) -> BTreeMap<String, String> {
    hmd::replay::serial_numbers(&log)
}
