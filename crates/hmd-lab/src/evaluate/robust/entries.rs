//! The catalogue of the suite: single imperfections with the law of their size, pairs of them, and all together.
//!
//! An imperfection is a set of effects of the reference model by name. A tolerance is a standard deviation: the size is drawn
//! uniformly from 0.5 to 1.5 of it, to either side, which has the same standard deviation and is never zero.

use std::sync::LazyLock;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Law of one value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Size {
    /// Standard deviation; scaled from `bench` to the actuator type as the effect's usual range is.
    Tolerance(f64),
    /// Uniform in the usual range of the effect.
    Usual,
    /// Uniform between two values.
    Between(f64, f64),
    /// This value.
    Exactly(f64),
}

/// One imperfection: effects by name, each with the law of its value.
#[derive(Debug)]
pub(super) struct Imperfection {
    pub(super) name: &'static str,
    pub(super) values: &'static [(&'static str, Size)],
}

/// What an entry consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EntryKind {
    /// One imperfection.
    Single,
    /// Two.
    Pair,
    /// All.
    All,
}

/// One entry of the catalogue.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) kind: EntryKind,
    pub(super) imperfections: Vec<&'static Imperfection>,
}

/// Pairs of the catalogue.
const PAIRS: usize = 20;

/// Draws the pairs; they are part of the catalogue, not of a run.
const PAIRS_SEED: u64 = 10;

/// All entries; their names are unique.
pub(super) static ENTRIES: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let mut entries: Vec<Entry> = SINGLE
        .iter()
        .map(|single| Entry {
            name: single.name.to_owned(),
            kind: EntryKind::Single,
            imperfections: vec![single],
        })
        .collect();
    entries.extend(pairs());
    entries.push(Entry {
        name: "all".to_owned(),
        kind: EntryKind::All,
        imperfections: SINGLE.iter().collect(),
    });
    entries
});

/// Names of all entries.
pub fn entry_names() -> impl Iterator<Item = &'static str> {
    ENTRIES.iter().map(|entry| entry.name.as_str())
}

/// Pairs of imperfections that have no effect in common.
fn pairs() -> Vec<Entry> {
    let mut rng = ChaCha8Rng::seed_from_u64(PAIRS_SEED);
    let mut pairs: Vec<Entry> = Vec::new();
    while pairs.len() < PAIRS {
        let [one, other] = [(); 2].map(|()| rng.random_range(0..SINGLE.len()));
        let (first, second) = (&SINGLE[one.min(other)], &SINGLE[one.max(other)]);
        let in_common = |name: &str| second.values.iter().any(|(effect, _)| *effect == name);
        let name = format!("{}+{}", first.name, second.name);
        if first.values.iter().any(|(effect, _)| in_common(effect)) || pairs.iter().any(|pair| pair.name == name) {
            continue;
        }
        pairs.push(Entry {
            name,
            kind: EntryKind::Pair,
            imperfections: vec![first, second],
        });
    }
    pairs
}

