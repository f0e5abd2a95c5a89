//! One file per verb of the command line. Thin: parse, call, print. Records go to stdout, everything else to stderr.

#[cfg(feature = "full")]
pub mod bench;
pub mod calibrate;
#[cfg(feature = "full")]
mod calibrate_type;
pub mod check_config;
#[cfg(feature = "full")]
pub mod demo;
#[cfg(feature = "full")]
pub mod evaluate;
pub mod event;
#[cfg(feature = "full")]
pub mod export;
pub mod inspect;
mod instant;
mod journal;
mod live;
#[cfg(feature = "full")]
pub mod manual;
#[cfg(feature = "full")]
pub mod map;
mod metrics_http;
mod outputs;
mod progress;
pub mod record;
pub mod recordings;
pub mod recover;
pub mod replay;
#[cfg(feature = "full")]
pub mod report;
mod requests;
pub mod run;
#[cfg_attr(not(feature = "full"), path = "no_serve.rs")]
mod serve;
mod service;
#[cfg(feature = "full")]
pub mod simulate;
mod table;
#[cfg(feature = "full")]
pub mod top;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::daemon::DaemonError;
use crate::replay::ReplayError;
use ema_identify::unit_calibration::UnitCalibration;
use hmd_core::assess::AssessError;
use hmd_core::assess::{check_serial, hash_of_type};
use hmd_core::config::{ActuatorConfig, Config, ConfigError};
use hmd_core::counted::counted;
use hmd_storage::calibration_file::{load_learnt, load_type_model, load_unit};
use hmd_storage::config_file;
use hmd_storage::event_file::{EventError, load_events};
use hmd_storage::printable;
use hmd_storage::recover::LISTED_MAX;

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

/// Exit code of an invalid combination of arguments, as that of the argument parser.
pub const USAGE: u8 = 2;

/// Valid syntax, invalid combination of arguments.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Misuse(String);

/// Exit code that belongs to an error.
#[must_use]
pub fn code_of(error: &anyhow::Error) -> u8 {
    // What the assessor refuses comes from the configuration: a calibration it names, its search, its levels.
    let by_assessor = error.downcast_ref::<AssessError>().is_some()
        || matches!(
            error.downcast_ref(),
            Some(EventError::Io { .. } | EventError::Line { .. })
        )
        || matches!(
            error.downcast_ref(),
            Some(ReplayError::Assess(_) | ReplayError::Events(_))
        )
        || matches!(error.downcast_ref(), Some(DaemonError::Assess(_)));
    if error.downcast_ref::<ConfigError>().is_some() || by_assessor {
        BAD_CONFIG
    } else if error.downcast_ref::<Misuse>().is_some() {
        USAGE
    } else {
        FAILED
    }
}

/// An error in one sentence: what failed, then why, without repeating a cause.
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
#[cfg(feature = "full")]
fn unknown_type(name: &str) -> Misuse {
    Misuse(format!(
        "--actuator: expected bench, servo28, servo270 or a type of the configuration, found {name:?}"
    ))
}

/// Settings of the command line.
#[derive(Debug, clap::Args)]
struct Settings {
    /// Set a key of the configuration, over what its files say, also several times: `identification.method=ga`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// EDS or DCF file of every drive of preset cia402 that names none: bus.eds.
    #[arg(long, value_name = "FILE")]
    eds: Option<PathBuf>,
}

/// The configuration of a file, or the defaults.
///
/// # Errors
/// The first thing that is wrong with it.
pub fn load_config(path: Option<&Path>) -> Result<Config, ConfigError> {
    config_file::load_config_with(path, &[])
}

/// The same with the settings of the command line.
fn load_config_with(path: Option<&Path>, settings: &Settings) -> Result<Config, ConfigError> {
    let mut all = settings.set.clone();
    // A path of the command line starts where the command runs, not where the configuration is.
    let eds = settings.eds.as_deref();
    all.extend(eds.map(|eds| {
        let eds = std::path::absolute(eds).unwrap_or_else(|_| eds.to_owned());
        format!("bus.eds={}", eds.display())
    }));
    config_file::load_config_with(path, &all)
}

