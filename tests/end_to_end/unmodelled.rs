//! Faults that the monitor does not have: said to be unknown, or named for what they are like; never for what they are not.

use ema_models::FaultVector;
use ema_models::reference::UnmodelledFault;

use crate::bench::{frames, unit, watch};

/// Status and named faults of one window at 400 Hz with noise.
fn assess_window(unmodelled: Option<UnmodelledFault>, back_emf: f64, seed: u64) -> (String, String, String) {
    let mut scenario = unit(FaultVector::NOMINAL, seed);
    scenario.unmodelled_fault = unmodelled;
    scenario.unit.motor.k *= back_emf;
    let health = watch(frames(&scenario, 0)).window().health.clone();
    (health.status, health.faults, health.reason)
}

#[test]
fn a_resolver_tooth_is_no_fault_and_a_large_one_not_passed_over() {
    for seed in 81..85 {
        // What sticks out of the fit is refused, sample by sample.
        let (status, faults, reason) = assess_window(Some(UnmodelledFault::ResolverTooth(0.02)), 1.0, seed);
        assert_ne!(status, "ok", "seed {seed}");
        assert_eq!(faults, "", "seed {seed}: {reason}");
        let (_, faults, reason) = assess_window(Some(UnmodelledFault::ResolverTooth(0.002)), 1.0, seed);
        assert_eq!(faults, "", "seed {seed}: {reason}");
    }
}

#[test]
fn a_locked_output_is_unmodelled() {
    for seed in [83, 84] {
        let (status, faults, reason) = assess_window(Some(UnmodelledFault::Brake(100.0)), 1.0, seed);
        assert_eq!(
            (status.as_str(), faults.as_str()),
            ("unmodelled", ""),
            "seed {seed}: {reason}"
        );
        assert!(reason.contains("does not turn"), "{reason}");
    }
}

#[test]
fn a_dragging_brake_is_friction() {
    for seed in [85, 86] {
        let (_, faults, reason) = assess_window(Some(UnmodelledFault::Brake(0.15)), 1.0, seed);
        assert_eq!(faults, "friction", "seed {seed}: {reason}");
    }
    // More than any wear makes.
    let (status, faults, reason) = assess_window(Some(UnmodelledFault::Brake(0.9)), 1.0, 87);
    assert_eq!((status.as_str(), faults.as_str()), ("unmodelled", ""), "{reason}");
}

#[test]
fn weak_magnets_are_no_shorted_phases() {
    for (seed, left) in [(88, 0.8), (89, 0.75), (90, 0.7), (91, 0.5)] {
        let (status, faults, reason) = assess_window(None, left, seed);
        assert_eq!(
            (status.as_str(), faults.as_str()),
            ("unmodelled", ""),
            "{left}, seed {seed}: {reason}"
        );
    }
}

#[test]
fn a_cold_or_hot_motor_is_healthy_and_a_worn_one_worn() {
    for (seed, temperature) in [(92, -40.0), (93, 20.0), (94, 120.0)] {
        for (truth, expected) in [(FaultVector::NOMINAL, ""), (crate::worn("short_b", 0.2), "short_b")] {
            let mut scenario = unit(truth, seed);
            scenario.winding_temp_deg_c = temperature;
            let health = watch(frames(&scenario, 0)).window().health.clone();
            assert_eq!(
                (health.status.as_str(), health.faults.as_str()),
                ("ok", expected),
                "{temperature} °C, seed {seed}: {health:?}"
            );
        }
    }
}
