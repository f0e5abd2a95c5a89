//! Comparison of the monitor with a measured window: residuals, costs and normal equations.

use crate::dispatch::{InstructionSet, LaneTypes, LaneWork};
use crate::fault::FaultVector;
use crate::friction::DryFriction;
use crate::lanes::{Lanes, RANK_LANES, SLOPE_LANES};
use crate::monitor::{Calibration, Conditions, Feedback, Monitor};
use crate::params::ActuatorParams;
use crate::prior::{NormalEquations, Prior};
use crate::real::Real;
use crate::recording::Recording;
use crate::residual::ResidualState;
use crate::signals::{SIGNAL_COUNT, Signals, Weights};
use crate::unknowns::{Coordinates, Scale, UNKNOWN_COUNT, Unknowns};

/// A measured window with all that its comparison with the monitor needs.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a> {
    /// The measured window.
    pub recording: Recording<'a>,
    /// Parameters of the actuator.
    pub params: &'a ActuatorParams,
    /// The monitor's calibration.
    pub calibration: &'a Calibration,
    /// Load and supply during the window.
    pub conditions: Conditions,
    /// Weight of each signal.
    pub weights: Weights,
    /// Source of the angles of the monitor's transmission and position loop.
    pub feedback: Feedback,
    /// Prior knowledge of load, integral and motor.
    pub prior: Prior,
}

