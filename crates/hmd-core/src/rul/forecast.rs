//! From a trend to the distribution of the life that is left.

use super::law::{Clock, Law};
use super::trend::Trend;
use super::usage::UseRate;

/// Laws of less weight than this do not count.
const WEIGHT_MIN: f64 = 1e-4;

/// Nodes and weights of three-point Gauss–Hermite quadrature for the use to come.
const USE_NODES: [(f64, f64); 3] = [(-1.732_050_8, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732_050_8, 1.0 / 6.0)];

/// Distribution of the hours that are left to one fault.
#[derive(Clone, Debug)]
pub struct Remaining<'a> {
    laws: Vec<(&'a Law, f64)>,
    end_of_life: f64,
    /// Hours over which the trend was watched.
    observed_h: f64,
    /// Hours since its last estimate.
    passed_h: f64,
    rate: UseRate,
}

impl<'a> Remaining<'a> {
    /// Of a trend whose last estimate was taken `passed_h` hours ago, with the use as it is now.
    #[must_use]
    pub fn new(trend: &'a Trend, rate: UseRate, passed_h: f64) -> Self {
        let weights = trend.weights();
        let mut laws: Vec<_> = trend.all_laws().zip(weights).filter(|(_, w)| *w > WEIGHT_MIN).collect();
        let sum: f64 = laws.iter().map(|(_, w)| w).sum();
        for (_, weight) in &mut laws {
            *weight /= sum;
        }
        // No law at all: the probability of everything is 0.
        Self {
            laws,
            end_of_life: trend.end_of_life,
            observed_h: trend.last.since(&trend.first.at).hours,
            passed_h,
            rate,
        }
    }

