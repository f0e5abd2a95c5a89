//! What the last window of an actuator showed, as gauges publish it and its history keeps it.

use ema_models::FaultId;
use serde::{Deserialize, Serialize};

use crate::fallen::fallen_by;
use crate::health::HealthState;
use crate::record::{Health, Rul};
use crate::windows_in_a_row::WindowsInARow;

/// What is known by the last window. What it does not show is not known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LastWindow {
    /// Its start, UTC ns.
    pub t_start_ns: u64,
    /// Damage and its standard deviation, in the order of [`FaultId::ALL`].
    pub(crate) damage: [(Option<f64>, Option<f64>); FaultId::COUNT],
    /// In the same order.
    pub(crate) states: Option<[HealthState; FaultId::COUNT]>,
    /// Hours left: 10, 50 and 90 % quantile.
    pub(crate) rul_h: [Option<f64>; 3],
    pub(crate) in_a_row: WindowsInARow,
    /// Which damages it says to have fallen without a repair; older files had none.
    #[serde(default)]
    pub(crate) fallen: [bool; FaultId::COUNT],
}

impl LastWindow {
    /// Leaves out what it says of a fault whose part is another now.
    pub(crate) fn forget(&mut self, fault: FaultId) {
        self.damage[fault.index()] = (None, None);
        if let Some(states) = &mut self.states {
            states[fault.index()] = HealthState::Unknown;
        }
    }

    /// Of the records of a window, and what it has in common with those before.
    #[must_use]
    pub fn new(health: &Health, rul: &Rul, in_a_row: &WindowsInARow) -> Self {
        let (damages, sigmas) = (health.damages(), health.damage_sigmas());
        Self {
            t_start_ns: health.t_start_ns,
            damage: std::array::from_fn(|n| (damages[n], sigmas[n].filter(|_| damages[n].is_some()))),
            states: health.states(),
            rul_h: [rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h],
            in_a_row: in_a_row.clone(),
            fallen: fallen_by(&health.reason),
        }
    }
}
