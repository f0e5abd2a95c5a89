//! Levels that one quantity has reached, by windows: hysteresis and persistence. Damage of a fault and drift of a sensor use it alike.

use ema_models::FaultId;
use serde::{Deserialize, Serialize};

use super::{HealthState, Levels};

/// Levels above nominal: watch, warning, critical.
pub(super) const STEPS: usize = 3;

/// State by the number of levels that are reached.
pub(super) const STATES: [HealthState; STEPS + 1] = [
    HealthState::Nominal,
    HealthState::Watch,
    HealthState::Warning,
    HealthState::Critical,
];

/// Levels that one quantity has reached, with hysteresis and persistence.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct LevelMemory {
    /// Levels reached: index into [`STATES`].
    reached: usize,
    /// Assessed windows in a row at or above each level.
    above: [u32; STEPS],
}

/// Sigmas below which a quantity is no evidence of anything: chance exceeds them with 0.27 %.
pub const SIGNIFICANCE: f64 = 3.0;

/// Sigmas that chance exceeds as rarely in the amplitude of two components, `√(−2 ln 0.0027)` (Rayleigh distribution).
const SIGNIFICANCE_OF_AMPLITUDE: f64 = 3.44;

/// Sigmas below which a damage is no evidence of the fault. An eccentricity is the amplitude of two components.
#[must_use]
pub fn significance(fault: FaultId) -> f64 {
    if fault == FaultId::Eccentricity {
        SIGNIFICANCE_OF_AMPLITUDE
    } else {
        SIGNIFICANCE
    }
}

impl LevelMemory {
    /// Whether the state is possible; a damaged file may hold any numbers.
    pub(crate) fn is_possible(&self) -> bool {
        self.reached <= STEPS
    }

    /// Goes back to a state, where the one reached is better.
    pub(super) fn hold(&mut self, least: HealthState) {
        let levels = STATES.iter().position(|state| *state == least).unwrap_or(0);
        self.reached = self.reached.max(levels);
    }

    /// The level reached.
    pub(crate) fn state(&self) -> HealthState {
        STATES[self.reached]
    }

    /// Assessed windows in a row at or above the level after the one reached; 0 at the last.
    pub(super) fn pending(&self) -> u32 {
        self.above.get(self.reached).copied().unwrap_or(0)
    }

    /// Takes a reading, a damage or whatever the levels are of, with its standard deviation; it counts from so many sigmas on.
    pub(crate) fn update(&mut self, damage: f64, sigma: f64, sigmas: f64, levels: &Levels) {
        let steps = levels.steps();
        let significant = damage >= sigmas * sigma;
        for (above, level) in self.above.iter_mut().zip(steps) {
            *above = if significant && damage >= level {
                above.saturating_add(1)
            } else {
                0
            };
        }
        let worse = self.above.iter().filter(|&&above| above >= levels.persistence).count();
        if worse > self.reached {
            self.reached = worse;
            return;
        }
        while self.reached > 0 && damage + sigma < steps[self.reached - 1] - levels.hysteresis {
            self.reached -= 1;
        }
    }
}
