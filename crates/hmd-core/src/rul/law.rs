//! One law of growth with its rate held fixed: a Kalman filter over damage and slope.

use serde::{Deserialize, Serialize};

/// The clock of wear: what its growth is a function of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// Operating hours.
    Hours,
    /// Work done, J.
    Work,
}

/// Standard deviation of a step of growth, as a share of it.
pub(super) const GROWTH_NOISE: f64 = 0.1;

/// Share of estimates that have nothing to do with the damage; they are spread evenly over 0…1.
const OUTLIERS: f64 = 0.01;

/// Growth `dd/dx = v`, `dv/dx = rate v` over a clock x: straight at rate 0, else exponential.
///
/// State: damage d and slope v, jointly normal. A step of growth g is uncertain by 10 % of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// What x is.
    pub clock: Clock,
    /// Relative growth of the slope, per unit of x.
    pub rate: f64,
    /// Damage, mean.
    pub damage: f64,
    /// Slope, mean, per unit of x.
    pub slope: f64,
    /// Covariance: of damage, of both, of slope.
    pub covariance: [f64; 3],
    /// Logarithm of the evidence, up to a constant that all laws of a trend share.
    pub log_evidence: f64,
}

impl Law {
    /// A law of which nothing is known but one estimate and that the damage has not moved by more than about 1 since.
    pub fn new(clock: Clock, rate: f64, damage: f64, variance: f64, slope_sigma: f64) -> Self {
        Self {
            clock,
            rate,
            damage,
            slope: 0.0,
            covariance: [variance, 0.0, slope_sigma * slope_sigma],
            log_evidence: 0.0,
        }
    }

    /// How far a slope of 1 carries the damage over x: `(e^(rate x) − 1) / rate`.
    pub fn reach(&self, x: f64) -> f64 {
        if self.rate * x < 1e-9 {
            x
        } else {
            (self.rate * x).min(EXPONENT_MAX).exp_m1() / self.rate
        }
    }

    /// The inverse of [`Law::reach`].
    pub fn time_to(&self, reach: f64) -> f64 {
        if self.rate * reach < 1e-9 {
            reach
        } else {
            (self.rate * reach).ln_1p() / self.rate
        }
    }

    /// Lets x pass.
    ///
    /// From one estimate to the next the damage moves by no more than about 1: a slope that only estimates next to no time apart have told
    /// is narrowed about none first.
    pub fn advance(&mut self, x: f64) {
        self.narrow_slope(x);
        let [dd, dv, vv] = self.covariance;
        let (g, e) = (self.reach(x), (self.rate * x).min(EXPONENT_MAX).exp());
        let noise = (GROWTH_NOISE * g).powi(2) * (self.slope * self.slope + vv);
        self.damage += self.slope * g;
        self.slope *= e;
        self.covariance = [dd + 2.0 * g * dv + g * g * vv + noise, e * (dv + g * vv), e * e * vv];
    }

    /// Narrows the slope so that over x it is uncertain by a damage of 1 at most, as an observation of no slope does that leaves so much of
    /// it. By x and not by its reach: all laws of a clock begin with the same slope, which their weights rely on.
    fn narrow_slope(&mut self, x: f64) {
        let [dd, dv, vv] = self.covariance;
        let sigma = vv.sqrt() * x;
        if sigma > 1.0 {
            let kept = 1.0 / sigma / sigma;
            self.damage -= dv / vv * (1.0 - kept) * self.slope;
            self.slope *= kept;
            self.covariance = [(dd - dv / vv * dv * (1.0 - kept)).max(0.0), dv * kept, vv * kept];
        }
    }

    /// Takes an estimate; returns how likely it is no outlier, and its squared innovation over the variance expected.
    pub fn observe(&mut self, damage: f64, variance: f64) -> (f64, f64) {
        let [dd, dv, vv] = self.covariance;
        let expected = dd + variance;
        let innovation = damage - self.damage;
        let squared = innovation * innovation / expected;
        let inlier = (1.0 - OUTLIERS) * (-0.5 * squared).exp() / (core::f64::consts::TAU * expected).sqrt();
        let likelihood = inlier + OUTLIERS;
        let p = inlier / likelihood;
        self.log_evidence += likelihood.ln();
        let gain = [dd / expected, dv / expected];
        self.damage += p * gain[0] * innovation;
        self.slope += p * gain[1] * innovation;
        // Mean over both cases: with the estimate and without it, and the spread between them.
        let shrink = -p * expected + p * (1.0 - p) * innovation * innovation;
        self.covariance = [
            (dd + shrink * gain[0] * gain[0]).max(0.0),
            dv + shrink * gain[0] * gain[1],
            (vv + shrink * gain[1] * gain[1]).max(0.0),
        ];
        (p, squared)
    }

    /// Standard deviation of the slope.
    pub fn slope_sigma(&self) -> f64 {
        self.covariance[2].sqrt()
    }

    /// Mean and variance of the damage when x more has passed in steps of `step`.
    ///
    /// Steps that grow like `e^(rate x)` sum the squares of their noise to `rate/2 coth(rate x / 2) step` of the square of
    /// the whole growth, straight ones to `step / x`.
    pub fn damage_after(&self, x: f64, step: f64) -> (f64, f64) {
        let [dd, dv, vv] = self.covariance;
        let g = self.reach(x);
        let growth = self.slope * g;
        let half = 0.5 * self.rate * x;
        let steepness = if half < 1e-6 { 1.0 } else { half / half.tanh() };
        let share = (steepness * step / x).min(1.0);
        let noise = (GROWTH_NOISE * growth).powi(2) * share;
        (self.damage + growth, dd + 2.0 * g * dv + g * g * vv + noise)
    }
}

