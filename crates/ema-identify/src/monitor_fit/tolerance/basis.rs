//! Per sample: the torque on the shaft, and the change of the measured signals, that one unit of each nuisance causes.
//!
//! Both follow from the measured signals alone, so they stay the same while the monitor's parameters change.

use std::vec::Vec;

use ema_models::{
    ComparedSample, Comparison, Real, SIGNAL_COUNT, ShaftTorques, Signals, Tolerances, abc_from_alpha_beta,
    alpha_beta_from_dq, phase_shapes,
};

/// Changes of the measured signals.
pub(super) const CHANGE_COUNT: usize = 8;

/// One sample's changes of the signals.
pub(super) type Changes = [[f64; SIGNAL_COUNT]; CHANGE_COUNT];

/// Both, one row per sample.
#[derive(Clone, Debug)]
pub(super) struct Basis {
    pub(super) torques: Vec<ShaftTorques>,
    pub(super) changes: Vec<Changes>,
    /// Share of each signal's weight: less where the current changes, because drives differ in how it does.
    pub(super) confidence: Vec<[f64; SIGNAL_COUNT]>,
}

/// Speed at which the friction beyond T_d has fallen to 1/e, rad/s: the middle of what gears have.
const STRIBECK_SPEED: f64 = 15.0;

/// Speed below which the direction of motion is gradual, rad/s.
const DIRECTION_SPEED: f64 = 1.0;

/// Time over which the monitor's speed residual is taken, s.
const SPEED_SPAN: f64 = 1e-3;

impl Basis {
    pub(super) fn new(window: &Comparison<'_>, tolerances: &Tolerances) -> Self {
        let samples = window.recording.samples;
        let confidence = (0..samples.len()).map(|n| confidence(window, tolerances.control_latency, n));
        let confidence = confidence.collect();
        let coupled = coupled_currents(window);
        let torques = (0..samples.len()).map(|n| torques(window, &coupled, n));
        let torques = torques.collect();
        let mut changes: Vec<Changes> = (0..samples.len()).map(|n| changes(window, &coupled, n)).collect();
        // The speed is compared as the difference of two angles.
        let rate = window.params.sensors.sample_rate;
        let span = (libm::round(rate * SPEED_SPAN) as usize).clamp(1, 8);
        for n in (0..changes.len()).rev() {
            for change in 0..CHANGE_COUNT {
                let both = n >= span && samples[n].measured && samples[n - span].measured;
                let earlier = if both {
                    changes[n - span][change][MOTOR_ANGLE]
                } else {
                    0.0
                };
                let now = changes[n][change][MOTOR_ANGLE];
                changes[n][change][MOTOR_SPEED] = if both {
                    (now - earlier) * rate / span as f64
                } else {
                    0.0
                };
            }
        }
        Self {
            torques,
            changes,
            confidence,
        }
    }
}

/// Confidence in the signals of sample `n`, for currents that lag by a time known to `latency`, s.
fn confidence(window: &Comparison<'_>, latency: f64, n: usize) -> [f64; SIGNAL_COUNT] {
    let samples = window.recording.samples;
    let rate = window.params.sensors.sample_rate;
    let (from, to) = (n.saturating_sub(2), (n + 2).min(samples.len() - 1));
    // Differences of neighbours, the largest nearby; what noise does to them is small.
    let steepest = samples[from..=to]
        .windows(2)
        .map(|pair| (pair[1].i_q - pair[0].i_q).abs() * rate)
        .fold(0.0, f64::max);
    let weights = window.weights.to_array();
    let mut confidence = [1.0; SIGNAL_COUNT];
    for signal in [DIRECT_CURRENT, QUADRATURE_CURRENT] {
        let off = weights[signal] * latency * steepest;
        confidence[signal] = 1.0 / libm::sqrt(1.0 + off * off);
    }
    confidence
}

/// Places among the signals.
const DIRECT_CURRENT: usize = 0;
const QUADRATURE_CURRENT: usize = 1;
const MOTOR_ANGLE: usize = 2;
const MOTOR_SPEED: usize = 3;

/// Rates of change at a sample, by its neighbours.
struct Slopes {
    i_d: f64,
    i_q: f64,
    omega_m: f64,
}

