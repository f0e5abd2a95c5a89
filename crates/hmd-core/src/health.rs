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
    /// No window has shown it yet, or a later one put it in doubt.
    #[default]
    Unknown,
    /// Shown, and no fault has reached its watch level.
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
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
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
    /// Standard deviations, same order, with all that the damage may be off by; one that is no number says that the window tells nothing of
    /// the fault. `None`: the damages are exact.
    pub sigma: Option<[f64; FaultId::COUNT]>,
}

/// Health after a window.
#[derive(Clone, Debug, PartialEq)]
pub struct HealthDecision {
    /// Number of the window.
    pub window: u64,
    /// The worst of the faults at watch or worse; without one nominal where every fault that is not hidden was shown, else unknown.
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
/// than the hysteresis. Windows that were not assessed neither change a state nor interrupt a row. A fault is unknown until a window
/// has shown it ([`DamageEvidence::shows`]), and again when a window finds a damage at the level of warning that is too uncertain to count.
///
/// ```
/// use ema_models::FaultId;
/// use hmd_core::health::{DamageEvidence, Health, HealthState, Levels};
/// let mut health = Health::new([Levels::default(); 7])?;
/// assert_eq!(health.update(0, None).state, HealthState::Unknown);
/// let damage = [0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01];
/// let worn = DamageEvidence { damage, sigma: None };
/// let decision = health.update(1, Some(&worn));
/// assert_eq!((decision.state, decision.faults), (HealthState::Watch, vec![FaultId::Friction]));
/// # Ok::<(), hmd_core::health::LevelsError>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Health {
    /// The rules. They come from the configuration, never from a file in which the rest is kept.
    #[serde(skip)]
    levels: [Levels; FaultId::COUNT],
    /// Faults that no window can show for want of a signal. They come from the configuration too.
    #[serde(skip)]
    hidden: [bool; FaultId::COUNT],
    /// Whether a window has shown each fault, and none after it has put that in doubt; older files had none.
    #[serde(default)]
    shown: [bool; FaultId::COUNT],
    last: (HealthState, [HealthState; FaultId::COUNT]),
    faults: [LevelMemory; FaultId::COUNT],
    /// State that each fault keeps until its part is replaced or the unit is commissioned; older files had none.
    #[serde(default)]
    held: [HealthState; FaultId::COUNT],
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
            hidden: [false; FaultId::COUNT],
            shown: [false; FaultId::COUNT],
            last: (HealthState::Unknown, [HealthState::Unknown; FaultId::COUNT]),
            faults: [LevelMemory::default(); FaultId::COUNT],
            held: [HealthState::Unknown; FaultId::COUNT],
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

    /// State of every fault after the last window, in the order of [`FaultId::ALL`].
    #[must_use]
    pub(crate) fn states(&self) -> [HealthState; FaultId::COUNT] {
        self.last.1
    }

    /// The faults at `warning` or worse of which a window shows, three sigmas above its damage, less than half of that level; with their
    /// states, in the order of [`FaultId::ALL`].
    pub(crate) fn fallen(&self, evidence: &DamageEvidence) -> Vec<(FaultId, HealthState)> {
        let fell = |fault: FaultId| {
            let (state, (damage, sigma)) = (self.faults[fault.index()].state(), evidence.damage_and_sigma(fault)?);
            let has_fallen = damage + SIGNIFICANCE * sigma < 0.5 * self.levels[fault.index()].warning;
            (state >= HealthState::Warning && has_fallen).then_some((fault, state))
        };
        FaultId::ALL.into_iter().filter_map(fell).collect()
    }

    /// Names the faults that no window can show: the state is nominal without them.
    pub(crate) fn hide(&mut self, faults: impl IntoIterator<Item = FaultId>) {
        self.hidden = [false; FaultId::COUNT];
        for fault in faults {
            self.hidden[fault.index()] = true;
        }
    }

    /// Forgets everything, as after the replacement of the part.
    pub fn reset(&mut self) {
        self.shown = [false; FaultId::COUNT];
        self.last = (HealthState::Unknown, [HealthState::Unknown; FaultId::COUNT]);
        self.faults = [LevelMemory::default(); FaultId::COUNT];
        self.release();
    }

