//! Three phases shorted alike and a weak magnet look much the same: which of the two explains a window.

use ema_models::{Coordinates, MOTOR_COORDINATES, MotorKnowledge};

use super::competing_optima::{differ, undecided_difference};
use super::least_squares::{Descent, LocalOptimum};
use super::window::MonitoredWindow;

/// Shorts in all three phases from which on a weak magnet is tried.
pub(super) const ALL_SHORTED: f64 = 0.05;

/// Standard deviation of the back-EMF coefficient for that, as a share.
pub(super) const ANY_MAGNET: f64 = 0.3;

/// Whether the magnets are weak, rather than all three phases shorted.
pub(super) enum WeakMagnet {
    /// Not tried, or the window speaks against it; monitor runs spent.
    No(u64),
    /// It explains the window as well.
    Perhaps(LocalOptimum),
    /// It explains the window clearly better than what is known of the motor allows.
    Yes(LocalOptimum),
}

/// Where an optimum has all three phases shorted, tries whether the motor's back-EMF, left open, takes their place.
pub(super) fn weak_magnet(window: &impl MonitoredWindow, optimum: &LocalOptimum, budget: u64) -> WeakMagnet {
    let common = optimum.at.0[2].min(optimum.at.0[3]).min(optimum.at.0[4]);
    let known = window.prior().motor;
    if common < ALL_SHORTED || known.information().is_none() {
        return WeakMagnet::No(0);
    }
    let open = window.with_motor(MotorKnowledge {
        mean: known.mean,
        covariance: [[known.covariance[0][0], 0.0], [0.0, ANY_MAGNET * ANY_MAGNET]],
    });
    let mut start = optimum.at.0;
    for phase in &mut start[2..=4] {
        *phase -= common;
    }
    start[MOTOR_COORDINATES[1]] -= common;
    let found = Descent::CLOSE_TO_A_FLOOR.descend(&open, Coordinates(start), budget);
    let before = open.cost(&optimum.at);
    let allowed = undecided_difference(&open, found.cost.min(before));
    let different = differ(&found.at, &optimum.at, |_| true);
    let spent = found.spent + 1;
    if different && found.cost < before - allowed {
        WeakMagnet::Yes(LocalOptimum { spent, ..found })
    } else if different && found.cost < before + allowed {
        WeakMagnet::Perhaps(LocalOptimum { spent, ..found })
    } else {
        WeakMagnet::No(spent)
    }
}
