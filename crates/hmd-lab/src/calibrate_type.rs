//! Calibration of a monitor against the reference, for one type of actuator (\[P\] section 5.2, eqs. 12 and 13).

mod ripple;

use ema_ga::{Bounds, Control, GaConfig, GenerationLog, Objective, Parallel, Search, evolve_owned};
use ema_models::{
    ActuatorParams, Calibration, Comparison, FAULT_COUNT, FaultVector, Feedback, MotorKnowledge, Profile, RANK_LANES,
    Ripple, SIGNAL_COUNT, Signals, StepTrial, Weights,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::simulated::SimulatedWindow;
use ema_identify::calibration::{CALIBRATION_VERSION, Mismatch, MonitorForm, Quality, SignalTable, TypeCalibration};
use ema_identify::{comparison, estimator_bias};
use hmd_core::seed::mix;

/// Windows a calibration learns from.
const HEALTHY_WINDOWS: u64 = 8;
const FAULTY_WINDOWS: u64 = 40;

/// Upper bits of the seeds of a calibration's windows, which nothing else uses: the suites hash theirs.
const SEED_SPACE: u64 = 0xCA11_B8A7_0000_0000;

/// Why a type was not calibrated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateTypeError {
    /// The position loop of the described actuator does not come to rest.
    #[error(
        "expected a loop that comes to rest, found one whose output does not stay within 5 % of a step of {step_rad:.3} rad \
         {WATCHED_S} s after it; check the gains, inertia and friction of the type"
    )]
    Unstable {
        /// Height of the step, rad.
        step_rad: f64,
    },
    /// The calibrated monitor still does not follow the reference.
    #[error(
        "expected a monitor whose quadrature current is off by at most {limit_a:.3} A rms, {} % of the largest, found \
         {found_a:.3} A in healthy windows; check the gains and other parameters of the type", 100.0 * ERROR_MAX
    )]
    Absurd {
        /// Most that is accepted, A.
        limit_a: f64,
        /// What was found, A.
        found_a: f64,
    },
}

/// Time after a step within which a loop must have come to rest, s.
const WATCHED_S: f64 = 2.0;

/// Largest error of the quadrature current after a calibration, as a share of the largest current: a short of 0.15, half of the
/// level `warning`, changes the current for the same torque by as much. Shipped calibrations have 0.4 to 0.7 %.
const ERROR_MAX: f64 = 0.05;

/// Refuses a type whose position loop does not come to rest in health. The step takes 0.1 s at full speed, 0.25 rad at most.
fn check_loop(params: &ActuatorParams) -> Result<(), CalibrateTypeError> {
    let step_rad = (0.1 * params.controller.omega_max / params.transmission.gear_ratio).min(0.25);
    let trial = StepTrial {
        params,
        calibration: &Calibration::default(),
        step_rad,
        load_nm: 0.0,
        duration_s: 2.0 * WATCHED_S,
    };
    let [response, ..] = trial.responses(&[FaultVector::NOMINAL; RANK_LANES]);
    if response.response_time_s <= WATCHED_S {
        Ok(())
    } else {
        Err(CalibrateTypeError::Unstable { step_rad })
    }
}

/// No calibration reduces the error in healthy windows by more than this factor: by a third at most so far.
const CORRECTED_MAX: f64 = 2.0;

/// Refuses a mean squared error of the quadrature current, A², beyond `factor` times what is accepted in the end.
fn check_error(params: &ActuatorParams, found_a2: f64, factor: f64) -> Result<(), CalibrateTypeError> {
    let (limit_a, found_a) = (ERROR_MAX * params.motor.i_max, found_a2.sqrt());
    if found_a.is_nan() || found_a > factor * limit_a {
        return Err(CalibrateTypeError::Absurd { limit_a, found_a });
    }
    Ok(())
}

/// Pieces of work of a calibration, of which it reports each; a fit may end before the last.
#[must_use]
pub fn pieces(monitor: MonitorForm) -> u64 {
    match monitor {
        // Windows and sweeps, rounds of the ripple, two rates.
        MonitorForm::ThreePhase => 2 + 3 * (CANDIDATES + 11) + 1 + 2 * CANDIDATES,
        // The generations of two stages.
        MonitorForm::OneAxis | MonitorForm::Paper => 1 + 2 * (GENERATIONS + 1) + 1 + 2 * CANDIDATES,
    }
}

