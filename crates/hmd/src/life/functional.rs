//! The functional end of life: when the faults foretold keep the actuator from meeting its specification.

use ema_models::FaultVector;

use crate::function::{Shortfall, Trial};
use crate::health::{FAULTS, INDEX};
use crate::rul::{Forecast, Prognosis, Quantiles, normal_cdf};

/// Halvings of the time to the end of life by damage: the functional one is found to 1/256 of it.
const HALVINGS: u32 = 8;

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
    shortfall: &Trial<'_>,
) -> Governs {
    let at = |hours: f64, share: f64| shortfall(&foretold(prognosis, seen, hours, share));
    let Ok(by_damage) = forecast.actuator else {
        // Without a trend only the present counts.
        return match at(0.0, 0.5) {
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
    let (hours, mut governs) = (by_damage.hours, Governs::Damage);
    let mut earlier = |damage_share: f64, end: f64| {
        let Some(mut missed) = at(end, damage_share) else {
            return end;
        };
        let (mut low, mut high) = (0.0, end);
        if let Some(now) = at(0.0, damage_share) {
            (high, missed) = (0.0, now);
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            match at(middle, damage_share) {
                Some(then) => (high, missed) = (middle, then),
                None => low = middle,
            }
        }
        if damage_share.total_cmp(&0.5).is_eq() {
            governs = Governs::Function(missed);
        }
        high
    };
    let p50 = earlier(0.5, hours.p50);
    let p10 = earlier(0.9, hours.p10).min(p50);
    let p90 = earlier(0.1, hours.p90).max(p50);
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
