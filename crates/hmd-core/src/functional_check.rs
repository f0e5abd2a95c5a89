//! Whether an actuator in some state of wear still does what its specification asks for: the monitor tries a step.

use ema_models::{ActuatorParams, Calibration, FaultVector, RANK_LANES, StepResponse, StepTrial};

use serde::{Deserialize, Serialize};

use crate::config::Specification;

/// The requirement that is not met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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

/// Fault vectors that are tried at once.
pub const TRIED: usize = RANK_LANES;

/// A specification that fault vectors are tried on: for each the first requirement that it makes the actuator miss.
pub type Trial<'a> = dyn Fn(&[FaultVector; TRIED]) -> [Option<Shortfall>; TRIED] + 'a;

/// How long a step is watched, s; twice the response time if that is longer.
const WATCHED_S: f64 = 1.0;

/// Share of the step that the output must make against the stall load.
const UNDER_WAY: f64 = 0.5;

/// The first requirement that each fault vector makes the actuator miss; `None` if it meets all that are set.
#[must_use]
pub fn shortfalls(
    params: &ActuatorParams,
    calibration: &Calibration,
    specification: &Specification,
    faults: &[FaultVector; TRIED],
) -> [Option<Shortfall>; TRIED] {
    let spec = specification;
    let steps = |load_nm| {
        let trial = StepTrial {
            params,
            calibration,
            step_rad: spec.step_rad,
            load_nm,
            watched_s: WATCHED_S.max(2.0 * spec.response_time_max_s),
        };
        trial.responses(faults)
    };
    let (working, stalled) = (
        steps(spec.load_nm),
        (spec.stall_load_nm > 0.0).then(|| steps(spec.stall_load_nm)),
    );
    std::array::from_fn(|n| {
        let stalls = |steps: &[StepResponse; TRIED]| steps[n].reached_rad < UNDER_WAY * spec.step_rad;
        missed(spec, &working[n]).or(stalled.as_ref().is_some_and(stalls).then_some(Shortfall::Stall))
    })
}

/// What a step under the working load does not meet.
fn missed(spec: &Specification, step: &StepResponse) -> Option<Shortfall> {
    if spec.slew_rate_min_rad_s > 0.0 && step.slew_rate_rad_s < spec.slew_rate_min_rad_s {
        return Some(Shortfall::SlewRate);
    }
    if spec.response_time_max_s > 0.0 && step.response_time_s > spec.response_time_max_s {
        return Some(Shortfall::ResponseTime);
    }
    (spec.steady_error_max_rad > 0.0 && step.steady_error_rad > spec.steady_error_max_rad)
        .then_some(Shortfall::SteadyError)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_identify::calibration::{MonitorForm, TypeCalibration};

    #[test]
    fn a_healthy_actuator_meets_what_a_worn_one_misses() {
        let params = ActuatorParams::bench();
        let calibration = TypeCalibration::built_in("bench", MonitorForm::ThreePhase)
            .expect("it is shipped")
            .coefficients();
        let healthy = StepTrial {
            params: &params,
            calibration: &calibration,
            step_rad: Specification::default().step_rad,
            load_nm: 10.0,
            watched_s: WATCHED_S,
        }
        .responses(&[FaultVector::NOMINAL; TRIED])[0];
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
            let mut tried = [FaultVector::NOMINAL; TRIED];
            tried[TRIED - 1] = fault;
            let mut found = [None; TRIED];
            found[TRIED - 1] = Some(expected);
            assert_eq!(shortfalls(&params, &calibration, &spec, &tried), found, "{expected:?}");
        }
    }
}
