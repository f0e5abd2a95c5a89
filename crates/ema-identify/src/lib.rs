//! One window to one estimate: the only place where monitor and search meet.

// Until the core does without it.
#![cfg(feature = "std")]

pub mod calibration;
mod population;
mod profile;
mod refine;
mod rivals;
mod turns;
pub mod unit_calibration;
pub mod unit_fit;
mod unmodelled;

use ema_ga::{
    Bounds, CmaConfig, ConfigError, Control, DeConfig, GaConfig, Outcome, Parallel, Search, StopReason, evolve_owned,
};
use ema_models::{
    ActuatorParams, Calibration, ComparedSample, Comparison, Conditions, Coordinates, FAULT_COUNT, FaultVector,
    Feedback, MotorKnowledge, Prior, Recording, SIGNAL_COUNT, Scale, SensedSample, Signals, UNKNOWN_COUNT, Unknowns,
    Weights, prepare_window,
};

use crate::calibration::TypeCalibration;
use crate::turns::align;
use population::PaperCost;
use refine::{End, FINE_STEP, UNLIMITED, data_variance, polish, refine, starts};
pub use refine::{bound, pull_from, refine_from};
use unmodelled::WeakMagnet;
pub use unmodelled::{Unmodelled, is_unmodelled};

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

/// A search by many individuals at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Population {
    /// The genetic algorithm.
    Genetic(GaConfig),
    /// Differential evolution.
    Differential(DeConfig),
    /// Evolution strategy with covariance matrix adaptation.
    CmaEs(CmaConfig),
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
}

/// Fault vector of one window, and how far it can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Best fault vector.
    pub fault: FaultVector,
    /// The same with its companions.
    pub unknowns: Unknowns,
    /// One standard deviation of each component, model error included; `None` where it means nothing (k7 without
    /// eccentricity) or the window does not show it.
    pub sigma: [Option<f64>; FAULT_COUNT],
    /// Whether the window shows the component.
    pub observable: [bool; FAULT_COUNT],
    /// Mean over the samples of half the squared weighted residuals.
    pub cost: f64,
    /// Root-mean-square residual of the quadrature current, A.
    pub residual_rms_a: f64,
    /// Monitor evaluations spent.
    pub evaluations: u64,
    /// Whether the budget of evaluations was spent before the search had ended: the best so far.
    pub cut: bool,
    /// Another fault vector, far from this one, that explains the window as well; the sigmas reach as far as it.
    pub rival: Option<FaultVector>,
    /// Back-EMF coefficient of the motor beyond what was expected of it, as a share of the type's.
    pub back_emf_off: f64,
    /// Whether another motor than the one expected explains the window clearly better.
    pub other_motor: bool,
    /// Whether the motor stood while it was told to move.
    pub locked: bool,
}

impl Estimate {
    /// Whether the data, though good, are of something the monitor does not know.
    #[must_use]
    pub fn is_unmodelled(&self) -> bool {
        self.unmodelled().is_some()
    }

    /// One standard deviation of each damage (see [`FaultVector::damage`]); infinite where the window shows nothing.
    #[must_use]
    pub fn damage_sigma(&self) -> [f64; FAULT_COUNT] {
        let mut sigma = self.sigma.map(|s| s.unwrap_or(f64::INFINITY));
        // The gain's damage is 2 |k8 − ½|.
        sigma[7] *= 2.0;
        sigma
    }
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

/// A standard deviation above this says that the window does not show the component.
const OBSERVABLE_SIGMA: f64 = 0.1;

/// Monitor runs of one set of normal equations: the point and one step along each coordinate.
const RUNS_PER_LINEARISATION: u64 = UNKNOWN_COUNT as u64 + 1;

/// Monitor runs after the search: those of the last weighing and of stating how sure the end is.
const JUDGING_RUNS: u64 = RUNS_PER_LINEARISATION + 3;

/// A window made ready for comparison, owning its samples.
#[derive(Clone, Debug)]
pub struct Prepared {
    samples: Vec<ComparedSample>,
    initial: ema_models::InitialState,
}

impl Prepared {
    /// Makes a window ready; its first `rest` samples precede the trigger, and those of the indices `filled` were not
    /// measured.
    #[must_use]
    pub fn new(params: &ActuatorParams, window: &[SensedSample], filled: &[usize], rest: usize) -> Self {
        let mut sensed = window.to_vec();
        align(params, &mut sensed);
        let mut samples = vec![ComparedSample::default(); sensed.len()];
        let initial = prepare_window(params, &sensed, filled, rest, &mut samples);
        Self { samples, initial }
    }

