//! Identification on the host: one window, an optional population search, descents side by side, one estimate.

use std::vec::Vec;

use ema_ga::{ConfigError, GaConfig, Outcome, StopReason};
use ema_models::{
    ActuatorParams, Calibration, Comparison, Conditions, Coordinates, FAULT_COUNT, FaultVector, Feedback,
    MotorKnowledge, Scale, Signals, Tolerances, Weights,
};

use crate::calibration::TypeCalibration;
use crate::estimate::Estimate;
use crate::monitor_fit::{
    COARSE, COARSE_THEN_FINE, LocalOptimum, Population, RUNS_OF_ASSESSMENT, Search, UNLIMITED, assess, best_first,
    conclude, conclude_with_tolerances, descend_side_by_side, is_locked, prior, residuals_with_tolerances,
    search_by_paper, starts,
};
use crate::prepared::Prepared;

/// How the fault vector is searched. `docs/search.md` compares them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The paper's standard genetic algorithm on its own cost (eq. 14), quadrature current only.
    PaperGa(GaConfig),
    /// A population search over all signals.
    Population(Population),
    /// Levenberg–Marquardt from health alone, over all signals.
    LeastSquares,
    /// A short population search, then Levenberg–Marquardt from its best and from health.
    Hybrid(Population),
}

impl Method {
    /// The default search: a genetic algorithm of 32 individuals and 5 generations, then refinement.
    #[must_use]
    pub fn hybrid() -> Self {
        let mut config = GaConfig::for_dimension(FAULT_COUNT as u32);
        config.population = 32;
        config.elite_count = 2;
        config.stop.max_generations = 5;
        Self::Hybrid(Population::Genetic(config))
    }

    /// The paper's search with the toolbox's defaults for eight bounded genes.
    #[must_use]
    pub fn paper_ga() -> Self {
        Self::PaperGa(GaConfig::for_dimension(FAULT_COUNT as u32))
    }
}

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

/// One window's fit, sample by sample, for records and plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fit {
    /// Measured quadrature current, A.
    pub i_q_measured: Vec<f32>,
    /// The monitor's, A.
    pub i_q_fitted: Vec<f32>,
    /// Measured motor speed, rad/s.
    pub omega_measured: Vec<f32>,
    /// The monitor's, rad/s.
    pub omega_fitted: Vec<f32>,
    /// Measured output angle relative to the window's first, rad.
    pub theta_out_measured: Vec<f32>,
    /// The monitor's, rad.
    pub theta_out_fitted: Vec<f32>,
}

impl Identifier {
    /// Estimates the fault vector of one window.
    ///
    /// The same window, settings and seed give the same estimate on any number of threads.
    ///
    /// # Errors
    /// [`ConfigError`] when the settings of the genetic algorithm contradict each other.
    pub fn identify(&self, window: &Prepared, conditions: Conditions, seed: u64) -> Result<Estimate, ConfigError> {
        let coefficients = self.calibration.coefficients();
        let comparison = self.comparison(window, &coefficients, conditions);
        let search = self.local_optima(&comparison, seed)?;
        let mismatch = self.calibration.mismatch_near(self.params.sensors.sample_rate);
        Ok(match self.method {
            Method::PaperGa(_) | Method::Population(_) => Estimate {
                cut: search.cut,
                ..assess(&comparison, mismatch, search.best().at, None, search.evaluations, None)
            },
            Method::LeastSquares | Method::Hybrid(_) if self.has_tolerances() => {
                conclude_with_tolerances(&comparison, mismatch, &self.tolerances, &search, self.budget())
            }
            Method::LeastSquares | Method::Hybrid(_) => conclude(&comparison, mismatch, &search, self.budget()),
        })
    }

    /// Where the search ends, before the signals are weighted by the window's own noise.
    ///
    /// # Errors
    /// As [`Identifier::identify`].
    pub fn search(&self, comparison: &Comparison<'_>, seed: u64) -> Result<Coordinates, ConfigError> {
        Ok(self.local_optima(comparison, seed)?.best().at)
    }

