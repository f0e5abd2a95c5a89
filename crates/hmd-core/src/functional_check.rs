//! Functional check: whether an actuator in some state of wear still meets its specification.
//!
//! Goes in: fault vectors and a specification. Comes out: for each fault vector the first requirement that is not met, by a
//! simulated step of the monitor.

use ema_models::{ActuatorParams, Calibration, FaultVector, RANK_LANES, StepResponse, StepTrial};

use serde::{Deserialize, Serialize};

use crate::config::Specification;

/// The requirement that is not met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UnmetRequirement {
    /// The output does not reach the speed.
    SlewRate,
    /// It takes too long.
    ResponseTime,
    /// Too much error remains.
    SteadyError,
    /// The stall load stops it.
    Stall,
}

impl UnmetRequirement {
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

/// Fault vectors that are checked together.
pub const CHECK_LANES: usize = RANK_LANES;

/// A check of fault vectors against a specification: for each the first requirement that is not met.
pub type RequirementCheck<'a> = dyn Fn(&[FaultVector; CHECK_LANES]) -> [Option<UnmetRequirement>; CHECK_LANES] + 'a;

/// Shortest duration of a simulated step, s.
const WATCHED_S: f64 = 1.0;

/// Duration of a simulated step, s: at least [`WATCHED_S`], twice the response time, and twice the time that the motion takes at the
/// largest speed.
fn watched_s(params: &ActuatorParams, specification: &Specification) -> f64 {
    let motion_s = specification.motion_s(params);
    WATCHED_S
        .max(2.0 * specification.response_time_max_s)
        .max(2.0 * motion_s)
}

/// Share of the step that the output must make against the stall load.
const UNDER_WAY: f64 = 0.5;

/// The first requirement that is not met with each fault vector; `None` if all that are set are met.
#[must_use]
pub fn unmet_requirements(
    params: &ActuatorParams,
    calibration: &Calibration,
    specification: &Specification,
    faults: &[FaultVector; CHECK_LANES],
) -> [Option<UnmetRequirement>; CHECK_LANES] {
    let spec = specification;
    let steps = |load_nm| {
        let trial = StepTrial {
            params,
            calibration,
            step_rad: spec.step_rad,
            load_nm,
            duration_s: watched_s(params, spec),
        };
        trial.responses(faults)
    };
    let (working, stalled) = (
        steps(spec.load_nm),
        (spec.stall_load_nm > 0.0).then(|| steps(spec.stall_load_nm)),
    );
    std::array::from_fn(|n| {
        let stalls = |steps: &[StepResponse; CHECK_LANES]| steps[n].reached_rad < UNDER_WAY * spec.step_rad;
        missed(spec, &working[n]).or(stalled.as_ref().is_some_and(stalls).then_some(UnmetRequirement::Stall))
    })
}

/// What a step under the working load does not meet.
fn missed(spec: &Specification, step: &StepResponse) -> Option<UnmetRequirement> {
    if spec.slew_rate_min_rad_s > 0.0 && step.slew_rate_rad_s < spec.slew_rate_min_rad_s {
        return Some(UnmetRequirement::SlewRate);
    }
    if spec.response_time_max_s > 0.0 && step.response_time_s > spec.response_time_max_s {
        return Some(UnmetRequirement::ResponseTime);
    }
    (spec.steady_error_max_rad > 0.0 && step.steady_error_rad > spec.steady_error_max_rad)
        .then_some(UnmetRequirement::SteadyError)
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
            duration_s: WATCHED_S,
        }
        .responses(&[FaultVector::NOMINAL; CHECK_LANES])[0];
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
                UnmetRequirement::SteadyError,
            ),
            (
                Specification {
                    slew_rate_min_rad_s: 0.97 * healthy.slew_rate_rad_s,
                    ..base
                },
                worn(|k| (k.friction, k.short_a, k.short_b) = (0.9, 0.6, 0.6)),
                UnmetRequirement::SlewRate,
            ),
            (
                Specification {
                    response_time_max_s: 1.5 * healthy.response_time_s,
                    ..base
                },
                worn(|k| k.gain = 0.05),
                UnmetRequirement::ResponseTime,
            ),
            (
                Specification {
                    stall_load_nm: 600.0,
                    ..base
                },
                worn(|k| (k.friction, k.short_a, k.short_b) = (0.9, 0.6, 0.6)),
                UnmetRequirement::Stall,
            ),
        ] {
            let mut tried = [FaultVector::NOMINAL; CHECK_LANES];
            tried[CHECK_LANES - 1] = fault;
            let mut found = [None; CHECK_LANES];
            found[CHECK_LANES - 1] = Some(expected);
            assert_eq!(
                unmet_requirements(&params, &calibration, &spec, &tried),
                found,
                "{expected:?}"
            );
        }
    }
}
