//! A type from several commissioned units: what is common becomes its value, what differs its tolerance.
//!
//! In: the calibrations of units of one type. Out: [`TypeOfUnits`], which is emitted as a part of a configuration. Of each parameter the
//! mean over the units is the value. The tolerance is the standard deviation of a further unit: with s² the variance between n units and
//! σ² the mean variance of one unit's own value,
//! `τ² = (1 + 1/n) max(s² − σ², σ² √(2/(n − 1)))`. The second term is the standard error of the first where the units differ by
//! no more than their own uncertainty, so that no tolerance is smaller than so many units can show. Derived here.

use std::fmt::Write;

use ema_identify::relations::{Element, Term};
use ema_identify::unit_calibration::{UnitCalibration, UnitParameter};
use ema_models::{ActuatorParams, Tolerances};

use crate::assess::hash_of_parameters;
use crate::config::ActuatorType;

/// Fewest units that show how units differ.
pub const UNITS_MIN: usize = 3;

/// Share of its tolerance up to which a unit's own standard deviation counts as a measurement.
const MEASURED_SHARE: f64 = 0.7;

/// Why units make no type.
#[derive(Debug, thiserror::Error)]
pub enum TypeOfUnitsError {
    /// Too few units.
    #[error("expected the calibrations of at least {UNITS_MIN} units, found {0}")]
    TooFew(usize),
    /// A unit is relative to other parameters.
    #[error(
        "{unit}: expected a unit commissioned with the parameters that type {type_name} has now, found one with others: commission it again"
    )]
    OtherParameters {
        /// The unit.
        unit: String,
        /// The type.
        type_name: String,
    },
    /// No parameter is measured by enough units.
    #[error("expected a parameter that {UNITS_MIN} units measure better than its tolerance, found none")]
    NothingMeasured,
}

/// A parameter of a type as its units have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommonParameter {
    /// Group and key in a type's section.
    pub key: (&'static str, &'static str),
    /// Value of the type until now, SI.
    pub of_type: f64,
    /// Mean of the units, SI.
    pub mean: f64,
    /// One standard deviation of a further unit, share of the mean.
    pub tolerance: f64,
    /// Units that measure it.
    pub units: usize,
}

/// What units of one type have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct TypeOfUnits {
    /// Name of the type.
    pub type_name: String,
    /// Units.
    pub units: usize,
    /// Parameters that are measured.
    pub parameters: Vec<CommonParameter>,
    /// Keys of those that are not: they stay as they are.
    pub open: Vec<&'static str>,
}

/// A parameter of one unit.
#[derive(Clone, Copy)]
struct Measured {
    value: f64,
    sigma: f64,
}

/// The type of several units, each with its name.
///
/// # Errors
/// [`TypeOfUnitsError`].
pub fn type_of_units(
    type_name: &str,
    of_type: &ActuatorType,
    units: &[(String, UnitCalibration)],
) -> Result<TypeOfUnits, TypeOfUnitsError> {
    if units.len() < UNITS_MIN {
        return Err(TypeOfUnitsError::TooFew(units.len()));
    }
    let expected = hash_of_parameters(of_type);
    if let Some((unit, _)) = units.iter().find(|(_, unit)| unit.parameters_hash != expected) {
        return Err(TypeOfUnitsError::OtherParameters {
            unit: unit.clone(),
            type_name: type_name.to_owned(),
        });
    }
    let (params, tolerances) = (&of_type.params, &of_type.tolerances);
    let mut found = TypeOfUnits {
        type_name: type_name.to_owned(),
        units: units.len(),
        parameters: Vec::new(),
        open: Vec::new(),
    };
    for parameter in Parameter::all() {
        let value = parameter.value(params);
        let limit = MEASURED_SHARE * parameter.tolerance(tolerances) * value;
        let measured: Vec<Measured> = units
            .iter()
            .filter_map(|(_, unit)| parameter.of_unit(unit, params))
            .filter(|measured| measured.sigma < limit)
            .collect();
        match common(&measured) {
            Some((mean, spread)) => found.parameters.push(CommonParameter {
                key: parameter.key(),
                of_type: value,
                mean,
                tolerance: spread / mean,
                units: measured.len(),
            }),
            None => found.open.push(parameter.key().1),
        }
    }
    if found.parameters.is_empty() {
        return Err(TypeOfUnitsError::NothingMeasured);
    }
    Ok(found)
}

