//! Prognosis of one actuator: the trend of each fault, and the earliest end of them all.

use serde::{Deserialize, Serialize};

use super::forecast::{Remaining, quantile};
use super::trend::{JUMP_AFTER, Trend};
use super::usage::{Odometer, Usage};
use ema_models::FaultId;

/// Estimates that a trend needs.
const ESTIMATES_MIN: u64 = 6;

/// Probability of growth that a trend needs.
const GROWTH_MIN: f64 = 0.999;

/// Growth of damage that a trend needs: less cannot be distinguished from the monitor's own error.
const GROWN_MIN: f64 = 0.01;

/// A life is predicted up to this multiple of the hours over which its trend was observed.
const EXTRAPOLATION_MAX: f64 = 20.0;

/// Quantiles of what is left, in one unit. A quantile beyond the reach of the trend is given as the reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// 10 %.
    pub p10: f64,
    /// Median.
    pub p50: f64,
    /// 90 %.
    pub p90: f64,
}

impl Quantiles {
    /// The same times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            p10: self.p10 * factor,
            p50: self.p50 * factor,
            p90: self.p90 * factor,
        }
    }
}

/// Remaining useful life of a fault or of an actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemainingLife {
    /// Operating hours left.
    pub hours: Quantiles,
    /// Cycles left, if use continues at its recent rate; `None` without cycles.
    pub cycles: Option<Quantiles>,
    /// Probability of the end within the horizon.
    pub fails_within_horizon: f64,
}

/// No hours left, for certain.
const NOTHING_LEFT: Quantiles = Quantiles {
    p10: 0.0,
    p50: 0.0,
    p90: 0.0,
};

/// Why there is no remaining useful life.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoTrend {
    /// Too few estimates since the trend began.
    #[error("no trend yet: {got} of {ESTIMATES_MIN} estimates")]
    TooFew {
        /// Their number.
        got: u64,
    },
    /// The estimates left their trend for good; a new one has begun.
    #[error("damage jumped, a new trend begins: {got} of {ESTIMATES_MIN} estimates")]
    Jumped {
        /// Estimates since.
        got: u64,
    },
    /// Two or more of the newest estimates lie above what the trend explains: of a jump it tells nothing.
    #[error("damage above its trend: with {JUMP_AFTER} estimates in a row a new one begins, {got} so far")]
    AboveTrend {
        /// Their number.
        got: u32,
    },
    /// Growth is not sure, or too small to matter.
    #[error("no fault grows")]
    NoGrowth,
    /// The median is beyond the reach of the trends.
    #[error("the end of life is more than {EXTRAPOLATION_MAX} times the observed {observed_h:.3} h away")]
    TooFar {
        /// Hours over which the trend was watched.
        observed_h: f64,
    },
}

/// Forecast after a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Of each fault, in the order of [`FaultId::ALL`].
    pub faults: [Result<RemainingLife, NoTrend>; FaultId::COUNT],
    /// Of the actuator: the earliest of its faults, taken as independent.
    pub actuator: Result<RemainingLife, NoTrend>,
    /// The fault with the shortest median life, or where none is within reach the likeliest to end it there; `None` where the actuator has
    /// no remaining life.
    pub dominant: Option<FaultId>,
    /// Hours of [`RemainingLife::fails_within_horizon`].
    pub horizon_h: f64,
}

/// Trends of all faults of one actuator. Bounded: at most some 150 laws for each fault and 64 readings of the odometer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prognosis {
    trends: [Trend; FaultId::COUNT],
    usage: Usage,
}

impl Prognosis {
    /// For a new part, with the damage at which each fault ends its life.
    #[must_use]
    pub fn new(end_of_life: [f64; FaultId::COUNT]) -> Self {
        Self {
            trends: end_of_life.map(Trend::new),
            usage: Usage::default(),
        }
    }

    /// Whether the state is possible; a damaged file may hold any numbers.
    pub fn is_possible(&self) -> bool {
        self.usage.is_possible() && self.trends.iter().all(Trend::is_possible)
    }

    /// Damage at the end of life of each fault.
    #[must_use]
    pub fn end_of_life(&self) -> [f64; FaultId::COUNT] {
        std::array::from_fn(|fault| self.trends[fault].end_of_life)
    }

    /// The same trends to other ends.
    #[must_use]
    pub fn with_end_of_life(mut self, end_of_life: [f64; FaultId::COUNT]) -> Self {
        for (trend, damage) in self.trends.iter_mut().zip(end_of_life) {
            trend.end_of_life = damage;
        }
        self
    }

    /// Forgets the trend of one fault, as after the replacement of a part.
    pub(crate) fn forget(&mut self, fault: FaultId) {
        let trend = &mut self.trends[fault.index()];
        *trend = Trend::new(trend.end_of_life);
    }

