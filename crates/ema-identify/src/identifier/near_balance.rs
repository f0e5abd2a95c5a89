//! The first search of a window whose numbers have tolerances: from the torque balance of the type.

use core::cell::RefCell;

use ema_models::{ActuatorParams, Comparison, FaultVector, Scale};

use super::Identifier;
use crate::effort::{Effort, Request, Stage};
use crate::monitor_fit::{Descent, InTime, Search, Starts, Time, Timed, UNLIMITED, descend_from_each, starts};
use crate::prepared::Prepared;

impl Identifier {
    /// The optimum near what the torque balance of the type says of a window, without nuisances, with the residuals of fine time and the
    /// derivatives of coarse time; that near health where the motion is too short for a balance.
    pub(super) fn near_balance(
        &self,
        window: &Prepared,
        comparison: &Comparison<'_>,
        coarse: &ActuatorParams,
        reserved: u64,
        effort: &Effort<'_>,
    ) -> Search {
        let scale = Scale::new(&self.params);
        let near = match window.by_type_balance(&self.params) {
            Some(found) => {
                let mut unknowns = comparison.unknowns_with_fault(found.fault);
                if comparison.conditions.load_torque.is_none() {
                    unknowns.load_torque = found.load_torque;
                }
                let mut near = Starts::new();
                near.extend([scale.coordinates(&unknowns)]);
                near
            }
            None => starts(comparison, &[FaultVector::NOMINAL]),
        };
        let how = Descent::TO_NUISANCES;
        let window_s = self.length_s(comparison.recording.samples.len());
        let most = near.len() as u64 * how.most_runs();
        let granted = effort.grant(&Request {
            stage: Stage::Search,
            window_s,
            runs: most.min(self.budget() / 2),
            reserved,
        });
        let share = granted / near.len() as u64;
        let kept = RefCell::default();
        let timed = Timed::new(*comparison, coarse, &kept).in_time(Time::Both);
        let search = Search::new(descend_from_each(&timed, &near, how, share), 0, false, UNLIMITED);
        effort.ran(Stage::Search, window_s, search.evaluations);
        search.in_coarse_time()
    }
}
