//! Damage of one actuator, window by window -> its health state.
//!
//! Goes in: the damage of each fault with its standard deviation ([`DamageEvidence`]). Comes out: a state for each fault and
//! for the actuator ([`HealthDecision`]). Each fault has its own levels with hysteresis and persistence; no clock.
//!
//! `level_memory` counts the windows at each level. The actuator's state is the worse of this and the state by remaining life (`history/urgency.rs`).

mod level_memory;

use std::ops::RangeInclusive;

use ema_models::FaultId;
use serde::{Deserialize, Serialize};

use crate::setting::{Expected, SettingError};
use level_memory::STEPS;

pub(crate) use level_memory::LevelMemory;
pub use level_memory::{SIGNIFICANCE, significance};

/// State of health of an actuator, or of one fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HealthState {
    /// No window was assessed yet.
    #[default]
    Unknown,
    /// No fault has reached its watch level.
    Nominal,
    /// A fault is visible.
    Watch,
    /// Plan its repair.
    Warning,
    /// Repair before the next use.
    Critical,
}

impl HealthState {
    /// From good to bad.
    pub const ALL: [Self; 5] = [Self::Unknown, Self::Nominal, Self::Watch, Self::Warning, Self::Critical];

    /// The state that a record names; unknown for any other word.
    #[must_use]
    pub fn named(name: &str) -> Self {
        let found = Self::ALL.into_iter().find(|state| state.name() == name);
        found.unwrap_or_default()
    }

    /// The name that records and the command line use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Nominal => "nominal",
            Self::Watch => "watch",
            Self::Warning => "warning",
            Self::Critical => "critical",
        }
    }
}

impl core::fmt::Display for HealthState {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

/// Rules for the health of one fault: the damage, in 0…1, at which its state changes. Section `[health]` of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Levels {
    /// From here on [`HealthState::Watch`].
    pub watch: f64,
    /// From here on [`HealthState::Warning`]; above `watch`.
    pub warning: f64,
    /// From here on [`HealthState::Critical`]; above `warning`.
    pub critical: f64,
    /// Damage at the end of life of the part, above `critical`; the remaining useful life counts to it.
    pub end_of_life: f64,
    /// How far the damage must fall below a level before the state improves; below `watch`.
    pub hysteresis: f64,
    /// Windows in a row that a worse state needs, at least 1.
    pub persistence: u32,
}

impl Default for Levels {
    fn default() -> Self {
        Self {
            watch: 0.05,
            warning: 0.3,
            critical: 0.6,
            end_of_life: 0.8,
            hysteresis: 0.02,
            persistence: 1,
        }
    }
}

/// Levels that were refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{fault}.{setting}")]
pub struct LevelsError {
    /// Name of the fault.
    pub fault: &'static str,
    /// The level, and what it must be.
    pub setting: SettingError,
}

impl Levels {
    /// Values of a level. Below 0.001 there is nothing to see, whatever the sensors.
    pub(crate) const LEVEL: RangeInclusive<f64> = 0.001..=1.0;
    /// Values of the hysteresis.
    pub(crate) const HYSTERESIS: RangeInclusive<f64> = 0.0..=1.0;
    /// Values of the persistence, windows.
    pub(crate) const PERSISTENCE: RangeInclusive<u32> = 1..=1_000;

    /// The same levels for the assessment of a single window: without persistence.
    #[must_use]
    pub fn at_once(self) -> Self {
        Self { persistence: 1, ..self }
    }

