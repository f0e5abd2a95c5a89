//! What a step of the setpoint shows of an actuator: many states of wear side by side, in single precision.

use crate::control::Setpoint;
use crate::dispatch::{InstructionSet, Numbers, Work};
use crate::fault::FaultVector;
use crate::lanes::{Lanes, RANK_LANES};
use crate::monitor::{Calibration, Feedback, Monitor};
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::samples::{ComparedSample, InitialState};
use crate::unknowns::{MotorDeviation, Unknowns};

/// Share of the step within which the output has arrived.
const ARRIVED: f64 = 0.05;

/// Share of the time watched, at its end, in which the error that remains is averaged.
const SETTLED: f64 = 0.1;

/// A step of the position setpoint from rest on the nominal supply, which the monitor tries on its own feedback.
#[derive(Clone, Copy, Debug)]
pub struct StepTrial<'a> {
    /// The actuator.
    pub params: &'a ActuatorParams,
    /// The monitor's calibration for it.
    pub calibration: &'a Calibration,
    /// Height of the step, rad at the output, above 0.
    pub step_rad: f64,
    /// Load at the output, Nm; positive opposes positive motion.
    pub load_nm: f64,
    /// How long it is watched, s.
    pub watched_s: f64,
}

/// What the step shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepResponse {
    /// Largest speed of the output, rad/s.
    pub slew_rate_rad_s: f64,
    /// Time after which the output stays within 5 % of the step from the setpoint, s; infinite if it does not.
    pub response_time_s: f64,
    /// Mean distance from the setpoint in the last tenth of the time, rad.
    pub steady_error_rad: f64,
    /// Largest angle reached, rad.
    pub reached_rad: f64,
}

impl StepTrial<'_> {
    /// The responses with these faults, in their order; the same bits with any instruction set.
    #[must_use]
    pub fn responses(&self, faults: &[FaultVector; RANK_LANES]) -> [StepResponse; RANK_LANES] {
        let monitors = faults.map(|fault| {
            let unknowns = Unknowns {
                fault,
                load_torque: self.load_nm,
                integral: 0.0,
                motor: MotorDeviation::default(),
            };
            Monitor::new(self.params, self.calibration, self.params.motor.v_dc, &unknowns)
                .with_feedback(Feedback::Simulated)
        });
        InstructionSet::best().run(Responses {
            trial: self,
            monitors: &monitors,
        })
    }

    fn samples(&self) -> usize {
        (self.watched_s * self.params.sensors.sample_rate) as usize + 1
    }
}

struct Responses<'a> {
    trial: &'a StepTrial<'a>,
    monitors: &'a [Monitor<f64>; RANK_LANES],
}

impl Work for Responses<'_> {
    type Output = [StepResponse; RANK_LANES];

    #[inline(always)]
    fn run<N: Numbers>(self) -> [StepResponse; RANK_LANES] {
        let trial = self.trial;
        let monitor = Monitor::side_by_side(self.monitors, |x| N::Single::from_lanes(x.map(|x| x as f32)));
        let initial = InitialState::default();
        let rest = ComparedSample {
            setpoint: Setpoint::Position(0.0),
            ..ComparedSample::default()
        };
        let stepped = ComparedSample {
            setpoint: Setpoint::Position(trial.step_rad),
            ..rest
        };
        let samples = trial.samples();
        let settled_from = samples - (SETTLED * samples as f64) as usize;
        let setpoint = N::Single::splat(trial.step_rad);
        let band = N::Single::splat(ARRIVED * trial.step_rad);
        let zero = N::Single::zero();
        let (mut fastest, mut furthest, mut away, mut errors) = (zero, zero, zero, zero);
        let mut state = monitor.start(&initial, &rest);
        for n in 0..samples {
            monitor.sample(&mut state, &initial, &stepped, &stepped);
            let out = monitor.output(&state);
            let error = (setpoint - out.theta_out).abs();
            fastest = fastest.max(out.omega_m);
            furthest = furthest.max(out.theta_out);
            // Number of the sample after the last one outside the band; whole numbers below 2²⁴ are exact.
            away = N::Single::select(error.le(band), away, N::Single::splat((n + 1) as f64));
            if n >= settled_from {
                errors = errors + error;
            }
        }
        let [fastest, furthest, away, errors] = [fastest, furthest, away, errors].map(Lanes::to_lanes);
        core::array::from_fn(|lane| StepResponse {
            slew_rate_rad_s: f64::from(fastest[lane]) / trial.params.transmission.gear_ratio,
            response_time_s: if away[lane] as usize + 1 >= samples {
                f64::INFINITY
            } else {
                f64::from(away[lane]) / trial.params.sensors.sample_rate
            },
            steady_error_rad: f64::from(errors[lane]) / (samples - settled_from).max(1) as f64,
            reached_rad: f64::from(furthest[lane]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_do_not_touch_each_other_and_wear_shows() {
        let params = ActuatorParams::bench();
        let trial = StepTrial {
            params: &params,
            calibration: &Calibration::default(),
            step_rad: 0.2,
            load_nm: 0.0,
            watched_s: 1.0,
        };
        let worn = FaultVector {
            friction: 0.9,
            short_a: 0.6,
            gain: 0.1,
            ..FaultVector::NOMINAL
        };
        let faults = core::array::from_fn(|lane| if lane % 3 == 1 { worn } else { FaultVector::NOMINAL });
        let mixed = trial.responses(&faults);
        let [all_healthy, all_worn] = [FaultVector::NOMINAL, worn].map(|fault| trial.responses(&[fault; RANK_LANES]));
        for (lane, response) in mixed.iter().enumerate() {
            let alone = if lane % 3 == 1 { &all_worn } else { &all_healthy };
            assert_eq!(response, &alone[lane]);
        }
        let (healthy, worn) = (mixed[0], mixed[1]);
        assert!(healthy.response_time_s < worn.response_time_s, "{healthy:?} {worn:?}");
        assert!(
            (healthy.reached_rad / 0.2 - 1.0).abs() < 0.05 && healthy.slew_rate_rad_s > 1.0,
            "{healthy:?}"
        );
    }

    #[test]
    fn a_step_that_never_arrives_takes_for_ever() {
        let params = ActuatorParams::bench();
        let trial = StepTrial {
            params: &params,
            calibration: &Calibration::default(),
            step_rad: 0.2,
            load_nm: 5000.0,
            watched_s: 0.2,
        };
        let stalled = trial.responses(&[FaultVector::NOMINAL; RANK_LANES])[0];
        assert!(
            stalled.response_time_s.is_infinite() && stalled.reached_rad < 0.1,
            "{stalled:?}"
        );
    }
}
