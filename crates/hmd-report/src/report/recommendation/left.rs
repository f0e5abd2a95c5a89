//! What is still known of an actuator once parts were replaced after its newest window.

use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;

use super::super::history::{History, Replacement, hours_of_all, requirement};
use super::friction::friction_left;

/// States and forecast without the parts that were replaced.
pub(super) struct Left {
    /// State of each fault by its damage, in the order of [`FaultId::ALL`].
    pub(super) states: [HealthState; FaultId::COUNT],
    /// The same; that of the fault which ends the life is not below a state by the remaining life.
    raised: [HealthState; FaultId::COUNT],
    /// The worst of them, or that by the remaining life.
    pub(super) state: HealthState,
    /// The faults that the state is about, the worst first.
    pub(super) reported: Vec<FaultId>,
    /// The fault whose trend ends the life first.
    pub(super) ends_first: Option<FaultId>,
    /// Hours to that end, 10 %, 50 % and 90 % quantile.
    pub(super) hours: Option<[f64; 3]>,
    /// The requirement that is missed then, in words, where a damage does not end the life.
    pub(super) requirement: Option<String>,
    /// Whether the recorded forecast was of a part that was replaced.
    pub(super) is_first_end_replaced: bool,
    /// What a friction that was critical may still come from.
    pub(super) friction_left: Option<&'static str>,
}

impl Left {
    pub(super) fn of(history: &History) -> Self {
        let rul = &history.newest.rul;
        let is_replaced = |fault: FaultId| clears(&history.replaced_since, fault);
        let before = history.states();
        let states = FaultId::ALL.map(|fault| match is_replaced(fault) {
            true => HealthState::Unknown,
            false => before[fault.index()],
        });
        let dominant = history.newest.ends_first();
        let mut since = history.replaced_since.iter();
        let is_first_end_replaced = since.any(|replacement| history.newest.is_end_of(replacement.part));
        let (ends_first, hours, requirement) = if is_first_end_replaced {
            let (ends_first, hours) = first_end(rul.faults(), is_replaced);
            (ends_first, hours, None)
        } else {
            (dominant, hours_of_all(rul), requirement(rul))
        };
        let by_life = history.newest.state_by_life().filter(|_| !is_first_end_replaced);
        let mut raised = states;
        // A requirement is missed by all faults together.
        let ends_alone = dominant.filter(|_| requirement.is_none());
        if let (Some(fault), Some(state)) = (ends_alone, by_life) {
            raised[fault.index()] = state;
        }
        let is_by_friction = ends_alone == Some(FaultId::Friction);
        let by_friction = history
            .newest
            .state_by_life()
            .filter(|_| is_by_friction)
            .unwrap_or_default();
        let was_critical = before[FaultId::Friction.index()].max(by_friction) == HealthState::Critical;
        let mut reported: Vec<FaultId> = FaultId::ALL
            .into_iter()
            .filter(|fault| raised[fault.index()] >= HealthState::Watch)
            .collect();
        let damage = |fault: FaultId| history.newest.shown.of(fault).map_or(0.0, |shown| shown.damage);
        reported.sort_by(|a, b| {
            let by_state = raised[b.index()].cmp(&raised[a.index()]);
            by_state.then(damage(*b).total_cmp(&damage(*a)))
        });
        let worst = raised
            .into_iter()
            .max()
            .unwrap_or_default()
            .max(by_life.unwrap_or_default());
        let state = if history.replaced_since.is_empty() {
            HealthState::named(&history.newest.health.health)
        } else if worst >= HealthState::Watch {
            worst
        } else {
            // Of every part that is replaced some fault is unknown.
            HealthState::Unknown
        };
        Self {
            // Records of older versions do not say whose hours they have.
            ends_first: ends_first.or(reported.first().copied().filter(|_| hours.is_some())),
            states,
            raised,
            state,
            reported,
            hours,
            requirement,
            is_first_end_replaced,
            friction_left: friction_left(history, was_critical),
        }
    }

    /// The faults that the state is about and that are in this state, the worst first.
    pub(super) fn in_state(&self, state: HealthState) -> Vec<FaultId> {
        let is_meant = |fault: &&FaultId| self.raised[fault.index()] == state;
        self.reported.iter().filter(is_meant).copied().collect()
    }

    /// The worst fault, where the state is by its damage and not by the remaining life.
    pub(super) fn in_state_by_damage(&self) -> Option<FaultId> {
        let worst = self.reported.first().copied();
        worst.filter(|fault| self.states[fault.index()] >= self.state)
    }

    /// Whether so little is left that there is nothing to plan.
    pub(super) fn ends_at_once(&self) -> bool {
        self.hours.is_some_and(|[p10, ..]| p10 < HOURS_TO_PLAN)
    }
}

/// Below so many hours there is nothing to plan.
pub(super) const HOURS_TO_PLAN: f64 = 1.0;

/// The fault that counts with the earliest end, and its hours.
fn first_end(
    hours: [Option<[f64; 3]>; FaultId::COUNT],
    is_replaced: impl Fn(FaultId) -> bool,
) -> (Option<FaultId>, Option<[f64; 3]>) {
    let of_fault = |fault: FaultId| hours[fault.index()].map(|hours| (fault, hours));
    let ends = FaultId::ALL
        .into_iter()
        .filter(|fault| !is_replaced(*fault))
        .filter_map(of_fault);
    let first = ends.min_by(|a, b| a.1[0].total_cmp(&b.1[0]));
    (first.map(|(fault, _)| fault), first.map(|(_, hours)| hours))
}

/// Whether nothing is known of this fault once these parts, or the actuator (`None`), are others.
pub(in super::super) fn clears(replaced: &[Replacement], fault: FaultId) -> bool {
    replaced
        .iter()
        .any(|replacement| ReplacedPart::renews(replacement.part, fault))
}
