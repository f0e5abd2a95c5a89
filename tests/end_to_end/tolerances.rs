//! Units that differ from their type within its tolerances: what the tolerances explain names no part, what they do not is named.

use ema_models::FaultVector;
use ema_models::reference::Scenario;
use hmd_core::config::Config;
use hmd_core::record::Health;

use crate::bench::{frames, unit, watch_all_with};
use crate::worn;

/// A unit whose parameters deviate by about one tolerance each.
fn off_its_type(fault: FaultVector, seed: u64) -> Scenario {
    let mut scenario = unit(fault, seed);
    for (effect, value) in [
        ("inductance_deviation", -0.07),
        ("inertia_deviation", 0.05),
        ("viscous_deviation", 0.5),
        ("dynamic_friction_deviation", 0.2),
        ("static_friction_deviation", 0.2),
        ("play_deviation", 0.5),
        ("current_limit_deviation", 0.02),
        ("speed_limit_deviation", -0.01),
    ] {
        scenario.effects.set(effect, value).expect("an effect of the reference");
    }
    scenario
}

/// Health by one window with the usual tolerances, the default.
fn health(scenario: &Scenario) -> Health {
    let outcome = watch_all_with(Config::default(), [frames(scenario, 0)]);
    outcome.window().health.clone()
}

#[test]
fn a_unit_within_the_tolerances_of_its_type_names_no_part() {
    for seed in [101, 102, 103] {
        let health = health(&off_its_type(FaultVector::NOMINAL, seed));
        assert_ne!(health.status, "unmodelled", "seed {seed}: {}", health.reason);
        assert_eq!(health.faults, "", "seed {seed}: {health:?}");
        // Friction 20 % off cannot be told from wear by 0.1: both the damage and its sigma say so.
        let (damage, sigma) = (health.k1, health.k1_sigma);
        assert!(sigma.is_some_and(|sigma| sigma > 0.05), "seed {seed}: {health:?}");
        assert!(damage.is_some_and(|damage| damage < 0.35), "seed {seed}: {damage:?}");
    }
}

#[test]
fn what_the_tolerances_do_not_explain_is_named() {
    for (fault, k, seed) in [
        ("backlash", 0.2, 104),
        ("eccentricity", 0.3, 105),
        ("short_b", 0.35, 106),
        ("gain", 0.7, 107),
    ] {
        let health = health(&off_its_type(worn(fault, k), seed));
        assert_eq!(health.faults, fault, "seed {seed}: {health:?}");
    }
}
