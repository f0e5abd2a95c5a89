//! The functional end of life: when the predicted faults keep the actuator from meeting its specification.
//!
//! Goes in: a forecast by damage, the trends behind it, and the requirements as a check of fault vectors. Comes out: the
//! forecast, brought forward if a requirement fails before the damage ends the life, and which criterion limits it.

use ema_models::{FAULT_COUNT, FaultId, FaultVector};
use serde::{Deserialize, Serialize};

use crate::functional_check::{CHECK_LANES, RequirementCheck, UnmetRequirement};
use crate::health::HealthState;
use crate::rul::{Forecast, Prognosis, Quantiles, RemainingLife, normal_cdf};

/// Times at which each quantile is checked together.
const TIMES: usize = 10;

/// The first search: from now to the end of life by damage, both included; the second: between two of its times.
/// Together they find the functional end to 1/99 of the life by damage.
const ROUNDS: [Round; 2] = [Round { offset: 0, parts: 9 }, Round { offset: 1, parts: 11 }];

/// Which times between two others are checked.
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
    /// Latest time known to meet all requirements, as a share of the hours to the end by damage.
    from: f64,
    /// Earliest time known to miss `missed`; 1 when none is missed.
    to: f64,
    missed: Option<UnmetRequirement>,
}

impl Search {
    fn new(share: f64) -> Self {
        Self {
            share,
            from: 0.0,
            to: 1.0,
            missed: None,
        }
    }

    fn time(&self, round: Round, n: usize) -> f64 {
        self.from + (self.to - self.from) * (n + round.offset) as f64 / round.parts as f64
    }

    /// Takes the results of the check at the times of a round, the earliest first.
    fn narrow(&mut self, round: Round, tried: &[Option<UnmetRequirement>]) {
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

/// The criterion that ends the life of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitingCriterion {
    /// The damage of one fault.
    Damage,
    /// A requirement that all faults together keep it from meeting.
    Function(UnmetRequirement),
}

impl LimitingCriterion {
    /// The name that records use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Damage => "damage",
            Self::Function(unmet_requirement) => unmet_requirement.name(),
        }
    }
}

/// Windows after which the requirements are checked again, however little has changed. A check costs more than all else here.
const TRIED_EVERY: u32 = 8;

/// Change of any fault parameter after which they are checked at once.
const MOVED: f64 = 0.02;

/// Result of the last functional check.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LastCheck {
    /// The damages then, with the direction of the eccentricity, as a fault vector.
    fault: [f64; FAULT_COUNT],
    /// Operating hours then.
    at_h: f64,
    /// Whether there was a trend.
    had_trend: bool,
    /// Windows since.
    windows: u32,
    /// Functional end at the 10, 50 and 90 % quantile, as shares of the hours to the end by damage.
    shares: [f64; 3],
    /// The requirement missed at the median.
    missed: Option<UnmetRequirement>,
}

impl LastCheck {
    fn is_due(&self, fault: &[f64; FAULT_COUNT], has_trend: bool) -> bool {
        let moved = largest_change(fault, &self.fault) > MOVED;
        self.windows >= TRIED_EVERY || self.had_trend != has_trend || moved
    }

    /// Hours to the functional end, of those to the end by damage: the same share of the time since the check.
    fn carried(&self, share: f64, by_damage_h: f64, now_h: f64) -> f64 {
        let since = now_h - self.at_h;
        (share * (since + by_damage_h) - since).clamp(0.0, by_damage_h)
    }
}

/// Largest change of a fault parameter. The eccentricity changes as the vector that it is: without one its direction means nothing.
fn largest_change(now: &[f64; FAULT_COUNT], then: &[f64; FAULT_COUNT]) -> f64 {
    let [now, then] = [now, then].map(|fault| {
        let of = FaultVector::from_array(*fault);
        let (sin, cos) = of.eccentricity_angle().sin_cos();
        let mut by_vector = *fault;
        [by_vector[5], by_vector[6]] = [of.eccentricity * cos, of.eccentricity * sin];
        by_vector
    });
    let changes = now.iter().zip(then).map(|(now, then)| (now - then).abs());
    changes.fold(0.0, f64::max)
}

/// The faults now and to come.
pub(super) struct Faults<'a> {
    /// Their trends.
    pub(super) prognosis: &'a Prognosis,
    /// State of each, in the order of [`FaultId::ALL`]: without a trend, those below `watch` have no damage.
    pub(super) states: [HealthState; FaultId::COUNT],
    /// The newest fault vector, whose direction of eccentricity and sign of the gain change are kept.
    pub(super) seen: FaultVector,
}

