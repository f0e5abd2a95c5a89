//! Noise of the measured signals in one window, apart from errors of the model, and what it makes of the residuals.
//!
//! A difference of high order keeps white noise and nearly nothing of what a mass, a winding or a controller does between the samples:
//! `Var Δᵖx = C(2p, p) Var x` of white noise, and `(2 sin(ωΔt/2))²ᵖ` of a motion at ω. What is white has the same variance by each order;
//! what else the signal has makes one of them larger. So the least of them is the noise. Half of the squares are below their median,
//! 0.455 of their mean, which the few large ones of a transient hardly move. Quantisation is a part of it.
//!
//! A residual that rises by what the noise of the window explains beyond that of commissioning is no error of the model. Derived here.

use std::vec::Vec;

use ema_models::dq_from_abc;

use super::kernel::Kernel;
use super::measured::{MOVING, MeasuredWindow};
use super::noise_change::{MeasurementNoise, NoiseChange};
use crate::recorded_sample::RecordedSample;

/// Orders of the differences, and the highest one.
const ORDERS: [usize; 3] = [2, 4, 6];
const HIGHEST: usize = 6;

/// Fewest samples that show a noise.
const MIN_SAMPLES: usize = 30;

/// Median of the square of a standard normal number.
const MEDIAN_SQUARE: f64 = 0.454_936;

/// Smallest difference that is a step of a quantised current, A: below it, the arithmetic's own.
const LEAST_STEP_A: f64 = 1e-6;

/// Standard deviation of a variance from one sample, relative: `√(1/(4 N f²))/m` of the median m of squares of the density f there, times √3.2, by
/// which neighbouring differences of the sixth order tell the same.
const RELATIVE_SIGMA: f64 = 4.2;

/// Standard deviations of a test, as of the residuals.
const TEST_SIGMAS: f64 = 4.0;

impl MeasurementNoise {
    /// That of a window while its motor turns; `None` where it turns too shortly.
    #[must_use]
    pub fn of<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> Option<Self> {
        let inner = window.inner();
        let mut signals = Vec::with_capacity(inner.len());
        for n in inner {
            let now = window.quantities(n);
            let [_, quadrature] = dq_from_abc(now.i, now.sin_cos_e);
            let turns = window.is_measured(n) && libm::fabs(now.omega_m) >= MOVING;
            signals.push(turns.then_some([quadrature, now.theta_m]));
        }
        let step = |signal: usize| {
            let steps = signals
                .windows(2)
                .filter_map(|pair| Some(pair[1]?[signal] - pair[0]?[signal]));
            let least = steps.map(libm::fabs).filter(|&step| step > LEAST_STEP_A);
            least.fold(f64::INFINITY, f64::min)
        };
        let [current, angle] = [0, 1].map(|signal| white_variance(&signals, signal));
        let (current, samples) = current?;
        // The noise of a quantised signal is at least that of its steps.
        let of_steps = step(0) * step(0) / 12.0;
        Some(Self {
            current: if current < of_steps && of_steps.is_finite() {
                of_steps
            } else {
                current
            },
            angle: angle?.0.max(window.params().sensors.motor_lsb().powi(2) / 12.0),
            samples: samples as f64,
        })
    }

    /// Variance of a relation's rows by the noise, in their unit squared.
    fn of_rows(&self, gains: &NoiseGains) -> f64 {
        gains.current * self.current + gains.angle * self.angle
    }

    /// Relative standard deviation of a variance.
    fn relative_sigma(&self) -> f64 {
        RELATIVE_SIGMA / self.samples.sqrt()
    }
}

