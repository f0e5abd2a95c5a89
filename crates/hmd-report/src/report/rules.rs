//! What a page measures damages and hours left by.

use ema_models::FaultId;
use hmd_core::catalogue::{FaultMode, catalogue};
use hmd_core::health::{HealthState, Levels};
use hmd_core::record::Shown;

/// Levels and texts of the faults, and the level of the remaining life.
pub(super) struct Rules {
    /// In the order of [`FaultId::ALL`].
    pub(super) modes: [FaultMode; FaultId::COUNT],
    /// An actuator is critical whose 10 % quantile of the hours left is below this; 0: never.
    pub(super) critical_h: f64,
    /// Whether the windows were assessed by them, as far as is known; the recordings do not say their own levels otherwise.
    pub(super) are_levels_of_windows: bool,
}

impl Rules {
    pub(super) fn new(levels: &[Levels; FaultId::COUNT], critical_h: f64, are_levels_of_windows: bool) -> Self {
        Self {
            modes: catalogue(levels).fault_modes,
            critical_h,
            are_levels_of_windows,
        }
    }

    /// The mode of a fault.
    pub(super) fn of(&self, fault: FaultId) -> &FaultMode {
        &self.modes[fault.index()]
    }

    /// The same, where its levels are those of the windows.
    pub(super) fn of_windows(&self, fault: FaultId) -> Option<&FaultMode> {
        self.are_levels_of_windows.then(|| self.of(fault))
    }

    /// Level of a damage by the levels of this page, where the windows were assessed by others, which gave it this lower one.
    pub(super) fn level_above(&self, fault: FaultId, shown: Shown, state: HealthState) -> Option<HealthState> {
        let mode = self.of(fault);
        let level = level_of(shown.damage, mode);
        let is_above = !self.are_levels_of_windows && level > state && state != HealthState::Unknown;
        (is_above && is_certain(shown, mode)).then_some(level)
    }
}

/// Whether a damage is beyond its uncertainty.
pub(super) fn is_certain(shown: Shown, mode: &FaultMode) -> bool {
    shown
        .sigma
        .is_none_or(|sigma| shown.damage >= mode.significance_sigmas * sigma)
}

/// The level of a damage by itself.
pub(super) fn level_of(damage: f64, mode: &FaultMode) -> HealthState {
    let reached = mode.severity.iter().rfind(|severity| damage >= severity.damage);
    reached.map_or(HealthState::Nominal, |severity| severity.class)
}

#[cfg(test)]
impl Default for Rules {
    fn default() -> Self {
        Self::new(&[Levels::default(); FaultId::COUNT], 0.0, true)
    }
}
