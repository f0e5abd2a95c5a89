//! All states of the program's own [`Health`], by damages at each place among the levels.

use ema_models::FaultId;
use hmd_core::health::{DamageEvidence, Health, HealthState, Levels, significance};
use serde_json::Value;
use stateright::{Checker, Model, Property};
use std::hash::{Hash, Hasher};

/// Windows in a row that a worse state needs.
const PERSISTENCE: u32 = 3;
/// Both share nothing but the state of the actuator; more faults add no other interaction.
const FAULTS: [FaultId; 2] = [FaultId::Friction, FaultId::Eccentricity];

fn levels() -> Levels {
    Levels {
        persistence: PERSISTENCE,
        ..Levels::default()
    }
}

fn steps() -> [f64; 3] {
    [levels().watch, levels().warning, levels().critical]
}

/// What a window says of one fault: a damage and its sigma.
type Reading = Option<(f64, f64)>;

/// A damage below, within the hysteresis of, and at each level, by a sigma that is zero, hinders an improvement, or makes it no evidence.
fn readings() -> Vec<Reading> {
    let hysteresis = levels().hysteresis;
    let places = steps()
        .into_iter()
        .flat_map(|step| [step - 1.5 * hysteresis, step - 0.5 * hysteresis, step]);
    let damages = std::iter::once(0.0).chain(places);
    let some = damages.flat_map(|damage| [0.0, hysteresis, damage / 2.0].map(|sigma| Some((damage, sigma))));
    std::iter::once(None).chain(some).collect()
}

/// State of the program, and what is known of the windows so far for each fault.
#[derive(Clone, Debug)]
struct Watched {
    health: Health,
    /// Windows in a row that reached each level significantly, at most [`PERSISTENCE`].
    rows: [[u32; 3]; FAULTS.len()],
    before: [HealthState; FAULTS.len()],
    now: [HealthState; FAULTS.len()],
    readings: [Reading; FAULTS.len()],
    /// By [`Watched::key`].
    key: String,
}

impl Watched {
    /// What later states depend on: counts beyond the persistence are all alike, so that the states are finite in number.
    fn key(&self) -> String {
        fn saturated(value: &mut Value) {
            match value {
                Value::Array(values) => values.iter_mut().for_each(saturated),
                Value::Object(fields) => fields.values_mut().for_each(saturated),
                Value::Number(number) if number.as_u64() > Some(PERSISTENCE.into()) => *value = PERSISTENCE.into(),
                _ => {}
            }
        }
        let mut health = serde_json::to_value(&self.health).unwrap();
        saturated(&mut health);
        format!(
            "{health} {:?} {:?} {:?} {:?}",
            self.rows, self.before, self.now, self.readings
        )
    }
}

impl PartialEq for Watched {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}

impl Hash for Watched {
    fn hash<H: Hasher>(&self, hasher: &mut H) {
        self.key.hash(hasher);
    }
}

/// Place of a state among the levels.
fn level(state: HealthState) -> Option<usize> {
    (state as usize).checked_sub(HealthState::Watch as usize)
}

struct Windows;

impl Model for Windows {
    type State = Watched;
    type Action = [Reading; FAULTS.len()];

    fn init_states(&self) -> Vec<Watched> {
        vec![Watched {
            health: Health::new([levels(); FaultId::COUNT]).unwrap(),
            rows: Default::default(),
            before: Default::default(),
            now: Default::default(),
            readings: Default::default(),
            key: String::new(),
        }]
    }

    fn actions(&self, _: &Watched, actions: &mut Vec<Self::Action>) {
        // One fault at a time; of the second, which differs in its significance alone, and of both together, the extremes.
        let extremes = [Some((0.0, 0.0)), Some((1.0, 0.0))];
        actions.extend(readings().into_iter().map(|one| [one, None]));
        actions.extend(extremes.map(|two| [None, two]));
        actions.extend(extremes.iter().flat_map(|one| extremes.map(|two| [*one, two])));
    }

    fn next_state(&self, state: &Watched, readings: Self::Action) -> Option<Watched> {
        let mut next = state.clone();
        let mut evidence = DamageEvidence {
            damage: [f64::NAN; FaultId::COUNT],
            sigma: Some([0.0; FaultId::COUNT]),
        };
        for (n, fault) in FAULTS.into_iter().enumerate() {
            let Some((damage, sigma)) = readings[n] else { continue };
            evidence.damage[fault.index()] = damage;
            evidence.sigma.as_mut().unwrap()[fault.index()] = sigma;
            for (row, step) in next.rows[n].iter_mut().zip(steps()) {
                let reached = damage >= step && damage >= significance(fault) * sigma;
                *row = if reached { PERSISTENCE.min(*row + 1) } else { 0 };
            }
        }
        let decision = next.health.update(0, Some(&evidence));
        next.before = state.now;
        next.now = FAULTS.map(|fault| decision.states[fault.index()]);
        next.readings = readings;
        let worst = decision.states.into_iter().max().unwrap();
        let is_open = decision.states.contains(&HealthState::Unknown);
        let expected = if is_open && worst == HealthState::Nominal {
            HealthState::Unknown
        } else {
            worst
        };
        assert_eq!(decision.state, expected);
        next.key = next.key();
        Some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("worse only by persistence", |_, state: &Watched| {
                (0..FAULTS.len()).all(|n| {
                    let worse = state.now[n] > state.before[n];
                    !worse || level(state.now[n]).is_none_or(|level| state.rows[n][level] == PERSISTENCE)
                })
            }),
            Property::always("worse as soon as the persistence is reached", |_, state: &Watched| {
                (0..FAULTS.len())
                    .all(|n| (0..3).all(|step| state.rows[n][step] < PERSISTENCE || level(state.now[n]) >= Some(step)))
            }),
            Property::always("better only below the hysteresis", |_, state: &Watched| {
                (0..FAULTS.len()).all(|n| {
                    let better = state.now[n] < state.before[n];
                    let Some(level) = level(state.before[n]) else { return true };
                    let limit = steps()[level] - levels().hysteresis;
                    !better || state.readings[n].is_some_and(|(d, sigma)| d + sigma < limit)
                })
            }),
            Property::always("unknown again only by a doubt", |_, state: &Watched| {
                (0..FAULTS.len()).all(|n| {
                    let is_lost = state.now[n] == HealthState::Unknown && state.before[n] != HealthState::Unknown;
                    let doubtful = |(d, sigma)| d >= levels().warning && d < significance(FAULTS[n]) * sigma;
                    !is_lost || state.readings[n].is_some_and(doubtful)
                })
            }),
            Property::always("no evidence, no change", |_, state: &Watched| {
                let known = |n: usize| state.before[n] != HealthState::Unknown;
                (0..FAULTS.len()).all(|n| state.readings[n].is_some() || !known(n) || state.now[n] == state.before[n])
            }),
            Property::sometimes("critical in both", |_, state: &Watched| {
                state.now == [HealthState::Critical; 2]
            }),
            Property::sometimes("from critical to nominal", |_, state: &Watched| {
                (state.before[0], state.now[0]) == (HealthState::Critical, HealthState::Nominal)
            }),
        ]
    }
}

#[test]
fn all_states_of_health() {
    let checker = Windows.checker().threads(2).spawn_bfs().join();
    println!(
        "health: {} states, {} steps",
        checker.unique_state_count(),
        checker.state_count()
    );
    checker.assert_properties();
}