/// Whether every calibration and the events that the configuration names can be used, before a log is read. `tell` gets a warning of each
/// unit that was commissioned under other parameters of its type.
///
/// # Errors
/// The first file that cannot.
pub fn check_files(config: &Config, tell: &mut dyn FnMut(&str)) -> anyhow::Result<()> {
    load_events(config).context("rul.events")?;
    let form = config.identification().monitor;
    for (name, of_type) in config.types().filter(|(_, of_type)| of_type.calibration.is_some()) {
        load_type_model(name, of_type, form, config).with_context(|| format!("type.{name}.calibration"))?;
    }
    for actuator in config.actuators() {
        if let Some(path) = &actuator.calibration {
            let unit = load_unit(&config.resolve(path), &actuator.type_name)
                .and_then(|unit| check_serial(path, actuator, &unit).map(|()| unit))
                .with_context(|| format!("actuator.calibration of {}", actuator.name))?;
            tell_of_changed_type(path, actuator, &unit, tell);
        }
    }
    Ok(())
}

/// The same with what earlier runs learnt of units, which a run goes on with; a replay needs it where its logs lack the windows that it was
/// learnt from.
///
/// # Errors
/// The first file that cannot be used.
pub fn check_files_of_run(config: &Config, tell: &mut dyn FnMut(&str)) -> anyhow::Result<()> {
    check_files(config, tell)?;
    for kept in load_learnt(config)? {
        tell_of_changed_type(&kept.path, kept.actuator, &kept.calibration, tell);
    }
    Ok(())
}

fn tell_of_changed_type(path: &Path, actuator: &ActuatorConfig, unit: &UnitCalibration, tell: &mut dyn FnMut(&str)) {
    if unit.parameters_hash != hash_of_type(actuator) {
        tell(&format!(
            "{}: warning: the parameters of type {} have changed since {} was commissioned",
            path.display(),
            actuator.type_name,
            actuator.name
        ));
    }
}

/// Refuses to begin a recording in a file that has something in it, or through a link: what was recorded is not to be replaced.
fn no_recording(output: &Path) -> Result<(), Misuse> {
    let is_link = std::fs::symlink_metadata(output).is_ok_and(|about| about.is_symlink());
    match std::fs::metadata(output) {
        found if is_link && found.as_ref().map_or(true, std::fs::Metadata::is_file) => Err(Misuse(format!(
            "--output: expected a file that is not there yet, or a folder, found {}, a link",
            output.display()
        ))),
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
pub struct Losses {
    listed: Vec<String>,
    total: u64,
}

impl Losses {
    /// Adds one, which says its place.
    pub fn add(&mut self, loss: &dyn std::fmt::Display) {
        self.total += 1;
        if self.listed.len() < LISTED_MAX {
            self.listed.push(loss.to_string());
        }
    }

    /// Tells what was lost, each with its place.
    pub fn list(&self, tell: &mut dyn FnMut(&str)) {
        for loss in &self.listed {
            tell(loss);
        }
        let more = self.total - self.listed.len() as u64;
        if more > 0 {
            tell(&counted(more, "more damaged place", "more damaged places"));
        }
    }

    /// The same, and how many there are; returns how the verb ends.
    pub fn exit(&self, tell: &mut dyn FnMut(&str)) -> Exit {
        if self.total == 0 {
            return Exit::Done;
        }
        self.list(tell);
        let places = counted(self.total, "damaged place", "damaged places");
        tell(&format!("data lost: {places} in the files read"));
        Exit::DataLost
    }
}

/// Writes a line to stderr, with what a terminal would obey escaped. An error of that cannot be reported anywhere.
pub fn warn(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr().lock(), "{}", printable(&line.to_string()));
}

/// The same for a verb whose messages a library may take instead.
fn to_stderr(line: &str) {
    warn(line);
}

/// Writes a line to stdout; a reader that has gone away is no failure.
fn say(line: &str) -> anyhow::Result<()> {
    match writeln!(std::io::stdout().lock(), "{line}") {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => std::process::exit(0),
        other => other.context("stdout"),
    }
}

/// The same of a verb that writes a file as well, which goes on without a reader.
#[cfg(feature = "full")]
fn say_beside(line: &str) -> anyhow::Result<()> {
    match writeln!(std::io::stdout().lock(), "{line}") {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.context("stdout"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_identify::unit_calibration::UnitError;

    #[test]
    fn what_the_assessor_refuses_is_a_bad_configuration_in_every_verb() {
        let refused = || {
            AssessError::from(UnitError::Parse {
                path: "unit.toml".to_owned(),
                message: "nothing".to_owned(),
            })
        };
        let errors = [
            anyhow::Error::from(refused()),
            ReplayError::Assess(refused()).into(),
            DaemonError::Assess(refused()).into(),
            anyhow::Error::from(refused()).context("actuator.calibration of ema0"),
        ];
        assert_eq!(errors.map(|error| code_of(&error)), [BAD_CONFIG; 4]);
        assert_eq!(
            code_of(&ReplayError::OutputIsInput { path: "a".to_owned() }.into()),
            FAILED
        );
    }
}
