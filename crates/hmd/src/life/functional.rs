//! The functional end of life: when the faults foretold keep the actuator from meeting its specification.

use ema_models::FaultVector;

use crate::function::{Shortfall, TRIED, Trial};
use crate::health::{FAULTS, INDEX};
use crate::rul::{Forecast, Prognosis, Quantiles, normal_cdf};

/// Times at which each quantile is tried at once.
const TIMES: usize = 10;

/// The first search: from now to the end of life by damage, both included; the second: between two of its times.
/// Together they find the functional end to 1/99 of the life by damage.
const ROUNDS: [Round; 2] = [Round { offset: 0, parts: 9 }, Round { offset: 1, parts: 11 }];

/// Which times between two others are tried.
#[derive(Clone, Copy)]
struct Round {
    /// Parts before the first.
    offset: usize,
    /// Equal parts.
    parts: usize,
}

/// Where the functional end of one quantile is sought.
#[derive(Clone, Copy)]
struct Search {
    /// Quantile of every damage.
    share: f64,
    /// Hours at which the actuator does its work.
    from: f64,
    /// Hours at which it misses `missed`, or the end of life by damage.
    to: f64,
    missed: Option<Shortfall>,
}

impl Search {
    fn new(share: f64, end: f64) -> Self {
        Self {
            share,
            from: 0.0,
            to: end,
            missed: None,
        }
    }

    fn time(&self, round: Round, n: usize) -> f64 {
        self.from + (self.to - self.from) * (n + round.offset) as f64 / round.parts as f64
    }

    /// What the trial says of the times of a round, the earliest first.
    fn narrow(&mut self, round: Round, tried: &[Option<Shortfall>]) {
        let first = tried.iter().position(Option::is_some);
        let last_good = first.unwrap_or(tried.len()).checked_sub(1);
        let from = last_good.map_or(self.from, |n| self.time(round, n));
        if let Some(n) = first {
            (self.to, self.missed) = (self.time(round, n), tried[n]);
        }
        // Missed at once, the end is now.
        self.from = from.min(self.to);
    }
}

/// Normal deviate of the 90 % quantile.
const NORMAL_90: f64 = 1.281_552;

/// What ends the life of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Governs {
    /// The damage of one fault.
    Damage,
    /// A requirement that all faults together make it miss.
    Function(Shortfall),
}

impl Governs {
    /// The name that records use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Damage => "damage",
            Self::Function(shortfall) => shortfall.name(),
        }
    }
}

/// Brings the life of the actuator forward to where the function ends, if that is earlier.
///
/// All faults are taken at the same quantile of their damage: where all are worse than foretold, the life is short.
/// `seen` is the newest fault vector, whose direction of eccentricity and sign of the gain hold on.
pub(super) fn bring_forward(
    forecast: &mut Forecast,
    prognosis: &Prognosis,
    seen: &FaultVector,
    shortfalls: &Trial<'_>,
) -> Governs {
    let at = |hours: f64, share: f64| foretold(prognosis, seen, hours, share);
    let Ok(by_damage) = forecast.actuator else {
        // Without a trend only the present counts.
        return match shortfalls(&[at(0.0, 0.5); TRIED])[0] {
            Some(missed) => {
                forecast.actuator = Ok(prognosis.life_of(
                    Quantiles {
                        p10: 0.0,
                        p50: 0.0,
                        p90: 0.0,
                    },
                    1.0,
                ));
                Governs::Function(missed)
            }
            None => Governs::Damage,
        };
    };
    let hours = by_damage.hours;
    let mut searches = [
        Search::new(0.5, hours.p50),
        Search::new(0.9, hours.p10),
        Search::new(0.1, hours.p90),
    ];
    for round in ROUNDS {
        // The two that are left over try the first again.
        let mut faults = [at(searches[0].time(round, 0), searches[0].share); TRIED];
        for (m, search) in searches.iter().enumerate() {
            for n in 0..TIMES {
                faults[m * TIMES + n] = at(search.time(round, n), search.share);
            }
        }
        let tried = shortfalls(&faults);
        for (m, search) in searches.iter_mut().enumerate() {
            search.narrow(round, &tried[m * TIMES..(m + 1) * TIMES]);
        }
        if searches.iter().all(|search| search.missed.is_none()) {
            break;
        }
    }
    let [half, pessimist, optimist] = searches;
    let governs = half.missed.map_or(Governs::Damage, Governs::Function);
    let p50 = half.to;
    let p10 = pessimist.to.min(p50);
    let p90 = optimist.to.max(p50);
    if governs != Governs::Damage {
        let hours = Quantiles { p10, p50, p90 };
        let within = by_damage
            .fails_within_horizon
            .max(probability_within(&hours, forecast.horizon_h));
        forecast.actuator = Ok(prognosis.life_of(hours, within));
    }
    governs
}

/// The fault vector after some hours, each damage at one quantile.
fn foretold(prognosis: &Prognosis, seen: &FaultVector, hours: f64, share: f64) -> FaultVector {
    let mut k = seen.to_array();
    for fault in 0..FAULTS {
        let damage = prognosis.damage_after(fault, hours, share).clamp(0.0, 1.0);
        let p = INDEX[fault];
        k[p] = match (p, seen.gain < 0.5) {
            (7, true) => 0.5 - 0.5 * damage,
            (7, false) => 0.5 + 0.5 * damage,
            _ => damage,
        };
    }
    FaultVector::from_array(k)
}

/// Probability of an end within some hours, by straight lines between the quantiles as normal deviates.
fn probability_within(quantiles: &Quantiles, hours: f64) -> f64 {
    let Quantiles { p10, p50, p90 } = *quantiles;
    let width = if hours < p50 { p50 - p10 } else { p90 - p50 };
    if width > 0.0 {
        normal_cdf(NORMAL_90 * (hours - p50) / width)
    } else {
        f64::from(u8::from(hours >= p50))
    }
}
