//! Friction is that of motor and gearbox together: one of them was replaced, the other is left.

use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;

use super::super::history::{History, Point};

/// Which of the two is new.
pub(in super::super) struct FrictionReplaced {
    /// Name of the new part.
    pub(in super::super) part: &'static str,
    /// What the friction may still come from, in words.
    pub(super) left: &'static str,
}

/// `None` where neither of them, both or the whole actuator was replaced.
pub(in super::super) fn friction_replaced(replaced: &[Option<ReplacedPart>]) -> Option<FrictionReplaced> {
    let has = |part: Option<ReplacedPart>| replaced.contains(&part);
    let (part, left) = match [None, Some(ReplacedPart::Motor), Some(ReplacedPart::Gearbox)].map(has) {
        [false, true, false] => (ReplacedPart::Motor, "gear and screw"),
        [false, false, true] => (ReplacedPart::Gearbox, "the bearings of the motor"),
        _ => return None,
    };
    Some(FrictionReplaced {
        part: part.name(),
        left,
    })
}

/// What a friction that was critical may still come from, where one of the two parts was replaced since and no window has shown it yet: a window
/// that knows of the replacement may be one that could not be assessed.
pub(super) fn friction_left(history: &History, was_critical: bool) -> Option<&'static str> {
    let friction = FaultId::Friction.index();
    let is_shown = |point: &Point| point.states[friction] != HealthState::Unknown;
    let first = history.points.iter().rposition(is_shown).map_or(0, |n| n + 1);
    let (before, since) = history.points.split_at(first);
    let replaced: Vec<Option<ReplacedPart>> = since
        .iter()
        .flat_map(|point| point.replaced.iter().copied())
        .chain(history.replaced_since.iter().map(|replacement| replacement.part))
        .collect();
    friction_replaced(&replaced)
        .filter(|_| was_critical || was_critical_before(before))
        .map(|of| of.left)
}

/// Whether friction was critical after these windows, by its damage or as what ended the life first.
fn was_critical_before(points: &[Point]) -> bool {
    let Some(last) = points.last() else { return false };
    let worst = last.states.into_iter().max().unwrap_or_default();
    let by_life = worst < HealthState::Critical && HealthState::named(&last.health) == HealthState::Critical;
    let ends_first = points.iter().rev().find_map(|point| point.ends_first);
    last.states[FaultId::Friction.index()] == HealthState::Critical
        || (by_life && ends_first == Some(FaultId::Friction))
}
