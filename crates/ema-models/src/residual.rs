//! Comparison of the monitor with a measured window: residuals (measured minus modelled), costs and normal equations.

use crate::dispatch::{InstructionSet, LaneTypes, LaneWork};
use crate::fault::FaultVector;
use crate::lanes::{Lanes, RANK_LANES, SLOPE_LANES};
use crate::monitor::{Calibration, Conditions, Feedback, Monitor, Output};
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::recording::Recording;
use crate::samples::ComparedSample;
use crate::unknowns::{
    Coordinates, LOAD_COORDINATE, MOTOR_COORDINATES, MotorKnowledge, Scale, UNKNOWN_COUNT, Unknowns,
};

/// Number of compared signals.
pub const SIGNAL_COUNT: usize = 5;

/// One number per compared signal: `i_d`, `i_q`, motor angle, motor speed, output angle.
///
/// The three phase currents are compared in the rotor frame, which is equivalent: at any angle
/// `Σ r_j² = 3/2 (r_d² + r_q²)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signals<T> {
    /// Direct current, A.
    pub i_d: T,
    /// Quadrature current, A.
    pub i_q: T,
    /// Motor angle, rad.
    pub theta_m: T,
    /// Motor speed, rad/s.
    pub omega_m: T,
    /// Output angle, rad.
    pub theta_out: T,
}

impl Signals<f64> {
    /// The measured signals of a sample.
    #[inline(always)]
    #[must_use]
    pub fn from_sample(sample: &ComparedSample) -> Self {
        Self {
            i_d: sample.i_d,
            i_q: sample.i_q,
            theta_m: sample.theta_m,
            omega_m: sample.omega_m,
            theta_out: sample.theta_out,
        }
    }
}

impl<T: Copy> Signals<T> {
    /// The signals in another number type.
    #[inline(always)]
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(T) -> S) -> Signals<S> {
        Signals {
            i_d: f(self.i_d),
            i_q: f(self.i_q),
            theta_m: f(self.theta_m),
            omega_m: f(self.omega_m),
            theta_out: f(self.theta_out),
        }
    }

    /// As an array, in the order of the fields.
    #[must_use]
    pub fn to_array(self) -> [T; SIGNAL_COUNT] {
        [self.i_d, self.i_q, self.theta_m, self.omega_m, self.theta_out]
    }

    /// From an array, in the order of the fields.
    #[must_use]
    pub fn from_array(a: [T; SIGNAL_COUNT]) -> Self {
        Self {
            i_d: a[0],
            i_q: a[1],
            theta_m: a[2],
            omega_m: a[3],
            theta_out: a[4],
        }
    }
}

/// Residuals of one monitor (or several, in lanes), sample by sample.
///
/// The residual of the speed is the difference of two residuals of the angle, about 1 ms and at least one sample apart,
/// divided by that time, so that measured and modelled speed are means over the same time at any sampling rate. It is zero
/// where the earlier angle was not measured.
#[derive(Clone, Copy, Debug)]
pub struct ResidualState<R> {
    per_span: R,
    span: usize,
    /// Residuals of the angle at the last samples, a ring buffer, and the index of the next one.
    angles: [R; LONGEST_SPAN],
    place: usize,
}

impl<R: Real> ResidualState<R> {
    /// The state before the first sample; `sample_rate` in Hz.
    #[must_use]
    #[inline(always)]
    pub fn new(sample_rate: f64) -> Self {
        let span = (libm::round(sample_rate * SPEED_SPAN) as usize).clamp(1, LONGEST_SPAN);
        Self {
            per_span: R::splat(sample_rate / span as f64),
            span,
            angles: [R::zero(); LONGEST_SPAN],
            place: 0,
        }
    }

    /// Samples over which speed is measured.
    #[must_use]
    #[inline(always)]
    pub fn span(&self) -> usize {
        self.span
    }

    /// Unweighted residuals of the next sample; `earlier` is true if the sample one span before it exists and was measured.
    #[inline(always)]
    pub fn next(&mut self, measured: &Signals<R>, output: &Output<R>, earlier: bool) -> Signals<R> {
        let theta_m = measured.theta_m - output.theta_m;
        let omega_m = if earlier {
            (theta_m - self.angles[self.place]) * self.per_span
        } else {
            R::zero()
        };
        self.angles[self.place] = theta_m;
        self.place = (self.place + 1) % self.span;
        Signals {
            i_d: measured.i_d - output.i_d,
            i_q: measured.i_q - output.i_q,
            theta_m,
            omega_m,
            theta_out: measured.theta_out - output.theta_out,
        }
    }
}

/// Weight of each signal: the inverse of its expected residual (1/A, 1/rad, s/rad); 0 omits the signal.
pub type Weights = Signals<f64>;

impl Weights {
    /// Only the quadrature current, as in \[P\].
    pub const CURRENT_ONLY: Self = Self {
        i_d: 0.0,
        i_q: 1.0,
        theta_m: 0.0,
        omega_m: 0.0,
        theta_out: 0.0,
    };
}

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

/// Prior knowledge of the unknowns beside the fault vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Standard deviation of the load torque about [`Conditions::load_torque`] (about 0 where it is not measured), Nm at the
    /// output; infinite without prior knowledge.
    pub load_torque: f64,
    /// Standard deviation of the speed loop's integral about its value from the first currents, Nm.
    pub integral: f64,
    /// Deviation of the motor. If it is known exactly, it adds no term, and its coordinates are fixed.
    pub motor: MotorKnowledge,
}

/// Coordinates with prior knowledge: load, integral, motor.
const KNOWN: [usize; 4] = [LOAD_COORDINATE, 9, MOTOR_COORDINATES[0], MOTOR_COORDINATES[1]];