/// Shorthand of a table row.
const fn row(name: &'static str, values: &'static [(&'static str, Size)]) -> Imperfection {
    Imperfection { name, values }
}

use Size::{Between, Exactly, Tolerance, Usual};

/// Carrier of a vector drive; with the bandwidth at least 45° of phase margin.
const PWM: (&str, Size) = ("pwm_frequency_hz", Between(12e3, 20e3));
/// Bandwidth of its current control.
const BANDWIDTH: (&str, Size) = ("current_bandwidth_hz", Between(400.0, 1000.0));

/// The single imperfections. Where several set the same effect, `all` takes the first.
#[rustfmt::skip]
const SINGLE: &[Imperfection] = &[
    row("vector_drive", &[PWM, BANDWIDTH]),
    row("dead_time", &[PWM, BANDWIDTH, ("dead_time_s", Usual)]),
    row("dead_time_compensated", &[PWM, BANDWIDTH, ("dead_time_s", Usual), ("dead_time_compensation", Between(0.7, 0.9))]),
    row("no_decoupling", &[PWM, BANDWIDTH, ("decoupling", Exactly(0.0))]),
    row("back_emf", &[("back_emf_deviation", Tolerance(0.03))]),
    row("resistance", &[("resistance_deviation", Tolerance(0.05))]),
    row("inductance", &[("inductance_deviation", Tolerance(0.07))]),
    row("inertia", &[("inertia_deviation", Tolerance(0.05))]),
    row("viscous", &[("viscous_deviation", Tolerance(0.5))]),
    row("dynamic_friction", &[("dynamic_friction_deviation", Tolerance(0.2))]),
    row("static_friction", &[("static_friction_deviation", Tolerance(0.2))]),
    row("play", &[("play_deviation", Tolerance(0.5))]),
    row("gear_efficiency", &[
        ("opposing_efficiency_deviation", Tolerance(0.1)), ("aiding_efficiency_deviation", Tolerance(0.1)),
        ("unmeasured_load_nm", Usual),
    ]),
    row("link_voltage", &[("link_voltage_deviation", Tolerance(0.02))]),
    row("current_limit", &[("current_limit_deviation", Tolerance(0.02))]),
    row("position_gain", &[("position_gain_deviation", Tolerance(0.01))]),
    row("speed_gains", &[("speed_gain_deviation", Tolerance(0.01)), ("integral_gain_deviation", Tolerance(0.01))]),
    row("speed_limit", &[("speed_limit_deviation", Tolerance(0.01))]),
    row("setpoint_rate", &[("setpoint_rate_rad_s", Usual)]),
    row("speed_filter", &[("speed_filter_hz", Usual)]),
    row("control_delay", &[("control_delay_periods", Exactly(1.0))]),
    row("compliance", &[("compliance_hz", Usual), ("compliance_damping", Usual), ("load_friction_share", Usual)]),
    row("stribeck", &[("stribeck_nm", Usual), ("stribeck_speed_rad_s", Usual)]),
    row("temperature", &[("temperature_rise_k", Usual), ("viscous_temperature", Usual), ("dry_temperature", Usual)]),
    row("mesh_ripple", &[("mesh_ripple", Usual), ("gear_teeth", Usual)]),
    row("cogging", &[("cogging_nm", Usual), ("cogging_phase_rad", Usual)]),
    row("unmeasured_load", &[("unmeasured_load_nm", Usual)]),
    row("spring", &[("spring_nm_per_rad", Usual)]),
    row("load_drift", &[("load_drift_nm", Usual), ("load_drift_period_s", Usual)]),
    row("emf_harmonics", &[("emf_5", Usual), ("emf_7", Usual)]),
    row("saturation", &[("saturation", Usual)]),
    row("current_gains", &[
        ("current_gain_a", Tolerance(0.01)), ("current_gain_b", Tolerance(0.01)), ("current_gain_c", Tolerance(0.01)),
    ]),
    row("current_offsets", &[
        ("current_offset_a_a", Tolerance(0.03)), ("current_offset_b_a", Tolerance(0.03)), ("current_offset_c_a", Tolerance(0.03)),
    ]),
    row("current_filter", &[("current_filter_hz", Usual)]),
    row("two_current_sensors", &[
        ("two_current_sensors", Exactly(1.0)), ("current_gain_a", Tolerance(0.01)), ("current_gain_b", Tolerance(0.01)),
        ("current_offset_a_a", Tolerance(0.03)), ("current_offset_b_a", Tolerance(0.03)),
    ]),
    row("current_latency", &[("current_latency_s", Usual)]),
    row("angle_latency", &[("angle_latency_s", Usual)]),
    row("sample_jitter", &[("sample_jitter", Usual)]),
    row("resolver_error", &[
        ("resolver_error_1_rad", Usual), ("resolver_phase_1_rad", Usual),
        ("resolver_error_2_rad", Usual), ("resolver_phase_2_rad", Usual),
    ]),
    row("encoder_eccentricity", &[("encoder_eccentricity_rad", Usual), ("encoder_phase_rad", Usual)]),
    row("link_sag", &[("link_resistance_ohm", Usual)]),
    row("link_ripple", &[("link_ripple_v", Usual), ("link_ripple_hz", Usual)]),
    row("shorted_turns", &[("short_resistance_ohm", Usual), ("short_coupling", Usual)]),
    row("tolerances", &[
        ("back_emf_deviation", Tolerance(0.03)), ("resistance_deviation", Tolerance(0.05)),
        ("inductance_deviation", Tolerance(0.07)), ("inertia_deviation", Tolerance(0.05)),
        ("viscous_deviation", Tolerance(0.5)), ("dynamic_friction_deviation", Tolerance(0.2)),
        ("static_friction_deviation", Tolerance(0.2)), ("play_deviation", Tolerance(0.5)),
        ("opposing_efficiency_deviation", Tolerance(0.1)), ("aiding_efficiency_deviation", Tolerance(0.1)),
        ("link_voltage_deviation", Tolerance(0.02)), ("current_limit_deviation", Tolerance(0.02)),
        ("position_gain_deviation", Tolerance(0.01)), ("speed_gain_deviation", Tolerance(0.01)),
        ("integral_gain_deviation", Tolerance(0.01)), ("speed_limit_deviation", Tolerance(0.01)),
    ]),
];

#[cfg(test)]
mod tests {
    use ema_models::reference::EFFECTS;

    use super::*;

    #[test]
    fn names_are_unique_and_the_catalogue_has_its_size() {
        let mut names: Vec<&str> = entry_names().collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), ENTRIES.len());
        let count = |kind| ENTRIES.iter().filter(|entry| entry.kind == kind).count();
        assert!(count(EntryKind::Single) >= 40);
        assert_eq!([count(EntryKind::Pair), count(EntryKind::All)], [PAIRS, 1]);
    }

    #[test]
    fn every_value_is_an_effect_of_the_reference() {
        for (name, _) in SINGLE.iter().flat_map(|single| single.values) {
            assert!(EFFECTS.iter().any(|info| info.name == *name), "{name}");
        }
    }
}
