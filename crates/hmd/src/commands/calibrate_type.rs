//! `hmd calibrate --type`: the monitor of a type of actuator against the reference model.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use hmd_core::config::{Config, MONITOR_NAMES};
use hmd_lab::calibrate_type::calibrate_type;

use super::{unknown_type, warn};

/// Options of the calibration of a type.
#[derive(Debug, clap::Args)]
pub(super) struct TypeArgs {
    /// Calibrate a type of actuator: the monitor against the reference model.
    #[arg(long = "type", conflicts_with = "logs")]
    of_type: bool,
    /// Type to calibrate: bench, servo28 or one of the configuration's.
    #[arg(long, default_value = "bench", value_name = "TYPE", requires = "of_type")]
    actuator: String,
    /// Monitor form of the type: three-phase, one-axis or paper.
    #[arg(long, default_value = "three-phase", value_parser = named_monitor, requires = "of_type")]
    monitor: MonitorForm,
}

impl TypeArgs {
    /// Whether a type is to be calibrated and not a unit.
    pub(super) fn is_asked(&self) -> bool {
        self.of_type
    }

    /// Calibrates the type and prints the error before and after.
    ///
    /// # Errors
    /// No type of that name.
    pub(super) fn calibrate(&self, config: &Config, seed: u64) -> anyhow::Result<TypeCalibration> {
        let Some(found) = config.actuator_type(&self.actuator) else {
            return Err(unknown_type(&self.actuator).into());
        };
        let calibration = calibrate_type(&self.actuator, &found.params, self.monitor, seed);
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