/// Calibrates a monitor form for a type of actuator; `done` is called after each of its [`pieces`].
///
/// # Errors
/// [`CalibrateTypeError`] where the type's loop is unstable, or the monitor does not follow the reference.
pub fn calibrate_type(
    name: &str,
    params: &ActuatorParams,
    monitor: MonitorForm,
    seed: u64,
    done: &dyn Fn(),
) -> Result<TypeCalibration, CalibrateTypeError> {
    check_loop(params)?;
    let windows = windows(params, seed);
    done();
    let (healthy, faulty) = windows.split_at(HEALTHY_WINDOWS as usize);

    let mut calibration = TypeCalibration::uncalibrated(name, monitor, params);
    let bare = Calibration {
        ripple: Ripple::NONE,
        ..calibration.coefficients()
    };
    let healthy_before_a2 = current_error(params, &bare, healthy);
    check_error(params, healthy_before_a2, CORRECTED_MAX)?;
    match monitor {
        MonitorForm::ThreePhase => {
            calibration.ripple = ripple::measure(params);
            done();
            ripple::fit(&mut calibration, params, &windows, done);
        }
        MonitorForm::OneAxis | MonitorForm::Paper => {
            // As \[P\] does: the coupling in nominal conditions. The shape functions are 1 there, whatever their coefficients.
            fit_coefficients(&mut calibration, params, healthy, Stage::Coupling, seed, done);
            if monitor == MonitorForm::Paper {
                fit_coefficients(&mut calibration, params, faulty, Stage::Shapes, seed, done);
            }
        }
    }
    let coefficients = calibration.coefficients();

    let healthy_after_a2 = current_error(params, &coefficients, healthy);
    check_error(params, healthy_after_a2, 1.0)?;
    calibration.at_rate = vec![mismatch(&calibration, params, &windows, done)];
    let mut slow = *params;
    slow.sensors.sample_rate /= SLOWER;
    if slow.checked().is_ok() {
        let windows = self::windows(&slow, seed);
        done();
        let slower = mismatch(&calibration, &slow, &windows, done);
        calibration.at_rate.push(slower);
    }
    calibration.quality = Quality {
        healthy_before_a2,
        healthy_after_a2,
        faulty_before_a2: current_error(params, &bare, faulty),
        faulty_after_a2: current_error(params, &coefficients, faulty),
    };
    calibration.version = CALIBRATION_VERSION;
    Ok(calibration)
}

/// Mean squared error of i_q at the true fault vectors, A², of the healthy and of the faulty windows that a calibration with this
/// seed learns from (\[P\] eq. 12, as a mean).
pub fn current_errors(params: &ActuatorParams, seed: u64) -> impl Fn(&Calibration) -> [f64; 2] + use<'_> {
    let windows = windows(params, seed);
    move |coefficients| {
        let (healthy, faulty) = windows.split_at(HEALTHY_WINDOWS as usize);
        [healthy, faulty].map(|windows| current_error(params, coefficients, windows))
    }
}

/// The second sample rate that a calibration looks at, as a divisor of the type's own: 400 Hz beside 2 kHz.
const SLOWER: f64 = 5.0;

/// The windows a calibration learns from, the healthy ones first.
fn windows(params: &ActuatorParams, seed: u64) -> Vec<SimulatedWindow> {
    (0..HEALTHY_WINDOWS + FAULTY_WINDOWS)
        .into_par_iter()
        .map(|n| {
            let case_seed = SEED_SPACE ^ (seed << 16) ^ n;
            let truth = if n < HEALTHY_WINDOWS {
                FaultVector::NOMINAL
            } else {
                random_faults(mix(case_seed, &[1]))
            };
            SimulatedWindow::new(params, truth, Profile::Mixed, case_seed)
        })
        .collect()
}

/// Several faults at once: each of k1…k6 is 0 with probability ½, else uniform in [0, 0.6]; k7 uniform; k8 uniform in
/// [0.3, 0.7]. The `random` suite draws from the same distribution with its own seeds.
#[must_use]
pub fn random_faults(seed: u64) -> FaultVector {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut k = [0.0; FAULT_COUNT];
    for value in k.iter_mut().take(6) {
        let present = rng.random_bool(0.5);
        let size = rng.random_range(0.0..0.6);
        *value = if present { size } else { 0.0 };
    }
    k[6] = rng.random_range(0.0..1.0);
    k[7] = rng.random_range(0.3..0.7);
    FaultVector::from_array(k)
}

