//! The tolerances of a type under their names in the file: `KEY_tolerance` beside the parameter `KEY`, a share of its value.
//!
//! `tolerances` of the type says which ones stand where none is set.
//!
//! Effects that no parameter describes have a tolerance of their own, with its unit in the name.

use std::collections::BTreeMap;

use ema_models::Tolerances;
use serde::{Serialize, Serializer};

use super::ConfigError;
use super::reader::Section;

/// One tolerance.
struct Tolerance {
    group: &'static str,
    key: &'static str,
    get: fn(&Tolerances) -> f64,
    set: fn(&mut Tolerances, f64),
}

macro_rules! tolerance {
    ($group:literal, $key:literal, $field:ident) => {
        Tolerance {
            group: $group,
            key: concat!($key, "_tolerance"),
            get: |tolerances| tolerances.$field,
            set: |tolerances, value| tolerances.$field = value,
        }
    };
}

const TOLERANCES: [Tolerance; 30] = [
    tolerance!("motor", "phase_resistance_ohm", r_s),
    tolerance!("motor", "phase_inductance_h", l_s),
    tolerance!("motor", "back_emf_coefficient_v_s_per_rad", k),
    tolerance!("motor", "current_max_a", i_max),
    tolerance!("motor", "bus_voltage_v", v_dc),
    tolerance!("motor", "inertia_kg_m2", j),
    tolerance!("motor", "viscous_damping_nm_s_per_rad", c),
    tolerance!("motor", "cogging", cogging),
    tolerance!("motor", "back_emf_harmonics", emf_harmonics),
    tolerance!("transmission", "efficiency_opposing", efficiency_opposing),
    tolerance!("transmission", "efficiency_aiding", efficiency_aiding),
    tolerance!("transmission", "dynamic_friction_nm", friction_dynamic),
    tolerance!("transmission", "static_friction_nm", friction_static),
    tolerance!("transmission", "backlash_rad", backlash),
    tolerance!("transmission", "stribeck", stribeck),
    tolerance!("transmission", "dry_friction_per_80_k", friction_temperature),
    tolerance!("transmission", "viscous_damping_per_80_k", viscous_temperature),
    tolerance!("transmission", "spring_load_per_rad", spring),
    tolerance!("transmission", "load_drift_per_s", load_drift),
    tolerance!("controller", "position_gain_per_s", g_p),
    tolerance!("controller", "speed_proportional_gain_nm_s_per_rad", k_p),
    tolerance!("controller", "speed_integral_gain_nm_per_rad", k_i),
    tolerance!("controller", "speed_max_rad_s", omega_max),
    tolerance!("controller", "hysteresis_half_band_a", hysteresis),
    tolerance!("controller", "latency_s", control_latency),
    tolerance!("sensors", "current_gain", current_gain),
    tolerance!("sensors", "current_offset_a", current_offset),
    tolerance!("sensors", "latency_s", sample_latency),
    tolerance!("sensors", "resolver_error_rad", resolver_error),
    tolerance!("sensors", "output_encoder_error_rad", encoder_error),
];

/// Largest tolerance: a number that may as well be ten times what it is.
const MAX: f64 = 10.0;

/// Keys of the tolerances in a subtable of a `[type.NAME]`.
pub(super) fn keys(group: &str) -> impl Iterator<Item = &'static str> {
    of_group(group).map(|tolerance| tolerance.key)
}

fn of_group(group: &str) -> impl Iterator<Item = &'static Tolerance> {
    TOLERANCES.iter().filter(move |tolerance| tolerance.group == group)
}

/// The tolerances of a type that sets none.
pub(super) const DEFAULT: Tolerances = Tolerances::USUAL;

/// The tolerances that a type starts from.
pub(super) fn base(type_section: &Section<'_>) -> Result<Tolerances, ConfigError> {
    type_section.choice("tolerances", DEFAULT, &WORDS)
}

/// Words for all tolerances.
const WORDS: [(&str, Tolerances); 2] = [("exact", Tolerances::MOTOR_ONLY), ("usual", Tolerances::USUAL)];

/// The word for the tolerances that a type starts from.
pub(super) fn word(base: &Tolerances) -> &'static str {
    let named = WORDS.iter().find(|(_, of_word)| of_word == base);
    named.map_or("", |(word, _)| word)
}

