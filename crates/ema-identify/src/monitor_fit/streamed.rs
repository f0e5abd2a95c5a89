//! The firmware's window: monitors in lock-step over recorded samples, their residuals summed as they come, none stored.
//!
//! Residuals and sums are those of [`Comparison`](ema_models::Comparison), operation by operation: both give the same bits.
//! Double precision throughout, because the short steps of the fine differences vanish in single precision.

use ema_models::{
    ActuatorParams, Calibration, ComparedSample, Conditions, Coordinates, InitialState, MOTOR_COORDINATES, Monitor,
    MonitorState, MotorKnowledge, NormalEquations, Prior, ResidualState, SIGNAL_COUNT, Scale, Setpoint, UNKNOWN_COUNT,
    Unknowns, Weights,
};

use super::coarse_time::{Time, coarse_in_time, periods};
use super::recorded_window::{MAX_CONTROLS, RecordedWindow, SampleDrive};
use super::window::{ActuatorKnowledge, InTime, MonitoredWindow, prior};
use crate::recorded_sample::RecordedSample;
use crate::relations::{ByTypeBalance, by_type_balance};

/// A recorded window, and the monitor that it is compared with.
#[derive(Clone, Copy, Debug)]
pub struct StreamedWindow<'a, S> {
    window: &'a RecordedWindow<'a, S>,
    params: &'a ActuatorParams,
    calibration: &'a Calibration,
    conditions: Conditions,
    weights: Weights,
    prior: Prior,
    time: Time,
}

/// The steps of one monitor.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Steps {
    Fine,
    Coarse,
}

/// One monitor at work.
#[derive(Clone, Copy)]
struct Running {
    steps: Steps,
    monitor: Monitor<f64>,
    state: MonitorState<f64>,
    residual: ResidualState<f64>,
}

/// Coordinates of a window whose motor is known exactly: those of the motor are the last ones.
const OWN_COUNT: usize = MOTOR_COORDINATES[0];
const _: () = assert!(MOTOR_COORDINATES[1] == OWN_COUNT + 1 && UNKNOWN_COUNT == OWN_COUNT + 2);

impl<'a, S: RecordedSample> StreamedWindow<'a, S> {
    /// A window of an actuator under some conditions, all signals with the weights of the calibration.
    #[must_use]
    pub fn new(window: &'a RecordedWindow<'a, S>, actuator: &'a ActuatorKnowledge, conditions: Conditions) -> Self {
        let ActuatorKnowledge {
            params,
            calibration,
            mismatch,
            motor,
        } = actuator;
        Self {
            window,
            params,
            calibration,
            conditions,
            weights: mismatch.weights(params.sensors.sample_rate, calibration.form),
            prior: prior(params, &conditions, *motor),
            time: Time::Fine,
        }
    }

    /// What the torque balance of the type says of the window.
    #[inline(never)]
    pub(super) fn by_type_balance(&self) -> Option<ByTypeBalance> {
        by_type_balance(self.params, self.window.samples(), &[], self.window.initial().backlash)
    }

    /// Steps of a monitor whose costs and residuals count.
    fn steps(&self) -> Steps {
        match self.time {
            Time::Fine | Time::Both => Steps::Fine,
            Time::Coarse => Steps::Coarse,
        }
    }

    /// One monitor at the first sample.
    #[inline(always)]
    fn start(&self, unknowns: &Unknowns, steps: Steps, first: &ComparedSample) -> Running {
        let unknowns = self.conditions.at_temperature(unknowns);
        let coarse;
        let params = if steps == Steps::Coarse {
            coarse = coarse_in_time(self.params);
            &coarse
        } else {
            self.params
        };
        let monitor = Monitor::new(params, self.calibration, self.conditions.v_dc, &unknowns);
        Running {
            steps,
            state: monitor.start(self.window.initial(), first),
            monitor,
            residual: ResidualState::new(self.params.sensors.sample_rate),
        }
    }

    /// Runs monitors in lock-step over the window and shows their unweighted residuals, sample by sample. `monitor` gives the unknowns and
    /// the steps of each.
    ///
    /// What all of them take from a sample is made ready once for all.
    fn run<const N: usize>(
        &self,
        monitor: impl Fn(usize) -> (Unknowns, Steps),
        mut visit: impl FnMut(&[[f64; SIGNAL_COUNT]; N]),
    ) {
        let initial = self.window.initial();
        let Some(first) = self.window.compared().next() else {
            return;
        };
        let start = |n| {
            let (unknowns, steps) = monitor(n);
            self.start(&unknowns, steps, &first)
        };
        // Not `from_fn`, which makes the array twice, one on top of the other on the stack.
        let mut running = [start(0); N];
        for (n, one) in running.iter_mut().enumerate().skip(1) {
            *one = start(n);
        }
        let periods = periods(self.params) as usize;
        let (mut n, mut coarsely, mut residuals) = (0, [0.0; MAX_CONTROLS], [[0.0; SIGNAL_COUNT]; N]);
        self.window.for_each_drive(|drive| {
            let counted: &[f64] = &drive.counted[..self.window.controls()];
            for (slot, &counted) in coarsely.iter_mut().zip(counted.iter().step_by(periods)) {
                *slot = counted;
            }
            let coarsely = &coarsely[..counted.len().div_ceil(periods)];
            for (one, residuals) in running.iter_mut().zip(&mut residuals) {
                let counted = match one.steps {
                    Steps::Fine => counted,
                    Steps::Coarse => coarsely,
                };
                let earlier = n >= one.residual.span();
                *residuals = one.over_sample(drive, initial, counted, earlier);
            }
            visit(&residuals);
            n += 1;
        });
    }
}

