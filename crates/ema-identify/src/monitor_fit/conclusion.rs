//! From the local optima of a search to the estimate of a window.

use ema_models::{Coordinates, FaultVector, SIGNAL_COUNT, Scale, Signals, Weights};

use super::coarse_time::Time;
use super::competing_optima::{competing_optimum, differ};
use super::least_squares::{
    Descent, LocalOptima, LocalOptimum, Starts, UNLIMITED, descend_from_each, refine_one_sided, starts,
};
use super::uncertainty::{RUNS_OF_ASSESSMENT, assess};
use super::weak_magnet::{WeakMagnet, weak_magnet};
use super::window::{InTime, MonitoredWindow};
use crate::calibration::Mismatch;
use crate::estimate::Estimate;

/// Estimates the fault vector of one window by descents from health, one after another: the whole identification of a
/// controller, and on the host the one of `Method::LeastSquares`.
///
/// The descents run in coarse time, and from where they end once more with the residuals of fine time.
#[must_use]
pub fn identify_from_health(window: &impl InTime, mismatch: &Mismatch) -> Estimate {
    let search = search_from_health(&window.in_time(Time::Coarse));
    conclude(&window.in_time(Time::Both), mismatch, search, UNLIMITED)
}

/// Not inlined: a controller has no room for its starts during the conclusion.
#[inline(never)]
fn search_from_health(window: &impl MonitoredWindow) -> Search {
    let starts = starts(window, &[FaultVector::NOMINAL]);
    let optima = descend_from_each(window, &starts, Descent::INTO_A_VALLEY, UNLIMITED);
    Search::new(optima, 0, false, UNLIMITED).in_coarse_time()
}

/// What a search found.
pub(crate) struct Search {
    /// At least one.
    pub(crate) optima: LocalOptima,
    /// Monitor runs spent.
    pub(crate) evaluations: u64,
    /// Whether the budget cut it short anywhere.
    pub(crate) cut: bool,
    /// Whether it ended in coarse time, a little off the optima.
    pub(crate) is_in_coarse_time: bool,
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
            is_in_coarse_time: false,
            share,
        }
    }

    /// The same of a search in coarse time.
    pub(crate) fn in_coarse_time(self) -> Self {
        Self {
            is_in_coarse_time: true,
            ..self
        }
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
pub(crate) fn conclude(window: &impl InTime, mismatch: &Mismatch, search: Search, budget: u64) -> Estimate {
    let (search, how) = if search.is_in_coarse_time {
        (search.resumed(window), Descent::NEARBY)
    } else {
        (search, Descent::TO_THE_FLOOR)
    };
    let best = search.best().at;
    // In fine time: derivatives of coarse time let the mismatch of the monitor move the end by a tenth of its error more.
    let reweighted = window
        .with_weights(weights_by_noise(window, mismatch, &best))
        .in_time(Time::Fine);
    let refined = refine_one_sided(&reweighted, best, how, search.share);
    let competing = competing_optimum(window, &search.optima);
    let spent = search.evaluations + refined.spent + 2;
    let (at, competing, more, other_motor) = match weak_magnet(&reweighted, &refined, search.share) {
        WeakMagnet::No(more) => (refined.at, competing, more, false),
        WeakMagnet::Perhaps(other) => (refined.at, competing.or(Some(other.at)), other.spent, false),
        WeakMagnet::Yes(other) => (other.at, competing, other.spent, true),
    };
    let spent = spent + more;
    let left = budget.saturating_sub(spent + RUNS_OF_ASSESSMENT);
    let estimate = assess(&reweighted, mismatch, at, competing, spent, Some(left));
    Estimate {
        cost: window.mean_cost(&estimate.unknowns),
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
