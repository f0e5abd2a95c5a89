//! Identification on the host: one window, an optional population search, descents side by side, one estimate.

mod fit;
mod method;
mod near_balance;

pub use fit::{Fit, Residuals};
pub use method::Method;

use core::cell::RefCell;

use ema_ga::{ConfigError, Control, GenerationLog, Outcome, StopReason};
use ema_models::{
    ActuatorParams, Calibration, Comparison, Conditions, Coordinates, FAULT_COUNT, FaultVector, Feedback,
    MotorKnowledge, Scale, Tolerances, Weights,
};

use crate::calibration::TypeCalibration;
use crate::effort::{Effort, Request, Stage};
use crate::estimate::Estimate;
use crate::monitor_fit::{
    Descent, FineResiduals, InTime, LocalOptimum, MAX_STARTS, Optimum, RUNS_OF_ASSESSMENT, RUNS_OF_DESCENT,
    RUNS_OF_STEP, Search, Starts, Time, Timed, UNLIMITED, assess, best_first, coarse_in_time, conclude,
    conclude_with_tolerances, descend_side_by_side, is_locked, prior, starts,
};
use crate::prepared::Prepared;

/// What identification needs to know beside the samples.
#[derive(Clone, Debug)]
pub struct Identifier {
    /// The actuator.
    pub params: ActuatorParams,
    /// The monitor's calibration for its type.
    pub calibration: TypeCalibration,
    /// The search.
    pub method: Method,
    /// How far the motor is off its type, and how well that is known.
    pub motor: MotorKnowledge,
    /// How well the other parameters are known.
    pub tolerances: Tolerances,
}

/// How wide a search is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Extent {
    /// Descents from health, of the methods that also have a population.
    FromHealth,
    /// All that the method has.
    Whole,
}

/// Systematic cost up to which an estimate explains a window: the right ones of usual windows have 0.4 at most, in noise too, and the
/// nearest wrong one found (`servo28`, 400 Hz) 1.2.
const EXPLAINED_COST: f64 = 0.6;

/// Cost up to which an estimate with tolerances explains a window. Units with any imperfection that a nuisance describes cost 0.9 to 1.9 on
/// `bench`, up to 3 on `servo28` at 400 Hz.
const EXPLAINED_WITH_TOLERANCES: f64 = 3.0;

/// Least short that is one. All three phases shorted look like a weak magnet: both optima are needed for an honest sigma, and descents
/// from health find but one.
const ANY_SHORT: f64 = 0.02;

impl Identifier {
    /// Estimates the fault vector of one window.
    ///
    /// The same window, settings and seed give the same estimate on any number of threads.
    ///
    /// # Errors
    /// [`ConfigError`] when the settings of the genetic algorithm contradict each other.
    #[expect(clippy::missing_panics_doc, reason = "unlimited work ends in an estimate")]
    pub fn identify(&self, window: &Prepared, conditions: Conditions, seed: u64) -> Result<Estimate, ConfigError> {
        let found = self.identify_within(window, conditions, seed, &Effort::unlimited())?;
        #[expect(clippy::expect_used, reason = "everything is granted")]
        Ok(found.expect("unlimited work ends in an estimate"))
    }

