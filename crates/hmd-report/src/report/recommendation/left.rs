//! What is still known of an actuator once parts were replaced after its newest window.

use ema_models::FaultId;
use hmd_core::health::HealthState;

use super::super::history::{History, hours_of_all, requirement};
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
    /// What a friction that was critical may still come from.
    pub(super) friction_left: Option<&'static str>,
}

impl Left {
    pub(super) fn of(history: &History) -> Self {
        let newest = history.newest_left();
        let states = newest.states();
        let required = requirement(&newest.rul);
        let by_life = newest.state_by_life();
        let mut raised = states;
        // A requirement is missed by all faults together.
        let ends_alone = newest.ends_first().filter(|_| required.is_none());
        if let (Some(fault), Some(state)) = (ends_alone, by_life) {
            raised[fault.index()] = state;
        }
        let before = &history.newest;
        let ended_alone = before.ends_first().filter(|_| requirement(&before.rul).is_none());
        let is_by_friction = ended_alone == Some(FaultId::Friction);
        let by_friction = before.state_by_life().filter(|_| is_by_friction).unwrap_or_default();
        let was_critical = before.states()[FaultId::Friction.index()].max(by_friction) == HealthState::Critical;
        let mut reported: Vec<FaultId> = FaultId::ALL
            .into_iter()
            .filter(|fault| raised[fault.index()] >= HealthState::Watch)
            .collect();
        let damage = |fault: FaultId| newest.shown.of(fault).map_or(0.0, |shown| shown.damage);
        reported.sort_by(|a, b| {
            let by_state = raised[b.index()].cmp(&raised[a.index()]);
            by_state.then(damage(*b).total_cmp(&damage(*a)))
        });
        let hours = hours_of_all(&newest.rul);
        Self {
            // Records of older versions do not say whose hours they have.
            ends_first: newest
                .ends_first()
                .or(reported.first().copied().filter(|_| hours.is_some())),
            states,
            raised,
            state: HealthState::named(&newest.health.health),
            reported,
            hours,
            requirement: required,
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