    /// The same levels, if they are possible together.
    ///
    /// # Errors
    /// The first that is no number or out of its range, not above the one before it, or a hysteresis not below `watch`.
    pub fn checked(self) -> Result<Self, SettingError> {
        let ascending = [
            ("watch", self.watch),
            ("warning", self.warning),
            ("critical", self.critical),
            ("end_of_life", self.end_of_life),
        ];
        for (field, level) in ascending {
            SettingError::unless_within(field, level, Self::LEVEL)?;
        }
        SettingError::unless_within("hysteresis", self.hysteresis, Self::HYSTERESIS)?;
        let persistence = Self::PERSISTENCE;
        let windows = f64::from(*persistence.start())..=f64::from(*persistence.end());
        SettingError::unless_within("persistence", self.persistence.into(), windows)?;
        for pair in ascending.windows(2) {
            let (lower, (field, got)) = (pair[0], pair[1]);
            if got <= lower.1 {
                let expected = Expected::MoreThan(lower);
                return Err(SettingError { field, got, expected });
            }
        }
        if self.hysteresis >= self.watch {
            return Err(SettingError {
                field: "hysteresis",
                got: self.hysteresis,
                expected: Expected::LessThan(("watch", self.watch)),
            });
        }
        Ok(self)
    }

    /// The levels of watch, warning, critical.
    fn steps(&self) -> [f64; STEPS] {
        [self.watch, self.warning, self.critical]
    }
}

/// Damage of an actuator, as identified from one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DamageEvidence {
    /// Damage of each fault (see [`ema_models::FaultVector::damages`]), in the order of [`FaultId::ALL`]. A damage that is
    /// no number was not observable in this window and leaves its fault as it is.
    pub damage: [f64; FaultId::COUNT],
    /// Standard deviations, same order; one that is no number makes its damage unobservable.
    pub sigma: Option<[f64; FaultId::COUNT]>,
}

/// Health after a window.
#[derive(Clone, Debug, PartialEq)]
pub struct HealthDecision {
    /// Number of the window.
    pub window: u64,
    /// The worst state of all faults.
    pub state: HealthState,
    /// The faults at watch or worse, in the order of [`FaultId::ALL`].
    pub faults: Vec<FaultId>,
    /// State of every fault, same order.
    pub states: [HealthState; FaultId::COUNT],
    /// Whether `state` or the list of faults is another than after the window before.
    pub changed: bool,
}

/// Health of one actuator.
///
/// A fault worsens to a level when as many assessed windows in a row as its own `persistence` have reached it, each with a
/// damage of at least [`significance`] sigmas. It improves at once when the damage plus one sigma is below the level by more
/// than the hysteresis. Windows that were not assessed neither change a state nor interrupt a row.
///
/// ```
/// use ema_models::FaultId;
/// use hmd_core::health::{DamageEvidence, Health, HealthState, Levels};
/// let mut health = Health::new([Levels::default(); 7])?;
/// assert_eq!(health.update(0, None).state, HealthState::Unknown);
/// let worn = DamageEvidence { damage: [0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01], sigma: None };
/// let decision = health.update(1, Some(&worn));
/// assert_eq!((decision.state, decision.faults), (HealthState::Watch, vec![FaultId::Friction]));
/// # Ok::<(), hmd_core::health::LevelsError>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Health {
    /// The rules. They come from the configuration, never from a file in which the rest is kept.
    #[serde(skip)]
    levels: [Levels; FaultId::COUNT],
    /// Whether any window was assessed. The name in history files is older.
    #[serde(rename = "judged")]
    assessed: bool,
    last: (HealthState, [HealthState; FaultId::COUNT]),
    faults: [LevelMemory; FaultId::COUNT],
}

impl Health {
    /// With the levels of each fault, in the order of [`FaultId::ALL`].
    ///
    /// # Errors
    /// The first level that [`Levels::checked`] refuses, and of which fault.
    pub fn new(levels: [Levels; FaultId::COUNT]) -> Result<Self, LevelsError> {
        for (fault, levels) in FaultId::ALL.into_iter().zip(&levels) {
            levels.checked().map_err(|setting| LevelsError {
                fault: fault.name(),
                setting,
            })?;
        }
        Ok(Self {
            levels,
            assessed: false,
            last: (HealthState::Unknown, [HealthState::Unknown; FaultId::COUNT]),
            faults: [LevelMemory::default(); FaultId::COUNT],
        })
    }

    /// The same memory under the levels of another.
    #[must_use]
    pub(crate) fn with_rules_of(self, other: &Self) -> Self {
        Self {
            levels: other.levels,
            ..self
        }
    }