impl Running {
    /// Unweighted residuals of a sample; runs to the next one. Not inlined: the monitor's numbers then stay in registers.
    #[inline(never)]
    fn over_sample(
        &mut self,
        drive: &SampleDrive<f64>,
        initial: &InitialState,
        counted: &[f64],
        earlier: bool,
    ) -> [f64; SIGNAL_COUNT] {
        let output = self.monitor.output(&self.state);
        let residuals = self.residual.next(&drive.measured, &output, earlier).to_array();
        self.monitor
            .run_sample_period_with(&mut self.state, initial, drive.setpoint, counted, drive.theta_m);
        residuals
    }
}

impl<S: RecordedSample> MonitoredWindow for StreamedWindow<'_, S> {
    fn params(&self) -> &ActuatorParams {
        self.params
    }

    fn conditions(&self) -> &Conditions {
        &self.conditions
    }

    fn weights(&self) -> &Weights {
        &self.weights
    }

    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn with_weights(self, weights: Weights) -> Self {
        Self { weights, ..self }
    }

    fn with_motor(mut self, motor: MotorKnowledge) -> Self {
        self.prior.motor = motor;
        self
    }

    fn sample_count(&self) -> usize {
        self.window.len()
    }

    fn setpoints_and_angles(&self) -> impl Iterator<Item = (Setpoint, f64)> {
        self.window.compared().map(|sample| (sample.setpoint, sample.theta_m))
    }

    #[inline(never)]
    fn mean_cost(&self, unknowns: &Unknowns) -> f64 {
        let weights = self.weights.to_array();
        let mut sum = 0.0;
        self.run::<1>(
            |_| (*unknowns, self.steps()),
            |[residuals]| {
                for (weight, r) in weights.iter().zip(residuals) {
                    let weighted = weight * r;
                    sum += weighted * weighted;
                }
            },
        );
        sum * (0.5 / self.window.len().max(1) as f64)
    }

    #[inline(never)]
    fn squared_residuals(&self, unknowns: &Unknowns) -> ([f64; SIGNAL_COUNT], usize) {
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0);
        self.run::<1>(
            |_| (*unknowns, self.steps()),
            |[residuals]| {
                for (sum, &r) in squares.iter_mut().zip(residuals) {
                    *sum += r * r;
                }
                count += 1;
            },
        );
        (squares, count)
    }

    fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations {
        let is_motor_known = self.prior.motor.information().is_none();
        match (self.time, is_motor_known) {
            (Time::Fine | Time::Coarse, true) => self.linearised::<OWN_COUNT, { OWN_COUNT + 1 }>(at, step),
            (Time::Both, true) => self.linearised::<OWN_COUNT, { OWN_COUNT + 2 }>(at, step),
            (Time::Fine | Time::Coarse, false) => self.linearised::<UNKNOWN_COUNT, { UNKNOWN_COUNT + 1 }>(at, step),
            (Time::Both, false) => self.linearised::<UNKNOWN_COUNT, { UNKNOWN_COUNT + 2 }>(at, step),
        }
    }
}

impl<S: RecordedSample> InTime for StreamedWindow<'_, S> {
    fn in_time(self, time: Time) -> Self {
        Self { time, ..self }
    }
}

impl<S: RecordedSample> StreamedWindow<'_, S> {
    /// Normal equations of the first `C` coordinates, by the point and one step along each of them, and where there is one more monitor, by
    /// that in fine time at the point: its residuals then count.
    #[inline(never)]
    fn linearised<const C: usize, const N: usize>(&self, at: &Coordinates, step: f64) -> NormalEquations {
        let scale = Scale::new(self.params);
        let steps = at.inward_steps(step);
        let per_step: [f64; C] = core::array::from_fn(|p| 1.0 / steps[p]);
        let weights = self.weights.to_array();
        let mut sums = NormalEquations::default();
        let counting = if N > C + 1 { N - 1 } else { 0 };
        let stepped = |n: usize| {
            let mut x = *at;
            if let Some(p) = n.checked_sub(1).filter(|&p| p < C) {
                x.0[p] += steps[p];
            }
            let is_fine = self.time == Time::Fine || n == C + 1;
            let steps = if is_fine { Steps::Fine } else { Steps::Coarse };
            (scale.unknowns(&x), steps)
        };
        self.run::<N>(stepped, |residuals| {
            let (along, counted) = (&residuals[1..=C], &residuals[counting]);
            for signal in 0..SIGNAL_COUNT {
                let weight = weights[signal];
                let (r, point) = (counted[signal] * weight, residuals[0][signal] * weight);
                sums.cost += 0.5 * r * r;
                let slope: [f64; C] = core::array::from_fn(|p| (along[p][signal] * weight - point) * per_step[p]);
                for p in 0..C {
                    sums.jtr[p] += slope[p] * r;
                    for q in 0..=p {
                        sums.jtj[p][q] += slope[p] * slope[q];
                    }
                }
            }
        });
        for p in 0..C {
            for q in 0..p {
                sums.jtj[q][p] = sums.jtj[p][q];
            }
        }
        self.prior.add_to(&mut sums, &scale, &self.conditions, at);
        sums
    }
}
