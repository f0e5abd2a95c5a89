//! Residuals: measured minus modelled, per sample and signal, and the costs made of them.

use crate::dispatch::{InstructionSet, Numbers, Work};
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

/// Number of signals that can be compared.
pub const SIGNAL_COUNT: usize = 5;

/// One number per compared signal: `i_d`, `i_q`, motor angle, motor speed, output angle.
///
/// The three phase currents are compared in the rotor frame: with equal weights they are the two axes over again,
/// `Σ r_j² = 3/2 (r_d² + r_q²)`, for any angle.
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
    /// What was measured.
    #[inline(always)]
    #[must_use]
    pub fn of(sample: &ComparedSample) -> Self {
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
    /// The same in another number type.
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
/// The speed's residual is the difference of two residuals of the angle about 1 ms apart, at least one sample, over
/// that time: measured and modelled speed are then means over the same time, however slow the sampling. It is zero
/// where the earlier angle was filled in.
#[derive(Clone, Copy, Debug)]
pub struct ResidualState<R> {
    per_span: R,
    span: usize,
    /// Residuals of the angle of the last samples, and where the next one goes.
    angles: [R; LONGEST_SPAN],
    place: usize,
}

impl<R: Real> ResidualState<R> {
    /// Before the first sample, at a sample rate in Hz.
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

    /// Residuals of the next sample, unweighted; `earlier` says whether the one a span before it is there and measured.
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

/// Weight of each signal: the inverse of its expected residual (1/A, 1/rad, s/rad); 0 leaves a signal out.
pub type Weights = Signals<f64>;

impl Weights {
    /// Only the quadrature current, as \[P\] compares.
    pub const CURRENT_ONLY: Self = Self {
        i_d: 0.0,
        i_q: 1.0,
        theta_m: 0.0,
        omega_m: 0.0,
        theta_out: 0.0,
    };
}

/// Everything a fault vector is judged by: one window, the actuator type, the monitor's calibration, the weights.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a> {
    /// The measured window.
    pub recording: Recording<'a>,
    /// The actuator, as known.
    pub params: &'a ActuatorParams,
    /// The monitor's calibration.
    pub calibration: &'a Calibration,
    /// Load and supply during the window.
    pub conditions: Conditions,
    /// What counts how much.
    pub weights: Weights,
    /// Where the monitor's transmission and position loop take their angles from.
    pub feedback: Feedback,
    /// What is known of load and integral beforehand.
    pub prior: Prior,
}

/// What is known of the companions of the fault vector beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Standard deviation of the load torque about [`Conditions::load_torque`] (about none where it is not measured), Nm
    /// at the output; infinite where nothing is known.
    pub load_torque: f64,
    /// Standard deviation of the speed loop's integral about what the first currents say, Nm.
    pub integral: f64,
    /// The motor. One that is known exactly adds no term: its coordinates are not for fitting.
    pub motor: MotorKnowledge,
}

/// Coordinates about which something is known beforehand: load, integral, motor.
const KNOWN: [usize; 4] = [LOAD_COORDINATE, 9, MOTOR_COORDINATES[0], MOTOR_COORDINATES[1]];

impl Prior {
    /// Adds what is known beforehand to normal equations at a point.
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

    /// Cost of a point's distance from what is known beforehand.
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

    /// Distance from what is expected, and information matrix, in the order of [`KNOWN`].
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
    /// Takes a motor that is known exactly out of the equations: its coordinates stay where they are and make nothing
    /// uncertain.
    #[must_use]
    pub fn holding_known_motor(mut self, motor: &MotorKnowledge) -> Self {
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
    /// The unknowns with a fault vector, and nothing else than is measured.
    #[must_use]
    pub fn with_fault(&self, fault: FaultVector) -> Unknowns {
        Unknowns {
            fault,
            load_torque: self.conditions.load_torque.unwrap_or(0.0),
            integral: 0.0,
            motor: self.prior.motor.mean,
        }
    }

    /// The monitor of this window for one set of unknowns.
    #[must_use]
    pub fn monitor(&self, unknowns: &Unknowns) -> Monitor<f64> {
        let unknowns = self.conditions.warmed(unknowns);
        Monitor::new(self.params, self.calibration, self.conditions.v_dc, &unknowns).with_feedback(self.feedback)
    }

    /// Runs a monitor (or several, in lanes) over the window and shows the residuals of each measured sample by its index.
    #[inline(always)]
    fn run<R: Real>(&self, monitor: &Monitor<R>, mut visit: impl FnMut(usize, Signals<R>)) {
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
            let measured = Signals::of(sample).map(R::splat);
            let signals = residual.next(&measured, &monitor.output(&state), earlier);
            if sample.measured {
                visit(n, signals);
            }
            let next = drive.get(n + 1).unwrap_or(now);
            monitor.sample(&mut state, initial, now, next);
        }
    }

