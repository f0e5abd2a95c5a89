//! The parameters of a type under their names in the file: SI, spelled out, unit last.
//!
//! One table joins the key in the file, the field of `ActuatorParams` and the name that its check reports.

use std::collections::BTreeMap;

use ema_models::{ActuatorParams, Expected, ParamsError, Tolerances};

use super::ConfigError;
use super::reader::Section;
use super::tolerances;

/// Subtables of a `[type.NAME]`.
pub(super) const GROUPS: [&str; 4] = ["motor", "transmission", "controller", "sensors"];

/// One parameter.
struct Param {
    group: &'static str,
    key: &'static str,
    /// Name in `ParamsError`.
    field: &'static str,
    get: fn(&ActuatorParams) -> f64,
    set: fn(&mut ActuatorParams, f64),
}

macro_rules! param {
    ($group:ident.$field:ident, $key:literal) => {
        Param {
            group: stringify!($group),
            key: $key,
            field: concat!(stringify!($group), ".", stringify!($field)),
            get: |params| params.$group.$field,
            set: |params, value| params.$group.$field = value,
        }
    };
}

const PARAMS: [Param; 26] = [
    param!(motor.pole_pairs, "pole_pairs"),
    param!(motor.r_s, "phase_resistance_ohm"),
    param!(motor.l_s, "phase_inductance_h"),
    param!(motor.k, "back_emf_coefficient_v_s_per_rad"),
    param!(motor.i_max, "current_max_a"),
    param!(motor.v_dc, "bus_voltage_v"),
    param!(motor.j, "inertia_kg_m2"),
    param!(motor.c, "viscous_damping_nm_s_per_rad"),
    param!(transmission.gear_ratio, "gear_ratio"),
    param!(transmission.efficiency_opposing, "efficiency_opposing"),
    param!(transmission.efficiency_aiding, "efficiency_aiding"),
    param!(transmission.friction_dynamic, "dynamic_friction_nm"),
    param!(transmission.friction_static, "static_friction_nm"),
    param!(transmission.backlash, "backlash_rad"),
    param!(controller.period, "period_s"),
    param!(controller.g_p, "position_gain_per_s"),
    param!(controller.k_p, "speed_proportional_gain_nm_s_per_rad"),
    param!(controller.k_i, "speed_integral_gain_nm_per_rad"),
    param!(controller.k_d, "speed_derivative_gain_nm_s2_per_rad"),
    param!(controller.omega_max, "speed_max_rad_s"),
    param!(controller.hysteresis, "hysteresis_half_band_a"),
    param!(sensors.output_counts_per_rev, "output_encoder_counts_per_rev"),
    param!(sensors.motor_counts_per_rev, "motor_resolver_counts_per_rev"),
    param!(sensors.current_full_scale, "current_full_scale_a"),
    Param {
        group: "sensors",
        key: "current_resolution_bits",
        field: "sensors.current_bits",
        get: |params| f64::from(params.sensors.current_bits),
        // A fraction was refused before; anything outside u32 becomes 0 or u32::MAX, which the check refuses.
        set: |params, value| params.sensors.current_bits = value as u32,
    },
    param!(sensors.sample_rate, "sample_rate_hz"),
];

/// Name under which `ParamsError` reports a sampling rate that is no multiple of the control period.
const SAMPLE_PERIOD_FIELD: &str = "1 / sensors.sample_rate";

/// `base` and the tolerances `known_within`, with everything that the subtables of `type_section` set.
pub(super) fn read(
    type_section: &Section<'_>,
    base: ActuatorParams,
    mut known_within: Tolerances,
) -> Result<(ActuatorParams, Tolerances), ConfigError> {
    let mut params = base;
    let mut groups = Vec::with_capacity(GROUPS.len());
    for group in GROUPS {
        let of_group = || PARAMS.iter().filter(move |param| param.group == group);
        let keys: Vec<_> = of_group()
            .map(|param| param.key)
            .chain(tolerances::keys(group))
            .collect();
        let section = type_section.section(group, &keys)?;
        for param in of_group() {
            let Some(value) = section.any_number(param.key, || "a number".to_owned())? else {
                continue;
            };
            if param.field == "sensors.current_bits" && value.fract() != 0.0 {
                return Err(section.refuse(param.key, "a whole number"));
            }
            (param.set)(&mut params, value);
        }
        tolerances::read(&section, group, &mut known_within)?;
        groups.push((group, section));
    }
    let params = params.checked().map_err(|error| {
        let field = if error.field == SAMPLE_PERIOD_FIELD {
            "sensors.sample_rate"
        } else {
            error.field
        };
        match PARAMS.iter().find(|param| param.field == field) {
            Some(param) => {
                let section = &groups
                    .iter()
                    .find(|(group, _)| *group == param.group)
                    .unwrap_or(&groups[0])
                    .1;
                let effective = format!("{} (not set here)", (param.get)(&params));
                section.refuse_effective(param.key, &expected(&error), &effective)
            }
            None => type_section.refuse_self("possible parameters", &error.to_string()),
        }
    })?;
    Ok((params, known_within))
}

/// What `error` asks for, in the names of the file.
fn expected(error: &ParamsError) -> String {
    match error.expected {
        Expected::MultipleOf(period) if error.field == SAMPLE_PERIOD_FIELD => {
            format!("a rate whose sample period is a whole multiple of controller.period_s = {period}")
        }
        Expected::MultipleOf(unit) => format!("a whole multiple of {unit}"),
        Expected::Within(min, max) => format!("a number from {min} to {max}"),
        Expected::AtLeast(field, value) => {
            let key = PARAMS
                .iter()
                .find(|param| param.field == field)
                .map_or(field, |param| param.key);
            format!("at least {key} = {value}")
        }
    }
}

/// Group, key and value of every parameter, in the order of the groups.
pub(super) fn listed(params: &ActuatorParams) -> impl Iterator<Item = (&'static str, &'static str, f64)> {
    PARAMS
        .iter()
        .map(move |param| (param.group, param.key, (param.get)(params)))
}

/// The parameters as the file would spell them, by group and key.
pub(super) fn by_key(params: &ActuatorParams) -> BTreeMap<&'static str, BTreeMap<&'static str, f64>> {
    let mut groups: BTreeMap<_, BTreeMap<_, _>> = BTreeMap::new();
    for param in &PARAMS {
        groups
            .entry(param.group)
            .or_default()
            .insert(param.key, (param.get)(params));
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_reaches_its_own_field() {
        let bench = ActuatorParams::bench();
        for param in &PARAMS {
            let mut changed = bench;
            (param.set)(&mut changed, f64::from(u16::MAX));
            for other in &PARAMS {
                let same = (other.get)(&changed).to_bits() == (other.get)(&bench).to_bits();
                assert_eq!(same, other.field != param.field, "{} and {}", param.field, other.field);
            }
        }
    }
}
