//! Since when an actuator is in its state, and its sensors are suspected.

use ema_models::FaultId;
use hmd_core::health::HealthState;

use super::super::history::{History, Point};
use super::checks::suspects;
use super::left::Left;

/// Start of the oldest window of the newest run of windows in this state or a worse one (`nominal`: in this state), UTC ns: by the faults that it is
/// about, else by the health of the actuator. A recording that knew nothing of the one before leaves it; a new part begins it anew. `None` of
/// `unknown`.
pub(super) fn since(history: &History, left: &Left) -> Option<u64> {
    let state = left.state;
    if state == HealthState::Unknown {
        return None;
    }
    let by_damage = left.in_state_by_damage();
    let faults = left.in_state(state).into_iter().filter(|_| by_damage.is_some());
    let first = faults.filter_map(|fault| of_fault(history, state, fault)).min();
    // Records of older versions have the state of the actuator alone.
    first.or_else(|| of_health(history, state, by_damage, left.ends_first))
}

/// The same of a fault; windows that do not know its state say nothing of it.
fn of_fault(history: &History, state: HealthState, fault: FaultId) -> Option<u64> {
    // Of recordings that overlap in time a worse state holds that an earlier one has shown later.
    let shown_ns = history.newest.shown.of(fault).map(|shown| shown.t_start_ns);
    let is_shown = |point: &Point| shown_ns == Some(point.t_start_ns) && point.states[fault.index()] >= state;
    let shown = history.points.iter().rposition(is_shown);
    let end = shown.map_or(history.points.len(), |n| n + 1);
    let mut since = None;
    for n in (0..end).rev() {
        let point = &history.points[n];
        match state_of(point, fault) {
            HealthState::Unknown => {}
            of_point if of_point < state => break,
            _ => since = Some(point.t_start_ns),
        }
        if point.renews(fault) {
            break;
        }
    }
    since
}

/// State of a fault after a window: by its damage, or by the remaining life that it ended first.
fn state_of(point: &Point, fault: FaultId) -> HealthState {
    let worst = point.states.into_iter().max().unwrap_or_default();
    let by_life = HealthState::named(&point.health);
    let is_by_life = by_life > worst && by_life >= HealthState::Watch && point.ends_first.is_none_or(|of| of == fault);
    let by_life = Some(by_life).filter(|_| is_by_life).unwrap_or_default();
    point.states[fault.index()].max(by_life)
}

/// The same of the actuator, as far as its parts are the same: by windows that reported a fault, where the newest assessed one did; else by the
/// remaining life, which a fault ends first.
fn of_health(
    history: &History,
    state: HealthState,
    reported: Option<FaultId>,
    ends_first: Option<FaultId>,
) -> Option<u64> {
    let reports = |point: &Point| reported.is_some_and(|fault| point.faults.iter().any(|name| name == fault.name()));
    let assessed = history.points.iter().rfind(|point| point.estimate.is_some());
    let is_reported = assessed.or(history.points.last()).is_some_and(reports);
    let opens = opening(history);
    // A state by the remaining life may rest on the forecast of an earlier recording, which the windows since do not repeat.
    let forecast_ns = Some(history.newest.rul.t_start_ns).filter(|t_ns| reported.is_none() && *t_ns != 0);
    let predicted = history
        .points
        .iter()
        .rposition(|point| Some(point.t_start_ns) == forecast_ns);
    let end = predicted.map_or(history.points.len(), |n| n + 1);
    let mut since = None;
    for n in (0..end).rev() {
        let point = &history.points[n];
        let was_silent = point.estimate.is_none();
        let of_point = HealthState::named(&point.health);
        // One that did not show it says nothing of it, nor does one before its recording knew anything.
        if of_point != HealthState::Unknown || !(was_silent || opens[n]) {
            let is_another = match state {
                HealthState::Nominal => of_point != state,
                _ => of_point < state,
            };
            if is_another || (is_reported && !was_silent && !reports(point)) {
                break;
            }
            since = Some(point.t_start_ns);
        }
        let is_of_fault = |of: FaultId| point.renews(of);
        if point.replaced.contains(&None) || reported.or(ends_first).is_some_and(is_of_fault) {
            break;
        }
    }
    since
}

/// Whether each window is among the first of its recording, which know nothing yet.
fn opening(history: &History) -> Vec<bool> {
    let mut opens = false;
    let of = |point: &Point| {
        opens = (opens || point.begins_recording) && HealthState::named(&point.health) == HealthState::Unknown;
        opens
    };
    history.points.iter().map(of).collect()
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
