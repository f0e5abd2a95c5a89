//! How fast this computer evaluates monitors and identifies windows.
//!
//! Every figure is the fastest of several runs: what else the computer does makes a run slower, never quicker.

mod report;

pub use report::{ActuatorsFigure, BenchReport, EvaluationFigure, PopulationFigure, SetFigure, ThreadFigure};

use std::hint::black_box;
use std::time::{Duration, Instant};

use ema_ga::{ConfigError, GaConfig};
use ema_models::reference::{Actuations, Scenario};
use ema_models::{
    ActuatorParams, Comparison, Conditions, FaultVector, InstructionSet, MotorKnowledge, RANK_LANES, Scale,
    SensedSample, Tolerances, Unknowns, steps_per_control,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::evaluate::TABLE_III;
use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, Method, Population, Prepared};

/// Length of the window of all figures but those over the length, s.
const WINDOW: f64 = 0.5;

/// Rest before the trigger that belongs to a window, s.
const PRE_TRIGGER: f64 = 0.02;

/// Time spent on each figure, and the fewest runs.
const TIME_PER_FIGURE: Duration = Duration::from_millis(300);
const FEWEST_RUNS: usize = 5;

/// Batches of [`RANK_LANES`] monitors that are shared out to the threads.
const BATCHES: usize = 32;

/// Windows that are identified side by side.
const WINDOWS: usize = 16;

/// Step of the differences of the linearisation that is measured.
const DIFFERENCE: f64 = 2e-3;

/// What the cost's growth is measured over: window lengths, s; sample rates, 1/s; populations; actuators.
const LENGTHS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
const SAMPLE_RATES: [f64; 4] = [400.0, 1000.0, 2000.0, 5000.0];
const POPULATIONS: [usize; 4] = [32, 64, 128, 256];
const ACTUATORS: [usize; 4] = [1, 4, 16, 64];

/// Why there are no figures.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// Threads cannot be started.
    #[error("cannot start {threads} threads")]
    Threads {
        /// How many.
        threads: usize,
        /// Why.
        source: rayon::ThreadPoolBuildError,
    },
    /// The search's settings contradict each other.
    #[error(transparent)]
    Search(#[from] ConfigError),
    /// The actuator has no calibration.
    #[error("no calibration of {0} for the three-phase monitor")]
    Calibration(&'static str),
}

/// Measures on `threads` threads and fewer; `done` is called after each figure.
///
/// # Errors
/// [`BenchError`] when threads cannot be started.
pub fn bench(threads: usize, done: &(dyn Fn() + Sync)) -> Result<BenchReport, BenchError> {
    let actuator = "bench";
    let params = ActuatorParams::bench();
    let bench = Bench {
        identifier: Identifier {
            params,
            calibration: TypeCalibration::built_in(actuator, MonitorForm::ThreePhase)
                .ok_or(BenchError::Calibration(actuator))?,
            method: Method::hybrid(),
            motor: MotorKnowledge::default(),
            tolerances: Tolerances::NONE,
        },
        window: window(&params, WINDOW),
        done,
    };
    let (scalar_f64_per_s, instruction_sets, linearisation_ms) = bench.one_core();
    let mut by_threads: Vec<ThreadFigure> = Vec::new();
    for n in up_to(threads) {
        let mut figure = on_threads(n, || bench.threads(n))?;
        let one = by_threads
            .first()
            .map_or(figure.evaluations_per_s, |one| one.evaluations_per_s);
        figure.over_one = figure.evaluations_per_s / one;
        by_threads.push(figure);
    }
    let with_rate = |sample_rate| {
        let mut params = params;
        params.sensors.sample_rate = sample_rate;
        params
    };
    Ok(BenchReport {
        actuator,
        monitor: "three-phase",
        step_us: 1e6 * params.controller.period / f64::from(steps_per_control(&params)),
        window_s: WINDOW,
        sample_rate_hz: params.sensors.sample_rate,
        instruction_set: InstructionSet::best().name(),
        lanes: RANK_LANES,
        scalar_f64_per_s,
        instruction_sets,
        linearisation_ms,
        threads: by_threads,
        by_window: LENGTHS.map(|length| bench.evaluation(&params, length)).to_vec(),
        by_sample_rate: SAMPLE_RATES
            .map(|rate| bench.evaluation(&with_rate(rate), WINDOW))
            .to_vec(),
        by_population: on_threads(threads, || {
            POPULATIONS.map(|n| bench.population(n)).into_iter().collect()
        })?,
        by_actuators: on_threads(threads, || ACTUATORS.map(|n| bench.actuators(n)).into_iter().collect())?,
    })
}

/// Number of figures for a number of threads, for a bar.
#[must_use]
pub fn figures(threads: usize) -> u64 {
    let growth = LENGTHS.len() + SAMPLE_RATES.len() + POPULATIONS.len() + ACTUATORS.len();
    (2 + InstructionSet::available().count() + 3 * up_to(threads).count() + growth) as u64
}

/// 1, 2, 4, … and the number itself.
fn up_to(threads: usize) -> impl Iterator<Item = usize> {
    let doubled = std::iter::successors(Some(1), |n| Some(2 * n));
    doubled.take_while(move |&n| n < threads).chain([threads])
}

/// Runs a measurement on its own threads.
fn on_threads<T: Send>(
    threads: usize,
    measure: impl FnOnce() -> Result<T, ConfigError> + Send,
) -> Result<T, BenchError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|source| BenchError::Threads { threads, source })?;
    Ok(pool.install(measure)?)
}

