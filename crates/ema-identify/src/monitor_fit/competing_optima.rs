//! Local optima other than the best that explain a window as well as it does.

use ema_models::{Coordinates, FAULT_COUNT};

use super::least_squares::LocalOptimum;
use super::window::MonitoredWindow;

/// Optima whose fault coordinates differ by less than this are the same.
const SAME_WITHIN: f64 = 0.05;

/// Twice the difference of two costs below which the data do not tell two optima apart: three sigmas of one coordinate.
const UNDECIDED: f64 = 9.0;

/// The best of the other optima that differs from the best one and costs hardly more, if there is one.
pub(super) fn competing_optimum(window: &impl MonitoredWindow, optima: &[LocalOptimum]) -> Option<Coordinates> {
    let (best, others) = optima.split_first()?;
    let allowed = undecided_difference(window, best.cost);
    others
        .iter()
        .take_while(|optimum| optimum.cost - best.cost < allowed)
        .find(|optimum| differ(&optimum.at, &best.at, |_| true))
        .map(|optimum| optimum.at)
}

/// Difference of costs up to which a window does not tell two points apart, the lower of them costing `cost`.
///
/// Costs are half sums of squared weighted residuals; the weights already count residuals for as few as are independent. A
/// fit that is worse than expected makes differences count for less.
pub(super) fn undecided_difference(window: &impl MonitoredWindow, cost: f64) -> f64 {
    let expected = 0.5 * window.weighted_signals() * window.sample_count() as f64;
    0.5 * UNDECIDED * (cost / expected).max(1.0)
}

/// Whether two points are different explanations by the coordinates that count.
pub(super) fn differ(a: &Coordinates, b: &Coordinates, counts: impl Fn(usize) -> bool) -> bool {
    (0..FAULT_COUNT).any(|p| counts(p) && (a.0[p] - b.0[p]).abs() > SAME_WITHIN)
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use crate::calibration::{MonitorForm, TypeCalibration};
    use crate::{Identifier, Method, Prepared};
    use ema_models::{ActuatorParams, Conditions, MotorKnowledge, SensedSample, Setpoint, Tolerances, UNKNOWN_COUNT};

    #[test]
    fn only_optima_that_differ_and_are_as_good_compete() {
        let identifier = Identifier {
            params: ActuatorParams::bench(),
            calibration: TypeCalibration::built_in("bench", MonitorForm::ThreePhase).unwrap(),
            method: Method::hybrid(),
            motor: MotorKnowledge::default(),
            tolerances: Tolerances::NONE,
        };
        let at_rest = SensedSample {
            seq: 0,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Position(0.0),
        };
        let window = Prepared::new(&identifier.params, &[at_rest; 1000], &[], 40, None);
        let coefficients = identifier.calibration.coefficients();
        let conditions = Conditions {
            load_torque: Some(0.0),
            v_dc: identifier.params.motor.v_dc,
            winding_temp_deg_c: None,
        };
        let comparison = identifier.comparison(&window, &coefficients, conditions);
        let optimum = |cost: f64, friction: f64| {
            let mut at = [0.0; UNKNOWN_COUNT];
            at[0] = friction;
            LocalOptimum {
                cost,
                at: Coordinates(at),
                spent: 0,
                cut: false,
                variance: None,
            }
        };
        let found = |optima: &[LocalOptimum]| competing_optimum(&comparison, optima).map(|at| at.0[0]);
        assert_eq!(
            found(&[optimum(900.0, 0.1), optimum(900.1, 0.12), optimum(900.2, 0.3)]),
            Some(0.3)
        );
        assert_eq!(found(&[optimum(900.0, 0.1), optimum(910.0, 0.3)]), None);
        assert_eq!(found(&[optimum(900.0, 0.1), optimum(900.0, 0.1)]), None);
    }
}