/// The comparison of a simulated window.
fn compare<'a>(
    window: &'a SimulatedWindow,
    params: &'a ActuatorParams,
    calibration: &'a Calibration,
    weights: Weights,
) -> Comparison<'a> {
    comparison(
        &window.prepared,
        params,
        calibration,
        window.conditions,
        weights,
        MotorKnowledge::default(),
    )
}

/// The same with the monitor left to itself, as the paper compares: only the quadrature current, in closed loop.
fn compare_alone<'a>(
    window: &'a SimulatedWindow,
    params: &'a ActuatorParams,
    calibration: &'a Calibration,
) -> Comparison<'a> {
    let compared = compare(window, params, calibration, Weights::CURRENT_ONLY);
    Comparison {
        feedback: Feedback::Simulated,
        ..compared
    }
}

/// Mean squared error of the quadrature current at the true fault vectors, A² (\[P\] eq. 12, as a mean).
fn current_error(params: &ActuatorParams, coefficients: &Calibration, windows: &[SimulatedWindow]) -> f64 {
    let sums: Vec<f64> = windows
        .par_iter()
        .map(|w| {
            let compared = compare_alone(w, params, coefficients);
            2.0 * compared.least_squares(&compared.unknowns_with_fault(w.truth))
        })
        .collect();
    sums.iter().sum::<f64>() / windows.len().max(1) as f64
}

/// What a stage of the one-axis forms' calibration finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Factors on back-EMF and torque gain.
    Coupling,
    /// Share of the squares in eq. 10, and k_E.
    Shapes,
}

/// Generations of a stage.
const GENERATIONS: u64 = 30;

/// The one-axis forms' coefficients by the genetic algorithm, as \[P\] does it.
fn fit_coefficients(
    calibration: &mut TypeCalibration,
    params: &ActuatorParams,
    windows: &[SimulatedWindow],
    stage: Stage,
    seed: u64,
    done: &dyn Fn(),
) {
    struct Misfit<'a> {
        bounds: Bounds<2>,
        start: &'a TypeCalibration,
        stage: Stage,
        params: &'a ActuatorParams,
        windows: &'a [SimulatedWindow],
    }
    impl Misfit<'_> {
        fn calibration(&self, genes: &[f64; 2]) -> TypeCalibration {
            let mut tried = self.start.clone();
            match self.stage {
                Stage::Coupling => [tried.back_emf, tried.torque] = *genes,
                // The gene is 1/k_FS-like: φ_SC runs from the plain mean of the turns (0) to the pure squares (1).
                Stage::Shapes => (tried.k_fs, tried.k_e) = (k_fs(genes[0]), genes[1]),
            }
            tried
        }
    }
    impl Objective<2> for Misfit<'_> {
        fn bounds(&self) -> &Bounds<2> {
            &self.bounds
        }
        fn cost(&self, genes: &[f64; 2]) -> f64 {
            let coefficients = Calibration {
                ripple: Ripple::NONE,
                ..self.calibration(genes).coefficients()
            };
            let mut sum = 0.0;
            for w in self.windows {
                let compared = compare_alone(w, self.params, &coefficients);
                sum += compared.least_squares(&compared.unknowns_with_fault(w.truth));
            }
            sum / self.windows.len() as f64
        }
    }
    let (lower, upper, start) = match stage {
        Stage::Coupling => ([0.9, 0.9], [1.2, 1.1], [1.0, 1.0]),
        Stage::Shapes => ([0.0, 0.0], [0.999, 1.0], [0.99, 0.5]),
    };
    #[expect(clippy::expect_used, reason = "constant bounds")]
    let bounds = Bounds::new(lower, upper).expect("constant bounds ascend");
    let objective = Misfit {
        bounds,
        start: &calibration.clone(),
        stage,
        params,
        windows,
    };
    let mut config = GaConfig::for_dimension(2);
    config.stop.max_generations = GENERATIONS as u32;
    let search = Search {
        objective: &objective,
        evaluate: Parallel,
        seed,
        initial: &[start],
    };
    let follow = |_: &GenerationLog<2>| {
        done();
        Control::Continue
    };
    if let Ok(found) = evolve_owned(&search, &config, follow) {
        *calibration = objective.calibration(&found.genes);
    }
}

/// k_FS from the share of the squares in eq. 10, so that its limit k_FS → ∞ is a finite gene.
fn k_fs(share: f64) -> f64 {
    2.0 * share / (1.0 - share)
}