/// A window of the given length, of an actuator that is worn as in the paper's Table III.
fn window(params: &ActuatorParams, length: f64) -> Prepared {
    let scenario = Scenario::new(*params, FaultVector::from_array(TABLE_III), 1);
    let actuations = Actuations {
        length,
        ..scenario.actuations
    };
    let count = |time: f64| (time * params.sensors.sample_rate).round() as usize;
    let samples: Vec<SensedSample> = Scenario { actuations, ..scenario }
        .run()
        .skip(count(actuations.rest - PRE_TRIGGER))
        .take(count(length))
        .collect();
    Prepared::new(params, &samples, &[], count(PRE_TRIGGER), None)
}

/// A batch as a search begins with: drawn from all of the box, so that the monitors have little in common.
fn candidates(comparison: &Comparison<'_>) -> [Unknowns; RANK_LANES] {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    std::array::from_fn(|_| {
        let k = std::array::from_fn(|_| rng.random_range(0.0..1.0));
        comparison.unknowns_with_fault(FaultVector::from_array(k))
    })
}

struct Bench<'a> {
    identifier: Identifier,
    window: Prepared,
    done: &'a (dyn Fn() + Sync),
}

impl Bench<'_> {
    /// Shortest time of a piece of work, s.
    fn seconds<T>(&self, mut work: impl FnMut() -> T) -> f64 {
        let mut shortest = f64::INFINITY;
        let start = Instant::now();
        let mut runs = 0;
        while runs < FEWEST_RUNS || start.elapsed() < TIME_PER_FIGURE {
            let run = Instant::now();
            black_box(work());
            shortest = shortest.min(run.elapsed().as_secs_f64());
            runs += 1;
        }
        (self.done)();
        shortest
    }

    fn conditions(&self) -> Conditions {
        Conditions {
            load_torque: Some(0.0),
            v_dc: self.identifier.params.motor.v_dc,
            winding_temp_deg_c: None,
        }
    }

    /// Scalar evaluations per second, those of each instruction set, and the time of a linearisation, ms.
    fn one_core(&self) -> (f64, Vec<SetFigure>, f64) {
        let coefficients = self.identifier.calibration.coefficients();
        let comparison = self
            .identifier
            .comparison(&self.window, &coefficients, self.conditions());
        let candidates = candidates(&comparison);
        let one_by_one = || candidates.map(|unknowns| comparison.least_squares(&unknowns));
        let scalar = self.seconds(one_by_one) / RANK_LANES as f64;
        let sets = InstructionSet::available().map(|set| {
            let seconds = self.seconds(|| comparison.rank_with(set, &candidates)) / RANK_LANES as f64;
            SetFigure {
                name: set.name(),
                evaluations_per_s: 1.0 / seconds,
                over_scalar_f64: scalar / seconds,
            }
        });
        let sets = sets.collect();
        let worn = comparison.unknowns_with_fault(FaultVector::from_array(TABLE_III));
        let at = Scale::new(&self.identifier.params).coordinates(&worn);
        let linearisation = self.seconds(|| comparison.normal_equations(&at, DIFFERENCE));
        (1.0 / scalar, sets, 1e3 * linearisation)
    }

    /// What the present threads do.
    fn threads(&self, threads: usize) -> Result<ThreadFigure, ConfigError> {
        let coefficients = self.identifier.calibration.coefficients();
        let comparison = self
            .identifier
            .comparison(&self.window, &coefficients, self.conditions());
        let candidates = candidates(&comparison);
        let batches = self.seconds(|| {
            (0..BATCHES).into_par_iter().for_each(|_| {
                black_box(comparison.rank(black_box(&candidates)));
            });
        });
        let evaluations_per_s = (BATCHES * RANK_LANES) as f64 / batches;
        Ok(ThreadFigure {
            threads,
            evaluations_per_s,
            over_one: 1.0,
            identification_ms: 1e3 * self.identifications(&self.identifier, 1)?.0,
            identifications_per_s: WINDOWS as f64 / self.identifications(&self.identifier, WINDOWS)?.0,
        })
    }

    /// Time of so many identifications side by side, s, and the monitor runs of one.
    fn identifications(&self, identifier: &Identifier, windows: usize) -> Result<(f64, u64), ConfigError> {
        let one = |n: usize| identifier.identify(&self.window, self.conditions(), n as u64);
        let evaluations = one(0)?.evaluations;
        let seconds = self.seconds(|| {
            (0..windows).into_par_iter().for_each(|n| {
                black_box(one(n).is_ok());
            });
        });
        Ok((seconds, evaluations))
    }

    /// One evaluation of a window of another length or sample rate.
    fn evaluation(&self, params: &ActuatorParams, length: f64) -> EvaluationFigure {
        let window = window(params, length);
        let identifier = Identifier {
            params: *params,
            ..self.identifier.clone()
        };
        let coefficients = identifier.calibration.coefficients();
        let comparison = identifier.comparison(&window, &coefficients, self.conditions());
        let candidates = candidates(&comparison);
        let seconds = self.seconds(|| comparison.rank(&candidates)) / RANK_LANES as f64;
        EvaluationFigure {
            window_s: length,
            sample_rate_hz: params.sensors.sample_rate,
            evaluation_us: 1e6 * seconds,
        }
    }

    /// One identification with another population.
    fn population(&self, population: usize) -> Result<PopulationFigure, ConfigError> {
        let method = match self.identifier.method {
            Method::Hybrid(Population::Genetic(config)) => {
                Method::Hybrid(Population::Genetic(GaConfig { population, ..config }))
            }
            other => other,
        };
        let identifier = Identifier {
            method,
            ..self.identifier.clone()
        };
        let (seconds, evaluations) = self.identifications(&identifier, 1)?;
        Ok(PopulationFigure {
            population,
            evaluations,
            identification_ms: 1e3 * seconds,
        })
    }

    /// One window of each of several actuators.
    fn actuators(&self, actuators: usize) -> Result<ActuatorsFigure, ConfigError> {
        let (seconds, _) = self.identifications(&self.identifier, actuators)?;
        Ok(ActuatorsFigure {
            actuators,
            all_ms: 1e3 * seconds,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_double_up_to_the_number_asked_for() {
        assert_eq!(up_to(6).collect::<Vec<_>>(), [1, 2, 4, 6]);
        assert_eq!(up_to(4).collect::<Vec<_>>(), [1, 2, 4]);
        assert_eq!(up_to(1).collect::<Vec<_>>(), [1]);
    }

    #[test]
    fn windows_have_the_length_asked_for_and_start_at_rest() {
        for length in LENGTHS {
            let window = window(&ActuatorParams::bench(), length);
            let samples = window.recording().samples;
            assert_eq!(samples.len(), (2000.0 * length) as usize);
            assert!(samples[..40].iter().all(|s| s.omega_m.abs() < 1.0));
            assert!(samples[40..].iter().any(|s| s.omega_m.abs() > 10.0));
        }
    }
}