impl Comparison<'_> {
    /// Unknowns with this fault vector, the measured load, and the mean of the prior.
    #[must_use]
    pub fn unknowns_with_fault(&self, fault: FaultVector) -> Unknowns {
        Unknowns {
            fault,
            load_torque: self.conditions.load_torque.unwrap_or(0.0),
            integral: 0.0,
            motor: self.prior.motor.mean,
        }
    }

    /// The monitor of this window for these unknowns.
    #[must_use]
    pub fn monitor(&self, unknowns: &Unknowns) -> Monitor<f64> {
        let unknowns = self.conditions.at_temperature(unknowns);
        Monitor::new(self.params, self.calibration, self.conditions.v_dc, &unknowns).with_feedback(self.feedback)
    }

    /// Runs a monitor (or several, in lanes) over the window and calls `visit` with index and residuals of each measured sample.
    #[inline(always)]
    fn run<R: Real>(&self, monitor: &Monitor<R>, visit: impl FnMut(usize, Signals<R>)) {
        self.run_under(monitor, |_| (*monitor.friction(), ()), |torque, ()| torque, visit);
    }

    /// [`Comparison::run`] with another friction and torque on the shaft: `shaft` gives the friction after the sample of an index, and
    /// what `on_shaft` makes the torque of from that of the motor, Nm.
    #[inline(always)]
    pub(crate) fn run_under<R: Real, D: Copy>(
        &self,
        monitor: &Monitor<R>,
        shaft: impl Fn(usize) -> (DryFriction<R>, D),
        on_shaft: impl Fn(R, D) -> R + Copy,
        mut visit: impl FnMut(usize, Signals<R>),
    ) {
        let Recording {
            samples,
            drive,
            initial,
        } = &self.recording;
        let Some(first) = drive.first() else { return };
        let mut residual = ResidualState::new(self.params.sensors.sample_rate);
        let mut state = monitor.start(initial, first);
        for (n, (sample, now)) in samples.iter().zip(*drive).enumerate() {
            let earlier = n >= residual.span() && samples[n - residual.span()].measured;
            let measured = Signals::from_sample(sample).map(R::splat);
            let signals = residual.next(&measured, &monitor.output(&state), earlier);
            if sample.measured {
                visit(n, signals);
            }
            let next = drive.get(n + 1).unwrap_or(now);
            let (friction, disturbed) = shaft(n);
            let on_shaft = |torque| on_shaft(torque, disturbed);
            monitor.run_sample_period_under(&mut state, initial, [now, next], &friction, on_shaft);
        }
    }

    /// Calls `visit` with index and unweighted residuals of each measured sample for these unknowns.
    pub fn residuals(&self, unknowns: &Unknowns, visit: impl FnMut(usize, Signals<f64>)) {
        self.run(&self.monitor(unknowns), visit);
    }

    /// Cost of [`Comparison::normal_equations`]: `½ Σ r²`, including the prior.
    #[must_use]
    pub fn cost(&self, at: &Coordinates) -> f64 {
        let scale = Scale::new(self.params);
        self.sum_with_prior(&scale, at, self.least_squares(&scale.unknowns(at)))
    }

    /// [`Comparison::cost`] of several points at once; the bits are the same.
    #[must_use]
    pub fn costs(&self, points: &[Coordinates; COST_LANES]) -> [f64; COST_LANES] {
        let scale = Scale::new(self.params);
        let monitors = core::array::from_fn(|lane| self.monitor(&scale.unknowns(&points[lane])));
        let costs = InstructionSet::best().run(HalfMeanSquares {
            comparison: self,
            monitors: &monitors,
        });
        core::array::from_fn(|lane| self.sum_with_prior(&scale, &points[lane], costs[lane]))
    }

    /// The sum over all samples of a mean cost, plus the cost of the prior.
    fn sum_with_prior(&self, scale: &Scale, at: &Coordinates, mean: f64) -> f64 {
        let known = self.prior.cost(scale, &self.conditions, at);
        mean * self.recording.samples.len() as f64 + known
    }

    /// Least-squares cost without the prior: mean over the samples of `½ Σ (w r)²` over the signals.
    #[must_use]
    pub fn least_squares(&self, unknowns: &Unknowns) -> f64 {
        self.half_mean_square(&self.monitor(unknowns))
    }

    /// [`Comparison::least_squares`] of several unknowns at once, in single precision: for searches, which only rank costs.
    #[must_use]
    pub fn rank(&self, unknowns: &[Unknowns; RANK_LANES]) -> [f64; RANK_LANES] {
        self.rank_with(InstructionSet::best(), unknowns)
    }

    /// [`Comparison::rank`] with one instruction set, for benches; every instruction set gives the same bits.
    #[must_use]
    pub fn rank_with(&self, instructions: InstructionSet, unknowns: &[Unknowns; RANK_LANES]) -> [f64; RANK_LANES] {
        let monitors = unknowns.map(|u| self.monitor(&u));
        instructions
            .run(HalfMeanSquare {
                comparison: self,
                monitors: &monitors,
            })
            .map(f64::from)
    }

    #[inline(always)]
    fn half_mean_square<R: Real>(&self, monitor: &Monitor<R>) -> R {
        let weights = self.weights.to_array().map(R::splat);
        let mut sum = R::zero();
        self.run(monitor, |_, r| {
            let r = r.to_array();
            for n in 0..SIGNAL_COUNT {
                let weighted = weights[n] * r[n];
                sum = sum + weighted * weighted;
            }
        });
        sum * R::splat(0.5 / self.recording.samples.len().max(1) as f64)
    }

    /// Modified total least squares of \[P\] eq. 14, with the square that is missing there:
    /// `Σ (I_HF − I_LF)² / √((τ dI_HF/dt)² + 1)`, on the quadrature current, as a mean over the samples.
    ///
    /// `time_scale` τ, s/A, makes the derivative dimensionless. The cost tolerates small delays where the current is steep.
    #[must_use]
    pub fn modified_total_least_squares(
        &self,
        unknowns: &[Unknowns; COST_LANES],
        time_scale: f64,
    ) -> [f64; COST_LANES] {
        let monitors = core::array::from_fn(|lane| self.monitor(&unknowns[lane]));
        InstructionSet::best().run(TotalLeastSquares {
            comparison: self,
            monitors: &monitors,
            time_scale,
        })
    }

    /// Normal equations at a point, by one-sided differences of monitors run in lanes, including the [`Prior`].
    ///
    /// The steps, of length `step`, point into the box. A long step smooths the small unevenness of the cost far from a minimum;
    /// a short step resolves the curvature near it.
    #[must_use]
    pub fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations {
        self.linearised(at, step, None)
    }

    /// [`Comparison::normal_equations`] with the derivatives of this comparison and other residuals: unweighted, one row per sample, rows that
    /// are missing counting as zero.
    #[must_use]
    pub fn normal_equations_with(
        &self,
        at: &Coordinates,
        step: f64,
        residuals: &[[f64; SIGNAL_COUNT]],
    ) -> NormalEquations {
        self.linearised(at, step, Some(residuals))
    }

    fn linearised(&self, at: &Coordinates, step: f64, residuals: Option<&[[f64; SIGNAL_COUNT]]>) -> NormalEquations {
        let scale = Scale::new(self.params);
        let steps = at.inward_steps(step);
        let monitors: [Monitor<f64>; SLOPE_LANES] = core::array::from_fn(|lane| {
            let mut x = *at;
            // Lane 0 and the unused lanes are at the point itself.
            if (1..=UNKNOWN_COUNT).contains(&lane) {
                x.0[lane - 1] += steps[lane - 1];
            }
            self.monitor(&scale.unknowns(&x))
        });
        let mut sums = InstructionSet::best().run(Linearised {
            comparison: self,
            monitors: &monitors,
            steps,
            residuals,
        });
        self.prior.add_to(&mut sums, &scale, &self.conditions, at);
        sums
    }
}

