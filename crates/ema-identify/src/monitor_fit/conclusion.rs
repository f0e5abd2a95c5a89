//! From the local optima of a search to the estimate of a window.

use ema_models::{Coordinates, FaultVector, SIGNAL_COUNT, Scale, Signals, Weights};

use super::coarse_time::Time;
use super::competing_optima::{competing_optimum, differ};
use super::least_squares::{
    Descent, LocalOptima, LocalOptimum, Starts, UNLIMITED, descend_from_each, refine_one_sided, start_by_balance,
    starts,
};
use super::streamed::StreamedWindow;
use super::uncertainty::{Curvature, Optimum, RUNS_OF_ASSESSMENT, assess};
use super::weak_magnet::{WeakMagnet, weak_magnet};
use super::window::{InTime, MonitoredWindow};
use crate::calibration::Mismatch;
use crate::estimate::Estimate;
use crate::recorded_sample::RecordedSample;
use crate::relations::ByTypeBalance;

/// Estimates the fault vector of one window by descents: the whole identification of a controller, and on the host the one of
/// `Method::LeastSquares`.
///
/// One descent from what the torque balance of the type says, with the residuals of fine time and the derivatives of coarse time. Without
/// a balance descents from health in coarse time, and from where they end with the residuals of fine time.
#[must_use]
#[inline(never)]
pub fn identify_recorded<S: RecordedSample>(window: &StreamedWindow<'_, S>, mismatch: &Mismatch) -> Estimate {
    let search = match window.by_type_balance() {
        Some(found) => search_from(&window.in_time(Time::Both), &found),
        None => search_from_health(&window.in_time(Time::Coarse)),
    };
    conclude(&window.in_time(Time::Both), mismatch, search, UNLIMITED)
}

#[inline(never)]
fn search_from(window: &impl MonitoredWindow, found: &ByTypeBalance) -> Search {
    let mut starts = Starts::new();
    starts.extend([start_by_balance(window, found)]);
    let optima = descend_from_each(window, &starts, Descent::CLOSE_TO_A_FLOOR, UNLIMITED);
    Search::new(optima, 0, false, UNLIMITED).in_time(Time::Both)
}

/// Not inlined: a controller has no room for its starts during the conclusion.
#[inline(never)]
fn search_from_health(window: &impl MonitoredWindow) -> Search {
    let starts = starts(window, &[FaultVector::NOMINAL]);
    let optima = descend_from_each(window, &starts, Descent::INTO_A_VALLEY, UNLIMITED);
    Search::new(optima, 0, false, UNLIMITED).in_time(Time::Coarse)
}

/// What a search found.
pub(crate) struct Search {
    /// At least one.
    pub(crate) optima: LocalOptima,
    /// Monitor runs spent.
    pub(crate) evaluations: u64,
    /// Whether the budget cut it short anywhere.
    pub(crate) cut: bool,
    /// In which it ended: that of coarse time is a little off the optima.
    pub(crate) time: Time,
    /// Monitor runs that each further descent may take.
    share: u64,
}

impl Search {
    /// Adds up what a population and the descents after it spent.
    pub(crate) fn new(optima: LocalOptima, evaluations: u64, cut: bool, share: u64) -> Self {
        Self {
            evaluations: evaluations + optima.iter().map(|optimum| optimum.spent).sum::<u64>(),
            cut: cut || optima.iter().any(|optimum| optimum.cut),
            optima,
            time: Time::Fine,
            share,
        }
    }

    /// The same of a search in another time than the fine one.
    pub(crate) fn in_time(self, time: Time) -> Self {
        Self { time, ..self }
    }

    /// The same with at most so many monitor runs for each further descent.
    #[cfg(feature = "std")]
    pub(crate) fn with_share_at_most(self, share: u64) -> Self {
        Self {
            share: self.share.min(share),
            ..self
        }
    }

    /// The same after further descents from the optima that differ.
    #[inline(never)]
    fn resumed(self, window: &impl MonitoredWindow) -> Self {
        let mut starts = Starts::new();
        for optimum in &self.optima {
            if starts.iter().all(|start| differ(start, &optimum.at, |_| true)) {
                // As many as there are optima fit.
                starts.extend([optimum.at]);
            }
        }
        let optima = descend_from_each(window, &starts, Descent::NEARBY, self.share);
        Self::new(optima, self.evaluations, self.cut, self.share)
    }

    /// The best local optimum.
    pub(crate) fn best(&self) -> &LocalOptimum {
        &self.optima[0]
    }
}

/// Weights the signals by the noise of this window, refines the best optimum once more and assesses it. `budget` are the
/// monitor runs that the whole identification may take.
///
/// The cost stays that of the calibration's weights: it is what says whether the fit is a good one at all.
#[inline(never)]
pub(crate) fn conclude(window: &impl InTime, mismatch: &Mismatch, search: Search, budget: u64) -> Estimate {
    let (search, how) = match search.time {
        Time::Coarse => (search.resumed(window), Descent::NEARBY),
        Time::Both => (search, Descent::NEARBY),
        Time::Fine => (search, Descent::TO_THE_FLOOR),
    };
    let best = search.best().at;
    let reweighted = window.with_weights(weights_by_noise(window, mismatch, &best));
    let refined = refine_one_sided(&reweighted, best, how, search.share);
    let competing = competing_optimum(window, &search.optima);
    let spent = search.evaluations + refined.spent + 1;
    let known = refined.variance.map(|variance| Curvature {
        cost: refined.cost,
        variance,
    });
    let (at, curvature, competing, more, other_motor) = match weak_magnet(&reweighted, &refined, search.share) {
        WeakMagnet::No(more) => (refined.at, known, competing, more, false),
        WeakMagnet::Perhaps(other) => (refined.at, known, competing.or(Some(other.at)), other.spent, false),
        WeakMagnet::Yes(other) => (other.at, None, competing, other.spent, true),
    };
    let spent = spent + more;
    let left = budget.saturating_sub(spent + RUNS_OF_ASSESSMENT);
    let end = Optimum {
        at,
        curvature,
        competing,
    };
    let estimate = assess(&reweighted, window.weights(), mismatch, end, spent, Some(left));
    Estimate {
        cut: search.cut || refined.cut || estimate.cut,
        other_motor,
        ..estimate
    }
}

/// The calibration's weights, less where a signal is noisier than in the windows it was made from: sensors differ, and
/// a noisy current says less than a speed that is as good as ever.
fn weights_by_noise(window: &impl MonitoredWindow, mismatch: &Mismatch, at: &Coordinates) -> Weights {
    let expected = Signals::from(mismatch.residual_rms).to_array();
    let (squares, count) = window.squared_residuals(&Scale::new(window.params()).unknowns(at));
    let mut weights = window.weights().to_array();
    for signal in 0..SIGNAL_COUNT {
        let found = libm::sqrt(squares[signal] / (count as f64).max(1.0));
        weights[signal] *= (expected[signal] / found.max(f64::MIN_POSITIVE)).min(1.0);
    }
    Signals::from_array(weights)
}