    /// Use so far.
    #[must_use]
    pub fn now(&self) -> Odometer {
        self.usage.now()
    }

    /// Takes a window: use so far, and the damage with its standard deviation of every fault that is observable in it. A window
    /// that was not assessed has none.
    pub fn update(&mut self, at: Odometer, estimates: &[Option<(f64, f64)>; FaultId::COUNT]) {
        self.usage.update(at);
        for (trend, estimate) in self.trends.iter_mut().zip(estimates) {
            if let Some((damage, sigma)) = *estimate {
                trend.update(at, damage, sigma);
            }
        }
    }

    /// Remaining useful life of each fault and of the actuator, with the probability of its end within `horizon_h` hours.
    #[must_use]
    pub fn forecast(&self, horizon_h: f64) -> Forecast {
        let remaining = FaultId::ALL.map(|fault| self.remaining(fault));
        let nothing = self.remaining_life_of(NOTHING_LEFT, 1.0);
        let faults = FaultId::ALL.map(|fault| match &remaining[fault.index()] {
            // Whatever the trend: a jump may have ended it.
            _ if self.trends[fault.index()].is_at_its_end() => Ok(nothing),
            Ok(remaining) => {
                self.remaining_life(|h| remaining.probability_within(h), remaining.observed_h(), horizon_h)
            }
            Err(none) => Err(*none),
        });
        // Also those whose median is out of reach: their early quantiles may not be.
        let growing: Vec<(FaultId, &Remaining<'_>)> = FaultId::ALL
            .into_iter()
            .filter_map(|fault| Some((fault, remaining[fault.index()].as_ref().ok()?)))
            .collect();
        let survives = |hours: f64| {
            growing
                .iter()
                .map(|(_, r)| 1.0 - r.probability_within(hours))
                .product::<f64>()
        };
        let observed_h = growing.iter().map(|(_, r)| r.observed_h()).fold(0.0, f64::max);
        let actuator = match growing.as_slice() {
            _ if self.trends.iter().any(Trend::is_at_its_end) => Ok(nothing),
            [] => Err(least_lacking(&faults)),
            [(fault, _)] => faults[fault.index()],
            _ => self.remaining_life(|h| 1.0 - survives(h), observed_h, horizon_h),
        };
        let median = |fault: FaultId| faults[fault.index()].map_or(f64::INFINITY, |life| life.hours.p50);
        let shortest = FaultId::ALL
            .into_iter()
            .filter(|fault| faults[fault.index()].is_ok())
            .min_by(|a, b| median(*a).total_cmp(&median(*b)));
        // Together they may end the life within reach where none does alone.
        let likeliest = || {
            let within_reach = |of: &Remaining<'_>| of.probability_within(EXTRAPOLATION_MAX * observed_h);
            let (fault, _) = growing
                .iter()
                .max_by(|(_, a), (_, b)| within_reach(a).total_cmp(&within_reach(b)))?;
            Some(*fault)
        };
        let dominant = shortest.or_else(|| actuator.is_ok().then(likeliest).flatten());
        Forecast {
            faults,
            actuator,
            dominant,
            horizon_h,
        }
    }

    /// Distribution of the hours left to one fault.
    ///
    /// # Errors
    /// Why there is none.
    pub fn remaining(&self, fault: FaultId) -> Result<Remaining<'_>, NoTrend> {
        let trend = &self.trends[fault.index()];
        let got = trend.estimates;
        if got < ESTIMATES_MIN {
            return Err(if trend.jumps > 0 {
                NoTrend::Jumped { got }
            } else {
                NoTrend::TooFew { got }
            });
        }
        if let Some(got) = trend.above() {
            return Err(NoTrend::AboveTrend { got });
        }
        let rate = self.usage.rate().ok_or(NoTrend::TooFew { got })?;
        let passed = self.usage.now().hours - trend.last.hours;
        let remaining = Remaining::new(trend, rate, passed);
        if remaining.probability_of_growth() < GROWTH_MIN || remaining.damage() - trend.first.damage < GROWN_MIN {
            return Err(NoTrend::NoGrowth);
        }
        Ok(remaining)
    }

    /// Damage of a fault at its last estimate; a single estimate is none.
    pub(crate) fn damage(&self, fault: FaultId) -> f64 {
        self.trends[fault.index()].damage()
    }

    /// Damage of a fault after some hours from now that is not exceeded with probability `share`; `None` without a trend.
    #[must_use]
    pub fn damage_after(&self, fault: FaultId, hours: f64, share: f64) -> Option<f64> {
        let remaining = self.remaining(fault).ok()?;
        Some(remaining.damage_quantile(hours, share))
    }

