//! Calibration of a monitor against the reference, for one type of actuator (\[P\] section 5.2, eqs. 12 and 13).

use ema_ga::{Bounds, Control, GaConfig, Objective, Parallel, Search, evolve_owned};
use ema_models::reference::{Reference, ReferenceState};
use ema_models::{
    ActuatorParams, Calibration, Comparison, FAULT_COUNT, FaultVector, Feedback, Form, MotorKnowledge, PaperShape,
    Profile, RIPPLE_KNOTS, RIPPLE_PLACES, Real, Ripple, SIGNAL_COUNT, Setpoint, Signals, Weights, dq_from_abc,
};
use nalgebra::{SMatrix, SVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::calibration::{CALIBRATION_VERSION, Mismatch, MonitorForm, Quality, SignalTable, TypeCalibration};
use crate::identify::{comparison, pull_from};
use crate::simulated::SimulatedWindow;

/// Windows a calibration learns from.
const HEALTHY_WINDOWS: u64 = 8;
const FAULTY_WINDOWS: u64 = 40;

/// Seeds below this belong to nobody else: the suites hash theirs.
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
            calibration.ripple = measure_ripple(params);
            fit_ripple(&mut calibration, params, &windows);
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
            2.0 * compared.least_squares(&compared.with_fault(w.truth))
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
                sum += compared.least_squares(&compared.with_fault(w.truth));
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
            compared.residuals(&compared.with_fault(w.truth), |_, r| trace.push(r.to_array()));
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

/// How wrong the monitor is in windows of one rate, with the weights of angle and speed that pull estimates least.
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
            table.model_sigma = pulls(&tried, params, windows);
            let total = table.model_sigma.iter().map(|s| s * s).sum::<f64>();
            if best.is_none_or(|(least, _)| total < least) {
                best = Some((total, table));
            }
        }
    }
    #[expect(clippy::expect_used, reason = "nine candidates were tried")]
    best.expect("a candidate").1
}

/// Root-mean-square distance that the mismatch pulls estimates which start at the truth.
fn pulls(calibration: &TypeCalibration, params: &ActuatorParams, windows: &[SimulatedWindow]) -> [f64; FAULT_COUNT] {
    let pulls = each_pull(calibration, params, windows);
    std::array::from_fn(|p| (pulls.iter().map(|d| d[p] * d[p]).sum::<f64>() / pulls.len().max(1) as f64).sqrt())
}

fn each_pull(
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
        .map(|w| pull_from(&compare(w, params, &coefficients, weights), &w.truth))
        .collect()
}

/// Measures the mean shortfall of the currents over the inverter's voltage, at constant speeds and loads.
///
/// Each run gives one point (m, g); the knots are the least-squares broken line through all of them.
fn measure_ripple(params: &ActuatorParams) -> [f64; RIPPLE_KNOTS] {
    const SETTLE_STEPS: u32 = 300_000;
    const MEASURED_STEPS: u32 = 400_000;
    let mut fast = *params;
    // The sweep goes up to the voltage limit, wherever the speed limit stands.
    let top_speed = 1.1 * params.motor.v_dc * 0.5 / params.motor.k;
    fast.controller.omega_max = 2.0 * top_speed;
    let mut runs = Vec::new();
    for speed in 1..=32 {
        for current_share in [-0.2, 0.0, 0.3, 0.6] {
            runs.push((f64::from(speed) / 32.0 * top_speed, current_share));
        }
    }
    let half_band = params.controller.hysteresis;
    let points: Vec<Option<(f64, f64)>> = runs
        .into_par_iter()
        .map(|(speed, current_share)| {
            let (motor, transmission) = (&params.motor, &params.transmission);
            let load = current_share
                * motor.i_max
                * motor.torque_gain()
                * transmission.gear_ratio
                * transmission.efficiency_opposing;
            let reference = Reference::new(&fast, &fast, &FaultVector::NOMINAL, load);
            let mut state = ReferenceState::at_rest(0.0, 0.0);
            let setpoint = Setpoint::Speed(speed);
            for _ in 0..SETTLE_STEPS {
                reference.step(&mut state, setpoint);
            }
            let mut sums = [0.0; 4];
            for _ in 0..MEASURED_STEPS {
                reference.step(&mut state, setpoint);
                let [d, q] = dq_from_abc(state.i, (motor.pole_pairs * state.theta_m).sin_cos_poly());
                for (sum, x) in sums.iter_mut().zip([d, q - state.i_ref, q, state.omega_m]) {
                    *sum += x / f64::from(MEASURED_STEPS);
                }
            }
            let [d, short_q, q, omega] = sums;
            let v_d = -motor.pole_pairs * omega * motor.l_s * q;
            let v_q = motor.r_s * q + motor.k * omega;
            let v = v_d.hypot(v_q);
            let shortfall = -(d * v_d + short_q * v_q) / v / half_band;
            // Beyond the voltage limit the current falls by much more than the band.
            (v > 0.0 && shortfall.abs() < 0.5).then_some((2.0 * v / motor.v_dc, shortfall))
        })
        .collect();
    broken_line(points.into_iter().flatten())
}