    /// Residuals of one set of unknowns, unweighted, measured sample by measured sample with its index.
    pub fn residuals(&self, unknowns: &Unknowns, visit: impl FnMut(usize, Signals<f64>)) {
        self.run(&self.monitor(unknowns), visit);
    }

    /// Cost that [`Comparison::normal_equations`] belong to: `½ Σ r²`, what is known beforehand included.
    #[must_use]
    pub fn cost(&self, at: &Coordinates) -> f64 {
        let scale = Scale::new(self.params);
        self.with_known(&scale, at, self.least_squares(&scale.unknowns(at)))
    }

    /// [`Comparison::cost`] of several points side by side, with the same bits.
    #[must_use]
    pub fn costs(&self, points: &[Coordinates; COST_LANES]) -> [f64; COST_LANES] {
        let scale = Scale::new(self.params);
        let monitors = core::array::from_fn(|lane| self.monitor(&scale.unknowns(&points[lane])));
        let costs = InstructionSet::best().run(HalfMeanSquares {
            comparison: self,
            monitors: &monitors,
        });
        core::array::from_fn(|lane| self.with_known(&scale, &points[lane], costs[lane]))
    }

    /// A mean cost as a sum, with that of what is known beforehand.
    fn with_known(&self, scale: &Scale, at: &Coordinates, mean: f64) -> f64 {
        let known = self.prior.cost(scale, &self.conditions, at);
        mean * self.recording.samples.len() as f64 + known
    }

    /// Plain least-squares cost: mean over the samples of `½ Σ (w r)²` over the signals.
    #[must_use]
    pub fn least_squares(&self, unknowns: &Unknowns) -> f64 {
        self.half_mean_square(&self.monitor(unknowns))
    }

    /// [`Comparison::least_squares`] of several at once, in single precision: for searches, which only rank.
    #[must_use]
    pub fn rank(&self, unknowns: &[Unknowns; RANK_LANES]) -> [f64; RANK_LANES] {
        self.rank_with(InstructionSet::best(), unknowns)
    }

    /// [`Comparison::rank`] with the instructions of one set, to measure them; the bits are the same with any.
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

    /// The paper's modified total least squares, \[P\] eq. 14 with its evident square:
    /// `Σ (I_HF − I_LF)² / √((τ dI_HF/dt)² + 1)`, on the quadrature current, as a mean over the samples.
    ///
    /// `time_scale` τ, s/A, makes the derivative dimensionless. Tolerant of small delays where the current is steep.
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

    /// Normal equations at a point, by forward differences of monitors run side by side.
    ///
    /// The differences go by `step` towards the inside of the box, so nothing leaves it. A long step sees over the cost's
    /// small unevenness from afar, a short one follows its curvature. What is known beforehand of load and integral
    /// ([`Prior`]) is part of the equations.
    #[must_use]
    pub fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations {
        let scale = Scale::new(self.params);
        let steps = at.inward_steps(step);
        let monitors: [Monitor<f64>; SLOPE_LANES] = core::array::from_fn(|lane| {
            let mut x = *at;
            // Lane 0 and the spare ones stay at the point itself.
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

/// Points that [`Comparison::costs`] takes at once.
pub const COST_LANES: usize = SLOPE_LANES;

/// [`Comparison::half_mean_square`] of several monitors as a piece of work for an [`InstructionSet`].
struct HalfMeanSquare<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; RANK_LANES],
}

impl Work for HalfMeanSquare<'_> {
    type Output = [f32; RANK_LANES];

    #[inline(always)]
    fn run<N: Numbers>(self) -> [f32; RANK_LANES] {
        let monitor = Monitor::side_by_side(self.monitors, |x| N::Single::from_lanes(x.map(|x| x as f32)));
        self.comparison.half_mean_square(&monitor).to_lanes()
    }
}

/// The same in double precision.
struct HalfMeanSquares<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; COST_LANES],
}

impl Work for HalfMeanSquares<'_> {
    type Output = [f64; COST_LANES];

    #[inline(always)]
    fn run<N: Numbers>(self) -> [f64; COST_LANES] {
        let monitor = Monitor::side_by_side(self.monitors, N::Double::from_lanes);
        self.comparison.half_mean_square(&monitor).to_lanes()
    }
}

/// The sums of the normal equations without what is known beforehand.
struct Linearised<'a> {
    comparison: &'a Comparison<'a>,
    monitors: &'a [Monitor<f64>; SLOPE_LANES],
    steps: [f64; UNKNOWN_COUNT],
}

impl Work for Linearised<'_> {
    type Output = NormalEquations;

    #[inline(always)]
    fn run<N: Numbers>(self) -> NormalEquations {
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

/// Time over which speed is measured, s, and the most samples this may be.
const SPEED_SPAN: f64 = 1e-3;
const LONGEST_SPAN: usize = 8;
