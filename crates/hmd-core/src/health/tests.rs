//! Histories of damages, and the states that they give.

use super::level_memory::STATES;
use super::*;
use proptest::prelude::*;

fn friction(damage: f64) -> DamageEvidence {
    DamageEvidence {
        damage: [damage, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        sigma: None,
    }
}

fn health(persistence: u32) -> Health {
    let levels = Levels {
        persistence,
        ..Levels::default()
    };
    Health::new([levels; FaultId::COUNT]).unwrap()
}

#[test]
fn levels_of_a_single_window_and_of_another_configuration() {
    let patient = Levels {
        persistence: 5,
        watch: 0.123,
        ..Levels::default()
    };
    let at_once = patient.at_once();
    assert_eq!(
        (at_once.persistence, at_once.watch.to_bits()),
        (1, patient.watch.to_bits())
    );
    let mut other = health(5).with_rules_of(&health(1));
    assert_eq!(other.state(), HealthState::Unknown);
    other.update(0, Some(&friction(0.2)));
    assert_eq!((other.state(), other.persistence(None)), (HealthState::Watch, 1));
}

#[test]
fn a_damage_at_the_edge_of_the_hysteresis_keeps_its_state() {
    // Exact in binary: 0.25 − 0.125.
    let levels = Levels {
        watch: 0.25,
        hysteresis: 0.125,
        persistence: 1,
        ..Levels::default()
    };
    let mut health = Health::new([levels; FaultId::COUNT]).unwrap();
    let after = [0.25, 0.125, 0.125 - f64::EPSILON].map(|damage| health.update(0, Some(&friction(damage))).state);
    assert_eq!(after, [HealthState::Watch, HealthState::Watch, HealthState::Nominal]);
}

#[test]
fn what_is_held_may_worsen_and_improves_only_when_released() {
    let mut health = health(1);
    let after = |health: &mut Health, damage: f64| health.update(0, Some(&friction(damage))).state;
    assert_eq!(after(&mut health, 0.0), HealthState::Nominal);
    // Of a healthy fault nothing is held.
    health.hold();
    assert_eq!(after(&mut health, 0.2), HealthState::Watch);
    assert_eq!(after(&mut health, 0.0), HealthState::Nominal);
    assert_eq!(after(&mut health, 0.4), HealthState::Warning);
    health.hold();
    assert_eq!(after(&mut health, 0.0), HealthState::Warning);
    assert_eq!(after(&mut health, 0.9), HealthState::Critical);
    assert_eq!(after(&mut health, 0.0), HealthState::Warning);
    health.release();
    assert_eq!(after(&mut health, 0.0), HealthState::Nominal);
}

#[test]
fn an_eccentricity_needs_more_sigmas_than_others() {
    for fault in FaultId::ALL {
        let expected = if fault == FaultId::Eccentricity { 3.44 } else { 3.0 };
        assert_eq!(significance(fault).to_bits(), f64::to_bits(expected), "{fault:?}");
    }
}

/// A history of friction damage, NaN for a window that was not assessed, and the initials of the states after each window.
fn states(persistence: u32, history: &[f64]) -> String {
    let mut health = health(persistence);
    let decide = |(n, &damage): (usize, &f64)| {
        let evidence = friction(damage);
        health.update(n as u64, (!damage.is_nan()).then_some(&evidence)).state
    };
    let initial = |state| match state {
        HealthState::Unknown => '?',
        HealthState::Nominal => 'n',
        HealthState::Watch => 'w',
        HealthState::Warning => 'W',
        HealthState::Critical => 'C',
    };
    history.iter().enumerate().map(decide).map(initial).collect()
}

#[test]
fn windows_that_ask_for_a_worse_state_are_counted() {
    let mut health = health(3);
    let pending = [0.0, 0.25, 0.25, 0.25, 0.25, 0.0].map(|damage| {
        health.update(0, Some(&friction(damage)));
        health.pending()
    });
    assert_eq!(
        pending,
        [0, 1, 2, 0, 0, 0],
        "counted towards the next level, and reached with the third"
    );
}

#[test]
fn histories() {
    const NONE: f64 = f64::NAN;
    for (persistence, history, expected) in [
        (1, &[NONE, NONE, 0.0, NONE][..], "??nn"),
        // Each level counts from its own value on.
        (1, &[0.049, 0.05, 0.299, 0.3, 0.599, 0.6, 1.0], "nwwWWCC"),
        // Improvement only below the level less the hysteresis.
        (1, &[0.61, 0.59, 0.581, 0.579, 0.281, 0.279, 0.031, 0.029], "CCCWWwwn"),
        // A repair is seen at once, through all levels.
        (1, &[0.9, 0.0], "Cn"),
        // Windows that were not assessed leave the state.
        (1, &[0.4, NONE, NONE, 0.4], "WWWW"),
        // Persistence: two in a row, not interrupted by a window that was not assessed; a single outlier has no effect.
        (2, &[0.4, 0.0, 0.4, NONE, 0.4], "nnnnW"),
        // The worst level that two windows in a row reached.
        (2, &[0.9, 0.1, 0.9, 0.9], "nwwC"),
    ] {
        assert_eq!(
            states(persistence, history),
            expected,
            "{history:?} with persistence {persistence}"
        );
    }
}

#[test]
fn each_fault_has_its_own_persistence() {
    let mut levels = [Levels::default(); FaultId::COUNT];
    levels[FaultId::Gain.index()].persistence = 3;
    let mut health = Health::new(levels).unwrap();
    let both = DamageEvidence {
        damage: [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4],
        sigma: None,
    };
    let named = [0, 1, 2].map(|window| health.update(window, Some(&both)).faults);
    use FaultId::{Friction, Gain};
    assert_eq!(named, [vec![Friction], vec![Friction], vec![Friction, Gain]]);
    let needed = [Some(Friction), Some(Gain), None].map(|fault| health.persistence(fault));
    assert_eq!(needed, [1, 3, 3], "of no fault in particular: the most");
}

#[test]
fn faults_are_listed_in_order() {
    let mut health = health(1);
    let damage = [0.1, 0.0, 0.7, 0.0, 0.0, 0.06, 0.31];
    let decision = health.update(3, Some(&DamageEvidence { damage, sigma: None }));
    use FaultId::{Eccentricity, Friction, Gain, ShortA};
    assert_eq!(decision.faults, [Friction, ShortA, Eccentricity, Gain]);
    assert_eq!(
        (decision.window, decision.state, decision.changed),
        (3, HealthState::Critical, true)
    );
    assert!(!health.update(4, None).changed);
    let all = DamageEvidence {
        damage: [1.0; FaultId::COUNT],
        sigma: None,
    };
    assert_eq!(health.update(5, Some(&all)).faults, FaultId::ALL);
    health.reset();
    assert_eq!(health.state(), HealthState::Unknown);
}

/// Friction of a window that tells something of it, and no other damage.
fn uncertain(damage: f64, sigma: f64) -> DamageEvidence {
    let mut sigmas = [0.01; FaultId::COUNT];
    sigmas[0] = sigma;
    DamageEvidence {
        sigma: Some(sigmas),
        ..friction(damage)
    }
}

#[test]
fn an_uncertain_damage_neither_alarms_nor_clears() {
    let mut health = health(1);
    for (damage, sigma, expected) in [
        (0.4, 0.2, HealthState::Unknown),
        (0.4, 0.1, HealthState::Warning),
        (0.1, 0.2, HealthState::Warning),
        (0.0, f64::NAN, HealthState::Warning),
        (f64::NAN, 0.0, HealthState::Warning),
        (0.0, 0.01, HealthState::Nominal),
    ] {
        let state = health.update(0, Some(&uncertain(damage, sigma))).state;
        assert_eq!(state, expected, "{damage} ± {sigma}");
    }
}

#[test]
fn an_unobservable_first_window_leaves_the_state_unknown() {
    let nothing = DamageEvidence {
        damage: [f64::NAN; FaultId::COUNT],
        sigma: None,
    };
    assert_eq!(health(1).update(0, Some(&nothing)).state, HealthState::Unknown);
}

#[test]
fn what_no_window_has_shown_is_unknown() {
    use FaultId::Friction;
    use HealthState::{Nominal, Unknown, Watch};
    let mut health = health(1);
    // All but friction, of which the window tells nothing, or too little: a damage of 0.3 is less than 2 σ away.
    for sigma in [f64::INFINITY, 0.16] {
        let decision = health.update(0, Some(&uncertain(0.0, sigma)));
        assert_eq!(
            (decision.state, decision.states[0], decision.states[1]),
            (Unknown, Unknown, Nominal)
        );
    }
    assert_eq!(health.update(1, Some(&uncertain(0.0, 0.14))).state, Nominal);
    // What has been shown stays where a window tells less, until one finds a damage at the level of warning that is too uncertain to count.
    for (damage, sigma, expected) in [
        (0.0, f64::INFINITY, Nominal),
        (0.29, 0.3, Nominal),
        (0.3, 0.3, Unknown),
        (0.29, 0.3, Unknown),
        (0.2, 0.05, Watch),
        (0.31, 0.3, Watch),
        (0.0, 0.01, Nominal),
    ] {
        let state = health.update(2, Some(&uncertain(damage, sigma))).state;
        assert_eq!(state, expected, "{damage} ± {sigma}");
    }
    // A new part begins unknown; what cannot be shown for want of a signal keeps nothing from being nominal.
    health.forget(Friction);
    assert_eq!(health.update(4, None).state, Unknown);
    health.hide([Friction]);
    let decision = health.update(5, Some(&uncertain(0.0, f64::INFINITY)));
    assert_eq!((decision.state, decision.states[0]), (Nominal, Unknown));
}

#[test]
fn the_damages_of_a_window_are_shown_or_uncertain() {
    let levels = [Levels::default(); FaultId::COUNT];
    let shown = uncertain(0.22, 0.46);
    assert_eq!(shown.shown(&levels)[..2], [None, Some(0.0)]);
    assert_eq!(shown.uncertain(&levels), [(FaultId::Friction, 0.22, 0.46)]);
    let nothing = uncertain(0.22, f64::INFINITY);
    assert_eq!((nothing.shown(&levels)[0], nothing.uncertain(&levels)), (None, vec![]));
    // Exact in binary: two sigmas reach the level of warning, which is then not ruled out.
    let levels = Levels {
        warning: 0.5,
        ..Levels::default()
    };
    for (damage, is_shown) in [(0.25, false), (0.25 - f64::EPSILON, true)] {
        let shows = uncertain(damage, 0.125).shows(FaultId::Friction, &levels);
        assert_eq!(shows, is_shown, "{damage}");
    }
}

#[test]
fn a_fault_has_fallen_where_a_window_shows_less_than_half_of_the_level_of_warning() {
    let levels = Levels {
        warning: 0.5,
        ..Levels::default()
    };
    let after = |damage: f64| {
        let mut health = Health::new([levels; FaultId::COUNT]).unwrap();
        health.update(0, Some(&friction(damage)));
        health
    };
    let (watch, warning, critical) = (after(0.4), after(0.55), after(0.7));
    assert_eq!(warning.states()[..2], [HealthState::Warning, HealthState::Nominal]);
    // Exact in binary: with three sigmas just half of the level, and less.
    for (damage, sigma, has_fallen) in [
        (0.25, 0.0, false),
        (0.25 - f64::EPSILON, 0.0, true),
        (0.0625, 0.0625, false),
        (0.0625, 0.0624, true),
        (0.0, 0.1, false),
        (0.0, f64::INFINITY, false),
        (f64::NAN, 0.0, false),
    ] {
        let fallen = |health: &Health| health.fallen(&uncertain(damage, sigma));
        let expected = |state| Vec::from_iter(has_fallen.then_some((FaultId::Friction, state)));
        assert_eq!(fallen(&warning), expected(HealthState::Warning), "{damage} ± {sigma}");
        assert_eq!(fallen(&critical), expected(HealthState::Critical), "{damage} ± {sigma}");
        assert_eq!(fallen(&watch), [], "{damage} ± {sigma}");
    }
}

#[test]
fn a_state_is_named_as_records_name_it_and_any_other_word_is_unknown() {
    for state in HealthState::ALL {
        assert_eq!(HealthState::named(state.name()), state);
    }
    assert_eq!(HealthState::named("Warning"), HealthState::Unknown);
}

#[test]
fn a_memory_beyond_the_levels_is_not_possible() {
    let mut health = health(1);
    health.update(0, Some(&friction(1.0)));
    assert!(health.is_possible());
    let text = serde_json::to_string(&health).unwrap();
    let damaged = text.replace("\"reached\":3", "\"reached\":4");
    assert_ne!(text, damaged);
    let damaged: Health = serde_json::from_str(&damaged).unwrap();
    assert!(!damaged.is_possible());
}

#[test]
fn impossible_levels_are_refused_by_name() {
    type Change = fn(&mut Levels);
    let cases: [(&str, Change); 7] = [
        ("watch", |l| l.watch = f64::NAN),
        ("warning", |l| l.warning = 0.05),
        ("critical", |l| l.critical = 1.1),
        ("end_of_life", |l| l.end_of_life = 0.0),
        // A life that ends before the repair is due.
        ("end_of_life", |l| l.end_of_life = 0.6),
        // A state that would never improve.
        ("hysteresis", |l| l.hysteresis = 0.05),
        ("persistence", |l| l.persistence = 0),
    ];
    for (field, change) in cases {
        let mut levels = [Levels::default(); FaultId::COUNT];
        change(&mut levels[FaultId::Gain.index()]);
        let refused = Health::new(levels).map(|_| ());
        assert_eq!(refused.map_err(|e| (e.fault, e.setting.field)), Err(("gain", field)));
    }
    let zero = Levels {
        hysteresis: 0.0,
        ..Levels::default()
    };
    assert!(Health::new([zero; FaultId::COUNT]).is_ok());
}

#[test]
fn states_are_spelled_in_lower_case() {
    for state in STATES.into_iter().chain([HealthState::Unknown]) {
        assert_eq!(serde_json::to_string(&state).unwrap(), format!("\"{state}\""));
    }
    assert!(HealthState::Critical > HealthState::Watch && HealthState::Nominal > HealthState::Unknown);
}

proptest! {
    #[test]
    fn no_chatter_inside_the_band(
        level in prop::sample::select(vec![0.05, 0.3, 0.6]),
        places in prop::collection::vec(0.0..=1.0f64, 1..60),
        above in 0.0..0.2f64,
        start in 0.0..1.0f64,
        persistence in 1u32..4,
    ) {
        let mut health = health(persistence);
        for n in 0..4 {
            health.update(n, Some(&friction(start)));
        }
        // Damage that stays within the hysteresis below the level, and anywhere short of the next level above it.
        let mut seen = Vec::new();
        for (n, place) in places.iter().enumerate() {
            let damage = level - 0.019 + place * (0.019 + above);
            seen.push(health.update(10 + n as u64, Some(&friction(damage))).state);
        }
        seen.dedup();
        let sorted = seen.is_sorted() || seen.iter().rev().is_sorted();
        prop_assert!(sorted, "a state was left and entered again: {:?}", seen);
    }

    #[test]
    fn never_panics_and_a_persistent_damage_gives_its_own_level(
        junk in prop::collection::vec(prop::array::uniform7(prop::num::f64::ANY), 0..20),
        damage in 0.0..1.0f64,
    ) {
        let mut health = health(2);
        for (n, damage) in junk.iter().enumerate() {
            health.update(n as u64, Some(&DamageEvidence { damage: *damage, sigma: Some(*damage) }));
        }
        health.update(90, Some(&friction(0.0)));
        health.update(91, Some(&friction(damage)));
        let expected = STATES[Levels::default().steps().iter().filter(|&&level| damage >= level).count()];
        prop_assert_eq!(health.update(92, Some(&friction(damage))).state, expected);
    }
}