/// The least variance of a signal by its differences of each order, and their number; `None` where too few neighbours have it.
fn white_variance(signals: &[Option<[f64; 2]>], signal: usize) -> Option<(f64, usize)> {
    let mut squares: [Vec<f64>; ORDERS.len()] = Default::default();
    for values in signals.windows(HIGHEST + 1) {
        let mut difference = [0.0; HIGHEST + 1];
        let mut is_whole = true;
        for (slot, value) in difference.iter_mut().zip(values) {
            match value {
                Some(value) => *slot = value[signal],
                None => is_whole = false,
            }
        }
        if !is_whole {
            continue;
        }
        for order in 1..=HIGHEST {
            for m in 0..=HIGHEST - order {
                difference[m] = difference[m + 1] - difference[m];
            }
            if let Some(place) = ORDERS.iter().position(|&of| of == order) {
                squares[place].push(difference[0] * difference[0]);
            }
        }
    }
    let count = squares[0].len();
    if count < MIN_SAMPLES {
        return None;
    }
    let by_order = squares.iter_mut().zip(ORDERS).map(|(squares, order)| {
        let (_, median, _) = squares.select_nth_unstable_by(count / 2, f64::total_cmp);
        *median / MEDIAN_SQUARE / binomial(2 * order, order)
    });
    Some((by_order.fold(f64::INFINITY, f64::min), count))
}

/// `n! / (k! (n − k)!)`.
fn binomial(n: usize, k: usize) -> f64 {
    (1..=k).map(|m| (n - k + m) as f64 / m as f64).product()
}

/// Variance of a row by each unit of variance of the signals.
#[derive(Clone, Copy, Debug)]
pub(super) struct NoiseGains {
    current: f64,
    angle: f64,
}

impl NoiseGains {
    /// Those of the torque balance, Nm²: `(G_T² Σ w²) σ_i²` with the weights of the average, `(J² Σ w²) σ_θ²` with those of the second derivative.
    pub(super) fn of_torque_balance<S: RecordedSample>(window: &MeasuredWindow<'_, S>, kernel: &Kernel) -> Self {
        let squares = |weights: &[f64]| weights.iter().map(|weight| weight * weight).sum::<f64>();
        let motor = &window.params().motor;
        Self {
            current: motor.torque_gain().powi(2) * squares(&kernel.average),
            angle: motor.j.powi(2) * squares(&kernel.second),
        }
    }

    /// Those of the law of the speed loop, (Nm/s)²: torque and speed are differentiated.
    pub(super) fn of_law<S: RecordedSample>(window: &MeasuredWindow<'_, S>, kernel: &Kernel) -> Self {
        let squares = |weights: &[f64]| weights.iter().map(|weight| weight * weight).sum::<f64>();
        let params = window.params();
        Self {
            current: params.motor.torque_gain().powi(2) * squares(&kernel.first),
            angle: params.controller.k_p.powi(2) * squares(&kernel.second),
        }
    }
}

/// What another noise makes of the residual of a relation.
#[derive(Clone, Copy, Debug)]
pub(super) struct NoiseRise {
    /// Residual of the healthy windows.
    healthy: f64,
    /// Largest variance that noise adds to that of the healthy windows.
    more: f64,
    /// Residual that a healthy window has with less noise, as a share of `healthy`.
    pub(super) calm: f64,
}

impl NoiseRise {
    /// Nothing is known of the noise.
    pub(super) fn unknown(healthy: f64) -> Self {
        Self {
            healthy,
            more: 0.0,
            calm: 1.0,
        }
    }

    /// Of a window whose relation has these gains and `independent` rows that share no sample, against healthy windows of this residual.
    ///
    /// With r₀² and n₀² at commissioning and n² now, the residual of a healthy window has the variance `r₀² + n² − n₀²`. What is more than r₀²
    /// is allowed for with what chance adds to residual and noise, `e^(8 √(1/2N + u²/4))`; what is less, for n within four standard deviations.
    /// Without n₀, all of r₀ may be noise where n is larger, and none of it where n is smaller.
    pub(super) fn new(change: &NoiseChange, gains: &NoiseGains, healthy: f64, independent: f64) -> Self {
        let r = healthy * healthy;
        let now = change.now.of_rows(gains);
        let chance = |sigma: f64| libm::exp(2.0 * TEST_SIGMAS * sigma);
        let of_residual = 0.5 / independent.max(1.0);
        let of_noise = 0.5 * change.now.relative_sigma();
        let more_than = |known: f64| (now - known).max(0.0) * chance(libm::sqrt(of_residual + of_noise * of_noise));
        let Some(commissioned) = change.commissioned else {
            return Self {
                healthy,
                more: more_than(r),
                calm: 1.0,
            };
        };
        let then = commissioned.of_rows(gains);
        let of_mean = TEST_SIGMAS * commissioned.relative_sigma();
        let most = now * chance(of_noise);
        let less = if most < then {
            // What of the residual was noise: at most as much as the windows had of it.
            let noise = (then * (1.0 - of_mean).max(0.0)).min(r);
            noise * (1.0 - most / then)
        } else {
            0.0
        };
        Self {
            healthy,
            more: more_than(then),
            calm: if r > 0.0 { libm::sqrt(1.0 - less / r) } else { 1.0 },
        }
    }

