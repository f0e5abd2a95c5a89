//! Whether an actuator in some state of wear still does what its specification asks for: the monitor tries a step.

use ema_models::{
    ActuatorParams, Calibration, ComparedSample, FaultVector, Feedback, InitialState, Monitor, MotorDeviation,
    Setpoint, Unknowns,
};

use crate::config::Specification;

/// The requirement that is not met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shortfall {
    /// The output does not reach the speed.
    SlewRate,
    /// It takes too long.
    ResponseTime,
    /// Too much error remains.
    SteadyError,
    /// The stall load stops it.
    Stall,
}

impl Shortfall {
    /// The name that records use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SlewRate => "slew_rate",
            Self::ResponseTime => "response_time",
            Self::SteadyError => "steady_error",
            Self::Stall => "stall",
        }
    }
}

/// A specification that fault vectors are tried on.
pub type Trial<'a> = dyn Fn(&FaultVector) -> Option<Shortfall> + 'a;

/// How long a step is watched, s; twice the response time if that is longer.
const WATCHED_S: f64 = 1.0;

/// Share of the step within which the output has arrived.
const ARRIVED: f64 = 0.05;

/// Share of the time watched, at its end, in which the error that remains is averaged.
const SETTLED: f64 = 0.1;

/// Share of the step that the output must make against the stall load.
const UNDER_WAY: f64 = 0.5;

/// What a step shows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    /// Largest speed of the output, rad/s.
    slew_rate_rad_s: f64,
    /// Time after which the output stays near the setpoint, s; infinite if it does not.
    response_time_s: f64,
    /// Mean distance from the setpoint at the end, rad.
    steady_error_rad: f64,
    /// Largest angle reached, rad.
    reached_rad: f64,
}

/// The first requirement that a fault vector makes the actuator miss; `None` if it meets all that are set.
#[must_use]
pub fn shortfall(
    params: &ActuatorParams,
    calibration: &Calibration,
    specification: &Specification,
    fault: &FaultVector,
) -> Option<Shortfall> {
    let spec = specification;
    let step = try_step(params, calibration, spec, fault, spec.load_nm);
    if spec.slew_rate_min_rad_s > 0.0 && step.slew_rate_rad_s < spec.slew_rate_min_rad_s {
        return Some(Shortfall::SlewRate);
    }
    if spec.response_time_max_s > 0.0 && step.response_time_s > spec.response_time_max_s {
        return Some(Shortfall::ResponseTime);
    }
    if spec.steady_error_max_rad > 0.0 && step.steady_error_rad > spec.steady_error_max_rad {
        return Some(Shortfall::SteadyError);
    }
    let stalls = |load_nm| try_step(params, calibration, spec, fault, load_nm).reached_rad < UNDER_WAY * spec.step_rad;
    (spec.stall_load_nm > 0.0 && stalls(spec.stall_load_nm)).then_some(Shortfall::Stall)
}

fn try_step(
    params: &ActuatorParams,
    calibration: &Calibration,
    spec: &Specification,
    fault: &FaultVector,
    load_torque: f64,
) -> Step {
    let unknowns = Unknowns {
        fault: *fault,
        load_torque,
        integral: 0.0,
        motor: MotorDeviation::default(),
    };
    let monitor = Monitor::new(params, calibration, params.motor.v_dc, &unknowns).with_feedback(Feedback::Simulated);
    let initial = InitialState::default();
    let rest = ComparedSample {
        setpoint: Setpoint::Position(0.0),
        ..ComparedSample::default()
    };
    let stepped = ComparedSample {
        setpoint: Setpoint::Position(spec.step_rad),
        ..rest
    };
    let rate = params.sensors.sample_rate;
    let watched_s = WATCHED_S.max(2.0 * spec.response_time_max_s);
    let samples = (watched_s * rate).ceil() as usize;
    let settled_from = samples - (SETTLED * samples as f64) as usize;
    let mut state = monitor.start(&initial, &rest);
    let mut step = Step {
        slew_rate_rad_s: 0.0,
        response_time_s: 0.0,
        steady_error_rad: 0.0,
        reached_rad: 0.0,
    };
    for n in 0..samples {
        monitor.sample(&mut state, &initial, &stepped, &stepped);
        let out = monitor.output(&state);
        let error = (spec.step_rad - out.theta_out).abs();
        step.slew_rate_rad_s = step.slew_rate_rad_s.max(out.omega_m / params.transmission.gear_ratio);
        step.reached_rad = step.reached_rad.max(out.theta_out);
        let has_arrived = error <= ARRIVED * spec.step_rad;
        if !has_arrived {
            step.response_time_s = (n + 1) as f64 / rate;
        }
        if n >= settled_from {
            step.steady_error_rad += error / (samples - settled_from) as f64;
        }
    }
    if step.response_time_s >= (samples - 1) as f64 / rate {
        step.response_time_s = f64::INFINITY;
    }
    step
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{MonitorForm, TypeCalibration};

    #[test]
    fn a_healthy_actuator_meets_what_a_worn_one_misses() {
        let params = ActuatorParams::bench();
        let calibration = TypeCalibration::built_in("bench", MonitorForm::ThreePhase)
            .expect("it is shipped")
            .coefficients();
        let healthy = try_step(
            &params,
            &calibration,
            &Specification::default(),
            &FaultVector::NOMINAL,
            10.0,
        );
        assert!(
            healthy.slew_rate_rad_s > 1.0 && healthy.response_time_s < 0.3,
            "{healthy:?}"
        );
        assert!(healthy.steady_error_rad < 1e-3, "{healthy:?}");
        let base = Specification {
            load_nm: 10.0,
            ..Specification::default()
        };
        let worn = |change: fn(&mut FaultVector)| {
            let mut fault = FaultVector::NOMINAL;
            change(&mut fault);
            fault
        };
        for (spec, fault, expected) in [
            (
                Specification {
                    steady_error_max_rad: 5e-4,
                    ..base
                },
                worn(|k| (k.friction, k.short_a, k.short_b, k.short_c) = (0.9, 0.9, 0.9, 0.9)),
                Shortfall::SteadyError,
            ),
            (
                Specification {
                    slew_rate_min_rad_s: 0.97 * healthy.slew_rate_rad_s,
                    ..base
                },
                worn(|k| (k.friction, k.short_a, k.short_b) = (0.9, 0.6, 0.6)),
                Shortfall::SlewRate,
            ),
            (
                Specification {
                    response_time_max_s: 1.5 * healthy.response_time_s,
                    ..base
                },
                worn(|k| k.gain = 0.05),
                Shortfall::ResponseTime,
            ),
            (
                Specification {
                    stall_load_nm: 600.0,
                    ..base
                },
                worn(|k| (k.friction, k.short_a, k.short_b) = (0.9, 0.6, 0.6)),
                Shortfall::Stall,
            ),
        ] {
            assert_eq!(
                shortfall(&params, &calibration, &spec, &FaultVector::NOMINAL),
                None,
                "{expected:?}"
            );
            assert_eq!(shortfall(&params, &calibration, &spec, &fault), Some(expected));
        }
    }
}