    /// A remaining life of these hours, with the cycles that belong to them.
    pub fn remaining_life_of(&self, hours: Quantiles, fails_within_horizon: f64) -> RemainingLife {
        let per_hour = self
            .usage
            .rate()
            .map(|rate| rate.cycles_per_hour)
            .filter(|rate| *rate > 0.0);
        RemainingLife {
            hours,
            cycles: per_hour.map(|rate| hours.scaled(rate)),
            fails_within_horizon,
        }
    }

    fn remaining_life(
        &self,
        within: impl Fn(f64) -> f64,
        observed_h: f64,
        horizon_h: f64,
    ) -> Result<RemainingLife, NoTrend> {
        let hours_max = EXTRAPOLATION_MAX * observed_h;
        let p50 = quantile(&within, 0.5, hours_max).ok_or(NoTrend::TooFar { observed_h })?;
        let or_reach = |share| quantile(&within, share, hours_max).unwrap_or(hours_max);
        let hours = Quantiles {
            p10: or_reach(0.1),
            p50,
            p90: or_reach(0.9),
        };
        // Beyond what is predicted there is no probability either.
        Ok(self.remaining_life_of(hours, within(horizon_h.min(hours_max))))
    }
}

/// The reason that is nearest to a number: that a fault does not grow is none while another, as that of a new part, has its first estimates.
fn least_lacking(faults: &[Result<RemainingLife, NoTrend>; FaultId::COUNT]) -> NoTrend {
    let nearness = |none: &NoTrend| match none {
        NoTrend::TooFew { got: 0 } => (0, 0),
        NoTrend::NoGrowth => (1, 0),
        NoTrend::TooFew { got } => (2, *got),
        NoTrend::Jumped { got } => (3, *got),
        NoTrend::AboveTrend { got } => (4, u64::from(*got)),
        NoTrend::TooFar { .. } => (5, 0),
    };
    let lacking = faults.iter().filter_map(|life| life.err());
    lacking.max_by_key(nearness).unwrap_or(NoTrend::NoGrowth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_is_that_of_the_fault_whose_number_is_nearest() {
        let reason = |worst: NoTrend, others: NoTrend| {
            let mut faults = [Err(others); FaultId::COUNT];
            faults[1] = Err(worst);
            least_lacking(&faults)
        };
        let (few, none, still) = (
            NoTrend::TooFew { got: 4 },
            NoTrend::TooFew { got: 0 },
            NoTrend::NoGrowth,
        );
        assert_eq!(reason(few, still), few);
        assert_eq!(reason(none, still), still);
        let jumped = NoTrend::Jumped { got: 4 };
        assert_eq!(reason(jumped, NoTrend::TooFew { got: 5 }), jumped);
    }

    fn grown(from: f64, step: f64, estimates: u32) -> Prognosis {
        let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
        for n in 0..estimates {
            let hours = f64::from(n);
            let at = Odometer {
                hours,
                cycles: 10.0 * hours,
                work_j: 500.0 * hours,
            };
            let damage = from + step * hours;
            prognosis.update(at, &std::array::from_fn(|fault| (fault == 0).then_some((damage, 1e-3))));
        }
        prognosis
    }

    #[test]
    fn a_trend_has_six_estimates_and_a_growth_that_is_sure_and_no_error() {
        let of = |prognosis: &Prognosis| prognosis.remaining(FaultId::ALL[0]).err();
        assert_eq!(of(&grown(0.1, 0.05, 5)), Some(NoTrend::TooFew { got: 5 }));
        let prognosis = grown(0.1, 0.05, 6);
        assert_eq!(of(&prognosis), None);
        // 0.35 at the end.
        let after = prognosis.damage_after(FaultId::ALL[0], 4.0, 0.5).unwrap_or(0.0);
        assert!((after - 0.55).abs() < 0.02, "{after}");
        // Sure, and less than what an error may be.
        assert_eq!(of(&grown(0.1, 2e-4, 40)), Some(NoTrend::NoGrowth));
        assert_eq!(of(&grown(0.1, 4e-4, 40)), None);
    }

    #[test]
    fn ends_and_quantiles_are_what_was_set() {
        let ends = std::array::from_fn(|fault| 0.1 * fault as f64 + 0.2);
        assert_eq!(
            Prognosis::new(ends).end_of_life().map(f64::to_bits),
            ends.map(f64::to_bits)
        );
        let other = grown(0.1, 0.05, 6).with_end_of_life(ends);
        assert_eq!(other.end_of_life().map(f64::to_bits), ends.map(f64::to_bits));
        let [p10, p50, p90] = [1.0, 2.0, 4.0];
        let expected = Quantiles {
            p10: 10.0,
            p50: 20.0,
            p90: 40.0,
        };
        assert_eq!(Quantiles { p10, p50, p90 }.scaled(10.0), expected);
    }
}