impl Faults<'_> {
    /// The fault vector now.
    fn now(&self) -> FaultVector {
        self.with_damages(|fault| self.damage_now(fault))
    }

    /// The fault vector after some hours, each damage at one quantile.
    fn after(&self, hours: f64, share: f64) -> FaultVector {
        self.with_damages(|fault| {
            let grown = self.prognosis.damage_after(fault, hours, share);
            grown.unwrap_or_else(|| self.damage_now(fault))
        })
    }

    /// Several damages too small to count would together miss what each one meets.
    fn damage_now(&self, fault: FaultId) -> f64 {
        if self.states[fault.index()] >= HealthState::Watch {
            self.prognosis.damage(fault)
        } else {
            0.0
        }
    }

    fn with_damages(&self, damage_of: impl Fn(FaultId) -> f64) -> FaultVector {
        let mut k = self.seen.to_array();
        for fault in FaultId::ALL {
            let damage = damage_of(fault).clamp(0.0, 1.0);
            k[fault.parameter()] = match (fault, self.seen.gain < 0.5) {
                (FaultId::Gain, true) => 0.5 - 0.5 * damage,
                (FaultId::Gain, false) => 0.5 + 0.5 * damage,
                _ => damage,
            };
        }
        FaultVector::from_array(k)
    }
}

/// Brings the end of the actuator's life forward to its functional end, if that is earlier.
///
/// All faults are taken at the same quantile of their damage: where all are worse than predicted, the life is short.
/// Between two checks the functional end moves with that by damage.
pub(super) fn bring_forward(
    forecast: &mut Forecast,
    faults: &Faults<'_>,
    unmet_requirements: &RequirementCheck<'_>,
    last: &mut Option<LastCheck>,
) -> LimitingCriterion {
    let (fault, now_h, by_damage) = (
        faults.now().to_array(),
        faults.prognosis.now().hours,
        forecast.actuator.ok(),
    );
    let tried = match last {
        Some(tried) if !tried.is_due(&fault, by_damage.is_some()) => tried,
        _ => {
            let (shares, missed) = match &by_damage {
                Some(remaining) => search(faults, remaining, unmet_requirements),
                // Without a trend only the present counts.
                None => {
                    let now = faults.after(0.0, 0.5);
                    ([0.0; 3], unmet_requirements(&[now; CHECK_LANES])[0])
                }
            };
            last.insert(LastCheck {
                fault,
                at_h: now_h,
                had_trend: by_damage.is_some(),
                windows: 0,
                shares,
                missed,
            })
        }
    };
    tried.windows += 1;
    // Where a requirement is missed at the 10 % quantile alone, the median is that by damage.
    let is_missed_early = tried.had_trend && tried.shares[0] < 1.0;
    if tried.missed.is_none() && !is_missed_early {
        return LimitingCriterion::Damage;
    }
    let nothing = Quantiles {
        p10: 0.0,
        p50: 0.0,
        p90: 0.0,
    };
    let by_damage_h = by_damage.map_or(nothing, |remaining| remaining.hours);
    let [p10, p50, p90] = tried.shares;
    let p50 = tried.carried(p50, by_damage_h.p50, now_h);
    let hours = Quantiles {
        p10: tried.carried(p10, by_damage_h.p10, now_h).min(p50),
        p50,
        p90: tried.carried(p90, by_damage_h.p90, now_h).max(p50),
    };
    let within = by_damage.map_or(1.0, |remaining| {
        let by_function = probability_within(&hours, forecast.horizon_h);
        remaining.fails_within_horizon.max(by_function)
    });
    forecast.actuator = Ok(faults.prognosis.remaining_life_of(hours, within));
    tried
        .missed
        .map_or(LimitingCriterion::Damage, LimitingCriterion::Function)
}

/// Functional end at the 10, 50 and 90 % quantile, as shares of the hours to the end by damage, and what is missed at the
/// median.
fn search(
    predicted: &Faults<'_>,
    by_damage: &RemainingLife,
    unmet_requirements: &RequirementCheck<'_>,
) -> ([f64; 3], Option<UnmetRequirement>) {
    let ends = [by_damage.hours.p10, by_damage.hours.p50, by_damage.hours.p90];
    let mut searches = [0.9, 0.5, 0.1].map(Search::new);
    for round in ROUNDS {
        let at = |m: usize, n: usize| {
            let search = &searches[m];
            predicted.after(ends[m] * search.time(round, n), search.share)
        };
        // The two that are left over try the first again.
        let mut faults = [at(0, 0); CHECK_LANES];
        for (place, fault) in faults.iter_mut().enumerate().take(searches.len() * TIMES) {
            *fault = at(place / TIMES, place % TIMES);
        }
        let tried = unmet_requirements(&faults);
        for (search, tried) in searches.iter_mut().zip(tried.chunks(TIMES)) {
            search.narrow(round, tried);
        }
        if searches.iter().all(|search| search.missed.is_none()) {
            break;
        }
    }
    (searches.map(|search| search.to), searches[1].missed)
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
