//! One file per verb of the command line. Thin: parse, call, print. Records go to stdout, everything else to stderr.

pub mod bench;
pub mod calibrate;
pub mod check_config;
pub mod demo;
pub mod evaluate;
pub mod event;
pub mod export;
pub mod inspect;
mod journal;
mod live;
pub mod manual;
mod metrics_http;
mod progress;
pub mod record;
pub mod recover;
pub mod replay;
pub mod report;
pub mod run;
#[cfg_attr(not(feature = "serve"), path = "no_serve.rs")]
mod serve;
mod service;
pub mod simulate;
mod table;
pub mod top;

use std::io::Write;
use std::path::Path;

use anyhow::Context;

use crate::calibration::load_calibration;
use crate::config::{Config, ConfigError};
use crate::daemon::DaemonError;
use crate::ingest::McapLoss;
use crate::judge::JudgeError;
use crate::life::events_of;
use crate::recover::LISTED_MAX;
use crate::replay::ReplayError;
use crate::same_file::is_same_file;
use crate::unit::UnitCalibration;

/// How a verb ended; the number is the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// Finished, but data were lost.
    DataLost = 3,
}

/// Exit code of everything that failed for another reason than its configuration.
pub const FAILED: u8 = 1;

/// Exit code of a bad configuration (`EX_CONFIG`).
pub const BAD_CONFIG: u8 = 78;

/// Exit code of arguments that make no sense, as that of the argument parser.
pub const USAGE: u8 = 2;

/// Arguments that the parser takes and that make no sense all the same.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Misuse(String);

/// Exit code that belongs to an error.
#[must_use]
pub fn code_of(error: &anyhow::Error) -> u8 {
    // What the judge refuses comes from the configuration: a calibration it names, its search, its levels.
    let by_judge = error.downcast_ref::<JudgeError>().is_some()
        || matches!(error.downcast_ref(), Some(ReplayError::Judge(_)))
        || matches!(error.downcast_ref(), Some(DaemonError::Judge(_)));
    if error.downcast_ref::<ConfigError>().is_some() || by_judge {
        BAD_CONFIG
    } else if error.downcast_ref::<Misuse>().is_some() {
        USAGE
    } else {
        FAILED
    }
}

/// An error in one sentence: what failed, then why, without repeating what a cause already says.
#[must_use]
pub fn sentence(error: &anyhow::Error) -> String {
    let root = error.root_cause().to_string();
    let mut text = error.to_string();
    for cause in error.chain().skip(1) {
        if text.contains(&root) {
            break;
        }
        text = format!("{text}: {cause}");
    }
    text
}

/// An unknown `--actuator`.
fn unknown_type(name: &str) -> Misuse {
    Misuse(format!(
        "--actuator: expected bench, servo28 or a type of the configuration, found {name:?}"
    ))
}

/// The configuration of a file, or the defaults.
///
/// # Errors
/// The first thing that is wrong with it.
pub fn load_config(path: Option<&Path>) -> Result<Config, ConfigError> {
    path.map_or_else(|| Ok(Config::default()), Config::load)
}

/// Whether every calibration and the events that the configuration names can be used, before a log is read.
///
/// # Errors
/// The first file that cannot.
pub fn check_files(config: &Config) -> anyhow::Result<()> {
    events_of(config).map_err(JudgeError::from)?;
    let expected = config.identification().monitor;
    for (name, found) in config.types() {
        let Some(path) = &found.calibration else { continue };
        let path = config.resolve(path);
        let checked = match load_calibration(&path) {
            Ok(calibration) if calibration.monitor == expected => Ok(()),
            Ok(calibration) => Err(JudgeError::Form {
                path: path.display().to_string(),
                expected,
                found: calibration.monitor,
            }),
            Err(e) => Err(JudgeError::from(e)),
        };
        checked.with_context(|| format!("type.{name}.calibration"))?;
    }
    for actuator in config.actuators() {
        if let Some(path) = &actuator.calibration {
            UnitCalibration::load(&config.resolve(path), &actuator.type_name)
                .map_err(JudgeError::from)
                .with_context(|| format!("actuator.calibration of {}", actuator.name))?;
        }
    }
    Ok(())
}

/// Refuses an output that is one of the files to be read, by whatever name.
fn no_input(output: &Path, inputs: impl IntoIterator<Item = impl AsRef<Path>>) -> Result<(), Misuse> {
    if inputs.into_iter().any(|input| is_same_file(output, input.as_ref())) {
        let output = output.display();
        return Err(Misuse(format!(
            "expected another output than a file that is read, found {output}"
        )));
    }
    Ok(())
}

/// Refuses to begin a recording in a file that has something in it: what was recorded is not to be replaced.
fn no_recording(output: &Path) -> Result<(), Misuse> {
    match std::fs::metadata(output) {
        Ok(about) if about.is_file() && about.len() > 0 => Err(Misuse(format!(
            "--output: expected a file that is not there yet, or a folder, found {}, {} bytes: it is not replaced",
            output.display(),
            about.len()
        ))),
        _ => Ok(()),
    }
}

/// Sets the number of threads of this process; all cores without one.
fn use_threads(threads: Option<usize>) -> anyhow::Result<()> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
    builder.build_global().context("cannot start threads")
}

/// Damaged places of the files that a verb reads, for the end: a file that is none of ours is refused in one sentence instead.
#[derive(Debug, Default)]
struct Losses {
    listed: Vec<McapLoss>,
    total: u64,
}

impl Losses {
    fn take(&mut self, loss: &McapLoss) {
        self.total += 1;
        if self.listed.len() < LISTED_MAX {
            self.listed.push(loss.clone());
        }
    }

    /// Says what was lost, each with its place, and how the verb ends.
    fn exit(&self) -> Exit {
        if self.total == 0 {
            return Exit::Done;
        }
        for loss in &self.listed {
            warn(loss);
        }
        let more = self.total - self.listed.len() as u64;
        if more > 0 {
            warn(format_args!("{more} more damaged places"));
        }
        warn(format_args!(
            "data lost: {} damaged places in the files read",
            self.total
        ));
        Exit::DataLost
    }
}

/// Writes a line to stderr. Where that cannot be written, nobody is left to be told.
pub fn warn(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Writes a line to stdout; a reader that has gone away is no failure.
fn say(line: &str) -> anyhow::Result<()> {
    match writeln!(std::io::stdout().lock(), "{line}") {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => std::process::exit(0),
        other => other.context("stdout"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit::UnitError;

    #[test]
    fn what_the_judge_refuses_is_a_bad_configuration_in_every_verb() {
        let refused = || {
            JudgeError::from(UnitError::Parse {
                path: "unit.toml".to_owned(),
                message: "nothing".to_owned(),
            })
        };
        let errors = [
            anyhow::Error::from(refused()),
            ReplayError::Judge(refused()).into(),
            DaemonError::Judge(refused()).into(),
            anyhow::Error::from(refused()).context("actuator.calibration of ema0"),
        ];
        assert_eq!(errors.map(|error| code_of(&error)), [BAD_CONFIG; 4]);
        assert_eq!(
            code_of(&ReplayError::OutputIsInput { path: "a".to_owned() }.into()),
            FAILED
        );
    }
}
