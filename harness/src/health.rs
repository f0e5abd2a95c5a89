//! Health of an actuator, window by window.

use crate::{MANY, SOME, for_any};
use ema_models::FaultId;
use hmd_core::health::{DamageEvidence, Health, HealthState, Levels, SIGNIFICANCE};

fn of_friction(damage: f64, sigma: f64) -> DamageEvidence {
    DamageEvidence {
        damage: [damage, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        sigma: Some([sigma, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    }
}

fn health(persistence: u32) -> Health {
    let levels = Levels {
        persistence,
        ..Levels::default()
    };
    Health::new([levels; FaultId::COUNT]).unwrap()
}

fn windows(longest: usize) -> impl bolero::ValueGenerator<Output = Vec<(u8, u8)>> {
    bolero::produce::<Vec<(u8, u8)>>().with().len(0..=longest)
}

/// Levels that are accepted rise, are numbers, and have a hysteresis below the first.
///
/// Any doubles.
#[test]
fn accepted_levels_rise() {
    for_any!(MANY, |input: ([u64; 5], u32)| {
        let scale = |bits: u64| {
            if bits & 1 == 0 {
                (bits >> 11) as f64 / 2f64.powi(53)
            } else {
                f64::from_bits(bits)
            }
        };
        let [watch, warning, critical, end_of_life, hysteresis] = input.0.map(scale);
        let levels = Levels {
            watch,
            warning,
            critical,
            end_of_life,
            hysteresis,
            persistence: input.1,
        };
        if levels.checked().is_ok() {
            let rising = [hysteresis, watch, warning, critical, end_of_life];
            assert!(rising.windows(2).all(|two| two[0] < two[1]), "{levels:?}");
            assert!(
                hysteresis >= 0.0 && end_of_life <= 1.0 && (1..=1000).contains(&input.1),
                "{levels:?}"
            );
        }
    });
}

/// A state worsens only when as many windows in a row as the persistence reached its level significantly.
///
/// Up to 100 windows of any damage and sigma, persistence 1 to 4.
#[test]
fn nothing_worsens_without_its_persistence() {
    for_any!(SOME, windows(100), |input: Vec<(u8, u8)>| {
        let persistence = 1 + input.len() as u32 % 4;
        let (levels, mut health) = (Levels::default(), health(persistence));
        let mut rows = [0; 3];
        let mut before = HealthState::Unknown;
        for (window, (damage, sigma)) in (0..).zip(input) {
            let (damage, sigma) = (f64::from(damage) / 255.0, f64::from(sigma) / 512.0);
            for (row, level) in rows.iter_mut().zip([levels.watch, levels.warning, levels.critical]) {
                *row = if damage >= level && damage >= SIGNIFICANCE * sigma {
                    *row + 1
                } else {
                    0
                };
            }
            let state = health.update(window, Some(&of_friction(damage, sigma))).state;
            if state > before.max(HealthState::Nominal) {
                let level = state as usize - HealthState::Watch as usize;
                assert!(rows[level] >= persistence, "{state} after {} windows", rows[level]);
            }
            before = state;
        }
    });
}

/// A state improves only when the damage and its sigma are below its level by the hysteresis.
///
/// Up to 100 windows of any damage and sigma.
#[test]
fn nothing_improves_within_the_hysteresis() {
    for_any!(SOME, windows(100), |input: Vec<(u8, u8)>| {
        let (levels, mut health) = (Levels::default(), health(1));
        let mut before = HealthState::Nominal;
        for (window, (damage, sigma)) in (0..).zip(input) {
            let (damage, sigma) = (f64::from(damage) / 255.0, f64::from(sigma) / 512.0);
            let state = health.update(window, Some(&of_friction(damage, sigma))).state;
            if state < before && before >= HealthState::Watch {
                let level =
                    [levels.watch, levels.warning, levels.critical][before as usize - HealthState::Watch as usize];
                assert!(
                    damage + sigma < level - levels.hysteresis,
                    "{before} to {state} at {damage} ± {sigma}"
                );
            }
            before = state;
        }
    });
}

/// Windows without evidence change nothing, whatever is no number.
///
/// Up to 40 windows, any doubles for damage and sigma between them.
#[test]
fn what_is_no_evidence_changes_nothing() {
    for_any!(SOME, windows(40), |input: Vec<(u8, u8)>| {
        let (mut plain, mut disturbed) = (health(2), health(2));
        for (window, (damage, sigma)) in (0..).zip(input) {
            let evidence = of_friction(f64::from(damage) / 255.0, f64::from(sigma) / 512.0);
            let expected = plain.update(window, Some(&evidence));
            let nothing = DamageEvidence {
                damage: [f64::NAN; 7],
                sigma: None,
            };
            let negative = DamageEvidence {
                sigma: Some([-1.0; 7]),
                ..evidence
            };
            disturbed.update(window, None);
            disturbed.update(window, Some(&nothing));
            disturbed.update(window, Some(&negative));
            let got = disturbed.update(window, Some(&evidence));
            assert_eq!(
                (got.state, got.states, got.faults),
                (expected.state, expected.states, expected.faults)
            );
        }
    });
}

/// A reset forgets everything.
///
/// Up to 40 windows before it.
#[test]
fn a_reset_forgets() {
    for_any!(SOME, windows(40), |input: Vec<(u8, u8)>| {
        let mut used = health(3);
        for (damage, sigma) in input {
            used.update(
                0,
                Some(&of_friction(f64::from(damage) / 255.0, f64::from(sigma) / 512.0)),
            );
        }
        used.reset();
        let mut new = health(3);
        assert_eq!(used.state(), HealthState::Unknown);
        for window in 0..4 {
            let evidence = of_friction(0.7, 0.0);
            assert_eq!(
                used.update(window, Some(&evidence)),
                new.update(window, Some(&evidence))
            );
        }
    });
}
