//! What errors of each signal do to an estimate, white ones and ones that drift.

use super::{Comparison, Linearising, SIGNAL_COUNT, SLOPE_LANES};
use crate::dispatch::{InstructionSet, Numbers, Work};
use crate::lanes::Lanes;
use crate::real::Real;
use crate::unknowns::{Coordinates, UNKNOWN_COUNT};

/// One square matrix over the coordinates for each signal.
pub type PerSignal = [[[f64; UNKNOWN_COUNT]; UNKNOWN_COUNT]; SIGNAL_COUNT];

/// Sums over one window of each signal's unweighted sensitivities `J_n`, one row for each sample.
#[derive(Clone, Copy, Debug)]
pub struct Sensitivity {
    /// `Σ J_nᵀ J_n`: covariance of `Jᵀe` for errors e that are white, of unit variance.
    pub white: PerSignal,
    /// `Σ Σ J_nᵀ J_m exp(−|t_n − t_m| / T)`: the same for errors of unit variance that forget themselves in a time T.
    pub drift: PerSignal,
    /// Mean square of each residual at the point itself.
    pub mean_square: [f64; SIGNAL_COUNT],
}

impl Comparison<'_> {
    /// Sensitivities at a point, by the differences of [`Comparison::normal_equations`]; `drift_time` is T, s.
    ///
    /// Samples that were not measured are no time: what drifts is taken to drift from one measured sample to the next.
    #[must_use]
    pub fn sensitivity(&self, at: &Coordinates, step: f64, drift_time: f64) -> Sensitivity {
        let Linearising { monitors, per_step } = self.linearising(at, step);
        InstructionSet::best().run(Summed {
            comparison: self,
            monitors: &monitors,
            per_step,
            kept: libm::exp(-1.0 / (drift_time * self.params.sensors.sample_rate)),
        })
    }
}

struct Summed<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [crate::monitor::Monitor<f64>; SLOPE_LANES],
    per_step: [f64; SLOPE_LANES],
    /// What is kept of an error from one sample to the next.
    kept: f64,
}

impl Work for Summed<'_> {
    type Output = Sensitivity;

    #[inline(always)]
    fn run<N: Numbers>(self) -> Sensitivity {
        let monitor = crate::monitor::Monitor::side_by_side(self.monitors, N::Double::from_lanes);
        let per_step = N::Double::from_lanes(self.per_step);
        let kept = N::Double::splat(self.kept);
        let zero = N::Double::zero();
        let mut white = [[zero; UNKNOWN_COUNT]; SIGNAL_COUNT];
        let mut one_way = white;
        let mut carried = [zero; SIGNAL_COUNT];
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0.0_f64);
        self.comparison.run(&monitor, |_, residuals| {
            let residuals = residuals.to_array();
            count += 1.0;
            for n in 0..SIGNAL_COUNT {
                let r = residuals[n].to_lanes()[0];
                squares[n] += r * r;
                let slope = (residuals[n] - N::Double::splat(r)) * per_step;
                carried[n] = carried[n] * kept + slope;
                let along = slope.to_lanes();
                for p in 0..UNKNOWN_COUNT {
                    let along = N::Double::splat(along[p + 1]);
                    white[n][p] = white[n][p] + slope * along;
                    one_way[n][p] = one_way[n][p] + carried[n] * along;
                }
            }
        });
        let mut sums = Sensitivity {
            white: PerSignal::default(),
            drift: PerSignal::default(),
            mean_square: squares.map(|sum| sum / count.max(1.0)),
        };
        for n in 0..SIGNAL_COUNT {
            let one_way = one_way[n].map(|row| row.to_lanes());
            for p in 0..UNKNOWN_COUNT {
                let same = white[n][p].to_lanes();
                for q in 0..UNKNOWN_COUNT {
                    sums.white[n][p][q] = same[q + 1];
                    // Each pair of samples both ways, each sample with itself once.
                    sums.drift[n][p][q] = one_way[p][q + 1] + one_way[q][p + 1] - same[q + 1];
                }
            }
        }
        sums
    }
}