    /// The samples and their initial state.
    #[must_use]
    pub fn recording(&self) -> Recording<'_> {
        Recording {
            samples: &self.samples,
            drive: &self.samples,
            initial: self.initial,
        }
    }
}

/// Where a search ended.
struct Found {
    /// At least one end, the best first.
    ends: Vec<End>,
    /// Monitor runs spent.
    evaluations: u64,
    /// Whether the budget cut it short anywhere.
    cut: bool,
    /// Monitor runs that each further descent may take.
    share: u64,
}

impl Found {
    /// Adds up what a population and the descents after it spent.
    fn new(ends: Vec<End>, evaluations: u64, cut: bool, share: u64) -> Self {
        Self {
            evaluations: evaluations + ends.iter().map(|end| end.spent).sum::<u64>(),
            cut: cut || ends.iter().any(|end| end.cut),
            ends,
            share,
        }
    }
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
        let all = self.comparison(window, &coefficients, conditions);
        let found = self.ends(&all, seed)?;
        Ok(match self.method {
            Method::PaperGa(_) | Method::Population(_) => Estimate {
                cut: found.cut,
                ..self.judge(&all, found.ends[0].at, None, found.evaluations, None)
            },
            Method::LeastSquares | Method::Hybrid(_) => self.finish(&all, &found),
        })
    }

    /// Where the search ends, before the signals are weighed by the window's own noise.
    ///
    /// # Errors
    /// As [`Identifier::identify`].
    pub fn search(&self, all: &Comparison<'_>, seed: u64) -> Result<Coordinates, ConfigError> {
        Ok(self.ends(all, seed)?.ends[0].at)
    }

    fn ends(&self, all: &Comparison<'_>, seed: u64) -> Result<Found, ConfigError> {
        let scale = Scale::new(&self.params);
        let of_population = |found: &Outcome<FAULT_COUNT>| {
            let end = End {
                cost: found.cost,
                at: scale.coordinates(&all.unknowns_with_fault(FaultVector::from_array(found.genes))),
                spent: found.evaluations,
                cut: found.stop == StopReason::MaxEvaluations,
            };
            Found::new(vec![end], 0, false, 0)
        };
        Ok(match self.method {
            Method::PaperGa(config) => {
                let alone = Comparison {
                    weights: Weights::CURRENT_ONLY,
                    feedback: Feedback::Simulated,
                    ..*all
                };
                let objective = PaperCost::new(alone, &self.params);
                let search = Search {
                    objective: &objective,
                    evaluate: Parallel,
                    seed,
                    initial: &[],
                };
                let found = evolve_owned(&search, &config, |_| Control::Continue)?;
                of_population(&found)
            }
            Method::Population(population) => of_population(&population.search(*all, seed)?),
            Method::LeastSquares => {
                let ends = refine(all, &starts(all, &scale, &[FaultVector::NOMINAL]), UNLIMITED);
                Found::new(ends, 0, false, UNLIMITED)
            }
            Method::Hybrid(population) => {
                let found = population.search(*all, seed)?;
                let faults = [FaultVector::from_array(found.genes), FaultVector::NOMINAL];
                let starts = starts(all, &scale, &faults);
                // The same share for each descent and for the last one, whichever of them needs it.
                let share = population.budget().map_or(UNLIMITED, |budget| {
                    budget.saturating_sub(found.evaluations + JUDGING_RUNS) / (starts.len() as u64 + 1)
                });
                let cut = found.stop == StopReason::MaxEvaluations;
                Found::new(refine(all, &starts, share), found.evaluations, cut, share)
            }
        })
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

    /// Weighs the signals by what noise this window has, refines once more and states how sure the end is.
    ///
    /// The cost stays that of the calibration's weights: it is what says whether the fit is a good one at all.
    fn finish(&self, comparison: &Comparison<'_>, found: &Found) -> Estimate {
        let best = found.ends[0].at;
        let weighed = Comparison {
            weights: self.weights_by_noise(comparison, &best),
            ..*comparison
        };
        let end = polish(&weighed, best, found.share);
        let rival = rivals::find(comparison, &found.ends);
        let spent = found.evaluations + end.spent + 2;
        let (at, rival, more, other_motor) = match unmodelled::weak_magnet(&weighed, &end, found.share) {
            WeakMagnet::No(more) => (end.at, rival, more, false),
            WeakMagnet::Perhaps(other) => (end.at, rival.or(Some(other.at)), other.spent, false),
            WeakMagnet::Yes(other) => (other.at, rival, other.spent, true),
        };
        let spent = spent + more;
        let left = self.budget().saturating_sub(spent + JUDGING_RUNS);
        let estimate = self.judge(&weighed, at, rival, spent, Some(left));
        Estimate {
            cost: comparison.least_squares(&estimate.unknowns),
            cut: found.cut || end.cut || estimate.cut,
            other_motor,
            ..estimate
        }
    }

    /// Monitor runs that one identification may take.
    fn budget(&self) -> u64 {
        match self.method {
            Method::Hybrid(population) => population.budget().unwrap_or(UNLIMITED),
            Method::LeastSquares | Method::PaperGa(_) | Method::Population(_) => UNLIMITED,
        }
    }

    /// The calibration's weights, less where a signal is noisier than in the windows it was made from: sensors differ, and
    /// a noisy current says less than a speed that is as good as ever.
    fn weights_by_noise(&self, comparison: &Comparison<'_>, at: &Coordinates) -> Weights {
        let expected = Signals::from(self.calibration.at(self.params.sensors.sample_rate).residual_rms).to_array();
        let unknowns = Scale::new(&self.params).unknowns(at);
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0.0_f64);
        comparison.residuals(&unknowns, |_, r| {
            for (sum, r) in squares.iter_mut().zip(r.to_array()) {
                *sum += r * r;
            }
            count += 1.0;
        });
        let mut weights = comparison.weights.to_array();
        for signal in 0..SIGNAL_COUNT {
            let found = (squares[signal] / count.max(1.0)).sqrt();
            weights[signal] *= (expected[signal] / found.max(f64::MIN_POSITIVE)).min(1.0);
        }
        Signals::from_array(weights)
    }

    /// States how sure a point is; each component at least as unsure as a rival is far.
    ///
    /// `left` are the monitor runs left to ask how sure friction is; `None` for a search that does not end in a valley, whose
    /// slopes have to do.
    fn judge(
        &self,
        comparison: &Comparison<'_>,
        at: Coordinates,
        rival: Option<Coordinates>,
        evaluations: u64,
        left: Option<u64>,
    ) -> Estimate {
        let scale = Scale::new(&self.params);
        let unknowns = scale.unknowns(&at);
        // The point may lie outside the disc of eccentricities; what is judged is what is reported.
        let at = scale.coordinates(&unknowns);
        let normal = comparison
            .normal_equations(&at, FINE_STEP)
            .with_known_motor_fixed(&comparison.prior.motor);
        let fault = unknowns.fault;
        let (mut current, mut n) = (0.0, 0.0_f64);
        comparison.residuals(&unknowns, |_, r| {
            current += r.i_q * r.i_q;
            n += 1.0;
        });
        let n = n.max(1.0);

        // Correlated residuals are already weighted down, so the weighted ones count as independent of unit size; a
        // worse fit than the calibration's widens the interval.
        let signals = comparison.weights.to_array().iter().filter(|w| **w > 0.0).count() as f64;
        let excess = (2.0 * normal.cost / (n * signals)).max(1.0);
        let mut by_data = data_variance(&normal, excess).map(f64::sqrt);
        let sure = left.map(|left| profile::friction(comparison, &at, normal.cost, by_data[0], excess, left));
        by_data[0] = sure.as_ref().map_or(by_data[0], |sure| sure.sigma);
        let model_sigma = self.calibration.at(self.params.sensors.sample_rate).model_sigma;
        let alone: [f64; FAULT_COUNT] = std::array::from_fn(|p| by_data[p].hypot(model_sigma[p]));
        // What the window does not show needs no rival to be open.
        let rival = rival.filter(|rival| rivals::apart(rival, &at, |p| alone[p] <= OBSERVABLE_SIGMA));
        let total: [f64; FAULT_COUNT] =
            std::array::from_fn(|p| alone[p].hypot(rival.map_or(0.0, |rival| rival.0[p] - at.0[p])));
        let mut sigma = [None; FAULT_COUNT];
        let mut observable = [false; FAULT_COUNT];
        for p in [0, 1, 2, 3, 4, 7] {
            observable[p] = total[p] <= OBSERVABLE_SIGMA;
            sigma[p] = observable[p].then_some(total[p]);
        }
        // Amplitude and direction out of the Cartesian pair: along and across the vector; across is an angle only where
        // the vector stands clear of its own uncertainty.
        let amplitude_sigma = total[5].max(total[6]);
        observable[5] = amplitude_sigma <= OBSERVABLE_SIGMA;
        sigma[5] = observable[5].then_some(amplitude_sigma);
        if observable[5] && fault.eccentricity > 3.0 * amplitude_sigma {
            observable[6] = true;
            sigma[6] = Some(amplitude_sigma / fault.eccentricity / std::f64::consts::TAU);
        }
        Estimate {
            fault,
            unknowns,
            sigma,
            observable,
            cost: normal.cost / n,
            residual_rms_a: (current / n).sqrt(),
            evaluations: evaluations + RUNS_PER_LINEARISATION + 1 + sure.as_ref().map_or(0, |sure| sure.spent),
            cut: sure.is_some_and(|sure| sure.cut),
            rival: rival.map(|rival| scale.unknowns(&rival).fault),
            back_emf_off: unknowns.motor.back_emf - comparison.prior.motor.mean.back_emf,
            other_motor: false,
            locked: unmodelled::is_locked(comparison),
        }
    }

    /// The fit of an estimate to a window.
    #[must_use]
    pub fn fit(&self, window: &Prepared, conditions: Conditions, estimate: &Estimate) -> Fit {
        let coefficients = self.calibration.coefficients();
        let mut fit = Fit::default();
        self.comparison(window, &coefficients, conditions)
            .residuals(&estimate.unknowns, |n, r| {
                let sample = &window.samples[n];
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

/// What the status frame's load may be off by, Nm: its last digit is 0.1.
const LOAD_SIGMA_NM: f64 = 0.03;

/// What a load that nobody measures may be, in shares of the largest one the motor could hold without losses.
const LOAD_SIGMA_SHARE: f64 = 0.1;

/// What the first currents leave open of the speed loop's integral, in shares of the largest torque.
const INTEGRAL_SIGMA_SHARE: f64 = 0.01;

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
        prior: Prior {
            load_torque: match conditions.load_torque {
                Some(_) => LOAD_SIGMA_NM,
                None => LOAD_SIGMA_SHARE * Scale::new(params).load_unit(),
            },
            integral: INTEGRAL_SIGMA_SHARE * params.motor.torque_gain() * params.motor.i_max,
            motor,
        },
    }
}

fn box_of<const D: usize>(lower: [f64; D], upper: [f64; D]) -> Bounds<D> {
    #[expect(clippy::expect_used, reason = "the bounds are constants of the program")]
    Bounds::new(lower, upper).expect("constant bounds ascend")
}
