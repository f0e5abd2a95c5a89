//! The load of one window at the output, and the part of it under which the gear loses torque.

use core::ops::Range;

use ema_models::ActuatorParams;
use nalgebra::{Matrix2, Vector2};

/// A load at the output: a constant part and a spring.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct OutputLoad {
    /// Constant part, Nm; positive opposes positive motion.
    pub(super) constant: f64,
    /// Stiffness about the first output angle, Nm/rad.
    pub(super) spring: f64,
}

/// Torque at the motor, as a share of the largest, `G_T I_max`, up to which a load is not told from errors of the others.
///
/// On simulated units with a vector drive and without any load, the balance finds up to 0.1 % at 2 kHz. The gear's loss under it
/// has one sign, so it would be taken from the friction.
const UNTOLD_SHARE: f64 = 1e-3;

impl OutputLoad {
    /// The load of a solution.
    pub(super) fn new(x: &Vector2<f64>) -> Self {
        Self {
            constant: x[0],
            spring: x[1],
        }
    }

    /// Whether another load of the same window differs by less than a thousandth of the larger one, in both parts.
    #[must_use]
    pub(super) fn is_close(&self, other: &Self) -> bool {
        let close = |a: f64, b: f64| libm::fabs(a - b) <= 1e-3 * libm::fabs(a).max(libm::fabs(b));
        close(self.constant, other.constant) && close(self.spring, other.spring)
    }

    /// The load at an output angle since the first sample, rad, in Nm; positive opposes positive motion.
    #[must_use]
    pub(super) fn at(&self, travel: f64) -> f64 {
        self.constant + self.spring * travel
    }

    /// Mean magnitude of the load over a range of travel, Nm.
    #[must_use]
    pub(super) fn mean_magnitude(&self, travel: &Range<f64>) -> f64 {
        let (at_start, at_end) = (self.at(travel.start), self.at(travel.end));
        let [one, other] = [at_start, at_end].map(libm::fabs);
        if at_start * at_end < 0.0 {
            0.5 * (one * one + other * other) / (one + other)
        } else {
            0.5 * (one + other)
        }
    }

    /// The part of a found load under which the gear loses torque: `max(0, 1 − (T₀/T)²)` of it, T its root-mean-square torque
    /// at the motor and T₀ 0.1 % of `G_T I_max`.
    ///
    /// `information` are the sums `Σ a aᵀ` of the terms of load and spring over as many rows. Derived here.
    #[must_use]
    pub(super) fn losing(&self, information: &Matrix2<f64>, rows: usize, params: &ActuatorParams) -> Self {
        let x = Vector2::new(self.constant, self.spring);
        let mean_square = x.dot(&(information * x)) / (rows.max(1) as f64);
        let untold = UNTOLD_SHARE * params.motor.torque_gain() * params.motor.i_max;
        let share = if mean_square > 0.0 {
            (1.0 - untold * untold / mean_square).max(0.0)
        } else {
            0.0
        };
        Self::new(&(x * share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_load_too_small_to_be_told_loses_nothing_and_a_large_one_its_all() {
        let params = ActuatorParams::bench();
        // One row whose terms are those of a load alone, −1/n.
        let information = Matrix2::new(1e-4, 0.0, 0.0, 0.0);
        let losing = |constant| {
            let load = OutputLoad { constant, spring: 0.0 };
            load.losing(&information, 1, &params).constant / constant
        };
        assert!(losing(1.0).abs() < 1e-12);
        assert!((losing(50.0) - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_mean_of_a_load_is_that_of_its_magnitude() {
        let mean = |constant, spring| OutputLoad { constant, spring }.mean_magnitude(&(-0.1..0.3));
        for (constant, spring, expected) in [
            (-5.0, 0.0, 5.0),
            (0.0, 0.0, 0.0),
            (10.0, 100.0, 20.0),
            (0.0, 100.0, 12.5),
        ] {
            assert!(
                (mean(constant, spring) - expected).abs() < 1e-12,
                "{constant}, {spring}"
            );
        }
    }
}