    /// The same with as much work as is granted: the best estimate so far, or none where that is not even one.
    ///
    /// The same grants give the same estimate.
    ///
    /// # Errors
    /// As [`Identifier::identify`].
    pub fn identify_within(
        &self,
        window: &Prepared,
        conditions: Conditions,
        seed: u64,
        effort: &Effort<'_>,
    ) -> Result<Option<Estimate>, ConfigError> {
        let window_s = self.length_s(window.recording().samples.len());
        let [least, usual, _] = self.runs_of_conclusion();
        let request = |runs| Request {
            stage: Stage::Conclusion,
            window_s,
            runs,
            reserved: 0,
        };
        if effort.grant(&request(least)) < least {
            return Ok(None);
        }
        let coefficients = self.calibration.coefficients();
        let comparison = self.comparison(window, &coefficients, conditions);
        let kept = RefCell::default();
        let narrow = if matches!(self.method, Method::Hybrid(_) | Method::LeastSquares) {
            let params = coarse_in_time(&self.params);
            let near = self.near_balance(window, &comparison, &params, &kept, usual, effort);
            let search = match near {
                Some(search) => search,
                None => {
                    let in_coarse_time = Comparison {
                        params: &params,
                        ..comparison
                    };
                    self.local_optima(&in_coarse_time, seed, usual, effort, Extent::FromHealth)?
                }
            };
            let Some((estimate, found)) = self.conclude_within(&comparison, search, &kept, effort) else {
                return Ok(None);
            };
            if self.method == Method::LeastSquares || self.is_explained(&comparison, &estimate, &kept) {
                return Ok(self.as_far_as_granted(estimate, &found, effort));
            }
            Some((estimate, found))
        } else {
            None
        };
        let search = self.local_optima(&comparison, seed, usual, effort, Extent::Whole)?;
        // The whole search knows more competing optima: without tolerances its estimate counts, whichever costs less.
        let whole = self.conclude_within(&comparison, search, &kept, effort);
        let (estimate, found) = match (narrow, whole) {
            (Some((narrow, _)), Some((whole, found))) => {
                let evaluations = narrow.evaluations + whole.evaluations;
                let best = if self.has_tolerances() && narrow.cost < whole.cost {
                    narrow
                } else {
                    whole
                };
                (Estimate { evaluations, ..best }, found)
            }
            (Some((narrow, from)), None) => (Estimate { cut: true, ..narrow }, from),
            (None, Some(whole)) => whole,
            (None, None) => return Ok(None),
        };
        Ok(self.as_far_as_granted(estimate, &found, effort))
    }

    /// Whether no other estimate is worth looking for: this one explains the window, and none explains it likewise.
    fn is_explained(&self, comparison: &Comparison<'_>, estimate: &Estimate, kept: &RefCell<FineResiduals>) -> bool {
        if estimate.locked {
            return true;
        }
        if self.has_tolerances() {
            return estimate.cost <= EXPLAINED_WITH_TOLERANCES;
        }
        let shorts = &estimate.fault.to_array()[2..=4];
        let resembles_weak_magnet = shorts.iter().all(|short| *short > ANY_SHORT) && self.motor.information().is_some();
        !resembles_weak_magnet
            && !estimate.is_unmodelled()
            && kept.borrow_mut().systematic_cost(comparison, &estimate.unknowns) <= EXPLAINED_COST
    }

    /// The estimate of a search's local optima with as much work as is granted, and the best of the optima; none without an
    /// estimate worth anything.
    fn conclude_within(
        &self,
        comparison: &Comparison<'_>,
        search: Search,
        kept: &RefCell<FineResiduals>,
        effort: &Effort<'_>,
    ) -> Option<(Estimate, Coordinates)> {
        let window_s = self.length_s(comparison.recording.samples.len());
        let [least, _, most] = self.runs_of_conclusion();
        let granted = effort.grant(&Request {
            stage: Stage::Conclusion,
            window_s,
            runs: most,
            reserved: 0,
        });
        if granted < least {
            return None;
        }
        let (search, budget) = if granted < most {
            let share = granted.saturating_sub(RUNS_OF_ASSESSMENT) / DESCENTS_OF_CONCLUSION;
            let budget = self.budget().min(search.evaluations + granted);
            (search.with_share_at_most(share), budget)
        } else {
            (search, self.budget())
        };
        let mismatch = self.calibration.mismatch_near(self.params.sensors.sample_rate);
        let (before, found) = (search.evaluations, search.best().at);
        let coarse = coarse_in_time(&self.params);
        let estimate = match self.method {
            Method::Eq14(_) | Method::Population(_) => Estimate {
                cut: search.cut,
                ..assess(
                    comparison,
                    &comparison.weights,
                    mismatch,
                    Optimum::uncompared(found),
                    before,
                    None,
                )
            },
            Method::LeastSquares | Method::Hybrid(_) if self.has_tolerances() => {
                conclude_with_tolerances(comparison, &coarse, mismatch, &self.tolerances, &search, kept, budget)
            }
            Method::LeastSquares | Method::Hybrid(_) => {
                let time = match search.time {
                    Time::Coarse | Time::Both => Time::Both,
                    Time::Fine => Time::Fine,
                };
                let window = Timed::new(*comparison, &coarse, kept).in_time(time);
                conclude(&window, mismatch, search, budget)
            }
        };
        effort.ran(Stage::Conclusion, window_s, estimate.evaluations - before);
        Some((estimate, found))
    }