struct Statistics {
    rms: Signals<f64>,
    correlation: Signals<f64>,
}

/// Size and integrated autocorrelation of the residuals at the true fault vectors.
fn residual_statistics(params: &ActuatorParams, coefficients: &Calibration, windows: &[SimulatedWindow]) -> Statistics {
    let traces: Vec<Vec<[f64; SIGNAL_COUNT]>> = windows
        .par_iter()
        .map(|w| {
            let mut trace = Vec::new();
            let compared = compare(w, params, coefficients, Weights::CURRENT_ONLY);
            compared.residuals(&compared.unknowns_with_fault(w.truth), |_, r| trace.push(r.to_array()));
            trace
        })
        .collect();
    let lags = traces.iter().map(Vec::len).min().unwrap_or(0) / 2;
    let product = |signal: usize, lag: usize| -> f64 {
        traces
            .iter()
            .flat_map(|t| t.iter().zip(&t[lag.min(t.len())..]))
            .map(|(a, b)| a[signal] * b[signal])
            .sum()
    };
    let samples: usize = traces.iter().map(Vec::len).sum();
    let mut rms = [0.0; SIGNAL_COUNT];
    let mut correlation = [1.0; SIGNAL_COUNT];
    for signal in 0..SIGNAL_COUNT {
        let variance = product(signal, 0);
        rms[signal] = (variance / samples.max(1) as f64).sqrt().max(1e-9);
        for lag in 1..lags {
            let share = product(signal, lag) / variance.max(1e-300);
            // The initial positive sequence: beyond it there is only noise.
            if share <= 0.05 {
                break;
            }
            correlation[signal] += 2.0 * share;
        }
    }
    Statistics {
        rms: Signals::from_array(rms),
        correlation: Signals::from_array(correlation),
    }
}

/// Pairs of weights that [`mismatch`] tries.
const CANDIDATES: u64 = 9;

/// How wrong the monitor is in windows of one rate, with the weights of angle and speed that bias estimates least.
///
/// The two say the same thing twice, the angle drifting and the speed noisy, so their correlation alone does not tell
/// how much each should count.
fn mismatch(
    calibration: &TypeCalibration,
    params: &ActuatorParams,
    windows: &[SimulatedWindow],
    done: &dyn Fn(),
) -> Mismatch {
    let statistics = residual_statistics(params, &calibration.coefficients(), windows);
    let measured = SignalTable::from(statistics.correlation);
    let mut best: Option<(f64, Mismatch)> = None;
    for theta in [0.2, 1.0, 5.0] {
        for omega in [1.0, 5.0, 25.0] {
            let mut table = Mismatch {
                sample_rate_hz: params.sensors.sample_rate,
                model_sigma: [0.0; FAULT_COUNT],
                residual_rms: statistics.rms.into(),
                correlation_samples: SignalTable {
                    theta_m: measured.theta_m * theta,
                    omega_m: measured.omega_m * omega,
                    ..measured
                },
            };
            let tried = TypeCalibration {
                at_rate: vec![table],
                ..calibration.clone()
            };
            table.model_sigma = rms_bias(&tried, params, windows);
            done();
            let total = table.model_sigma.iter().map(|s| s * s).sum::<f64>();
            if best.is_none_or(|(least, _)| total < least) {
                best = Some((total, table));
            }
        }
    }
    #[expect(clippy::expect_used, reason = "nine candidates were tried")]
    best.expect("a candidate").1
}

/// Root-mean-square estimator bias that the mismatch causes, over the windows.
fn rms_bias(calibration: &TypeCalibration, params: &ActuatorParams, windows: &[SimulatedWindow]) -> [f64; FAULT_COUNT] {
    let biases = each_bias(calibration, params, windows);
    std::array::from_fn(|p| (biases.iter().map(|d| d[p] * d[p]).sum::<f64>() / biases.len().max(1) as f64).sqrt())
}

fn each_bias(
    calibration: &TypeCalibration,
    params: &ActuatorParams,
    windows: &[SimulatedWindow],
) -> Vec<[f64; FAULT_COUNT]> {
    let (coefficients, weights) = (
        calibration.coefficients(),
        calibration.weights(params.sensors.sample_rate),
    );
    windows
        .par_iter()
        .map(|w| estimator_bias(&compare(w, params, &coefficients, weights), &w.truth))
        .collect()
}