    /// Of laws with weights that sum to 1.
    #[must_use]
    pub fn from_laws(
        laws: Vec<(&'a Law, f64)>,
        end_of_life: f64,
        observed_h: f64,
        passed_h: f64,
        rate: UseRate,
    ) -> Self {
        Self {
            laws,
            end_of_life,
            observed_h,
            passed_h,
            rate,
        }
    }

    /// Hours over which the trend was watched.
    #[must_use]
    pub fn observed_h(&self) -> f64 {
        self.observed_h
    }

    /// Damage at the last estimate, mean.
    #[must_use]
    pub fn damage(&self) -> f64 {
        self.laws.iter().map(|(law, weight)| weight * law.damage).sum()
    }

    /// Probability that the end of life comes within this many hours from now.
    #[must_use]
    pub fn probability_within(&self, hours: f64) -> f64 {
        let hours = hours + self.passed_h;
        let reached = |law: &Law, x: f64| {
            let (mean, variance) = law.damage_after(x, x * self.rate.step_hours / hours);
            normal_cdf((mean - self.end_of_life) / variance.sqrt().max(1e-9))
        };
        self.laws
            .iter()
            .map(|(law, weight)| {
                weight
                    * match law.clock {
                        Clock::Hours => reached(law, hours),
                        Clock::Work => {
                            let spread = self.rate.log_sigma * (hours / self.rate.observed_h).min(1.0).sqrt();
                            let work = hours * self.rate.work_j_per_hour;
                            USE_NODES
                                .iter()
                                .map(|(node, share)| share * reached(law, work * (spread * node).exp()))
                                .sum()
                        }
                    }
            })
            .sum()
    }

    /// Damage after some hours from now that is not exceeded with probability `share`, with the use of late.
    #[must_use]
    pub fn damage_quantile(&self, hours: f64, share: f64) -> f64 {
        let hours = (hours + self.passed_h).max(f64::MIN_POSITIVE);
        let normals: Vec<(f64, f64, f64)> = self
            .laws
            .iter()
            .map(|(law, weight)| {
                let x = match law.clock {
                    Clock::Hours => hours,
                    Clock::Work => hours * self.rate.work_j_per_hour,
                };
                let (mean, variance) = law.damage_after(x, x * self.rate.step_hours / hours);
                (*weight, mean, variance.sqrt().max(1e-9))
            })
            .collect();
        let below = |damage: f64| -> f64 {
            normals
                .iter()
                .map(|(w, mean, sigma)| w * normal_cdf((damage - mean) / sigma))
                .sum()
        };
        let (mut low, mut high) = (0.0, 1.0);
        while high - low > DAMAGE_PRECISION {
            let middle = 0.5 * (low + high);
            if below(middle) < share {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Probability that the damage grows at all.
    #[must_use]
    pub fn probability_of_growth(&self) -> f64 {
        self.laws
            .iter()
            .map(|(law, weight)| weight * normal_cdf(law.slope / law.slope_sigma().max(f64::MIN_POSITIVE)))
            .sum()
    }
}

/// Hours, to 0.1 %, by which a probability that rises with them reaches `share`; `None` if it does not within `hours_max`.
pub fn quantile(probability_within: impl Fn(f64) -> f64, share: f64, hours_max: f64) -> Option<f64> {
    // No number is no probability.
    let reached = |hours: f64| probability_within(hours) >= share;
    if !reached(hours_max) {
        return None;
    }
    let (mut low, mut high) = (NOW * hours_max, hours_max);
    if reached(low) {
        return Some(0.0);
    }
    while high / low > 1.0 + PRECISION {
        let middle = (low * high).sqrt();
        if reached(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some((low * high).sqrt())
}

/// Share of the longest time sought that is as good as now.
const NOW: f64 = 1e-6;

/// Precision of a damage to come; it is sought between 0 and 1.
const DAMAGE_PRECISION: f64 = 1e-4;

/// Relative precision of a quantile.
const PRECISION: f64 = 1e-3;

/// Standard normal distribution.
pub(crate) fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z * core::f64::consts::FRAC_1_SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::super::law::GROWTH_NOISE;
    use super::*;

    fn rate(work_j_per_hour: f64, step_hours: f64, log_sigma: f64) -> UseRate {
        UseRate {
            cycles_per_hour: 1.0,
            work_j_per_hour,
            step_hours,
            log_sigma,
            observed_h: 300.0,
        }
    }

    #[test]
    fn a_straight_line_that_is_known_well_ends_where_it_must() {
        let law = Law {
            slope: 1e-3,
            ..Law::new(Clock::Hours, 0.0, 0.3, 1e-8, 1e-6)
        };
        let rate = rate(1.0, 1.0, 0.0);
        let remaining = Remaining::from_laws(vec![(&law, 1.0)], 0.8, 300.0, 0.0, rate);
        let [p10, p50, p90] =
            [0.1, 0.5, 0.9].map(|share| quantile(|h| remaining.probability_within(h), share, 1e4).unwrap_or(f64::NAN));
        assert!((p50 - 500.0).abs() < 1.0, "{p50}");
        assert!(p10 < p50 && p50 < p90 && p90 - p10 < 10.0, "{p10} {p90}");
        // Ten hours later without an estimate there are ten hours less.
        let later = Remaining::from_laws(vec![(&law, 1.0)], 0.8, 300.0, 10.0, rate);
        assert!((remaining.probability_within(495.0) - later.probability_within(485.0)).abs() < 1e-12);
    }

    #[test]
    fn nodes_and_weights_have_the_moments_of_a_normal_distribution() {
        let moment = |power: i32| -> f64 { USE_NODES.iter().map(|(node, share)| share * node.powi(power)).sum() };
        let moments = [0, 1, 2, 3, 4, 5].map(moment);
        for (moment, expected) in moments.iter().zip([1.0, 0.0, 1.0, 0.0, 3.0, 0.0]) {
            assert!((moment - expected).abs() < 1e-6, "{moments:?}");
        }
    }

    #[test]
    fn damage_is_the_mean_of_the_laws() {
        let [one, other] = [0.2, 0.6].map(|damage| Law::new(Clock::Hours, 0.0, damage, 1e-8, 1e-6));
        let rate = rate(1.0, 1.0, 0.0);
        let remaining = Remaining::from_laws(vec![(&one, 0.25), (&other, 0.75)], 0.8, 1.0, 0.0, rate);
        assert!((remaining.damage() - 0.5).abs() < 1e-12, "{}", remaining.damage());
    }

    /// Against the integral over the use, by trapezoids.
    #[test]
    fn use_that_scatters_spreads_the_end_of_life() {
        let law = Law {
            slope: 1e-6,
            ..Law::new(Clock::Work, 0.0, 0.3, 2e-2, 1e-7)
        };
        let rate = rate(2e3, 4.0, 0.3);
        let (observed_h, hours) = (400.0, 240.0);
        let remaining = Remaining::from_laws(vec![(&law, 1.0)], 0.8, observed_h, 0.0, rate);
        let spread = 0.3 * (hours / observed_h).sqrt();
        let (mut expected, mut weights) = (0.0, 0.0);
        for n in -4000..=4000 {
            let z = f64::from(n) * 1e-3 * 1.5;
            let work = hours * 2e3 * (spread * z).exp();
            let (mean, variance) = law.damage_after(work, work * 4.0 / hours);
            let weight = (-0.5 * z * z).exp();
            expected += weight * normal_cdf((mean - 0.8) / variance.sqrt());
            weights += weight;
        }
        expected /= weights;
        let found = remaining.probability_within(hours);
        assert!((0.2..0.8).contains(&expected), "{expected}");
        assert!((found - expected).abs() < 0.01, "{found} {expected}");
    }

    /// With a law that is known well, the nodes of the use to come reach the end of life one after the other.
    #[test]
    fn the_use_to_come_spreads_by_its_own_sigma_as_far_as_the_use_was_watched() {
        let law = Law {
            slope: 1e-6,
            ..Law::new(Clock::Work, 0.0, 0.3, 1e-12, 1e-13)
        };
        // Work of 5e5 J is left: 250 h of the use so far. The trend was watched for another time than the use.
        for observed_h in [100.0, 1000.0] {
            let rate = UseRate {
                observed_h,
                ..rate(2e3, 1e-9, 0.3)
            };
            let sigma_at = |hours: f64| 0.3 * (hours / observed_h).min(1.0).sqrt();
            let remaining = Remaining::from_laws(vec![(&law, 1.0)], 0.8, 40.0, 0.0, rate);
            for (node, before, after) in [(3.0_f64.sqrt(), 0.0, 1.0 / 6.0), (0.0, 1.0 / 6.0, 5.0 / 6.0)] {
                let mut hours: f64 = 250.0;
                for _ in 0..100 {
                    hours = 250.0 * (-node * sigma_at(hours)).exp();
                }
                let found = [0.999, 1.001].map(|share| remaining.probability_within(share * hours));
                assert!((found[0] - before).abs() < 1e-4, "{hours} {found:?}");
                assert!((found[1] - after).abs() < 1e-4, "{hours} {found:?}");
            }
        }
    }

    #[test]
    fn growth_scatters_by_the_root_of_its_steps() {
        let law = Law {
            slope: 1e-3,
            ..Law::new(Clock::Hours, 0.0, 0.3, 1e-16, 1e-20)
        };
        for step_hours in [4.0_f64, 16.0] {
            let remaining = Remaining::from_laws(vec![(&law, 1.0)], 0.8, 300.0, 0.0, rate(1.0, step_hours, 0.0));
            // 0.49 more in 490 h, and 0.01 is missing.
            let sigma = GROWTH_NOISE * 0.49 * (step_hours / 490.0).sqrt();
            let (found, expected) = (remaining.probability_within(490.0), normal_cdf(-0.01 / sigma));
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn quantiles_have_their_limits() {
        assert_eq!(quantile(|_| 0.4, 0.5, 100.0), None);
        assert_eq!(quantile(|_| 0.6, 0.5, 100.0), Some(0.0));
        assert_eq!(quantile(|_| f64::NAN, 0.5, 100.0), None);
        let found = quantile(|h| h / 100.0, 0.3, 100.0).unwrap_or(0.0);
        assert!((found - 30.0).abs() < 0.05, "{found}");
    }

    #[test]
    fn the_normal_distribution() {
        assert!((normal_cdf(1.959_964) - 0.975).abs() < 1e-6);
        assert!((normal_cdf(0.0) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn a_damage_to_come_is_the_quantile_of_all_laws() {
        let hourly = Law {
            slope: 1e-3,
            ..Law::new(Clock::Hours, 0.0, 0.2, 1e-4, 1e-5)
        };
        let by_work = Law {
            slope: 2e-6,
            ..Law::new(Clock::Work, 0.0, 0.3, 4e-4, 1e-7)
        };
        let rate = rate(2e3, 4.0, 0.0);
        let one = Remaining::from_laws(vec![(&by_work, 1.0)], 0.8, 300.0, 10.0, rate);
        // 50 h after 10 h without an estimate, 1.2e5 J: 0.24 more.
        let variance = 4e-4 + (1.2e5_f64 * 1e-7).powi(2) + (GROWTH_NOISE * 0.24).powi(2) * 4.0 / 60.0;
        for (share, z) in [(0.1, -1.281_552), (0.5, 0.0), (0.9, 1.281_552)] {
            let (found, expected) = (one.damage_quantile(50.0, share), 0.54 + z * variance.sqrt());
            assert!((found - expected).abs() < 1e-4, "{found} {expected}");
        }
        let both = Remaining::from_laws(vec![(&hourly, 0.5), (&by_work, 0.5)], 0.8, 300.0, 10.0, rate);
        // The laws are far apart: the median of each is a quarter of both.
        let of_hours = Remaining::from_laws(vec![(&hourly, 1.0)], 0.8, 300.0, 10.0, rate);
        let medians = [&of_hours, &one].map(|remaining| remaining.damage_quantile(50.0, 0.5));
        assert!((medians[0] - 0.26).abs() < 1e-4, "{medians:?}");
        for (share, expected) in [(0.25, medians[0]), (0.75, medians[1])] {
            let found = both.damage_quantile(50.0, share);
            assert!((found - expected).abs() < 2e-4, "{found} {expected}");
        }
    }

    #[test]
    fn a_time_below_a_millionth_of_the_longest_is_now() {
        let after = |least: f64| quantile(move |hours| f64::from(u8::from(hours >= least)), 0.5, 1e4);
        assert_eq!(after(5e-3), Some(0.0));
        let found = after(0.1).unwrap_or(0.0);
        assert!((found / 0.1 - 1.0).abs() < 1e-3, "{found}");
    }
}
