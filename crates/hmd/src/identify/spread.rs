//! How far errors of the data and of the monitor move an estimate.
//!
//! An estimate is off by `−H⁻¹ (Jᵀ W² e + P d)`: e are the residuals at the truth, W the weights, P what is known beforehand
//! and d by how much it is wrong, `H = Jᵀ W² J + P`. So the covariance of e, through the window's own sensitivities, is the
//! covariance of the estimate. The weights need not be right for that; they decide how good the estimate is, not how good it
//! is said to be.

use ema_models::{Comparison, Coordinates, NormalEquations, SIGNAL_COUNT, Signals, UNKNOWN_COUNT};
use nalgebra::SMatrix;

use super::refine::{FINE_STEP, hold_known_motor};
use crate::calibration::Mismatch;

/// Time after which the monitor's slow errors have forgotten themselves, s: a tenth of a window.
const DRIFT_TIME_S: f64 = 0.05;

/// Information that a coordinate without any influence is given, so that the others can be found.
const VANISHING: f64 = 1e-9;

type Matrix = SMatrix<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>;

/// Variances of each coordinate for errors of unit variance, by kind and signal.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// Of what is known beforehand being wrong by as much as it says.
    known: [f64; UNKNOWN_COUNT],
    /// Of coordinates that nothing says anything of being anywhere.
    unseen: [f64; UNKNOWN_COUNT],
    /// Of errors that are white.
    white: [[f64; UNKNOWN_COUNT]; SIGNAL_COUNT],
    /// Of errors that drift.
    drift: [[f64; UNKNOWN_COUNT]; SIGNAL_COUNT],
    /// Mean square of each residual.
    pub(super) mean_square: [f64; SIGNAL_COUNT],
}

/// Kinds of errors that a calibration tells apart: the ripple's white share, and the drift of each signal.
pub const KINDS: usize = 1 + SIGNAL_COUNT;

/// Signals whose residuals are mostly the inverter's ripple and the converters' noise.
const CURRENTS: [usize; 2] = [0, 1];

impl Spread {
    /// At a point; without a window that says anything, infinite.
    pub(super) fn of(comparison: &Comparison<'_>, at: &Coordinates) -> Self {
        let sums = comparison.sensitivity(at, FINE_STEP, DRIFT_TIME_S);
        let squares = comparison.weights.to_array().map(|w| w * w);
        let prior = comparison.prior.information(comparison.params, &comparison.conditions);
        let mut normal = NormalEquations {
            jtj: prior,
            ..NormalEquations::default()
        };
        for p in 0..UNKNOWN_COUNT {
            normal.jtj[p][p] += VANISHING;
            for q in 0..UNKNOWN_COUNT {
                normal.jtj[p][q] += (0..SIGNAL_COUNT).map(|s| squares[s] * sums.white[s][p][q]).sum::<f64>();
            }
        }
        let normal = hold_known_motor(normal, &comparison.prior.motor);
        let inverse = Matrix::from_fn(|r, c| normal.jtj[r][c])
            .cholesky()
            .map(|factor| factor.inverse());
        let through = |covariance: &[[f64; UNKNOWN_COUNT]; UNKNOWN_COUNT], scale: f64| match &inverse {
            Some(inverse) => {
                let covariance = Matrix::from_fn(|r, c| scale * covariance[r][c]);
                let moved = inverse * covariance * inverse;
                std::array::from_fn(|p| moved[(p, p)])
            }
            None => [f64::INFINITY; UNKNOWN_COUNT],
        };
        let mut vanishing = [[0.0; UNKNOWN_COUNT]; UNKNOWN_COUNT];
        for (p, row) in vanishing.iter_mut().enumerate() {
            row[p] = VANISHING;
        }
        Self {
            known: through(&prior, 1.0),
            unseen: through(&vanishing, 1.0),
            white: std::array::from_fn(|s| through(&sums.white[s], squares[s] * squares[s])),
            drift: std::array::from_fn(|s| through(&sums.drift[s], squares[s] * squares[s])),
            mean_square: sums.mean_square,
        }
    }

    /// Variance of each coordinate that does not depend on [`KINDS`], and how much one unit of each kind adds.
    ///
    /// What a current's residual has beyond the ripple is sensor noise, and white. A position or speed that fits worse than
    /// in the calibration's windows drifts as much more.
    #[must_use]
    pub fn kinds(&self, mismatch: &Mismatch) -> ([f64; UNKNOWN_COUNT], [[f64; UNKNOWN_COUNT]; KINDS]) {
        let expected = Signals::from(mismatch.residual_rms).to_array().map(|rms| rms * rms);
        let mut fixed: [f64; UNKNOWN_COUNT] = std::array::from_fn(|p| self.known[p] + self.unseen[p]);
        let mut kinds = [[0.0; UNKNOWN_COUNT]; KINDS];
        for s in 0..SIGNAL_COUNT {
            let current = CURRENTS.contains(&s);
            let worse = self.mean_square[s] / expected[s];
            for p in 0..UNKNOWN_COUNT {
                if current {
                    fixed[p] += (self.mean_square[s] - expected[s]).max(0.0) * self.white[s][p];
                    kinds[0][p] += expected[s] * self.white[s][p];
                }
                kinds[1 + s][p] = self.drift[s][p] * if current { 1.0 } else { worse.max(1.0) };
            }
        }
        (fixed, kinds)
    }

    /// Variance of each coordinate under a calibration's errors.
    pub(super) fn variance(&self, mismatch: &Mismatch) -> [f64; UNKNOWN_COUNT] {
        let (mut variance, kinds) = self.kinds(mismatch);
        for (kind, size) in kinds.iter().zip(mismatch.sizes()) {
            for p in 0..UNKNOWN_COUNT {
                variance[p] += size * kind[p];
            }
        }
        variance
    }
}
