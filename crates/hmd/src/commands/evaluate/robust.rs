//! `hmd evaluate robust`: the suite of imperfect units, with the state of a run that is resumed.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

use anyhow::Context;
use ema_models::ActuatorParams;
use hmd_lab::evaluate::robust::{
    FinishedUnit, ROBUST_WINDOWS, RobustError, RobustOptions, first_line, read_state, robust, robust_table,
};

use super::super::{Exit, Misuse, progress};
use super::{Args, print};

/// Sample rate without `--rate`, Hz.
const RATE_HZ: f64 = 2000.0;

/// Runs the suite.
///
/// # Errors
/// An unknown entry, type or rate, or a state that cannot be read or written.
pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let options = RobustOptions {
        rate_hz: args.rate.unwrap_or(RATE_HZ),
        n: args.n.unwrap_or(ROBUST_WINDOWS),
        seed: args.seed,
        actuators: match &args.actuator {
            Some(name) => vec![name.clone()],
            None => ActuatorParams::BUILT_IN.map(str::to_owned).to_vec(),
        },
        entries: args.entry.clone(),
    };
    let windows = options.windows().map_err(as_misuse)?;
    let (finished, mut state) = match &args.resume {
        Some(path) => {
            let (finished, state) = resumed(path, &options).with_context(|| path.display().to_string())?;
            (finished, Some(state))
        }
        None => (Vec::new(), None),
    };
    let mut keep = |unit: &FinishedUnit| match &mut state {
        Some(file) => file.write_all(unit.line().as_bytes()),
        None => Ok(()),
    };
    let bar = progress::over_pieces(windows);
    let report = robust(&options, finished, &mut keep, &|windows| bar.inc(windows)).map_err(as_misuse)?;
    bar.finish_and_clear();
    print(args, &report, robust_table)?;
    Ok(Exit::Done)
}

/// Finished units of the state in a file, and the file to which further ones are appended.
fn resumed(path: &Path, options: &RobustOptions) -> anyhow::Result<(Vec<FinishedUnit>, File)> {
    let text = match std::fs::read_to_string(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        other => other?,
    };
    let (finished, whole) = read_state(&text, options)?;
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    file.set_len(whole as u64)?;
    if whole == 0 {
        file.write_all(first_line(options).as_bytes())?;
    }
    Ok((finished, file))
}

/// A wrong argument is told as one.
fn as_misuse(error: RobustError) -> anyhow::Error {
    match error {
        RobustError::Entry { .. } | RobustError::Actuator { .. } | RobustError::Rate(_) | RobustError::Config(_) => {
            Misuse(error.to_string()).into()
        }
        other => other.into(),
    }
}