    /// An estimate, and how far it may be off where work was not granted in whole; none where it is worth nothing.
    fn as_far_as_granted(&self, estimate: Estimate, start: &Coordinates, effort: &Effort<'_>) -> Option<Estimate> {
        if !(estimate.cut && effort.is_short()) {
            return Some(estimate);
        }
        // How badly the best so far fits says nothing of the model.
        if estimate.is_unmodelled() && !estimate.locked {
            return None;
        }
        let end = Scale::new(&self.params).coordinates(&estimate.unknowns);
        Some(estimate.reaching(&core::array::from_fn(|p| end.0[p] - start.0[p])))
    }

    fn length_s(&self, samples: usize) -> f64 {
        samples as f64 / self.params.sensors.sample_rate
    }

    /// Monitor runs after the search: with which an estimate is worth anything, of most windows, and at most.
    fn runs_of_conclusion(&self) -> [u64; 3] {
        match self.method {
            Method::Eq14(_) | Method::Population(_) => [RUNS_OF_ASSESSMENT; 3],
            Method::LeastSquares | Method::Hybrid(_) if self.has_tolerances() => [180, 250, 660],
            Method::LeastSquares | Method::Hybrid(_) => [100, 350, 6 * RUNS_OF_DESCENT],
        }
    }

    /// Where the search ends, before the signals are weighted by the window's own noise.
    ///
    /// # Errors
    /// As [`Identifier::identify`].
    pub fn search(&self, comparison: &Comparison<'_>, seed: u64) -> Result<Coordinates, ConfigError> {
        let optima = self.local_optima(comparison, seed, 0, &Effort::unlimited(), Extent::Whole)?;
        Ok(optima.best().at)
    }

    /// The local optima of a search that leaves `reserved` monitor runs for the conclusion.
    ///
    /// Where not even a usual search is granted, descents start from health alone.
    fn local_optima(
        &self,
        comparison: &Comparison<'_>,
        seed: u64,
        reserved: u64,
        effort: &Effort<'_>,
        extent: Extent,
    ) -> Result<Search, ConfigError> {
        let window_s = self.length_s(comparison.recording.samples.len());
        let request = |runs| Request {
            stage: Stage::Search,
            window_s,
            runs,
            reserved,
        };
        let how = self.descent(extent);
        // Asks for each generation before it begins.
        let mut seen = 0;
        let mut follow = |log: &GenerationLog<FAULT_COUNT>, (individuals, generations): (u64, u32)| {
            effort.ran(Stage::Search, window_s, log.evaluations - seen);
            seen = log.evaluations;
            if log.generation >= generations || effort.grants_all(&request(individuals)) {
                Control::Continue
            } else {
                Control::Stop
            }
        };
        let descend = |starts: &Starts, share: u64| {
            let wanted = starts.len() as u64 * how.most_runs();
            let granted = effort.grant(&request(wanted));
            let share = if granted < wanted {
                share.min(granted / starts.len() as u64)
            } else {
                share
            };
            let optima = descend_side_by_side(comparison, starts, how, share);
            let spent = optima.iter().map(|optimum| optimum.spent).sum();
            effort.ran(Stage::Search, window_s, spent);
            optima
        };
        Ok(match self.method {
            Method::Eq14(population) => {
                let extent = population.extent();
                let found = population.search_by_eq14(comparison, seed, |log| follow(log, extent))?;
                self.best_individual(comparison, &found)
            }
            Method::Population(population) => {
                let extent = population.extent();
                let found = population.search(*comparison, seed, |log| follow(log, extent))?;
                self.best_individual(comparison, &found)
            }
            Method::LeastSquares => {
                let starts = starts(comparison, &[FaultVector::NOMINAL]);
                let search = Search::new(descend(&starts, UNLIMITED), 0, false, UNLIMITED);
                match extent {
                    Extent::FromHealth => search.in_time(Time::Coarse),
                    Extent::Whole => search,
                }
            }
            Method::Hybrid(population) if extent == Extent::FromHealth => {
                let starts = starts(comparison, &[FaultVector::NOMINAL]);
                let share = population.budget().map_or(UNLIMITED, |budget| {
                    budget.saturating_sub(RUNS_OF_ASSESSMENT) / (2 * starts.len() as u64 + 1)
                });
                Search::new(descend(&starts, share), 0, false, share).in_time(Time::Coarse)
            }
            Method::Hybrid(population) => {
                let (individuals, generations) = population.extent();
                let usual = individuals * (u64::from(generations) + 1) + MAX_STARTS as u64 * RUNS_OF_USUAL_DESCENT;
                if !effort.grants_all(&request(usual)) {
                    let starts = starts(comparison, &[FaultVector::NOMINAL]);
                    return Ok(Search::new(descend(&starts, UNLIMITED), 0, true, UNLIMITED));
                }
                let found = population.search(*comparison, seed, |log| follow(log, (individuals, generations)))?;
                let faults = [FaultVector::from_array(found.genes), FaultVector::NOMINAL];
                let starts = starts(comparison, &faults);
                // The same share for each descent and for the last one, whichever of them needs it.
                let share = population.budget().map_or(UNLIMITED, |budget| {
                    // Half is left for the nuisances.
                    let budget = if self.has_tolerances() { budget / 2 } else { budget };
                    budget.saturating_sub(found.evaluations + RUNS_OF_ASSESSMENT) / (starts.len() as u64 + 1)
                });
                Search::new(descend(&starts, share), found.evaluations, was_cut(&found), share)
            }
        })
    }