    fn local_optima(&self, comparison: &Comparison<'_>, seed: u64) -> Result<Search, ConfigError> {
        Ok(match self.method {
            Method::PaperGa(config) => self.best_individual(comparison, &search_by_paper(comparison, &config, seed)?),
            Method::Population(population) => self.best_individual(comparison, &population.search(*comparison, seed)?),
            Method::LeastSquares => {
                let starts = starts(comparison, &[FaultVector::NOMINAL]);
                let optima = descend_side_by_side(comparison, &starts, self.steps(), UNLIMITED);
                Search::new(optima, 0, false, UNLIMITED)
            }
            Method::Hybrid(population) => {
                let found = population.search(*comparison, seed)?;
                let faults = [FaultVector::from_array(found.genes), FaultVector::NOMINAL];
                let starts = starts(comparison, &faults);
                // The same share for each descent and for the last one, whichever of them needs it.
                let share = population.budget().map_or(UNLIMITED, |budget| {
                    // Half is left for the nuisances.
                    let budget = if self.has_tolerances() { budget / 2 } else { budget };
                    budget.saturating_sub(found.evaluations + RUNS_OF_ASSESSMENT) / (starts.len() as u64 + 1)
                });
                let cut = found.stop == StopReason::MaxEvaluations;
                let optima = descend_side_by_side(comparison, &starts, self.steps(), share);
                Search::new(optima, found.evaluations, cut, share)
            }
        })
    }

    /// Steps of the search's descents. With tolerances the fit of unknowns and nuisances starts where they end, and goes on by
    /// itself.
    fn steps(&self) -> &'static [f64] {
        if self.has_tolerances() {
            &COARSE
        } else {
            &COARSE_THEN_FINE
        }
    }

    /// The best of a population as the end of the search, without a descent.
    fn best_individual(&self, comparison: &Comparison<'_>, found: &Outcome<FAULT_COUNT>) -> Search {
        let unknowns = comparison.unknowns_with_fault(FaultVector::from_array(found.genes));
        let best = LocalOptimum {
            cost: found.cost,
            at: Scale::new(&self.params).coordinates(&unknowns),
            spent: found.evaluations,
            cut: found.stop == StopReason::MaxEvaluations,
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
            Method::LeastSquares | Method::PaperGa(_) | Method::Population(_) => UNLIMITED,
        }
    }

    /// Calls `visit` with index and unweighted residuals of each measured sample for an estimate.
    pub fn residuals(
        &self,
        window: &Prepared,
        conditions: Conditions,
        estimate: &Estimate,
        visit: impl FnMut(usize, Signals<f64>),
    ) {
        let coefficients = self.calibration.coefficients();
        let comparison = self.comparison(window, &coefficients, conditions);
        if estimate.deviations.is_empty() {
            comparison.residuals(&estimate.unknowns, visit);
        } else {
            residuals_with_tolerances(&comparison, &self.tolerances, estimate, visit);
        }
    }

    /// The fit of an estimate to a window.
    #[must_use]
    pub fn fit(&self, window: &Prepared, conditions: Conditions, estimate: &Estimate) -> Fit {
        let samples = window.recording().samples;
        let mut fit = Fit::default();
        self.residuals(window, conditions, estimate, |n, r| {
            let sample = &samples[n];
            fit.i_q_measured.push(sample.i_q as f32);
            fit.i_q_fitted.push((sample.i_q - r.i_q) as f32);
            fit.omega_measured.push(sample.omega_m as f32);
            fit.omega_fitted.push((sample.omega_m - r.omega_m) as f32);
            fit.theta_out_measured.push(sample.theta_out as f32);
            fit.theta_out_fitted.push((sample.theta_out - r.theta_out) as f32);
        });
        fit
    }
}

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
