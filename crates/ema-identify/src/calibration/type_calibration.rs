//! The calibration of one type of actuator as a whole: the monitor's coefficients, and how wrong it still is at several
//! sample rates. Made by `hmd calibrate --type`, stored as TOML, shipped for the built-in types.

use std::borrow::ToOwned;
use std::string::String;
use std::vec;
use std::vec::Vec;

use ema_models::{Calibration, FAULT_COUNT, Form, PaperShape, RIPPLE_KNOTS, Ripple, Signals, Weights};
use serde::{Deserialize, Serialize};

use super::mismatch::{Mismatch, NoiseBeside, SignalTable};

/// Version of the file's layout.
pub const CALIBRATION_VERSION: u32 = 3;

/// Form of the monitor model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MonitorForm {
    /// The paper's: one equivalent phase with its two shape functions.
    Paper,
    /// One equivalent phase with derived shapes.
    OneAxis,
    /// Three averaged phases.
    ThreePhase,
}

/// Calibration of one monitor form for one type of actuator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TypeCalibration {
    /// Layout version, [`CALIBRATION_VERSION`].
    pub version: u32,
    /// Name of the actuator type it was made for.
    pub actuator_type: String,
    /// Monitor form.
    pub monitor: MonitorForm,
    /// Factor on the back-EMF coefficient.
    pub back_emf: f64,
    /// Factor on the torque gain.
    pub torque: f64,
    /// Coefficient k_FS of the paper's eq. 10 (paper form).
    pub k_fs: f64,
    /// Coefficient k_E of the paper's eq. 11 (paper form).
    pub k_e: f64,
    /// Mean shortfall of the currents in the hysteresis band, in half bands, at the voltages [`ema_models::RIPPLE_VOLTAGES`]
    /// (three-phase form).
    pub ripple: [f64; RIPPLE_KNOTS],
    /// Factor on what a phase that stands apart from the others adds to it (three-phase form).
    pub ripple_apart: f64,
    /// How far the current's peaks reach beyond its mean at rest, in half bands (three-phase form).
    pub ripple_peak: f64,
    /// Time constant with which the currents of a vector drive follow their references, s; that of a commissioned unit, in no file of
    /// a type.
    #[serde(skip)]
    pub current_time_constant_s: f64,
    /// What the calibration was worth.
    pub quality: Quality,
    /// How wrong the monitor still is, at several sample rates; at least one.
    pub at_rate: Vec<Mismatch>,
}

/// Mean squared quadrature current error of the monitor at the true fault vector (\[P\] eqs. 12, 13 with the mean), A².
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quality {
    /// Healthy windows, before calibration.
    pub healthy_before_a2: f64,
    /// Healthy windows, after.
    pub healthy_after_a2: f64,
    /// Faulty windows, before.
    pub faulty_before_a2: f64,
    /// Faulty windows, after.
    pub faulty_after_a2: f64,
}

/// Why a calibration file was refused.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The file is no calibration.
    #[error("{path}: expected a type calibration, found {message}")]
    Parse {
        /// The file.
        path: String,
        /// Error of the parser, on one line.
        message: String,
    },
    /// The file is of another version.
    #[error(
        "{path}: expected calibration version {CALIBRATION_VERSION}, found {found}: make it anew with hmd calibrate --type"
    )]
    Version {
        /// The file.
        path: String,
        /// Its version.
        found: u32,
    },
    /// A number in it is impossible.
    #[error("{path}: {key}: expected a finite number {expected}, found {found}")]
    Value {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        found: f64,
    },
}

impl TypeCalibration {
    /// The calibration shipped with a built-in type, if there is one for this monitor form.
    #[must_use]
    pub fn built_in(actuator_type: &str, monitor: MonitorForm) -> Option<Self> {
        let text = match (actuator_type, monitor) {
            ("bench", MonitorForm::ThreePhase) => include_str!("../../calibration/bench.toml"),
            ("bench", MonitorForm::Paper) => include_str!("../../calibration/bench-paper.toml"),
            ("servo28", MonitorForm::ThreePhase) => include_str!("../../calibration/servo28.toml"),
            ("servo270", MonitorForm::ThreePhase) => include_str!("../../calibration/servo270.toml"),
            _ => return None,
        };
        Self::parse(text, "built-in calibration").ok()
    }

