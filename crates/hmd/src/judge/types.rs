//! Types of actuators and the calibrations that they are judged with.

use std::path::Path;

use ema_models::ActuatorParams;
use sha2::{Digest, Sha256};

use super::JudgeError;
use crate::calibration::load_calibration;
use crate::config::Config;
use crate::seal::hex;
use ema_identify::calibration::{MonitorForm, TypeCalibration};

/// A type's calibration, and whether anybody made it.
#[derive(Clone, Debug)]
pub(super) struct KnownType {
    pub(super) calibration: TypeCalibration,
    pub(super) calibrated: bool,
}

impl KnownType {
    /// From a file if the configuration names one, else as shipped.
    ///
    /// A shipped calibration belongs to the shipped parameters; a type that changes them has none.
    pub(super) fn load(
        type_name: &str,
        params: &ActuatorParams,
        form: MonitorForm,
        path: Option<&Path>,
    ) -> Result<Self, JudgeError> {
        if let Some(path) = path {
            let calibration = load_calibration(path)?;
            if calibration.monitor != form {
                let path = path.display().to_string();
                return Err(JudgeError::Form {
                    path,
                    expected: form,
                    found: calibration.monitor,
                });
            }
            return Ok(Self {
                calibration,
                calibrated: true,
            });
        }
        // The sample rate does not count: it is read from the device's own time, and the calibration serves any.
        let shipped_params = match type_name {
            "bench" => Some(ActuatorParams::bench()),
            "servo28" => Some(ActuatorParams::servo28()),
            _ => None,
        };
        let unchanged = shipped_params.is_some_and(|mut shipped| {
            shipped.sensors.sample_rate = params.sensors.sample_rate;
            shipped == *params
        });
        let shipped = TypeCalibration::built_in(type_name, form).filter(|_| unchanged);
        Ok(match shipped {
            Some(calibration) => Self {
                calibration,
                calibrated: true,
            },
            None => Self {
                calibration: TypeCalibration::uncalibrated(type_name, form, params),
                calibrated: false,
            },
        })
    }
}

/// Hash of the calibrations that a configuration's types are judged with, as shipped or as their files stand.
#[must_use]
pub fn model_hash(config: &Config) -> String {
    let mut hash = Sha256::new();
    let form = config.identification().monitor;
    let mut types: Vec<&str> = config.actuators().iter().map(|a| a.type_name.as_str()).collect();
    types.push("bench");
    types.sort_unstable();
    types.dedup();
    for name in types {
        if let Some(found) = config.actuator_type(name) {
            let path = found.calibration.as_deref().map(|path| config.resolve(path));
            if let Ok(known) = KnownType::load(name, &found.params, form, path.as_deref()) {
                hash.update(known.calibration.emit());
            }
        }
    }
    hex(&hash.finalize())
}
