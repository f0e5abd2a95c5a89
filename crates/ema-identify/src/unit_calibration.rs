//! The calibration of one motor, as text.

use std::borrow::ToOwned;
use std::format;
use std::string::String;

use ema_models::{MotorDeviation, MotorKnowledge};
use serde::{Deserialize, Serialize};

/// Version of the file's layout.
pub const UNIT_VERSION: u32 = 1;

/// How far one motor is off its type, as learnt from healthy windows of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitCalibration {
    /// Layout version, [`UNIT_VERSION`].
    pub version: u32,
    /// Name of the actuator type it is relative to.
    pub actuator_type: String,
    /// Healthy windows it was made from.
    pub windows: u32,
    /// Deviation of the phase resistance, as a share of the type's.
    pub resistance: f64,
    /// Deviation of the back-EMF coefficient, as a share of the type's.
    pub back_emf: f64,
    /// Standard deviation of the first.
    pub resistance_sigma: f64,
    /// Standard deviation of the second.
    pub back_emf_sigma: f64,
    /// Their correlation, above −1 and below 1.
    pub correlation: f64,
}

/// Why a unit's calibration was refused.
#[derive(Debug, thiserror::Error)]
pub enum UnitError {
    /// The file is no calibration of a unit.
    #[error("{path}: expected a unit's calibration, found {message}")]
    Parse {
        /// The file.
        path: String,
        /// What is wrong, on one line.
        message: String,
    },
    /// It is relative to another type.
    #[error("{path}: expected a unit of type {expected}, found one of type {found}")]
    Type {
        /// The file.
        path: String,
        /// Type of the configured actuator.
        expected: String,
        /// Type in the file.
        found: String,
    },
}

impl UnitCalibration {
    /// From what a fit found.
    #[must_use]
    pub fn new(actuator_type: &str, windows: u32, motor: &MotorKnowledge) -> Self {
        let [[a, b], [_, d]] = motor.covariance;
        Self {
            version: UNIT_VERSION,
            actuator_type: actuator_type.to_owned(),
            windows,
            resistance: motor.mean.resistance,
            back_emf: motor.mean.back_emf,
            resistance_sigma: a.sqrt(),
            back_emf_sigma: d.sqrt(),
            correlation: b / (a * d).sqrt(),
        }
    }

    /// What is known of the motor.
    #[must_use]
    pub fn motor(&self) -> MotorKnowledge {
        let mixed = self.correlation * self.resistance_sigma * self.back_emf_sigma;
        MotorKnowledge {
            mean: MotorDeviation {
                resistance: self.resistance,
                back_emf: self.back_emf,
            },
            covariance: [
                [self.resistance_sigma * self.resistance_sigma, mixed],
                [mixed, self.back_emf_sigma * self.back_emf_sigma],
            ],
        }
    }

    /// From the text of a file called `name`.
    ///
    /// # Errors
    /// [`UnitError`] when it is no calibration of a unit, or belongs to another type.
    pub fn parse(text: &str, name: &str, actuator_type: &str) -> Result<Self, UnitError> {
        let refused = |message: String| UnitError::Parse {
            path: name.to_owned(),
            message,
        };
        let unit: Self = toml::from_str(text).map_err(|e| refused(e.message().replace('\n', " ")))?;
        if unit.version != UNIT_VERSION {
            return Err(refused(format!("version {}, not {UNIT_VERSION}", unit.version)));
        }
        for (key, value, sound) in [
            ("resistance", unit.resistance, unit.resistance.abs() < 1.0),
            ("back_emf", unit.back_emf, unit.back_emf.abs() < 1.0),
            ("resistance_sigma", unit.resistance_sigma, unit.resistance_sigma > 0.0),
            ("back_emf_sigma", unit.back_emf_sigma, unit.back_emf_sigma > 0.0),
            ("correlation", unit.correlation, unit.correlation.abs() < 1.0),
        ] {
            if !(sound && value.is_finite()) {
                return Err(refused(format!("{key} = {value}")));
            }
        }
        if unit.actuator_type != actuator_type {
            return Err(UnitError::Type {
                path: name.to_owned(),
                expected: actuator_type.to_owned(),
                found: unit.actuator_type,
            });
        }
        Ok(unit)
    }

    /// As the text of a file.
    #[must_use]
    pub fn emit(&self) -> String {
        toml::to_string(self).expect("numbers, names and tables of them always serialise")
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn what_was_written_is_read_and_another_type_is_refused() {
        let motor = MotorKnowledge {
            mean: MotorDeviation {
                resistance: 0.03,
                back_emf: -0.02,
            },
            covariance: [[4e-4, -1e-7], [-1e-7, 1e-8]],
        };
        let unit = UnitCalibration::new("bench", 5, &motor);
        let read = UnitCalibration::parse(&unit.emit(), "unit.toml", "bench").unwrap();
        assert_eq!(read, unit);
        assert!((read.motor().covariance[0][1] + 1e-7).abs() < 1e-20);
        let other = UnitCalibration::parse(&unit.emit(), "unit.toml", "servo28").unwrap_err();
        assert_eq!(
            other.to_string(),
            "unit.toml: expected a unit of type servo28, found one of type bench"
        );
        let absurd = unit.emit().replace("correlation = -", "correlation = 7 #");
        assert!(UnitCalibration::parse(&absurd, "unit.toml", "bench").is_err());
    }
}
