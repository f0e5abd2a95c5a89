//! Since when an actuator is in its state, and its sensors are suspected.

use ema_models::FaultId;
use hmd_core::health::HealthState;

use super::super::axis::{Mark, marks_before};
use super::super::history::{History, Point};
use super::checks::suspects;

/// Start of the oldest window of the newest run of windows in this state or a worse one (`nominal`: in this state) since the last reset; where
/// the state is that of a fault, and the newest window reported it, of windows that reported it.
pub(super) fn since(history: &History, state: HealthState, fault: Option<FaultId>) -> Option<u64> {
    let reports = |point: &Point| fault.is_some_and(|fault| point.faults.iter().any(|name| name == fault.name()));
    let assessed = history.points.iter().rfind(|point| point.estimate.is_some());
    let is_reported = assessed.or(history.points.last()).is_some_and(reports);
    let mut since = None;
    for n in (0..history.points.len()).rev() {
        let point = &history.points[n];
        // One that did not show it says nothing of it.
        let was_silent = point.estimate.is_none();
        let of_point = HealthState::named(&point.health);
        if of_point == HealthState::Unknown && was_silent && state != HealthState::Unknown {
            continue;
        }
        let is_another = match state {
            HealthState::Nominal => of_point != state,
            _ => of_point < state,
        };
        if is_another || (is_reported && !was_silent && !reports(point)) {
            break;
        }
        since = Some(point.t_start_ns);
        let begins_anew = |mark: &Mark| matches!(mark, Mark::Unit | Mark::Reset);
        if n > 0 && marks_before(history, n).iter().any(begins_anew) {
            break;
        }
    }
    since
}

/// Start of the oldest window of the newest run of windows that all suspect a sensor, UTC ns; `None` where all that the newest one suspects was
/// replaced since.
pub(super) fn suspected_since(history: &History) -> Option<u64> {
    // A name that this version does not know is suspected all the same.
    if !history.replaced_since.is_empty() && suspects(history).is_empty() {
        return None;
    }
    let run = history.points.iter().rev().take_while(|point| point.is_suspected);
    run.last().map(|point| point.t_start_ns)
}
