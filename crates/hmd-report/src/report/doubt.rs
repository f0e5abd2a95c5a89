//! Faults that were known once and are not now: in doubt, or of a part that was replaced.

use ema_models::FaultId;
use hmd_core::health::HealthState;

use super::history::{History, Point};

/// Whether a window has shown a fault that is not known now and not in doubt: its part was replaced then.
pub(super) fn is_shown_before(history: &History, fault: FaultId) -> bool {
    let is_known = |point: &Point| point.states[fault.index()] != HealthState::Unknown;
    let is_open = history.states()[fault.index()] == HealthState::Unknown;
    is_open && history.points.iter().any(is_known) && in_doubt(history, fault).is_none()
}

/// The window that put in doubt what windows before it had shown of a fault of the same part.
pub(super) fn in_doubt(history: &History, fault: FaultId) -> Option<&Point> {
    let is_open = |point: &Point| point.states[fault.index()] == HealthState::Unknown;
    let first = history.points.iter().rposition(|point| !is_open(point))? + 1;
    let doubts = history.points.get(first)?;
    let is_anew = history.points[first..].iter().any(|point| point.renews(fault));
    (!is_anew).then_some(doubts)
}
