//! `hmd evaluate sensors`: the suite of wrong sensors, wires and configured numbers.

use hmd_lab::evaluate::sensors::{SENSORS_UNITS, SensorsError, SensorsOptions, sensors, sensors_table};

use super::super::{Exit, Misuse, progress};
use super::{Args, print};

/// Types without `--actuator`.
const ACTUATORS: [&str; 2] = ["bench", "servo28"];

/// Runs the suite.
///
/// # Errors
/// An unknown entry or type.
pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let options = SensorsOptions {
        n: args.n.unwrap_or(SENSORS_UNITS),
        seed: args.seed,
        actuators: match &args.actuator {
            Some(name) => vec![name.clone()],
            None => ACTUATORS.map(str::to_owned).to_vec(),
        },
        entries: args.entry.clone(),
    };
    let bar = progress::over_pieces(options.windows().map_err(as_misuse)?);
    let report = sensors(&options, &|windows| bar.inc(windows)).map_err(as_misuse)?;
    bar.finish_and_clear();
    print(args, &report, sensors_table)?;
    Ok(Exit::Done)
}

/// A wrong argument is told as one.
fn as_misuse(error: SensorsError) -> anyhow::Error {
    match error {
        SensorsError::Entry { .. } | SensorsError::Actuator { .. } => Misuse(error.to_string()).into(),
        other => other.into(),
    }
}