/// Mean and standard deviation of a further unit; `None` from fewer than three units, or without a positive mean.
fn common(units: &[Measured]) -> Option<(f64, f64)> {
    if units.len() < UNITS_MIN {
        return None;
    }
    let n = units.len() as f64;
    let mean = units.iter().map(|unit| unit.value).sum::<f64>() / n;
    let between = units.iter().map(|unit| (unit.value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let own = units.iter().map(|unit| unit.sigma * unit.sigma).sum::<f64>() / n;
    let variance = (between - own).max(own * (2.0 / (n - 1.0)).sqrt());
    (mean > 0.0).then(|| (mean, ((1.0 + 1.0 / n) * variance).sqrt()))
}

/// A parameter that units measure and a type has.
#[derive(Clone, Copy)]
enum Parameter {
    OfUnit(UnitParameter),
    StaticFriction,
    Backlash,
}

impl Parameter {
    fn all() -> impl Iterator<Item = Self> {
        // Those of the controller also stand for what the monitor's controller lacks.
        let of_unit = UnitParameter::ALL
            .into_iter()
            .filter(|parameter| !parameter.is_of_controller())
            .map(Self::OfUnit);
        of_unit.chain([Self::StaticFriction, Self::Backlash])
    }

    fn key(self) -> (&'static str, &'static str) {
        match self {
            Self::OfUnit(parameter) => parameter.key().split_once('.').unwrap_or(("", parameter.key())),
            Self::StaticFriction => ("transmission", "static_friction_nm"),
            Self::Backlash => ("transmission", "backlash_rad"),
        }
    }

    fn value(self, params: &ActuatorParams) -> f64 {
        match self {
            Self::OfUnit(parameter) => parameter.value(params),
            Self::StaticFriction => params.transmission.friction_static,
            Self::Backlash => params.transmission.backlash,
        }
    }

    fn tolerance(self, tolerances: &Tolerances) -> f64 {
        match self {
            Self::OfUnit(parameter) => parameter.tolerance(tolerances),
            // It is learnt together with T_d.
            Self::StaticFriction => UnitParameter::DryFriction.tolerance(tolerances),
            Self::Backlash if tolerances.backlash > 0.0 => tolerances.backlash,
            Self::Backlash => Tolerances::USUAL.backlash,
        }
    }

    /// What a unit's calibration says of it, if it does.
    fn of_unit(self, unit: &UnitCalibration, params: &ActuatorParams) -> Option<Measured> {
        match self {
            Self::OfUnit(parameter) => measured(unit, parameter, params),
            Self::StaticFriction => {
                let dry = measured(unit, UnitParameter::DryFriction, params)?;
                let share = params.transmission.friction_static / params.transmission.friction_dynamic;
                let share = if share.is_finite() { share } else { 1.0 };
                Some(Measured {
                    value: share * dry.value,
                    sigma: share * dry.sigma,
                })
            }
            Self::Backlash => {
                let play = unit.relations?.commissioned.baseline[Element::Backlash as usize];
                (play.windows > 0).then(|| Measured {
                    value: play.mean,
                    sigma: play.scatter.max(play.sigma) / (play.windows as f64).sqrt(),
                })
            }
        }
    }
}

/// By the relations, where they were learnt: torques relative to the type's k, nothing electrical. The monitor finds the scale of
/// torques by the supply's limit alone, with a bias of several of its sigmas: units of the reference with R +2 to +8 % and k −2 to
/// +2 % came out as −26 to +4 % and 0 to +2.5 %.
fn measured(unit: &UnitCalibration, parameter: UnitParameter, params: &ActuatorParams) -> Option<Measured> {
    let Some(relations) = unit.relations else {
        let (deviation, of_type) = (unit.monitor?.parameters.of(parameter), parameter.value(params));
        return Some(Measured {
            value: (1.0 + deviation.share) * of_type,
            sigma: deviation.sigma * of_type,
        });
    };
    let term = match parameter {
        UnitParameter::Inertia => Term::Inertia,
        UnitParameter::Damping => Term::Damping,
        UnitParameter::DryFriction => Term::DryFriction,
        _ => return None,
    };
    Some(Measured {
        value: relations.commissioned.balance.of(term),
        sigma: relations.commissioned.sigma_of(term)?,
    })
}

impl TypeOfUnits {
    /// As a part of a configuration: values and tolerances of the type.
    #[must_use]
    pub fn emit(&self) -> String {
        let mut text = format!(
            "# Type {} by {} commissioned units: their mean, and their spread as tolerance (one standard deviation, share of the value).\n\
             # Made by hmd {}. Calibrate the type and commission its units again.\n",
            self.type_name,
            self.units,
            env!("CARGO_PKG_VERSION")
        );
        let mut group = "";
        // Groups in the order of their first parameter; the table of parameters is sorted by group.
        for CommonParameter {
            key, mean, tolerance, ..
        } in &self.parameters
        {
            if group != key.0 {
                group = key.0;
                let _ = writeln!(text, "\n[type.{}.{group}]", self.type_name);
            }
            let _ = writeln!(
                text,
                "{} = {}\n{}_tolerance = {}",
                key.1,
                rounded(*mean),
                key.1,
                rounded(*tolerance)
            );
        }
        text
    }

    /// For an operator: each parameter, and what stays as it is.
    #[must_use]
    pub fn in_words(&self) -> Vec<String> {
        let mut lines: Vec<String> = self
            .parameters
            .iter()
            .map(|common| {
                format!(
                    "{}.{}: {} ± {:.1} % by {} units, {:+.1} % from the type",
                    common.key.0,
                    common.key.1,
                    rounded(common.mean),
                    100.0 * common.tolerance,
                    common.units,
                    100.0 * (common.mean / common.of_type - 1.0)
                )
            })
            .collect();
        if !self.open.is_empty() {
            lines.push(format!(
                "not measured by {UNITS_MIN} units, left as in the type: {}",
                self.open.join(", ")
            ));
        }
        lines
    }
}

/// To four significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units(values: &[f64], sigma: f64) -> Vec<Measured> {
        values.iter().map(|&value| Measured { value, sigma }).collect()
    }

    #[test]
    fn the_units_own_uncertainty_is_no_spread() {
        let values = [0.9, 1.0, 1.1, 1.0, 1.0];
        let variance = 0.02 / 4.0;
        let (mean, exact) = common(&units(&values, 0.0)).unwrap();
        assert!((mean - 1.0).abs() < 1e-12 && (exact * exact - 1.2 * variance).abs() < 1e-12);
        let (_, uncertain) = common(&units(&values, 0.05)).unwrap();
        assert!((uncertain * uncertain - 1.2 * (variance - 0.0025)).abs() < 1e-12);
    }

    #[test]
    fn units_that_agree_leave_a_tolerance_all_the_same() {
        let (_, few) = common(&units(&[1.0; 3], 0.01)).unwrap();
        let (_, many) = common(&units(&[1.0; 30], 0.01)).unwrap();
        assert!(many < few && many > 0.004, "{few} {many}");
        assert!(common(&units(&[1.0; 2], 0.01)).is_none());
    }
}