/// Keeps a law that has long lost from overflowing.
const EXPONENT_MAX: f64 = 40.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_seconds_apart_leave_the_slope_over_a_week_open() {
        let variance = 1e-4;
        let mut law = Law::new(Clock::Hours, 0.0, 0.1, variance, 1.0 / 3e-4);
        law.advance(3e-4);
        law.observe(0.101, variance);
        for week in 1..=3 {
            law.advance(168.0);
            let (p, _) = law.observe(0.1 + 0.01 * f64::from(week), variance);
            assert!(p > 0.9, "week {week}: {p}");
        }
        assert!((law.slope * 168.0 - 0.01).abs() < 0.005, "{law:?}");
    }

    #[test]
    fn reach_and_time_are_inverse_and_straight_at_rate_zero() {
        for rate in [0.0, 1e-12, 1e-3, 0.1] {
            let law = Law::new(Clock::Hours, rate, 0.0, 0.0, 0.0);
            for x in [1e-3, 1.0, 100.0] {
                assert!((law.time_to(law.reach(x)) / x - 1.0).abs() < 1e-9, "rate {rate}, x {x}");
            }
        }
    }

    #[test]
    fn an_exponential_follows_its_equation_however_it_is_divided() {
        let mut whole = Law {
            slope: 1e-3,
            ..Law::new(Clock::Hours, 0.01, 0.1, 0.0, 0.0)
        };
        let mut parts = whole.clone();
        whole.advance(200.0);
        for _ in 0..100 {
            parts.advance(2.0);
        }
        let exact = 0.1 + 1e-3 * (2.0_f64.exp() - 1.0) / 0.01;
        assert!((whole.damage - exact).abs() < 1e-12 && (parts.damage - exact).abs() < 1e-12);
        assert!((parts.slope - 1e-3 * 2.0_f64.exp()).abs() < 1e-15);
        // Many small steps average their noise: that is what a step's noise means.
        assert!(parts.covariance[0] < 0.1 * whole.covariance[0]);
    }

    #[test]
    fn a_straight_law_is_the_regression_line() {
        // Without noise of growth to speak of, the filter's slope is that of least squares.
        let points: Vec<(f64, f64)> = (0..20).map(|n| (f64::from(n), 1e-4 * f64::from(n * n % 7))).collect();
        let mut law = Law::new(Clock::Hours, 0.0, points[0].1, 1e-4, 1.0);
        for &(_, d) in &points[1..] {
            law.advance(1.0);
            law.observe(d, 1e-4);
        }
        let n = points.len() as f64;
        let [mx, my] = [
            points.iter().map(|p| p.0).sum::<f64>() / n,
            points.iter().map(|p| p.1).sum::<f64>() / n,
        ];
        let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
            / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>();
        assert!((law.slope - slope).abs() < 2e-6, "{} and {slope}", law.slope);
    }

    #[test]
    fn an_outlier_hardly_moves_it() {
        let mut law = Law {
            slope: 1e-3,
            ..Law::new(Clock::Hours, 0.0, 0.1, 1e-6, 1e-5)
        };
        law.advance(10.0);
        let before = law.damage;
        let (p, squared) = law.observe(0.9, 1e-5);
        assert!(p < 1e-6 && squared > 100.0 && (law.damage - before).abs() < 1e-6);
    }

    /// Against the noise of each step by itself.
    #[test]
    fn the_noise_of_an_exponential_is_that_of_its_steps() {
        for (rate, x) in [(0.0, 40.0), (0.02, 40.0), (0.1, 30.0)] {
            let law = Law {
                slope: 1e-3,
                covariance: [4e-4, 3e-6, 9e-8],
                ..Law::new(Clock::Hours, rate, 0.1, 0.0, 0.0)
            };
            let step: f64 = 0.05;
            let steps = (x / step).round() as u32;
            let noise: f64 = (0..steps)
                .map(|n| {
                    let slope = 1e-3 * (rate * step * f64::from(n)).exp();
                    (GROWTH_NOISE * slope * law.reach(step)).powi(2)
                })
                .sum();
            let g = law.reach(x);
            let (mean, variance) = law.damage_after(x, step);
            let expected = 4e-4 + 2.0 * g * 3e-6 + g * g * 9e-8 + noise;
            assert!((mean - (0.1 + 1e-3 * g)).abs() < 1e-12, "{mean}");
            assert!(
                (variance - expected).abs() < 2e-3 * noise,
                "{rate}: {variance} {expected}"
            );
        }
    }

    /// As the observation of a slope of 0 whose variance leaves `1 / x²`.
    #[test]
    fn a_slope_is_narrowed_as_by_an_observation() {
        let [dd, dv, vv] = [0.02, 0.03, 0.09];
        let mut law = Law {
            slope: 0.2,
            covariance: [dd, dv, vv],
            ..Law::new(Clock::Hours, 0.0, 0.3, 0.0, 0.0)
        };
        law.narrow_slope(10.0);
        let left = 0.01;
        let observed = vv * left / (vv - left);
        let gain = [dv / (vv + observed), vv / (vv + observed)];
        let expected = [
            0.3 - gain[0] * 0.2,
            0.2 - gain[1] * 0.2,
            dd - gain[0] * dv,
            dv - gain[1] * dv,
            left,
        ];
        let found = [
            law.damage,
            law.slope,
            law.covariance[0],
            law.covariance[1],
            law.covariance[2],
        ];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{law:?}");
        }
    }
}
