//! Levenberg–Marquardt from health, the window's own noise, and once more.

use ema_ga::{Bounds, LmConfig, Residuals, levenberg_marquardt};
use ema_models::{Coordinates, FaultVector, NormalEquations, SIGNAL_COUNT, Scale, Signals, UNKNOWN_COUNT, Unknowns};
use nalgebra::{SMatrix, SVector};

use crate::compare::Identification;
use crate::window::RecordedWindow;

/// Steps of the finite differences: far from the solution, and near it.
const STEPS: [f64; 2] = [2e-2, 2e-3];

/// Loads from which the search starts where the load is not measured, in shares of the largest: the gear's losses bend at
/// zero, so both sides are tried.
const LOAD_STARTS: [f64; 2] = [-0.01, 0.01];

/// Where an identification ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The best point.
    pub at: Coordinates,
    /// Its cost `½ Σ r²`, by the weights of the last descent.
    pub cost: f64,
    /// Linearisations made.
    pub linearisations: u32,
    /// Monitor runs over the window, those of the linearisations included.
    pub runs: u32,
}

impl Identification {
    /// Finds the unknowns of one window, from health.
    #[must_use]
    pub fn identify(&self, window: &RecordedWindow<'_>) -> Found {
        let scale = Scale::new(&self.params);
        let from = |load_torque| {
            scale.coordinates(&Unknowns {
                fault: FaultVector::NOMINAL,
                load_torque,
                integral: 0.0,
                motor: self.prior.motor.mean,
            })
        };
        let mut best = match self.conditions.load_torque {
            Some(load) => self.descend(window, from(load)),
            None => {
                let [below, above] = LOAD_STARTS.map(|share| from(share * scale.load_unit()));
                let (one, other) = (self.descend(window, below), self.descend(window, above));
                let better = if other.cost < one.cost { other } else { one };
                better.after(
                    one.linearisations + other.linearisations - better.linearisations,
                    one.runs + other.runs - better.runs,
                )
            }
        };
        let weighed = Self {
            weights: self.weights_by_noise(window, &best.at),
            ..*self
        };
        best.runs += 1;
        weighed.descend(window, best.at).after(best.linearisations, best.runs)
    }

    /// One descent, coarse and then fine; the better of both ends.
    fn descend(&self, window: &RecordedWindow<'_>, start: Coordinates) -> Found {
        #[expect(clippy::expect_used, reason = "the bounds are constants of the program")]
        let bounds = Bounds::new(Coordinates::LOWER, Coordinates::UPPER).expect("constant bounds ascend");
        let config = LmConfig {
            max_iterations: 25,
            max_evaluations: 60,
            step_tolerance: 2e-5,
            cost_tolerance: 1e-6,
            ..LmConfig::default()
        };
        let mut from = start.0;
        let mut end = Found {
            at: start,
            cost: f64::INFINITY,
            linearisations: 0,
            runs: 0,
        };
        for step in STEPS {
            let descent = Descent {
                identification: self,
                window,
                step,
            };
            let found = levenberg_marquardt(&descent, &bounds, from, &config);
            end = end.after(
                found.iterations,
                found.evaluations + found.iterations * UNKNOWN_COUNT as u32,
            );
            from = found.genes;
            if found.cost < end.cost {
                (end.cost, end.at) = (found.cost, Coordinates(from));
            }
        }
        end
    }

    /// The weights, less where a signal is noisier than expected.
    fn weights_by_noise(&self, window: &RecordedWindow<'_>, at: &Coordinates) -> Signals<f64> {
        let (found, expected) = (self.residual_rms(window, at), self.expected.to_array());
        let mut weights = self.weights.to_array();
        for signal in 0..SIGNAL_COUNT {
            weights[signal] *= (expected[signal] / found[signal].max(f64::MIN_POSITIVE)).min(1.0);
        }
        Signals::from_array(weights)
    }
}

impl Found {
    /// With the effort that came before it.
    fn after(self, linearisations: u32, runs: u32) -> Self {
        Self {
            linearisations: self.linearisations + linearisations,
            runs: self.runs + runs,
            ..self
        }
    }
}

struct Descent<'a> {
    identification: &'a Identification,
    window: &'a RecordedWindow<'a>,
    step: f64,
}

impl Residuals<UNKNOWN_COUNT> for Descent<'_> {
    fn normal_equations(
        &self,
        genes: &[f64; UNKNOWN_COUNT],
        jtj: &mut SMatrix<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>,
        jtr: &mut SVector<f64, UNKNOWN_COUNT>,
    ) -> f64 {
        let at = Coordinates(*genes);
        let sums: NormalEquations = self
            .identification
            .normal_equations(self.window, &at, self.step)
            .with_known_motor_fixed(&self.identification.prior.motor);
        for p in 0..UNKNOWN_COUNT {
            jtr[p] = sums.jtr[p];
            for q in 0..UNKNOWN_COUNT {
                jtj[(p, q)] = sums.jtj[p][q];
            }
        }
        sums.cost
    }

    fn cost(&self, genes: &[f64; UNKNOWN_COUNT]) -> f64 {
        self.identification.cost(self.window, &Coordinates(*genes))
    }
}
