//! Calibration of a monitor against the reference, for one type of actuator (\[P\] section 5.2, eqs. 12 and 13).

mod ripple;

use ema_ga::{Bounds, Control, GaConfig, Objective, Parallel, Search, evolve_owned};
use ema_models::{
    ActuatorParams, Calibration, Comparison, FAULT_COUNT, FaultVector, Feedback, Form, MotorKnowledge, PaperShape,
    Profile, Ripple, SIGNAL_COUNT, Signals, Weights,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::simulated::SimulatedWindow;
use ema_identify::calibration::{CALIBRATION_VERSION, Mismatch, MonitorForm, Quality, SignalTable, TypeCalibration};
use ema_identify::{comparison, estimator_bias};

/// Windows a calibration learns from.
const HEALTHY_WINDOWS: u64 = 8;
const FAULTY_WINDOWS: u64 = 40;

/// Upper bits of the seeds of a calibration's windows, which nothing else uses: the suites hash theirs.
const SEED_SPACE: u64 = 0xCA11_B8A7_0000_0000;

/// Calibrates a monitor form for a type of actuator.
#[must_use]
pub fn calibrate_type(name: &str, params: &ActuatorParams, monitor: MonitorForm, seed: u64) -> TypeCalibration {
    let windows = windows(params, seed);
    let (healthy, faulty) = windows.split_at(HEALTHY_WINDOWS as usize);

    let mut calibration = TypeCalibration::uncalibrated(name, monitor, params);
    let bare = Calibration {
        ripple: Ripple::NONE,
        ..calibration.coefficients()
    };
    match monitor {
        MonitorForm::ThreePhase => {
            calibration.ripple = ripple::measure(params);
            ripple::fit(&mut calibration, params, &windows);
        }
        MonitorForm::OneAxis | MonitorForm::Paper => {
            fit_coefficients(&mut calibration, params, &windows, seed);
        }
    }
    let coefficients = calibration.coefficients();

    calibration.at_rate = vec![mismatch(&calibration, params, &windows)];
    let mut slow = *params;
    slow.sensors.sample_rate /= SLOWER;
    if slow.checked().is_ok() {
        let slower = mismatch(&calibration, &slow, &self::windows(&slow, seed));
        calibration.at_rate.push(slower);
    }
    calibration.quality = Quality {
        healthy_before_a2: current_error(params, &bare, healthy),
        healthy_after_a2: current_error(params, &coefficients, healthy),
        faulty_before_a2: current_error(params, &bare, faulty),
        faulty_after_a2: current_error(params, &coefficients, faulty),
    };
    calibration.version = CALIBRATION_VERSION;
    calibration
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
                random_faults(case_seed)
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

/// The one-axis forms' coefficients by the genetic algorithm, as \[P\] does it.
fn fit_coefficients(
    calibration: &mut TypeCalibration,
    params: &ActuatorParams,
    windows: &[SimulatedWindow],
    seed: u64,
) {
    struct Misfit<'a> {
        bounds: Bounds<4>,
        form: MonitorForm,
        params: &'a ActuatorParams,
        windows: &'a [SimulatedWindow],
    }
    impl Misfit<'_> {
        fn coefficients(&self, genes: &[f64; 4]) -> Calibration {
            let form = match self.form {
                // The gene is 1/k_FS-like: φ_SC runs from the plain mean of the turns (0) to the pure squares (1).
                MonitorForm::Paper => Form::Paper(PaperShape {
                    k_fs: k_fs(genes[2]),
                    k_e: genes[3],
                }),
                MonitorForm::OneAxis | MonitorForm::ThreePhase => Form::OneAxis,
            };
            Calibration {
                form,
                back_emf: genes[0],
                torque: genes[1],
                current_time_constant: 0.0,
                ripple: Ripple::NONE,
            }
        }
    }
    impl Objective<4> for Misfit<'_> {
        fn bounds(&self) -> &Bounds<4> {
            &self.bounds
        }
        fn cost(&self, genes: &[f64; 4]) -> f64 {
            let coefficients = self.coefficients(genes);
            let mut sum = 0.0;
            for w in self.windows {
                let compared = compare_alone(w, self.params, &coefficients);
                sum += compared.least_squares(&compared.unknowns_with_fault(w.truth));
            }
            sum / self.windows.len() as f64
        }
    }
    #[expect(clippy::expect_used, reason = "constant bounds")]
    let bounds = Bounds::new([0.9, 0.9, 0.0, 0.0], [1.2, 1.1, 0.999, 1.0]).expect("constant bounds ascend");
    let objective = Misfit {
        bounds,
        form: calibration.monitor,
        params,
        windows,
    };
    let mut config = GaConfig::for_dimension(4);
    config.stop.max_generations = 30;
    let search = Search {
        objective: &objective,
        evaluate: Parallel,
        seed,
        initial: &[[1.0, 1.0, 0.99, 0.5]],
    };
    if let Ok(found) = evolve_owned(&search, &config, |_| Control::Continue) {
        [calibration.back_emf, calibration.torque, _, calibration.k_e] = found.genes;
        calibration.k_fs = k_fs(found.genes[2]);
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

/// How wrong the monitor is in windows of one rate, with the weights of angle and speed that bias estimates least.
///
/// The two say the same thing twice, the angle drifting and the speed noisy, so their correlation alone does not tell
/// how much each should count.
fn mismatch(calibration: &TypeCalibration, params: &ActuatorParams, windows: &[SimulatedWindow]) -> Mismatch {
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