    /// Forgets one fault, as after the replacement of a part.
    pub(crate) fn forget(&mut self, fault: FaultId) {
        self.faults[fault.index()] = LevelMemory::default();
        self.shown[fault.index()] = false;
        self.held[fault.index()] = HealthState::Unknown;
        let mut states = self.last.1;
        states[fault.index()] = HealthState::Unknown;
        self.last = (self.of_actuator(&states), states);
    }

    /// Keeps the faults at watch or worse from improving: what they were measured by is void.
    pub(crate) fn hold(&mut self) {
        for (held, state) in self.held.iter_mut().zip(self.last.1) {
            if is_fault(state) {
                *held = state.max(*held);
            }
        }
    }

    /// The damages of the windows decide again.
    pub(crate) fn release(&mut self) {
        self.held = [HealthState::Unknown; FaultId::COUNT];
    }

    /// Takes the next window; `None` if it was not assessed.
    pub fn update(&mut self, window: u64, damage_evidence: Option<&DamageEvidence>) -> HealthDecision {
        for (fault, memory) in FaultId::ALL.into_iter().zip(&mut self.faults) {
            let Some(evidence) = damage_evidence else { break };
            let Some((damage, sigma)) = evidence.damage_and_sigma(fault) else {
                continue;
            };
            let levels = &self.levels[fault.index()];
            memory.update(damage, sigma, significance(fault), levels);
            memory.hold(self.held[fault.index()]);
            let shown = &mut self.shown[fault.index()];
            *shown = evidence.shows(fault, levels) || (*shown && damage < levels.warning);
        }
        let states = FaultId::ALL.map(|fault| match self.faults[fault.index()].state() {
            HealthState::Nominal if !self.shown[fault.index()] => HealthState::Unknown,
            state => state,
        });
        let state = self.of_actuator(&states);
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

    fn of_actuator(&self, states: &[HealthState; FaultId::COUNT]) -> HealthState {
        let worst = states.iter().copied().max().unwrap_or_default();
        let is_open = |(state, hidden): (&HealthState, &bool)| *state == HealthState::Unknown && !hidden;
        if worst == HealthState::Nominal && states.iter().zip(&self.hidden).any(is_open) {
            HealthState::Unknown
        } else {
            worst
        }
    }
}

/// Sigmas above a damage beyond which it is not expected: 98 of 100 are below.
const RULED_OUT: f64 = 2.0;

fn is_fault(state: HealthState) -> bool {
    state >= HealthState::Watch
}

impl DamageEvidence {
    /// Damage and sigma of a fault, if the window tells something of it.
    pub(crate) fn damage_and_sigma(&self, fault: FaultId) -> Option<(f64, f64)> {
        let damage = self.damage[fault.index()];
        let sigma = self.sigma.map_or(0.0, |sigma| sigma[fault.index()]);
        (damage.is_finite() && sigma.is_finite() && sigma >= 0.0).then_some((damage, sigma))
    }

    /// Whether the window shows what state a fault is in: its damage is significant, or a damage at the level of warning is ruled out,
    /// which is two sigmas away.
    #[must_use]
    pub fn shows(&self, fault: FaultId, levels: &Levels) -> bool {
        self.damage_and_sigma(fault).is_some_and(|(damage, sigma)| {
            damage >= significance(fault) * sigma || damage + RULED_OUT * sigma < levels.warning
        })
    }

    /// Damage of each fault that the window shows, in the order of [`FaultId::ALL`].
    pub(crate) fn shown(&self, levels: &[Levels; FaultId::COUNT]) -> [Option<f64>; FaultId::COUNT] {
        FaultId::ALL.map(|fault| {
            let is_shown = self.shows(fault, &levels[fault.index()]);
            is_shown.then_some(self.damage[fault.index()])
        })
    }

    /// The faults of which the window finds a damage, but too uncertain a one to tell their state.
    pub(crate) fn uncertain(&self, levels: &[Levels; FaultId::COUNT]) -> Vec<(FaultId, f64, f64)> {
        let is_open = |fault: &FaultId| !self.shows(*fault, &levels[fault.index()]);
        let found = |fault| {
            let (damage, sigma) = self.damage_and_sigma(fault)?;
            Some((fault, damage, sigma))
        };
        FaultId::ALL.into_iter().filter(is_open).filter_map(found).collect()
    }
}

#[cfg(test)]
mod tests;
