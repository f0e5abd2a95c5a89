//! Other ends of the search that explain a window as well as the best one does.

use ema_models::{Comparison, Coordinates, FAULT_COUNT};

use super::refine::End;

/// Ends whose fault coordinates differ by less than this are the same.
const APART: f64 = 0.05;

/// Twice the difference of two costs below which the data do not tell two ends apart: three sigmas of one coordinate.
const UNDECIDED: f64 = 9.0;

/// The best of the other ends that is apart from the best one and costs hardly more, if there is one.
///
/// Costs are half sums of squared weighted residuals; the weights already hold residuals for as few as are independent. A
/// fit that is worse than expected makes differences count for less.
pub(super) fn find(comparison: &Comparison<'_>, ends: &[End]) -> Option<Coordinates> {
    let (best, others) = ends.split_first()?;
    let allowed = undecided(comparison, best.cost);
    others
        .iter()
        .take_while(|end| end.cost - best.cost < allowed)
        .find(|end| apart(&end.at, &best.at, |_| true))
        .map(|end| end.at)
}

/// Difference of costs up to which a window does not tell two points apart, the lower of them costing `cost`.
pub(super) fn undecided(comparison: &Comparison<'_>, cost: f64) -> f64 {
    let signals = comparison.weights.to_array().iter().filter(|w| **w > 0.0).count() as f64;
    let expected = 0.5 * signals * comparison.recording.samples.len() as f64;
    0.5 * UNDECIDED * (cost / expected).max(1.0)
}

/// Whether two points are different explanations by the coordinates that count.
pub(super) fn apart(a: &Coordinates, b: &Coordinates, counts: impl Fn(usize) -> bool) -> bool {
    (0..FAULT_COUNT).any(|p| counts(p) && (a.0[p] - b.0[p]).abs() > APART)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{MonitorForm, TypeCalibration};
    use crate::{Identifier, Method, Prepared};
    use ema_models::{ActuatorParams, Conditions, MotorKnowledge, SensedSample, Setpoint, UNKNOWN_COUNT};

    #[test]
    fn only_ends_that_are_apart_and_as_good_are_rivals() {
        let identifier = Identifier {
            params: ActuatorParams::bench(),
            calibration: TypeCalibration::built_in("bench", MonitorForm::ThreePhase).unwrap(),
            method: Method::hybrid(),
            motor: MotorKnowledge::default(),
        };
        let at_rest = SensedSample {
            seq: 0,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Position(0.0),
        };
        let window = Prepared::new(&identifier.params, &[at_rest; 1000], &[], 40);
        let coefficients = identifier.calibration.coefficients();
        let conditions = Conditions {
            load_torque: Some(0.0),
            v_dc: identifier.params.motor.v_dc,
            winding_temp_deg_c: None,
        };
        let comparison = identifier.comparison(&window, &coefficients, conditions);
        let end = |cost: f64, friction: f64| {
            let mut at = [0.0; UNKNOWN_COUNT];
            at[0] = friction;
            End {
                cost,
                at: Coordinates(at),
                spent: 0,
                cut: false,
            }
        };
        let found = |ends: &[End]| find(&comparison, ends).map(|at| at.0[0]);
        assert_eq!(found(&[end(900.0, 0.1), end(900.1, 0.12), end(900.2, 0.3)]), Some(0.3));
        assert_eq!(found(&[end(900.0, 0.1), end(910.0, 0.3)]), None);
        assert_eq!(found(&[end(900.0, 0.1), end(900.0, 0.1)]), None);
    }
}