    /// A residual without what noise explains of it, at least that of a healthy window.
    pub(super) fn beyond(&self, residual: f64) -> f64 {
        if self.more <= 0.0 {
            return residual;
        }
        libm::sqrt((residual * residual - self.more).max(0.0)).max(residual.min(self.healthy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal numbers by a linear congruence: sums of twelve uniform ones.
    fn normal() -> impl FnMut() -> f64 {
        let mut state = 1_u64;
        let mut uniform = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    #[test]
    fn noise_is_found_beside_motion_and_transients() {
        let mut normal = normal();
        let mut variance = |noise: f64| {
            let signal = |n: usize| {
                let t = n as f64 / 2000.0;
                // A chirp of 3 A up to 100 Hz, and a step of a set point.
                3.0 * libm::sin(core::f64::consts::TAU * 100.0 * t * t) + if n > 400 { 2.0 } else { 0.0 }
            };
            let signals: Vec<_> = (0..1000).map(|n| Some([signal(n) + noise * normal(), 0.0])).collect();
            white_variance(&signals, 0).unwrap().0.sqrt()
        };
        for noise in [0.005, 0.02, 0.08, 0.2] {
            let found = variance(noise);
            assert!((found / noise - 1.0).abs() < 0.15, "{found} instead of {noise}");
        }
    }

    #[test]
    fn what_is_not_white_is_no_noise() {
        // A ripple at a sixth of the sample rate beside noise of a tenth of it.
        let mut normal = normal();
        let signals: Vec<_> = (0..1000)
            .map(|n| Some([0.1 * libm::sin(1.05 * n as f64) + 0.01 * normal(), 0.0]))
            .collect();
        let (found, _) = white_variance(&signals, 0).unwrap();
        assert!(found.sqrt() < 0.1 / 2f64.sqrt(), "{}", found.sqrt());
        assert!(white_variance(&signals[..20], 0).is_none());
    }

    fn change(now: f64, then: Option<f64>) -> NoiseChange {
        let noise = |current: f64, samples| MeasurementNoise {
            current,
            angle: 0.0,
            samples,
        };
        NoiseChange {
            now: noise(now * now, 1000.0),
            commissioned: then.map(|then| noise(then * then, 8000.0)),
        }
    }

    #[test]
    fn a_residual_counts_without_what_noise_explains() {
        let gains = NoiseGains {
            current: 1.0,
            angle: 0.0,
        };
        // Healthy windows: noise of 3, errors of 4.
        let rise = |now, then| NoiseRise::new(&change(now, then), &gains, 5.0, 60.0);
        for then in [Some(3.0), None] {
            let same = rise(3.0, then);
            assert!(
                (same.beyond(9.0) - 9.0).abs() < 1e-12 && (same.calm - 1.0).abs() < 1e-12,
                "{then:?}"
            );
            let noisy = rise(30.0, then);
            assert!((noisy.beyond(30.3) - 5.0).abs() < 1e-12, "{then:?}");
            assert!(noisy.beyond(60.0) > 30.0, "{then:?}");
        }
        // With hardly any noise the errors are left, as far as they are known.
        let calm = rise(0.1, Some(3.0)).calm * 5.0;
        assert!((4.0..4.5).contains(&calm), "{calm}");
        assert!((rise(0.1, None).calm - 1.0).abs() < 1e-12);
    }
}