impl Prior {
    /// Adds the terms of the prior to the normal equations at a point.
    pub fn add_to(&self, sums: &mut NormalEquations, scale: &Scale, conditions: &Conditions, at: &Coordinates) {
        let (distance, information) = self.terms(scale, conditions, at);
        for (r, &p) in KNOWN.iter().enumerate() {
            for (c, &q) in KNOWN.iter().enumerate() {
                sums.jtj[p][q] += information[r][c];
                sums.jtr[p] += information[r][c] * distance[c];
                sums.cost += 0.5 * distance[r] * information[r][c] * distance[c];
            }
        }
    }

    /// Cost of a point's distance from the prior's mean.
    #[must_use]
    pub fn cost(&self, scale: &Scale, conditions: &Conditions, at: &Coordinates) -> f64 {
        let (distance, information) = self.terms(scale, conditions, at);
        let mut known = 0.0;
        for (row, d) in information.iter().zip(distance) {
            for (weight, other) in row.iter().zip(distance) {
                known += 0.5 * d * weight * other;
            }
        }
        known
    }

    /// Distance from the mean, and information matrix, in the order of [`KNOWN`].
    fn terms(&self, scale: &Scale, conditions: &Conditions, at: &Coordinates) -> ([f64; 4], [[f64; 4]; 4]) {
        let unit = Unknowns {
            fault: FaultVector::NOMINAL,
            load_torque: self.load_torque,
            integral: self.integral,
            motor: self.motor.mean,
        };
        let sigma = scale.coordinates(&unit).0;
        let expected = scale
            .coordinates(&Unknowns {
                load_torque: conditions.load_torque.unwrap_or(0.0),
                integral: 0.0,
                ..unit
            })
            .0;
        let mut information = [[0.0; 4]; 4];
        information[0][0] = 1.0 / (sigma[LOAD_COORDINATE] * sigma[LOAD_COORDINATE]);
        information[1][1] = 1.0 / (sigma[9] * sigma[9]);
        if let Some(motor) = self.motor.information() {
            for (r, row) in motor.into_iter().enumerate() {
                information[2 + r][2..].copy_from_slice(&row);
            }
        }
        (KNOWN.map(|p| at.0[p] - expected[p]), information)
    }
}

/// Normal equations of a least-squares problem in [`Coordinates`].
#[derive(Clone, Copy, Debug, Default)]
pub struct NormalEquations {
    /// `JᵀJ`.
    pub jtj: [[f64; UNKNOWN_COUNT]; UNKNOWN_COUNT],
    /// `Jᵀr`.
    pub jtr: [f64; UNKNOWN_COUNT],
    /// `½ Σ r²`.
    pub cost: f64,
}

impl NormalEquations {
    /// The equations with the motor's coordinates fixed if the deviation is known exactly: they do not change and add no
    /// uncertainty.
    #[must_use]
    pub fn with_known_motor_fixed(mut self, motor: &MotorKnowledge) -> Self {
        if motor.information().is_none() {
            for p in MOTOR_COORDINATES {
                for q in 0..UNKNOWN_COUNT {
                    self.jtj[p][q] = 0.0;
                    self.jtj[q][p] = 0.0;
                }
                self.jtj[p][p] = 1.0;
                self.jtr[p] = 0.0;
            }
        }
        self
    }
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
        self.run_under(monitor, |_| (), |torque, ()| torque, visit);
    }

    /// [`Comparison::run`] with another torque on the shaft: `on_shaft` gives it, Nm, from that of the motor and what
    /// `disturbance` gives for the index of the sample before.
    #[inline(always)]
    pub(crate) fn run_under<R: Real, D: Copy>(
        &self,
        monitor: &Monitor<R>,
        disturbance: impl Fn(usize) -> D,
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
            let disturbed = disturbance(n);
            let on_shaft = |torque| on_shaft(torque, disturbed);
            monitor.run_sample_period_under(&mut state, initial, [now, next], on_shaft);
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
    pub fn modified_total_least_squares(&self, unknowns: &Unknowns, time_scale: f64) -> f64 {
        let samples = self.recording.samples;
        let per_period = self.params.sensors.sample_rate;
        let mut sum = 0.0;
        self.residuals(unknowns, |n, r| {
            let (before, after) = (&samples[n.saturating_sub(1)], &samples[(n + 1).min(samples.len() - 1)]);
            let span = if n == 0 || n + 1 == samples.len() { 1.0 } else { 2.0 };
            let slope = time_scale * (after.i_q - before.i_q) * per_period / span;
            sum += r.i_q * r.i_q / libm::sqrt(slope * slope + 1.0);
        });
        sum / samples.len().max(1) as f64
    }

    /// Normal equations at a point, by one-sided differences of monitors run in lanes, including the [`Prior`].
    ///
    /// The steps, of length `step`, point into the box. A long step smooths the small unevenness of the cost far from a minimum;
    /// a short step resolves the curvature near it.
    #[must_use]
    pub fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations {
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

/// Sums of the normal equations without the prior, as [`LaneWork`].
struct Linearised<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; SLOPE_LANES],
    steps: [f64; UNKNOWN_COUNT],
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
        self.comparison.run(&monitor, |_, residuals| {
            let residuals = residuals.to_array();
            for n in 0..SIGNAL_COUNT {
                let weighted = residuals[n] * N::Double::splat(weights[n]);
                let r = weighted.to_lanes()[0];
                let slope = (weighted - N::Double::splat(r)) * per_step;
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

/// Time over which speed is measured, s.
const SPEED_SPAN: f64 = 1e-3;
/// Largest number of samples in that time.
const LONGEST_SPAN: usize = 8;
