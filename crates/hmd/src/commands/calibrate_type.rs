//! `hmd calibrate --type`: the monitor of a type of actuator against the reference model, or its parameters by several units.

use std::path::PathBuf;

use anyhow::Context;
use ema_identify::calibration::{MonitorForm, TypeCalibration};
use hmd_core::config::{ActuatorType, Config, MONITOR_NAMES};
use hmd_core::type_of_units::type_of_units;
use hmd_lab::calibrate_type::{calibrate_type, pieces};
use hmd_storage::calibration_file::load_unit;

use super::progress::over_pieces;
use super::{Misuse, unknown_type};

/// Options of the calibration of a type.
#[derive(Debug, clap::Args)]
pub(super) struct TypeArgs {
    /// Calibrate a type of actuator: the monitor against the reference model.
    #[arg(long = "type", conflicts_with = "logs")]
    of_type: bool,
    /// With --type, the type to calibrate: bench (without it), servo28, servo270 or one of the configuration's.
    #[arg(long, value_name = "TYPE")]
    actuator: Option<String>,
    /// With --type, the calibrations of three units of the type or more: values and tolerances of the type, as a part of a configuration.
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "monitor")]
    units: Vec<PathBuf>,
    /// With --type, the monitor form: three-phase (without it), one-axis or paper.
    #[arg(long, value_parser = named_monitor)]
    monitor: Option<MonitorForm>,
}

impl TypeArgs {
    /// Whether a type is to be calibrated and not a unit.
    ///
    /// # Errors
    /// An option of a type without `--type`.
    pub(super) fn is_requested(&self) -> Result<bool, Misuse> {
        let has_option = self.actuator.is_some() || self.monitor.is_some() || !self.units.is_empty();
        if !self.of_type && has_option {
            let sentence = "--actuator, --monitor and --units: expected together with --type, found alone";
            return Err(Misuse(sentence.to_owned()));
        }
        Ok(self.of_type)
    }

    /// The calibrations of units that the type is made of; none where it is calibrated against the reference.
    pub(super) fn units(&self) -> &[PathBuf] {
        &self.units
    }

    /// The type and its name.
    fn found<'a>(&'a self, config: &'a Config) -> Result<(&'a str, &'a ActuatorType), Misuse> {
        let name = self.actuator.as_deref().unwrap_or("bench");
        let found = config.actuator_type(name).ok_or_else(|| unknown_type(name))?;
        Ok((name, found))
    }

    /// The type that the units have in common, as a part of a configuration; tells what was found.
    ///
    /// # Errors
    /// No type of that name, a file that is no calibration of a unit of it, or too few units.
    pub(super) fn of_units(&self, config: &Config, tell: &mut dyn FnMut(&str)) -> anyhow::Result<String> {
        let (name, found) = self.found(config)?;
        let mut units = Vec::with_capacity(self.units.len());
        for path in &self.units {
            // The exit code of a bad configuration belongs to files that it names.
            let unit = load_unit(path, name).map_err(|error| anyhow::anyhow!("{error}"))?;
            units.push((path.display().to_string(), unit));
        }
        let common = type_of_units(name, found, &units)?;
        for line in common.in_words() {
            tell(&line);
        }
        Ok(common.emit())
    }

    /// Calibrates the type and tells the error before and after.
    ///
    /// # Errors
    /// No type of that name, or one that no monitor follows.
    pub(super) fn calibrate(
        &self,
        config: &Config,
        seed: u64,
        tell: &mut dyn FnMut(&str),
    ) -> anyhow::Result<TypeCalibration> {
        let (name, found) = self.found(config)?;
        let form = self.monitor.unwrap_or(MonitorForm::ThreePhase);
        let bar = over_pieces(pieces(form));
        let calibration = calibrate_type(name, &found.params, form, seed, &|| bar.inc(1));
        bar.finish_and_clear();
        let calibration = calibration.with_context(|| format!("type {name}"))?;
        let q = &calibration.quality;
        tell("mean squared error of i_q, A²   before      after");
        tell(&format!(
            "healthy                       {:.5}    {:.5}",
            q.healthy_before_a2, q.healthy_after_a2
        ));
        tell(&format!(
            "faulty                        {:.5}    {:.5}",
            q.faulty_before_a2, q.faulty_after_a2
        ));
        Ok(calibration)
    }
}

/// The monitor form of a name.
pub(super) fn named_monitor(text: &str) -> Result<MonitorForm, String> {
    let found = MONITOR_NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, form)| form)
        .ok_or_else(|| "expected three-phase, one-axis or paper".to_owned())
}
