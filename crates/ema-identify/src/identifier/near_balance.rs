//! The first search of a window: from the torque balance of its type.

use core::cell::RefCell;

use ema_models::{ActuatorParams, Comparison, FaultVector};

use super::Identifier;
use crate::effort::{Effort, Request, Stage};
use crate::monitor_fit::{
    Descent, FineResiduals, InTime, Search, Starts, Time, Timed, descend_from_each, start_by_balance, starts,
};
use crate::prepared::Prepared;

/// Shares of the budget, one in as many: of this search, and of each later descent, which is the last one or has another magnet.
const SEARCH_SHARE: u64 = 2;
const LATER_SHARE: u64 = 4;

impl Identifier {
    /// The optimum near what the torque balance of the type says of a window, without nuisances, with the residuals of fine time and the
    /// derivatives of coarse time. Where the motion is too short for a balance: with tolerances that near health, else none.
    pub(super) fn near_balance(
        &self,
        window: &Prepared,
        comparison: &Comparison<'_>,
        coarse: &ActuatorParams,
        kept: &RefCell<FineResiduals>,
        reserved: u64,
        effort: &Effort<'_>,
    ) -> Option<Search> {
        let near = match window.by_type_balance(&self.params) {
            Some(found) => {
                let mut near = Starts::new();
                near.extend([start_by_balance(comparison, &found)]);
                near
            }
            None if self.has_tolerances() => starts(comparison, &[FaultVector::NOMINAL]),
            None => return None,
        };
        let how = Descent::CLOSE_TO_A_FLOOR;
        let window_s = self.length_s(comparison.recording.samples.len());
        let most = near.len() as u64 * how.most_runs();
        let granted = effort.grant(&Request {
            stage: Stage::Search,
            window_s,
            runs: most.min(self.budget() / SEARCH_SHARE),
            reserved,
        });
        let share = granted / near.len() as u64;
        let timed = Timed::new(*comparison, coarse, kept).in_time(Time::Both);
        let search = Search::new(
            descend_from_each(&timed, &near, how, share),
            0,
            false,
            self.budget() / LATER_SHARE,
        );
        effort.ran(Stage::Search, window_s, search.evaluations);
        Some(search.in_time(Time::Both))
    }
}