    /// Whether the state is possible; a damaged file may hold any numbers.
    pub(crate) fn is_possible(&self) -> bool {
        self.faults.iter().all(LevelMemory::is_possible)
    }

    /// Windows in a row that a worse state needs by a fault; without one, the most that any fault needs.
    pub(crate) fn persistence(&self, fault: Option<FaultId>) -> u32 {
        let most = || self.levels.iter().map(|levels| levels.persistence).max();
        fault.map_or_else(|| most().unwrap_or(1), |fault| self.levels[fault.index()].persistence)
    }

    /// Assessed windows in a row that ask for a worse state than the one reached, the most of any fault; 0 when none does.
    pub(crate) fn pending(&self) -> u32 {
        self.faults.iter().map(LevelMemory::pending).max().unwrap_or(0)
    }

    /// State after the last window.
    #[must_use]
    pub fn state(&self) -> HealthState {
        self.last.0
    }

    /// Forgets everything, as after the replacement of the part.
    pub fn reset(&mut self) {
        self.assessed = false;
        self.last = (HealthState::Unknown, [HealthState::Unknown; FaultId::COUNT]);
        self.faults = [LevelMemory::default(); FaultId::COUNT];
    }

    /// Forgets one fault, as after the replacement of a part.
    pub(crate) fn forget(&mut self, fault: FaultId) {
        self.faults[fault.index()] = LevelMemory::default();
    }

    /// Takes the next window; `None` if it was not assessed.
    pub fn update(&mut self, window: u64, damage_evidence: Option<&DamageEvidence>) -> HealthDecision {
        for (fault, memory) in FaultId::ALL.into_iter().zip(&mut self.faults) {
            let Some((damage, sigma)) =
                damage_evidence.and_then(|damage_evidence| damage_evidence.damage_and_sigma(fault))
            else {
                continue;
            };
            memory.update(damage, sigma, significance(fault), &self.levels[fault.index()]);
            self.assessed = true;
        }
        let states = self.faults.map(|memory| {
            if self.assessed {
                memory.state()
            } else {
                HealthState::Unknown
            }
        });
        let state = states.iter().copied().max().unwrap_or_default();
        let changed = (state, states.map(is_fault)) != (self.last.0, self.last.1.map(is_fault));
        self.last = (state, states);
        let faults = FaultId::ALL
            .into_iter()
            .filter(|fault| is_fault(states[fault.index()]))
            .collect();
        HealthDecision {
            window,
            state,
            faults,
            states,
            changed,
        }
    }
}

fn is_fault(state: HealthState) -> bool {
    state >= HealthState::Watch
}

impl DamageEvidence {
    /// Damage and sigma of a fault, if it was observable.
    pub(crate) fn damage_and_sigma(&self, fault: FaultId) -> Option<(f64, f64)> {
        let damage = self.damage[fault.index()];
        let sigma = self.sigma.map_or(0.0, |sigma| sigma[fault.index()]);
        (damage.is_finite() && sigma.is_finite() && sigma >= 0.0).then_some((damage, sigma))
    }
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn an_uncertain_damage_neither_alarms_nor_clears() {
        let with_sigma = |damage: f64, sigma: f64| DamageEvidence {
            sigma: Some([sigma; FaultId::COUNT]),
            ..friction(damage)
        };
        let mut health = health(1);
        assert_eq!(
            health.update(0, Some(&with_sigma(0.4, 0.2))).state,
            HealthState::Nominal
        );
        assert_eq!(
            health.update(1, Some(&with_sigma(0.4, 0.1))).state,
            HealthState::Warning
        );
        assert_eq!(
            health.update(2, Some(&with_sigma(0.1, 0.2))).state,
            HealthState::Warning
        );
        assert_eq!(
            health.update(3, Some(&with_sigma(0.0, f64::NAN))).state,
            HealthState::Warning
        );
        assert_eq!(health.update(4, Some(&friction(f64::NAN))).state, HealthState::Warning);
        assert_eq!(
            health.update(5, Some(&with_sigma(0.0, 0.01))).state,
            HealthState::Nominal
        );
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
}
