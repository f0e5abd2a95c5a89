//! Every effective parameter of a type or unit, where its value comes from, and how well it is known.

use std::collections::BTreeMap;
use std::fmt::{self, Write};

use ema_identify::relations::Term;
use ema_identify::unit_calibration::{UnitCalibration, UnitEstimator, UnitParameter};
use ema_models::ActuatorParams;
use serde::{Serialize, Serializer};

use super::actuator_type::{ActuatorType, parameters_as_text};
use super::{Config, drive, params, tolerances};

/// Where a value comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A built-in type.
    BuiltIn(&'static str),
    /// The tolerances of a type that sets none, by their word in the file: `usual` or `exact`.
    Tolerances(&'static str),
    /// File and line of the configuration, or the calibration of a unit.
    File(String),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn(name) => write!(f, "built-in {name}"),
            Self::Tolerances(word) => f.write_str(word),
            Self::File(place) => f.write_str(place),
        }
    }
}

impl Serialize for Origin {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A parameter, or an effect that has a tolerance only.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EffectiveParameter {
    /// Group and key in the file, such as `motor.inertia_kg_m2`.
    pub key: String,
    /// Value in the unit of the key; `None`: an effect whose value is not known.
    pub value: Option<f64>,
    /// Where the value comes from.
    pub origin: Option<Origin>,
    /// One standard deviation: a share of the value, or of an effect as its key says; `None`: taken as exact.
    pub tolerance: Option<f64>,
    /// Where the tolerance comes from.
    pub tolerance_origin: Option<Origin>,
}

impl Config {
    /// The effective parameters of each type that an actuator uses or the file describes, by type.
    #[must_use]
    pub fn effective_parameters(&self) -> BTreeMap<&str, Vec<EffectiveParameter>> {
        self.types()
            .filter(|(name, of_type)| of_type.origins.is_configured || self.is_used(name))
            .map(|(name, of_type)| (name, of_type.effective_parameters()))
            .collect()
    }

    /// Whether an actuator is of a type.
    #[must_use]
    pub fn is_used(&self, type_name: &str) -> bool {
        self.actuators.iter().any(|actuator| actuator.type_name == type_name)
    }

    /// Types that the file describes and no actuator uses.
    pub fn unused_types(&self) -> impl Iterator<Item = &str> {
        self.types()
            .filter(|(name, of_type)| of_type.origins.is_configured && !self.is_used(name))
            .map(|(name, _)| name)
    }
}

impl ActuatorType {
    /// The built-in type that it starts from.
    #[must_use]
    pub fn built_in(&self) -> &'static str {
        self.origins.built_in
    }

    /// Parameters that the type, called `name`, takes from the built-in type that it starts from; none where it is that type, but for its
    /// tolerances and the sample rate.
    #[must_use]
    pub fn inherited(&self, name: &str) -> Vec<String> {
        let of_base = ActuatorParams::built_in(self.built_in());
        let drive = ema_models::DriveParams::of_built_in(self.built_in());
        let is_changed = of_base.is_none_or(|base| parameters_as_text(&base, &drive) != self.parameters_as_text());
        if name == self.built_in() && !is_changed {
            return Vec::new();
        }
        let all = self.effective_parameters().into_iter();
        all.filter(|parameter| matches!(parameter.origin, Some(Origin::BuiltIn(_))))
            .map(|parameter| parameter.key)
            .collect()
    }

