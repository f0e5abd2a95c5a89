//! What was learnt of one unit from its healthy windows, as the text of a file.
//!
//! In: the text of a unit file, written by `hmd calibrate LOG…`. Out: [`UnitCalibration`], every number checked. The file holds both
//! estimators where both could be learnt, and names the one that assesses the unit's windows.

mod elements;
mod parameters;
mod seen;

use std::borrow::ToOwned;
use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};

use ema_models::{FaultId, MotorDeviation, MotorKnowledge};
use serde::{Deserialize, Serialize};

use crate::relations::{CommissionedRelations, ELEMENT_COUNT, MeasurementNoise};

pub use elements::{ElementStatistics, NORMAL_999, change_since, elements_of, fault_of, nominal_elements};
pub(crate) use parameters::apply;
pub use parameters::{Deviation, UNIT_PARAMETER_COUNT, UnitParameter, UnitParameters};
pub use seen::{Motion, RATE_MARGIN, Seen, Unseen};

/// Version of the file's layout.
pub const UNIT_VERSION: u32 = 3;

/// How the windows of a unit are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UnitEstimator {
    /// The monitor with the unit's parameters, corrected by what healthy windows show.
    Monitor,
    /// The relations between measured signals.
    Relations,
    /// Both, each fault by the one that shows it better in a window.
    Both,
}

/// What was learnt of one unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitCalibration {
    /// Layout version, [`UNIT_VERSION`].
    pub version: u32,
    /// Program and version that wrote it.
    pub made_by: String,
    /// Name of the actuator type it is relative to.
    pub actuator_type: String,
    /// Hash of the type's parameters.
    pub parameters_hash: String,
    /// Part number of the unit, where configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_number: Option<String>,
    /// Serial number of the unit, where configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial_number: Option<String>,
    /// Healthy windows it was made from.
    pub windows: u32,
    /// What assesses its windows.
    pub estimator: UnitEstimator,
    /// Why this estimator.
    pub estimator_reason: String,
    /// Zero of the output's angle against the motor's behind the gear, rad, but for whole turns of the motor; where the windows show it. Older
    /// files had none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_zero_rad: Option<f64>,
    /// Under which conditions the windows were recorded.
    pub seen: Seen,
    /// Smallest damage of each fault that a window shows with a probability of 99 % at a false alarm rate of 0.1 %; without the
    /// faults that the windows do not show.
    pub smallest_damage: BTreeMap<String, f64>,
    /// The monitor, where it explains the unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monitor: Option<UnitMonitor>,
    /// The relations, where the windows determine them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relations: Option<UnitRelations>,
    /// What the windows show of the sensors; older files had none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensors: Option<CommissionedSensors>,
}

/// The sensors of a unit at commissioning.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommissionedSensors {
    /// Start of the newest window, UTC ns.
    pub until_ns: i64,
    /// Each quantity that enough windows show, by its name in records.
    pub quantities: BTreeMap<String, CommissionedQuantity>,
}

/// One quantity of the sensors at commissioning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommissionedQuantity {
    /// Windows that show it.
    pub windows: u32,
    /// Their mean.
    pub mean: f64,
    /// Standard deviation from window to window.
    pub scatter: f64,
}

/// The monitor of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitMonitor {
    /// Mean cost of the healthy windows.
    pub cost: f64,
    /// Deviations from the type.
    pub parameters: UnitParameters,
    /// Time constant with which the currents follow their references, s; 0 where comparators hold them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub current_time_constant_s: f64,
    /// Apparent fault vector of the healthy windows, by element.
    pub baseline: [ElementStatistics; ELEMENT_COUNT],
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &f64) -> bool {
    value.to_bits() == 0
}

impl UnitMonitor {
    /// What is known of the motor.
    #[must_use]
    pub fn motor(&self) -> MotorKnowledge {
        let (resistance, back_emf) = (self.parameters.resistance, self.parameters.back_emf);
        let mixed = self.parameters.resistance_back_emf_correlation * resistance.sigma * back_emf.sigma;
        MotorKnowledge {
            mean: MotorDeviation {
                resistance: resistance.share,
                back_emf: back_emf.share,
            },
            covariance: [
                [resistance.sigma * resistance.sigma, mixed],
                [mixed, back_emf.sigma * back_emf.sigma],
            ],
        }
    }
}