/// Points per call of [`Comparison::costs`].
pub const COST_LANES: usize = SLOPE_LANES;

/// [`Comparison::half_mean_square`] of several monitors in single precision, as [`LaneWork`].
struct HalfMeanSquare<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; RANK_LANES],
}

impl LaneWork for HalfMeanSquare<'_> {
    type Output = [f32; RANK_LANES];

    #[inline(always)]
    fn run<N: LaneTypes>(self) -> [f32; RANK_LANES] {
        let monitor = Monitor::side_by_side(self.monitors, |x| N::Single::from_lanes(x.map(|x| x as f32)));
        self.comparison.half_mean_square(&monitor).to_lanes()
    }
}

/// [`Comparison::half_mean_square`] of several monitors in double precision, as [`LaneWork`].
struct HalfMeanSquares<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; COST_LANES],
}

impl LaneWork for HalfMeanSquares<'_> {
    type Output = [f64; COST_LANES];

    #[inline(always)]
    fn run<N: LaneTypes>(self) -> [f64; COST_LANES] {
        let monitor = Monitor::side_by_side(self.monitors, N::Double::from_lanes);
        self.comparison.half_mean_square(&monitor).to_lanes()
    }
}

/// [`Comparison::modified_total_least_squares`] as [`LaneWork`].
struct TotalLeastSquares<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; COST_LANES],
    time_scale: f64,
}

impl LaneWork for TotalLeastSquares<'_> {
    type Output = [f64; COST_LANES];

    #[inline(always)]
    fn run<N: LaneTypes>(self) -> [f64; COST_LANES] {
        let monitor = Monitor::side_by_side(self.monitors, N::Double::from_lanes);
        let samples = self.comparison.recording.samples;
        let per_period = self.comparison.params.sensors.sample_rate;
        let mut sum = N::Double::zero();
        self.comparison.run(&monitor, |n, r| {
            let (before, after) = (&samples[n.saturating_sub(1)], &samples[(n + 1).min(samples.len() - 1)]);
            let span = if n == 0 || n + 1 == samples.len() { 1.0 } else { 2.0 };
            let slope = self.time_scale * (after.i_q - before.i_q) * per_period / span;
            sum = sum + r.i_q * r.i_q / N::Double::splat(libm::sqrt(slope * slope + 1.0));
        });
        sum.to_lanes().map(|sum| sum / samples.len().max(1) as f64)
    }
}

/// Sums of the normal equations without the prior, as [`LaneWork`].
struct Linearised<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; SLOPE_LANES],
    steps: [f64; UNKNOWN_COUNT],
    /// Residuals in place of those of the monitor at the point.
    residuals: Option<&'a [[f64; SIGNAL_COUNT]]>,
}

impl LaneWork for Linearised<'_> {
    type Output = NormalEquations;

    #[inline(always)]
    fn run<N: LaneTypes>(self) -> NormalEquations {
        let monitor = Monitor::side_by_side(self.monitors, N::Double::from_lanes);
        let weights = self.comparison.weights.to_array();
        let mut per_step = [0.0; SLOPE_LANES];
        for (p, step) in self.steps.into_iter().enumerate() {
            per_step[p + 1] = 1.0 / step;
        }
        let per_step = N::Double::from_lanes(per_step);
        let zero = N::Double::zero();
        let (mut cost, mut jtr, mut jtj) = (0.0, zero, [zero; UNKNOWN_COUNT]);
        self.comparison.run(&monitor, |sample, residuals| {
            let residuals = residuals.to_array();
            let given = self.residuals.map(|rows| rows.get(sample).copied().unwrap_or_default());
            for n in 0..SIGNAL_COUNT {
                let weighted = residuals[n] * N::Double::splat(weights[n]);
                let point = weighted.to_lanes()[0];
                let r = given.map_or(point, |given| given[n] * weights[n]);
                let slope = (weighted - N::Double::splat(point)) * per_step;
                let along = slope.to_lanes();
                cost += 0.5 * r * r;
                jtr = jtr + slope * N::Double::splat(r);
                for p in 0..UNKNOWN_COUNT {
                    jtj[p] = jtj[p] + slope * N::Double::splat(along[p + 1]);
                }
            }
        });
        let mut sums = NormalEquations {
            cost,
            ..NormalEquations::default()
        };
        let jtr = jtr.to_lanes();
        for p in 0..UNKNOWN_COUNT {
            sums.jtr[p] = jtr[p + 1];
            sums.jtj[p].copy_from_slice(&jtj[p].to_lanes()[1..=UNKNOWN_COUNT]);
        }
        sums
    }
}
