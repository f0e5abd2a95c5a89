//! What is still known of an actuator once parts were replaced after its newest window.

use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;

use super::super::history::{History, Replacement, hours_of_all};

/// States and forecast without the parts that were replaced.
pub(super) struct Left {
    /// State of each fault, in the order of [`FaultId::ALL`].
    pub(super) states: [HealthState; FaultId::COUNT],
    /// The worst of them, or that by the remaining life.
    pub(super) state: HealthState,
    /// The faults that the state is about, the worst first.
    pub(super) reported: Vec<FaultId>,
    /// The fault whose trend ends the life first.
    pub(super) ends_first: Option<FaultId>,
    /// Hours to that end, 10 %, 50 % and 90 % quantile.
    pub(super) hours: Option<[f64; 3]>,
    /// Whether the recorded forecast was of a part that was replaced.
    pub(super) is_first_end_replaced: bool,
}

impl Left {
    pub(super) fn of(history: &History) -> Self {
        let (health, rul) = &history.newest;
        let is_replaced = |fault: FaultId| clears(&history.replaced_since, fault);
        let before = history.states();
        let states = FaultId::ALL.map(|fault| match is_replaced(fault) {
            true => HealthState::Unknown,
            false => before[fault.index()],
        });
        let dominant = FaultId::from_name(&rul.dominant_fault);
        let is_first_end_replaced = dominant.map_or_else(
            || {
                history
                    .replaced_since
                    .iter()
                    .any(|replacement| replacement.part.is_none())
            },
            is_replaced,
        );
        let (ends_first, hours) = if is_first_end_replaced {
            first_end(rul.faults(), is_replaced)
        } else {
            (dominant, hours_of_all(rul))
        };
        let mut reported: Vec<FaultId> = FaultId::ALL
            .into_iter()
            .filter(|fault| states[fault.index()] >= HealthState::Watch)
            .collect();
        let damage = |fault: FaultId| history.shown.of(fault).map_or(0.0, |shown| shown.damage);
        reported.sort_by(|a, b| {
            let by_state = states[b.index()].cmp(&states[a.index()]);
            by_state.then(damage(*b).total_cmp(&damage(*a)))
        });
        let recorded = HealthState::named(&health.health);
        let worst = states.into_iter().max().unwrap_or_default();
        let state = if history.replaced_since.is_empty() {
            recorded
        } else if worst >= HealthState::Watch {
            worst
        } else if states.contains(&HealthState::Unknown) {
            HealthState::Unknown
        } else {
            recorded.max(worst)
        };
        // Where it is by the remaining life alone.
        if reported.is_empty() && state >= HealthState::Watch {
            reported.extend(dominant.filter(|fault| !is_replaced(*fault)));
        }
        Self {
            // Records of older versions do not say whose hours they have.
            ends_first: ends_first.or(reported.first().copied().filter(|_| hours.is_some())),
            states,
            state,
            reported,
            hours,
            is_first_end_replaced,
        }
    }

    /// The faults that the state is about and that are in this state, the worst first.
    pub(super) fn in_state(&self, state: HealthState) -> Vec<FaultId> {
        let is_meant = |fault: &&FaultId| self.state_of(**fault) == state;
        self.reported.iter().filter(is_meant).copied().collect()
    }

    /// State of a reported fault; that of the actuator where only the remaining life is the reason.
    fn state_of(&self, fault: FaultId) -> HealthState {
        match self.states[fault.index()] {
            state if state >= HealthState::Watch => state,
            _ => self.state,
        }
    }
}

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
    let is_of = |part: Option<ReplacedPart>| part.is_none_or(|part| part.faults().contains(&fault));
    replaced.iter().any(|replacement| is_of(replacement.part))
}