    /// What stands in for a calibration that nobody made: no correction, residuals of the size the hysteresis band and
    /// the sensors' steps give.
    #[must_use]
    pub fn uncalibrated(actuator_type: &str, monitor: MonitorForm, params: &ema_models::ActuatorParams) -> Self {
        let ripple = 0.7 * params.controller.hysteresis;
        let sensors = &params.sensors;
        Self {
            version: CALIBRATION_VERSION,
            actuator_type: actuator_type.to_owned(),
            monitor,
            back_emf: 1.0,
            torque: 1.0,
            k_fs: PaperShape::default().k_fs,
            k_e: PaperShape::default().k_e,
            ripple: Ripple::default().knots,
            ripple_apart: Ripple::default().unequal_phases,
            ripple_peak: Ripple::default().peak,
            current_time_constant_s: 0.0,
            quality: Quality {
                healthy_before_a2: 0.0,
                healthy_after_a2: 0.0,
                faulty_before_a2: 0.0,
                faulty_after_a2: 0.0,
            },
            at_rate: vec![Mismatch {
                sample_rate_hz: sensors.sample_rate,
                model_sigma: [0.02; FAULT_COUNT],
                residual_rms: SignalTable {
                    i_d: ripple,
                    i_q: ripple,
                    theta_m: 10.0 * sensors.motor_lsb(),
                    omega_m: 0.3 * sensors.motor_lsb() * sensors.sample_rate,
                    theta_out: 0.3 * sensors.output_lsb(),
                },
                correlation_samples: SignalTable {
                    i_d: 1.0,
                    i_q: 1.0,
                    theta_m: 300.0,
                    omega_m: 3.0,
                    theta_out: 1.0,
                },
            }],
        }
    }

    /// From the text of a file called `name`.
    ///
    /// # Errors
    /// [`CalibrationError`] when it is no calibration of this version.
    pub fn parse(text: &str, name: &str) -> Result<Self, CalibrationError> {
        /// What every version has.
        #[derive(Deserialize)]
        struct Versioned {
            version: u32,
        }
        let unreadable = |e: toml::de::Error| CalibrationError::Parse {
            path: name.to_owned(),
            message: e.message().replace('\n', " "),
        };
        // Both kinds of calibration are named in the same file.
        let table: toml::Table = toml::from_str(text).map_err(unreadable)?;
        if table.contains_key("estimator") {
            return Err(CalibrationError::Parse {
                path: name.to_owned(),
                message: "the calibration of a unit".to_owned(),
            });
        }
        // First the version: another one has other keys.
        let Versioned { version } = toml::from_str(text).map_err(unreadable)?;
        if version != CALIBRATION_VERSION {
            return Err(CalibrationError::Version {
                path: name.to_owned(),
                found: version,
            });
        }
        let parsed: Self = toml::from_str(text).map_err(unreadable)?;
        let refused = |key, expected, found| CalibrationError::Value {
            path: name.to_owned(),
            key,
            expected,
            found,
        };
        if parsed.at_rate.is_empty() {
            return Err(CalibrationError::Parse {
                path: name.to_owned(),
                message: "no table at_rate".to_owned(),
            });
        }
        let mut positive = vec![("back_emf", parsed.back_emf), ("torque", parsed.torque)];
        let mut not_negative = vec![
            ("ripple_apart", parsed.ripple_apart),
            ("ripple_peak", parsed.ripple_peak),
        ];
        for table in &parsed.at_rate {
            positive.push(("at_rate.sample_rate_hz", table.sample_rate_hz));
            for signal in Signals::from(table.residual_rms).to_array() {
                positive.push(("at_rate.residual_rms", signal));
            }
            for signal in Signals::from(table.correlation_samples).to_array() {
                positive.push(("at_rate.correlation_samples", signal));
            }
            not_negative.extend(table.model_sigma.iter().map(|&x| ("at_rate.model_sigma", x)));
        }
        if let Some(&(key, found)) = positive.iter().find(|(_, x)| !(x.is_finite() && *x > 0.0)) {
            return Err(refused(key, "above zero", found));
        }
        if let Some(&(key, found)) = not_negative.iter().find(|(_, x)| !(x.is_finite() && *x >= 0.0)) {
            return Err(refused(key, "not below zero", found));
        }
        let coefficients = [("k_fs", parsed.k_fs), ("k_e", parsed.k_e)];
        for (key, found) in coefficients.into_iter().chain(parsed.ripple.map(|x| ("ripple", x))) {
            if !found.is_finite() {
                return Err(refused(key, "", found));
            }
        }
        Ok(parsed)
    }