/// The relations of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitRelations {
    /// Root-mean-square residual of the torque balance in windows that were left out, Nm.
    pub residual_rms_nm: f64,
    /// Factor on the sigma of each element, at least 1: how much farther windows that were left out lie from no change.
    pub sigma_factors: [f64; ELEMENT_COUNT],
    /// Noise of the measured signals in the windows; older files had none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<MeasurementNoise>,
    /// What was learnt of all windows.
    pub commissioned: CommissionedRelations,
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
    /// It has another layout.
    #[error(
        "{path}: expected unit calibration version {UNIT_VERSION}, found {found}: make it anew with hmd calibrate LOG…"
    )]
    Version {
        /// The file.
        path: String,
        /// Its version.
        found: i64,
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
    /// From the text of a file called `name`.
    ///
    /// # Errors
    /// [`UnitError`] when it is no calibration of a unit, or belongs to another type.
    pub fn parse(text: &str, name: &str, actuator_type: &str) -> Result<Self, UnitError> {
        let refused = |message: String| UnitError::Parse {
            path: name.to_owned(),
            message,
        };
        let on_one_line = |e: toml::de::Error| refused(e.message().replace('\n', " "));
        let table: toml::Table = toml::from_str(text).map_err(on_one_line)?;
        if table.contains_key("at_rate") {
            return Err(refused("the calibration of a type".to_owned()));
        }
        match table.get("version").and_then(toml::Value::as_integer) {
            Some(version) if version == i64::from(UNIT_VERSION) => {}
            Some(found) => {
                return Err(UnitError::Version {
                    path: name.to_owned(),
                    found,
                });
            }
            None => return Err(refused("no version".to_owned())),
        }
        if let Some(key) = not_finite(&table) {
            return Err(refused(format!("{key}: a number that is not finite")));
        }
        let unit: Self = toml::from_str(text).map_err(on_one_line)?;
        if let Some(defect) = unit.defect() {
            return Err(refused(defect));
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

    /// What is wrong with finite numbers, if anything.
    fn defect(&self) -> Option<String> {
        let has_estimator = match self.estimator {
            UnitEstimator::Monitor => self.monitor.is_some(),
            UnitEstimator::Relations => self.relations.is_some(),
            UnitEstimator::Both => self.monitor.is_some() && self.relations.is_some(),
        };
        if !has_estimator {
            return Some(format!("the estimator {:?} without its table", self.estimator));
        }
        if let Some(unknown) = self
            .smallest_damage
            .keys()
            .find(|name| FaultId::from_name(name).is_none())
        {
            return Some(format!("smallest_damage.{unknown}: no fault"));
        }
        if let Some(zero) = self.output_zero_rad.filter(|zero| zero.abs() > core::f64::consts::TAU) {
            return Some(format!("output_zero_rad = {zero}"));
        }
        if let Some(monitor) = &self.monitor {
            if monitor.current_time_constant_s < 0.0 {
                return Some(format!(
                    "monitor.current_time_constant_s = {}",
                    monitor.current_time_constant_s
                ));
            }
            if monitor.cost < 0.0 {
                return Some(format!("monitor.cost = {}", monitor.cost));
            }
            if let Some(found) = monitor.baseline.iter().find(|found| found.scatter < 0.0) {
                return Some(format!("monitor.baseline: a scatter of {}", found.scatter));
            }
            if let Some(defect) = monitor.parameters.defect() {
                return Some(format!("monitor.parameters: {defect}"));
            }
        }
        for (name, of) in self.sensors.iter().flat_map(|sensors| &sensors.quantities) {
            if of.windows < 2 || of.scatter < 0.0 {
                return Some(format!(
                    "sensors.quantities.{name}: a scatter of {} in {} windows",
                    of.scatter, of.windows
                ));
            }
        }
        if let Some(relations) = &self.relations {
            if relations.residual_rms_nm < 0.0 {
                return Some(format!("relations.residual_rms_nm = {}", relations.residual_rms_nm));
            }
            if let Some(factor) = relations.sigma_factors.iter().find(|&&factor| factor < 1.0) {
                return Some(format!("relations.sigma_factors: {factor}, below 1"));
            }
        }
        None
    }

    /// As the text of a file.
    #[must_use]
    pub fn emit(&self) -> String {
        toml::to_string(self).expect("numbers, names and tables of them always serialise")
    }
}

/// Key of the first number of a table that is not finite.
fn not_finite(table: &toml::Table) -> Option<String> {
    fn in_value(value: &toml::Value) -> bool {
        match value {
            toml::Value::Float(x) => !x.is_finite(),
            toml::Value::Array(values) => values.iter().any(in_value),
            toml::Value::Table(table) => table.values().any(in_value),
            _ => false,
        }
    }
    table
        .iter()
        .find(|(_, value)| in_value(value))
        .map(|(key, _)| key.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::TypeCalibration;

    fn by_monitor() -> UnitCalibration {
        let deviation = |share| Deviation { share, sigma: 0.01 };
        UnitCalibration {
            version: UNIT_VERSION,
            made_by: "hmd".to_owned(),
            actuator_type: "bench".to_owned(),
            parameters_hash: "00".to_owned(),
            part_number: None,
            serial_number: Some("0042".to_owned()),
            windows: 12,
            estimator: UnitEstimator::Monitor,
            estimator_reason: "hysteresis drive".to_owned(),
            output_zero_rad: Some(0.0125),
            seen: Seen {
                winding_temp_deg_c: Some([18.0, 25.0]),
                ..Seen::default()
            },
            smallest_damage: [("friction".to_owned(), 0.06)].into(),
            monitor: Some(UnitMonitor {
                cost: 2.1,
                parameters: UnitParameters {
                    resistance: deviation(0.03),
                    back_emf: deviation(-0.02),
                    inductance: deviation(0.07),
                    inertia: deviation(0.0),
                    viscous_damping: deviation(0.5),
                    dry_friction: deviation(-0.2),
                    position_gain: deviation(0.01),
                    speed_gain: deviation(0.0),
                    integral_gain: deviation(0.0),
                    speed_limit: deviation(-0.01),
                    current_limit: deviation(0.0),
                    resistance_back_emf_correlation: -0.1,
                },
                current_time_constant_s: 2e-4,
                baseline: [ElementStatistics {
                    mean: 0.01,
                    scatter: 0.002,
                    windows: 12,
                }; ELEMENT_COUNT],
            }),
            relations: None,
            sensors: None,
        }
    }

    fn refused(text: &str, actuator_type: &str) -> String {
        let refused = UnitCalibration::parse(text, "unit.toml", actuator_type);
        refused.expect_err("refused").to_string()
    }

    #[test]
    fn what_was_written_is_read() {
        let unit = by_monitor();
        let read = UnitCalibration::parse(&unit.emit(), "unit.toml", "bench").unwrap();
        assert_eq!(read, unit);
        let covariance = read.monitor.unwrap().motor().covariance;
        assert!((covariance[0][1] + 0.1 * 1e-4).abs() < 1e-15);
    }

    #[test]
    fn files_that_are_no_calibration_of_this_unit_are_refused() {
        let text = by_monitor().emit();
        assert_eq!(
            refused(&text, "servo28"),
            "unit.toml: expected a unit of type servo28, found one of type bench"
        );
        for (what, by, reason) in [
            (
                "version = 3",
                "version = 1",
                "expected unit calibration version 3, found 1: make it anew",
            ),
            ("version = 3", "", "found no version"),
            (
                "estimator = \"monitor\"",
                "estimator = \"relations\"",
                "the estimator Relations without its table",
            ),
            ("cost = 2.1", "cost = nan", "monitor: a number that is not finite"),
            (
                "friction = 0.06",
                "fraction = 0.06",
                "smallest_damage.fraction: no fault",
            ),
            (
                "share = 0.07",
                "share = -1.5",
                "a deviation of motor.phase_inductance_h of -1.5",
            ),
            ("correlation = -0.1", "correlation = 7.0", "a correlation of 7"),
        ] {
            let found = refused(&text.replacen(what, by, 1), "bench");
            assert!(found.contains(reason), "{what} -> {by}: {found}");
        }
    }

    #[test]
    fn calibrations_of_types_and_units_are_told_apart() {
        let of_type = include_str!("../calibration/bench.toml");
        assert_eq!(
            refused(of_type, "bench"),
            "unit.toml: expected a unit's calibration, found the calibration of a type"
        );
        let refused = TypeCalibration::parse(&by_monitor().emit(), "type.toml").unwrap_err();
        assert_eq!(
            refused.to_string(),
            "type.toml: expected a type calibration, found the calibration of a unit"
        );
    }
}