    /// Its parameters in the order of the file's groups, then effects with a tolerance only.
    #[must_use]
    pub fn effective_parameters(&self) -> Vec<EffectiveParameter> {
        let origins = &self.origins;
        let place = |group: &'static str, key: &str| {
            let set = origins.places.get(&(group, key.to_owned()));
            set.map(|place| Origin::File(place.clone()))
        };
        let mut tolerances: BTreeMap<(&'static str, &'static str), f64> = tolerances::set(&self.tolerances)
            .map(|(group, key, value)| ((group, key), value))
            .collect();
        let tolerance_origin = |group: &'static str, key: &'static str| {
            place(group, key).unwrap_or(Origin::Tolerances(origins.tolerances))
        };
        let mut parameters = Vec::new();
        for (group, key, value) in params::listed(&self.params).chain(drive::listed(&self.drive)) {
            let name = tolerances::key_of(group, key);
            let known_within = name.and_then(|name| Some((name, tolerances.remove(&(group, name))?)));
            parameters.push(EffectiveParameter {
                key: format!("{group}.{key}"),
                value: Some(value),
                origin: Some(place(group, key).unwrap_or(Origin::BuiltIn(origins.built_in))),
                tolerance: known_within.map(|(_, tolerance)| tolerance),
                tolerance_origin: known_within.map(|(name, _)| tolerance_origin(group, name)),
            });
        }
        for ((group, key), tolerance) in tolerances {
            parameters.push(EffectiveParameter {
                key: format!("{group}.{}", key.strip_suffix("_tolerance").unwrap_or(key)),
                value: None,
                origin: None,
                tolerance: Some(tolerance),
                tolerance_origin: Some(tolerance_origin(group, key)),
            });
        }
        parameters
    }
}

/// What the calibration of a unit, called `file`, puts in the place of its type's parameters, by the estimator that assesses it.
#[must_use]
pub fn parameters_of_unit(of_type: &ActuatorParams, unit: &UnitCalibration, file: &str) -> Vec<EffectiveParameter> {
    let known = |key: &str, value: f64, sigma: f64| EffectiveParameter {
        key: key.to_owned(),
        value: Some(value),
        origin: Some(Origin::File(file.to_owned())),
        tolerance: Some(sigma / value.abs()).filter(|share| share.is_finite()),
        tolerance_origin: Some(Origin::File(file.to_owned())),
    };
    match (unit.estimator, &unit.monitor, &unit.relations) {
        (UnitEstimator::Monitor | UnitEstimator::Both, Some(monitor), _) => UnitParameter::ALL
            .into_iter()
            .map(|parameter| {
                let (deviation, value) = (monitor.parameters.of(parameter), parameter.value(of_type));
                known(
                    parameter.key(),
                    value * (1.0 + deviation.share),
                    value * deviation.sigma,
                )
            })
            .collect(),
        (_, _, Some(relations)) => [
            (UnitParameter::Inertia, Term::Inertia),
            (UnitParameter::Damping, Term::Damping),
            (UnitParameter::DryFriction, Term::DryFriction),
        ]
        .into_iter()
        .map(|(parameter, term)| {
            let commissioned = &relations.commissioned;
            let value = commissioned.balance.values[term as usize];
            known(parameter.key(), value, commissioned.sigma_of(term).unwrap_or(0.0))
        })
        .collect(),
        _ => Vec::new(),
    }
}

/// Writes a line for each parameter.
///
/// # Errors
/// Those of the output.
pub fn write_parameters(out: &mut impl Write, parameters: &[EffectiveParameter]) -> fmt::Result {
    for parameter in parameters {
        write!(out, "  {}", parameter.key)?;
        if let Some(value) = parameter.value {
            write!(out, " {}", rounded(value))?;
        }
        if let Some(tolerance) = parameter.tolerance {
            write!(out, " ± {}", rounded(tolerance))?;
            out.write_str(if parameter.value.is_some() { " of it" } else { "" })?;
        }
        let shown = [&parameter.origin, &parameter.tolerance_origin];
        let mut shown: Vec<String> = shown.into_iter().flatten().map(ToString::to_string).collect();
        shown.dedup();
        writeln!(out, " ({})", shown.join(", "))?;
    }
    Ok(())
}

/// A whole number in full, any other with six significant digits.
fn rounded(value: f64) -> String {
    let is_whole = value.fract().abs() <= 0.0 && value.abs() < 1e9;
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    if is_whole {
        format!("{value}")
    } else if (1e-3..1e6).contains(&rounded.abs()) {
        format!("{rounded}")
    } else {
        format!("{rounded:e}")
    }
}