    /// As the text of a file.
    #[must_use]
    pub fn emit(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// The monitor's coefficients.
    #[must_use]
    pub fn coefficients(&self) -> Calibration {
        let form = match self.monitor {
            MonitorForm::Paper => Form::Paper(PaperShape {
                k_fs: self.k_fs,
                k_e: self.k_e,
            }),
            MonitorForm::OneAxis => Form::OneAxis,
            MonitorForm::ThreePhase => Form::ThreePhase,
        };
        Calibration {
            form,
            back_emf: self.back_emf,
            torque: self.torque,
            ripple: Ripple {
                knots: self.ripple,
                unequal_phases: self.ripple_apart,
                peak: self.ripple_peak,
            },
            current_time_constant: self.current_time_constant_s,
        }
    }

    /// The same for a unit whose currents follow their references with a time constant, s; 0 changes nothing. Such a drive has no
    /// hysteresis band.
    #[must_use]
    pub fn with_current_time_constant(self, current_time_constant_s: f64) -> Self {
        if current_time_constant_s > 0.0 {
            Self {
                current_time_constant_s,
                ripple: [0.0; RIPPLE_KNOTS],
                ripple_apart: 0.0,
                ripple_peak: 0.0,
                ..self
            }
        } else {
            self
        }
    }

    /// The same for windows of so many samples at a sample rate, Hz, whose signals have this noise beside.
    #[must_use]
    pub fn with_noise_beside(self, noise: &NoiseBeside, sample_rate: f64, samples: usize) -> Self {
        let at_rate = vec![
            self.mismatch_near(sample_rate)
                .with_noise_beside(noise, sample_rate, samples),
        ];
        Self { at_rate, ..self }
    }

    /// The table of the sample rate nearest to the given one, as a ratio.
    ///
    /// # Panics
    /// Without any table; a calibration that was read has one.
    #[must_use]
    pub fn mismatch_near(&self, sample_rate: f64) -> &Mismatch {
        let far = |table: &&Mismatch| (table.sample_rate_hz / sample_rate).ln().abs();
        let nearest = self.at_rate.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
        #[expect(clippy::expect_used, reason = "every way to make a calibration gives it a table")]
        nearest.expect("a calibration has a table")
    }

    /// Weight of each signal at a sample rate, Hz ([`Mismatch::weights`] of the nearest table).
    #[must_use]
    pub fn weights(&self, sample_rate: f64) -> Weights {
        self.mismatch_near(sample_rate)
            .weights(sample_rate, self.coefficients().form)
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn a_file_of_another_version_is_refused_for_its_version_and_not_for_its_keys() {
        let old = "version = 2\nripple = [0.1, 0.1]\nsomething = 1\n";
        let refused = TypeCalibration::parse(old, "old.toml").map(|_| ());
        let message = refused.map_err(|e| e.to_string()).unwrap_err();
        assert!(
            message.starts_with("old.toml: expected calibration version 3, found 2"),
            "{message}"
        );
    }
}
