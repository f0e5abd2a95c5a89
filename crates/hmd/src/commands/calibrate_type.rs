//! `hmd calibrate --type`: the monitor of a type of actuator against the reference model.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use hmd_core::config::{Config, MONITOR_NAMES};
use hmd_lab::calibrate_type::calibrate_type;

use super::{Misuse, unknown_type, warn};

/// Options of the calibration of a type.
#[derive(Debug, clap::Args)]
pub(super) struct TypeArgs {
    /// Calibrate a type of actuator: the monitor against the reference model.
    #[arg(long = "type", conflicts_with = "logs")]
    of_type: bool,
    /// With --type, the type to calibrate: bench (without it), servo28, servo270 or one of the configuration's.
    #[arg(long, value_name = "TYPE")]
    actuator: Option<String>,
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
        if !self.of_type && (self.actuator.is_some() || self.monitor.is_some()) {
            let sentence = "--actuator and --monitor: expected together with --type, found alone";
            return Err(Misuse(sentence.to_owned()));
        }
        Ok(self.of_type)
    }

    /// Calibrates the type and prints the error before and after.
    ///
    /// # Errors
    /// No type of that name.
    pub(super) fn calibrate(&self, config: &Config, seed: u64) -> anyhow::Result<TypeCalibration> {
        let name = self.actuator.as_deref().unwrap_or("bench");
        let Some(found) = config.actuator_type(name) else {
            return Err(unknown_type(name).into());
        };
        let form = self.monitor.unwrap_or(MonitorForm::ThreePhase);
        let calibration = calibrate_type(name, &found.params, form, seed);
        let q = &calibration.quality;
        warn(format_args!("mean squared error of i_q, A²   before      after"));
        warn(format_args!(
            "healthy                       {:.5}    {:.5}",
            q.healthy_before_a2, q.healthy_after_a2
        ));
        warn(format_args!(
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
