//! Logs and recorded files as tables, and what a configuration amounts to.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use hmd::commands::recordings::{Wanted, is_table, logs_of_folder, recordings};
use hmd::commands::{Losses, check_files, load_config};
use hmd_core::config::ActuatorConfig;
use hmd_report::export::{TableKind, export, export_raw, raw_heads};
use hmd_storage::calibration_file::hash_of_models;
use pyo3::prelude::*;

use crate::arrow::{ArrowTable, Shared};
use crate::error::{misuse, raised};

/// Records of files or folders that `hmd` wrote; also what could not be read, a sentence each.
#[pyfunction]
pub(crate) fn read_records(py: Python<'_>, files: Vec<PathBuf>, table: &str) -> PyResult<(ArrowTable, Vec<String>)> {
    let kind = match table {
        "health" => TableKind::Health,
        "samples" => TableKind::Samples,
        _ => return Err(misuse(format!("table: expected health or samples, found {table:?}"))),
    };
    let rows = Shared::new(kind.heads());
    let losses = py
        .detach(|| {
            let files = recordings(&files, Wanted::Records)?;
            let mut losses = Losses::default();
            export(&files, kind, Box::new(rows.clone()), &mut |loss| losses.add(loss))?;
            Ok::<_, anyhow::Error>(losses)
        })
        .map_err(raised)?;
    let mut lost = Vec::new();
    losses.exit(&mut |sentence| lost.push(sentence.to_owned()));
    Ok((rows.into_table()?, lost))
}

/// Samples of logs, or folders of them; also what could not be read, a sentence each.
#[pyfunction]
pub(crate) fn read_raw(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    config: Option<PathBuf>,
) -> PyResult<(ArrowTable, Vec<String>)> {
    let config = load_config(config.as_deref()).map_err(raised)?;
    let rows = Shared::new(raw_heads());
    let named: Vec<String> = logs.iter().map(|log| log.display().to_string()).collect();
    let (losses, sum) = py
        .detach(|| {
            let logs = recordings(&logs, Wanted::Logs)?;
            let mut losses = Losses::default();
            let table = Box::new(rows.clone());
            let exported = export_raw(&logs, Arc::new(config), table, &mut |loss| losses.add(loss))?;
            Ok::<_, anyhow::Error>((losses, exported.lost))
        })
        .map_err(raised)?;
    let mut lost = Vec::new();
    losses.list(&mut |sentence| lost.push(sentence.to_owned()));
    lost.extend(sum.map(|sum| format!("{}: {sum}", named.join(", "))));
    Ok((rows.into_table()?, lost))
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
    hmd_storage::serial_numbers::serial_numbers(&log)
}

/// Serial numbers of the actuators of a configuration that has them.
#[pyfunction]
pub(crate) fn configured_serial_numbers(config: Option<PathBuf>) -> PyResult<BTreeMap<String, String>> {
    let config = load_config(config.as_deref()).map_err(raised)?;
    let serial_of = |actuator: &ActuatorConfig| Some((actuator.name.clone(), actuator.serial_number.clone()?));
    Ok(config.actuators().iter().filter_map(serial_of).collect())
}

/// A log of a folder: its path, and whether it is a table, which needs a section `[map]`.
type Log = (PathBuf, bool);

/// Another file of a folder, and why it is no log.
type PassedOver = (PathBuf, String);

/// The logs of a folder, and the other files in it with the reason why each is none.
#[pyfunction]
pub(crate) fn logs_in(folder: PathBuf) -> PyResult<(Vec<Log>, Vec<PassedOver>)> {
    let content = logs_of_folder(&folder).map_err(raised)?;
    let logs = content.recordings.into_iter().map(|log| {
        let is_table = is_table(&log);
        (log, is_table)
    });
    let passed_over = content.passed_over.into_iter();
    Ok((
        logs.collect(),
        passed_over.map(|(file, why)| (file, why.to_string())).collect(),
    ))
}

/// Whether a configuration says what the signals of a log are (`[map]`).
#[pyfunction]
pub(crate) fn has_map(config: Option<PathBuf>) -> PyResult<bool> {
    let config = load_config(config.as_deref()).map_err(raised)?;
    Ok(config.actuator_of_logs().is_some())
}