/// Key of the tolerance of a parameter, if it can have one.
pub(super) fn key_of(group: &str, parameter: &str) -> Option<&'static str> {
    keys(group).find(|key| key.strip_suffix("_tolerance") == Some(parameter))
}

/// Sets in `tolerances` what the subtable of a group sets.
pub(super) fn read(section: &Section<'_>, group: &str, tolerances: &mut Tolerances) -> Result<(), ConfigError> {
    for tolerance in of_group(group) {
        let value = section.number(tolerance.key, (tolerance.get)(tolerances), 0.0..=MAX)?;
        (tolerance.set)(tolerances, value);
    }
    Ok(())
}

/// Tolerances that are not zero, by group and key.
pub(super) fn set(tolerances: &Tolerances) -> impl Iterator<Item = (&'static str, &'static str, f64)> {
    let all = TOLERANCES.iter().map(|t| (t, (t.get)(tolerances)));
    all.filter(|(_, value)| *value > 0.0)
        .map(|(t, value)| (t.group, t.key, value))
}

/// Whether the type has the tolerances of one that sets none.
pub(super) fn are_default(tolerances: &Tolerances) -> bool {
    *tolerances == DEFAULT
}

pub(super) fn as_file_keys<S: Serializer>(tolerances: &Tolerances, serializer: S) -> Result<S::Ok, S::Error> {
    let mut groups: BTreeMap<_, BTreeMap<_, _>> = BTreeMap::new();
    for tolerance in &TOLERANCES {
        let of_group = groups.entry(tolerance.group).or_default();
        of_group.insert(tolerance.key, (tolerance.get)(tolerances));
    }
    groups.serialize(serializer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn every_tolerance_reaches_its_own_field() {
        for tolerance in &TOLERANCES {
            let mut changed = Tolerances::NONE;
            (tolerance.set)(&mut changed, 7.0);
            for other in &TOLERANCES {
                let is_set = (other.get)(&changed) > 0.0;
                assert_eq!(
                    is_set,
                    other.key == tolerance.key && other.group == tolerance.group,
                    "{}",
                    other.key
                );
            }
        }
    }

    fn of_bench(text: &str) -> (Tolerances, Config) {
        let config = Config::from_toml_str(text, "hmd.toml").unwrap();
        (config.actuators()[0].tolerances, config)
    }

    #[test]
    fn a_type_has_the_usual_tolerances_unless_it_says_otherwise() {
        let (default, config) = of_bench("");
        assert_eq!(default, Tolerances::USUAL);
        assert!(
            config
                .describe()
                .contains("inertia_kg_m2 0.001 ± 0.05 of it (built-in bench, usual)"),
            "{}",
            config.describe()
        );
        let (usual, same) = of_bench("type.bench.tolerances = \"usual\"");
        assert_eq!((usual, same.hash()), (default, config.hash()));

        let (exact, config) = of_bench("type.bench.tolerances = \"exact\"");
        assert_eq!(exact, Tolerances::MOTOR_ONLY);
        assert!(config.describe().contains("inertia_kg_m2 0.001 (built-in bench)\n"));
        assert_ne!(config.hash(), same.hash());

        let inertia = "type.bench.motor.inertia_kg_m2_tolerance = 0.1\n";
        let (alone, _) = of_bench(inertia);
        assert_eq!(alone, Tolerances { j: 0.1, ..default });
        let (beside, config) = of_bench(&format!("{inertia}type.bench.tolerances = \"exact\""));
        assert_eq!(beside, Tolerances { j: 0.1, ..exact });
        assert!(config.describe().contains("± 0.1 of it (built-in bench, hmd.toml:1)"));
    }

    #[test]
    fn an_unknown_word_for_all_tolerances_is_refused() {
        let error = Config::from_toml_str("type.bench.tolerances = \"none\"", "hmd.toml").unwrap_err();
        assert!(error.to_string().contains("\"exact\" or \"usual\""), "{error}");
    }

    #[test]
    fn an_impossible_tolerance_is_refused_with_its_place() {
        for value in ["-0.1", "nan", "11.0", "\"5 %\""] {
            let text = format!("[type.bench.motor]\ninertia_kg_m2_tolerance = {value}");
            let error = Config::from_toml_str(&text, "hmd.toml").unwrap_err().to_string();
            assert!(
                error.starts_with("hmd.toml:2: type.bench.motor.inertia_kg_m2_tolerance: expected"),
                "{error}"
            );
        }
    }
}
