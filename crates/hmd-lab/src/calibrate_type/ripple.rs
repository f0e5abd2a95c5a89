//! The mean effect of the hysteresis band on the currents of one type of actuator: first by sweeps at constant speed, then by
//! the least estimator bias in actuations.

use ema_models::reference::{Reference, ReferenceState};
use ema_models::{
    ActuatorParams, FAULT_COUNT, FaultVector, RIPPLE_KNOTS, RIPPLE_VOLTAGES, Real, Ripple, Setpoint, dq_from_abc,
};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::{each_bias, mismatch};
use crate::simulated::SimulatedWindow;
use ema_identify::calibration::TypeCalibration;

/// Measures the mean shortfall of the currents over the inverter's voltage, at constant speeds and loads.
///
/// Each run gives one point (m, g); the knots are the least-squares broken line through all of them.
pub(super) fn measure(params: &ActuatorParams) -> [f64; RIPPLE_KNOTS] {
    const SETTLE_STEPS: u32 = 300_000;
    const MEASURED_STEPS: u32 = 400_000;
    let mut fast = *params;
    // The sweep goes up to the voltage limit, whatever the speed limit.
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
    let after = RIPPLE_VOLTAGES.iter().position(|&place| m < place);
    let n = after.unwrap_or(RIPPLE_KNOTS - 1);
    let before = if n == 0 { 0.0 } else { RIPPLE_VOLTAGES[n - 1] };
    let share = ((m - before) / (RIPPLE_VOLTAGES[n] - before)).min(1.0);
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

/// Adjusts the ripple to the least estimator bias in actuations, with the sweeps as what is known beforehand: Gauss–Newton on
/// the windows' biases, each window counting by the inverse square of its own, so that a few with large ones do not decide.
pub(super) fn fit(
    calibration: &mut TypeCalibration,
    params: &ActuatorParams,
    windows: &[SimulatedWindow],
    done: &dyn Fn(),
) {
    type Vector = SVector<f64, COEFFICIENTS>;
    let known = coefficients(calibration);
    for _ in 0..ROUNDS {
        // The weights depend on the ripple, hardly, and the ripple on the weights.
        calibration.at_rate = vec![mismatch(calibration, params, windows, done)];
        let at = coefficients(calibration);
        let biases = each_bias(calibration, params, windows);
        done();
        let slopes: [Vec<[f64; FAULT_COUNT]>; COEFFICIENTS] = std::array::from_fn(|c| {
            let mut moved = at;
            moved[c] += DIFFERENCE * SPREAD[c];
            let moved = each_bias(&with_coefficients(calibration, moved), params, windows);
            done();
            moved
        });
        let mut normal = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::zeros();
        let mut rhs = Vector::zeros();
        for c in 0..COEFFICIENTS {
            normal[(c, c)] = 1.0 / (SPREAD[c] * SPREAD[c]);
            rhs[c] = (known[c] - at[c]) * normal[(c, c)];
        }
        for (w, bias) in biases.iter().enumerate() {
            let weight = 1.0 / (bias.iter().map(|d| d * d).sum::<f64>() + SMALL_BIAS * SMALL_BIAS);
            for p in 0..FAULT_COUNT {
                let slope = Vector::from_fn(|c, _| (slopes[c][w][p] - bias[p]) / (DIFFERENCE * SPREAD[c]));
                normal += slope * slope.transpose() * weight;
                rhs -= slope * (bias[p] * weight);
            }
        }
        let Some(factor) = normal.cholesky() else { return };
        let step = factor.solve(&rhs);
        let before = mean_length(&biases);
        let better = [1.0, 0.5, 0.25].into_iter().find_map(|share| {
            let tried = with_coefficients(calibration, std::array::from_fn(|c| rounded(at[c] + share * step[c])));
            (mean_length(&each_bias(&tried, params, windows)) < before).then_some(tried)
        });
        done();
        match better {
            Some(better) => *calibration = better,
            None => return,
        }
    }
}

/// Linearisations of [`fit`].
const ROUNDS: u32 = 3;

/// Step of its differences, in [`SPREAD`].
const DIFFERENCE: f64 = 0.1;

/// Bias below which smaller ones have no greater weight.
const SMALL_BIAS: f64 = 2e-3;

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

/// Mean length of the biases.
fn mean_length(biases: &[[f64; FAULT_COUNT]]) -> f64 {
    let lengths = biases.iter().map(|bias| bias.iter().map(|d| d * d).sum::<f64>().sqrt());
    lengths.sum::<f64>() / biases.len().max(1) as f64
}