impl Slopes {
    fn at(samples: &[ComparedSample], n: usize, rate: f64) -> Self {
        let (before, after) = (n.saturating_sub(1), (n + 1).min(samples.len() - 1));
        let per_span = rate / (after - before).max(1) as f64;
        let slope = |value: fn(&ComparedSample) -> f64| (value(&samples[after]) - value(&samples[before])) * per_span;
        Self {
            i_d: slope(|s| s.i_d),
            i_q: slope(|s| s.i_q),
            omega_m: slope(|s| s.omega_m),
        }
    }
}

/// What a current control with integral part and without decoupling adds to the direct and quadrature current, A, per time
/// constant of its loop, s: `s τ/(1 + s τ)` with τ = L/R of the rotational voltages over L, ω_e i_q and −(ω_e i_d + k ω_m/L).
fn coupled_currents(window: &Comparison<'_>) -> Vec<[f64; 2]> {
    let motor = &window.params.motor;
    let samples = window.recording.samples;
    let step = 1.0 / window.params.sensors.sample_rate;
    let kept = libm::exp(-step * motor.r_s / motor.l_s);
    let (mut slow, mut first) = ([0.0; 2], true);
    let of_sample = |sample: &ComparedSample| {
        let omega_e = motor.pole_pairs * sample.omega_m;
        let coupled = [
            omega_e * sample.i_q,
            -(omega_e * sample.i_d + motor.k * sample.omega_m / motor.l_s),
        ];
        if first {
            (slow, first) = (coupled, false);
        }
        for (slow, now) in slow.iter_mut().zip(coupled) {
            *slow = kept * *slow + (1.0 - kept) * now;
        }
        [coupled[0] - slow[0], coupled[1] - slow[1]]
    };
    samples.iter().map(of_sample).collect()
}

/// Torques between sample `n` and the next one.
fn torques(window: &Comparison<'_>, coupled: &[[f64; 2]], n: usize) -> ShaftTorques {
    let params = window.params;
    let samples = window.recording.samples;
    let origin = &window.recording.initial.origin;
    let rate = params.sensors.sample_rate;
    let (now, next) = (&samples[n], &samples[(n + 1).min(samples.len() - 1)]);
    let mean = |value: fn(&ComparedSample) -> f64| 0.5 * (value(now) + value(next));
    let theta_m = mean(|s| s.theta_m);
    let omega_m = (next.theta_m - now.theta_m) * rate;
    let pole_pairs = params.motor.pole_pairs;
    let theta_e = origin.theta_e + pole_pairs * theta_m;
    let omega_e = pole_pairs * omega_m;
    let alpha_e = pole_pairs * 0.5 * (Slopes::at(samples, n, rate).omega_m + slope_at_next(samples, n, rate));
    let sin_cos = theta_e.sin_cos_poly();
    let (sin, cos) = sin_cos;
    let (sin2, cos2) = (2.0 * sin * cos, cos * cos - sin * sin);
    let shapes = phase_shapes(sin_cos);
    let i = abc_from_alpha_beta(alpha_beta_from_dq([mean(|s| s.i_d), mean(|s| s.i_q)], sin_cos));
    let k = params.motor.k;
    let direction = omega_m / libm::sqrt(omega_m * omega_m + DIRECTION_SPEED * DIRECTION_SPEED);
    let per_gear = 1.0 / params.transmission.gear_ratio;
    let turned = (mean(|s| s.theta_out) - samples[0].theta_out) * per_gear;
    let square = omega_m / STRIBECK_SPEED * (omega_m / STRIBECK_SPEED);
    let (sin_cogging, cos_cogging) = (6.0 * theta_e).sin_cos_poly();
    // Σ_j sin(h θ_j) i_j with θ_j = θ_e − 2πj/3; the order of the phases decides the sign.
    let harmonic = |order: f64| -> f64 {
        let third = core::f64::consts::TAU / 3.0;
        (0..3)
            .map(|j| (order * (theta_e - third * f64::from(j))).sin_cos_poly().0 * i[j as usize])
            .sum::<f64>()
            * k
    };
    // J d²/dt² of the resolver's error: on the shaft that the resolver shows, it acts as a torque.
    let per_pole_pair = params.motor.j / pole_pairs;
    let second = |order: f64, along: f64, across: f64| {
        -per_pole_pair * (order * order * omega_e * omega_e * along + order * alpha_e * across)
    };
    let latency = Slopes::at(samples, n, rate);
    let gain = params.motor.torque_gain();
    let [along, across] = offset_torques(shapes);
    let disturbances = [
        direction * libm::exp(-square),
        sin_cogging,
        cos_cogging,
        second(1.0, cos, sin),
        second(1.0, sin, -cos),
        second(2.0, cos2, sin2),
        second(2.0, sin2, -cos2),
        harmonic(5.0),
        harmonic(7.0),
        k * along,
        k * across,
        k * shapes[0] * i[0],
        k * shapes[1] * i[1],
        k * shapes[2] * i[2],
        gain * latency.i_q,
        params.controller.k_p * latency.omega_m,
        -gain * coupled[n][1],
    ];
    ShaftTorques {
        disturbances,
        load_changes: [turned, n as f64 / rate * per_gear],
    }
}