/// Least-squares broken line through points (m, g).
fn broken_line(points: impl Iterator<Item = (f64, f64)>) -> [f64; RIPPLE_KNOTS] {
    let mut normal = SMatrix::<f64, RIPPLE_KNOTS, RIPPLE_KNOTS>::identity() * 1e-6;
    let mut rhs = SVector::<f64, RIPPLE_KNOTS>::zeros();
    for (m, g) in points {
        let hats = hats(m);
        normal += hats * hats.transpose();
        rhs += hats * g;
    }
    match normal.cholesky() {
        Some(factor) => {
            let knots = factor.solve(&rhs);
            std::array::from_fn(|n| rounded(knots[n].max(0.0)))
        }
        None => Ripple::default().knots,
    }
}

/// Share of each knot in the broken line at m: the line starts at 0, and is flat behind the last knot.
fn hats(m: f64) -> SVector<f64, RIPPLE_KNOTS> {
    let mut hats = SVector::zeros();
    let after = RIPPLE_PLACES.iter().position(|&place| m < place);
    let n = after.unwrap_or(RIPPLE_KNOTS - 1);
    let before = if n == 0 { 0.0 } else { RIPPLE_PLACES[n - 1] };
    let share = ((m - before) / (RIPPLE_PLACES[n] - before)).min(1.0);
    hats[n] = share;
    if n > 0 {
        hats[n - 1] = 1.0 - share;
    }
    hats
}

fn rounded(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

/// Coefficients of the ripple: the knots, the factor on the hump, the peak at rest.
const COEFFICIENTS: usize = RIPPLE_KNOTS + 2;

/// How far actuations may differ from the sweeps, as a standard deviation of each coefficient: most at low voltage, where the
/// reference of the current does not stand still as it does in a sweep; hump and peak are known from the shipped actuators.
const SPREAD: [f64; COEFFICIENTS] = [0.1, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 1.0, 0.4];

/// Adjusts the ripple to what pulls estimates least in actuations, with the sweeps as what is known beforehand: Gauss–Newton on
/// the windows' pulls, each window counting by the inverse of its own, so that a few with large ones do not decide.
fn fit_ripple(calibration: &mut TypeCalibration, params: &ActuatorParams, windows: &[SimulatedWindow]) {
    type Vector = SVector<f64, COEFFICIENTS>;
    let known = coefficients(calibration);
    for _ in 0..ROUNDS {
        // The weights depend on the ripple, hardly, and the ripple on the weights.
        calibration.at_rate = vec![mismatch(calibration, params, windows)];
        let at = coefficients(calibration);
        let pulls = each_pull(calibration, params, windows);
        let slopes: [Vec<[f64; FAULT_COUNT]>; COEFFICIENTS] = std::array::from_fn(|c| {
            let mut moved = at;
            moved[c] += DIFFERENCE * SPREAD[c];
            each_pull(&with_coefficients(calibration, moved), params, windows)
        });
        let mut normal = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::zeros();
        let mut rhs = Vector::zeros();
        for c in 0..COEFFICIENTS {
            normal[(c, c)] = 1.0 / (SPREAD[c] * SPREAD[c]);
            rhs[c] = (known[c] - at[c]) * normal[(c, c)];
        }
        for (w, pull) in pulls.iter().enumerate() {
            let weight = 1.0 / (pull.iter().map(|d| d * d).sum::<f64>() + SMALL_PULL * SMALL_PULL);
            for p in 0..FAULT_COUNT {
                let slope = Vector::from_fn(|c, _| (slopes[c][w][p] - pull[p]) / (DIFFERENCE * SPREAD[c]));
                normal += slope * slope.transpose() * weight;
                rhs -= slope * (pull[p] * weight);
            }
        }
        let Some(factor) = normal.cholesky() else { return };
        let step = factor.solve(&rhs);
        let before = mean_length(&pulls);
        let better = [1.0, 0.5, 0.25].into_iter().find_map(|share| {
            let tried = with_coefficients(calibration, std::array::from_fn(|c| rounded(at[c] + share * step[c])));
            (mean_length(&each_pull(&tried, params, windows)) < before).then_some(tried)
        });
        match better {
            Some(better) => *calibration = better,
            None => return,
        }
    }
}

/// Linearisations of [`fit_ripple`].
const ROUNDS: u32 = 3;

/// Step of its differences, in [`SPREAD`].
const DIFFERENCE: f64 = 0.1;

/// A pull so small that smaller ones count no more.
const SMALL_PULL: f64 = 2e-3;

fn coefficients(calibration: &TypeCalibration) -> [f64; COEFFICIENTS] {
    let mut all = [calibration.ripple_peak; COEFFICIENTS];
    all[..RIPPLE_KNOTS].copy_from_slice(&calibration.ripple);
    all[RIPPLE_KNOTS] = calibration.ripple_apart;
    all
}

fn with_coefficients(calibration: &TypeCalibration, all: [f64; COEFFICIENTS]) -> TypeCalibration {
    TypeCalibration {
        ripple: std::array::from_fn(|n| all[n]),
        ripple_apart: all[RIPPLE_KNOTS].max(0.0),
        ripple_peak: all[RIPPLE_KNOTS + 1].max(0.0),
        ..calibration.clone()
    }
}

/// Mean distance of pulls.
fn mean_length(pulls: &[[f64; FAULT_COUNT]]) -> f64 {
    let lengths = pulls.iter().map(|pull| pull.iter().map(|d| d * d).sum::<f64>().sqrt());
    lengths.sum::<f64>() / pulls.len().max(1) as f64
}