    /// How the search's descents go: no further than the last part needs, which starts from where they end.
    fn descent(&self, extent: Extent) -> Descent {
        match extent {
            _ if self.has_tolerances() => Descent::WITHOUT_NUISANCES,
            Extent::FromHealth => Descent::INTO_A_VALLEY,
            Extent::Whole => Descent::TO_THE_FLOOR,
        }
    }

    /// The best of a population as the end of the search, without a descent.
    fn best_individual(&self, comparison: &Comparison<'_>, found: &Outcome<FAULT_COUNT>) -> Search {
        let unknowns = comparison.unknowns_with_fault(FaultVector::from_array(found.genes));
        let best = LocalOptimum {
            cost: found.cost,
            at: Scale::new(&self.params).coordinates(&unknowns),
            spent: found.evaluations,
            cut: was_cut(found),
            variance: None,
        };
        Search::new(best_first([best]), 0, false, 0)
    }

    /// The comparison of one window, all signals with their weights.
    #[must_use]
    pub fn comparison<'a>(
        &'a self,
        window: &'a Prepared,
        coefficients: &'a Calibration,
        conditions: Conditions,
    ) -> Comparison<'a> {
        comparison(
            window,
            &self.params,
            coefficients,
            conditions,
            self.calibration.weights(self.params.sensors.sample_rate),
            self.motor,
        )
    }

    /// Whether anything but the motor is known within tolerances only.
    fn has_tolerances(&self) -> bool {
        !self.tolerances.are_zero_beside_motor()
    }

    /// Whether the motor stood in a window while it was commanded to move.
    #[must_use]
    pub fn is_locked(&self, window: &Prepared, conditions: Conditions) -> bool {
        let coefficients = self.calibration.coefficients();
        is_locked(&self.comparison(window, &coefficients, conditions))
    }

    /// Monitor runs that one identification may take.
    fn budget(&self) -> u64 {
        match self.method {
            Method::Hybrid(population) => population.budget().unwrap_or(UNLIMITED),
            Method::LeastSquares | Method::Eq14(_) | Method::Population(_) => UNLIMITED,
        }
    }
}

/// Whether a population search was ended before its time.
fn was_cut(found: &Outcome<FAULT_COUNT>) -> bool {
    matches!(found.stop, StopReason::MaxEvaluations | StopReason::Stopped)
}

/// Monitor runs of most coarse descents.
const RUNS_OF_USUAL_DESCENT: u64 = 6 * RUNS_OF_STEP;

/// Descents after the search at most that have the same share: in fine time, the last one, with another magnet, and of the friction bound.
const DESCENTS_OF_CONCLUSION: u64 = 4;

/// The comparison of one window with a monitor, by the measured angles.
#[must_use]
pub fn comparison<'a>(
    window: &'a Prepared,
    params: &'a ActuatorParams,
    calibration: &'a Calibration,
    conditions: Conditions,
    weights: Weights,
    motor: MotorKnowledge,
) -> Comparison<'a> {
    Comparison {
        recording: window.recording(),
        params,
        calibration,
        conditions,
        weights,
        feedback: Feedback::Measured,
        prior: prior(params, &conditions, motor),
    }
}