/// Torques, for each `k`, of two orthogonal axes of the current offsets: `(o_α, −o_α/2, −o_α/2)` and `√3/2 (0, o_β, −o_β)`.
fn offset_torques(shapes: [f64; 3]) -> [f64; 2] {
    const SQRT_3_2: f64 = 0.866_025_403_784_438_6;
    [
        shapes[0] - 0.5 * (shapes[1] + shapes[2]),
        SQRT_3_2 * (shapes[1] - shapes[2]),
    ]
}

fn slope_at_next(samples: &[ComparedSample], n: usize, rate: f64) -> f64 {
    Slopes::at(samples, (n + 1).min(samples.len() - 1), rate).omega_m
}

/// Changes of the signals of sample `n`, the speed left out.
fn changes(window: &Comparison<'_>, coupled: &[[f64; 2]], n: usize) -> Changes {
    let params = window.params;
    let samples = window.recording.samples;
    let sample = &samples[n];
    let slopes = Slopes::at(samples, n, params.sensors.sample_rate);
    let omega_e = params.motor.pole_pairs * sample.omega_m;
    let change = |signals: Signals<f64>| signals.to_array();
    let none = Signals::from_array([0.0; SIGNAL_COUNT]);
    let (sin_out, cos_out) = sample.theta_out.sin_cos_poly();
    [
        change(Signals {
            i_q: -slopes.i_q,
            ..none
        }),
        change(Signals {
            i_q: -slopes.omega_m * params.controller.k_p / params.motor.torque_gain(),
            ..none
        }),
        change(Signals {
            i_d: -(slopes.i_d - omega_e * sample.i_q),
            i_q: -(slopes.i_q + omega_e * sample.i_d),
            ..none
        }),
        change(Signals {
            i_d: -omega_e * sample.i_q,
            i_q: omega_e * sample.i_d,
            theta_m: -sample.omega_m,
            theta_out: -sample.omega_m / params.transmission.gear_ratio,
            omega_m: 0.0,
        }),
        change(Signals {
            theta_out: sin_out,
            ..none
        }),
        change(Signals {
            theta_out: cos_out - 1.0,
            ..none
        }),
        change(Signals {
            i_d: coupled[n][0],
            ..none
        }),
        change(Signals {
            i_q: coupled[n][1],
            ..none
        }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::phase_shapes;

    #[test]
    fn offsets_make_the_torque_of_their_phases() {
        for theta_e in [0.3, 1.7, 4.0] {
            let shapes = phase_shapes(f64::sin_cos_poly(theta_e));
            let [along, across] = offset_torques(shapes);
            let of = |offsets: [f64; 3]| -> f64 { shapes.iter().zip(offsets).map(|(s, o)| s * o).sum() };
            let half_root = 0.75_f64.sqrt();
            assert!((along - of([1.0, -0.5, -0.5])).abs() < 1e-12);
            assert!((across - of([0.0, half_root, -half_root])).abs() < 1e-12);
        }
    }
}
