//! Health of a unit's sensors over time: how far offsets, gains, latency, resolver errors and link voltage have drifted.
//!
//! In, window by window: what a window shows of the sensors ([`SensorReadings`]) and the operating hours. Out: value, drift, trend and
//! level of each quantity ([`SensorState`]). The first windows that show a quantity are its reference, their scatter is a part of
//! every later sigma: model errors are the same before and after. A drifting sensor raises no part; a worn part has columns of its
//! own where it could pass for a sensor ([`sensor_checks`](crate::sensor_checks)).
//!
//! No clock, no files. Bounded: a reference and [`TREND_MAX`] readings for each quantity.

mod quantity;
mod reference;
mod trend;

use serde::{Deserialize, Serialize};

use ema_models::{ActuatorParams, Tolerances};

use crate::health::{HealthState, LevelMemory, Levels, SIGNIFICANCE};
use crate::sensor_checks::SensorReadings;
pub use quantity::{SENSOR_QUANTITY_COUNT, SensorQuantity};
use reference::Reference;
pub use trend::TREND_MAX;
use trend::Trend;

/// Levels of a drift, in tolerances of the quantity.
const LEVELS: Levels = Levels {
    watch: 1.0,
    warning: 2.0,
    critical: 4.0,
    end_of_life: f64::INFINITY,
    hysteresis: 0.25,
    persistence: 3,
};

/// What is known of one quantity after a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorState {
    /// The quantity.
    pub quantity: SensorQuantity,
    /// In the window, with its standard deviation; `None` where the window does not show it.
    pub value: Option<(f64, f64)>,
    /// Difference from the reference, with its standard deviation; `None` while there is no reference, or no value.
    pub drift: Option<(f64, f64)>,
    /// Growth of the drift per operating hour, with its standard deviation, over the last readings.
    pub trend_per_h: Option<(f64, f64)>,
    /// Level of the drift; unknown while there is no reference.
    pub level: HealthState,
}

/// Health of the sensors of one unit.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorHealth {
    tracked: [Tracked; SENSOR_QUANTITY_COUNT],
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Tracked {
    reference: Reference,
    level: LevelMemory,
    trend: Trend,
}

impl SensorHealth {
    /// Whether the state is possible; a damaged file may hold any numbers.
    #[must_use]
    pub fn is_possible(&self) -> bool {
        self.tracked.iter().all(|tracked| {
            tracked.reference.is_possible() && tracked.level.is_possible() && tracked.trend.is_possible()
        })
    }

    /// Forgets these quantities: the next windows are their reference.
    pub fn forget(&mut self, quantities: &[SensorQuantity]) {
        for &quantity in quantities {
            self.tracked[quantity as usize] = Tracked::default();
        }
    }

    /// Worst level of all quantities after the last window.
    #[must_use]
    pub fn level(&self) -> HealthState {
        self.tracked.iter().map(Tracked::level).max().unwrap_or_default()
    }

    /// Takes what a window shows at so many operating hours; `None` of a window that is no evidence.
    pub fn update(
        &mut self,
        hours: f64,
        readings: Option<&SensorReadings>,
        params: &ActuatorParams,
        tolerances: &Tolerances,
    ) -> [SensorState; SENSOR_QUANTITY_COUNT] {
        SensorQuantity::ALL.map(|quantity| {
            let value = readings.and_then(|readings| quantity.of(readings));
            let tolerance = quantity.tolerance(params, tolerances);
            self.tracked[quantity as usize].update(quantity, hours, value, tolerance)
        })
    }
}

impl Tracked {
    fn update(
        &mut self,
        quantity: SensorQuantity,
        hours: f64,
        value: Option<(f64, f64)>,
        tolerance: f64,
    ) -> SensorState {
        let value = value.filter(|(value, sigma)| value.is_finite() && sigma.is_finite() && *sigma >= 0.0);
        let drift = value.and_then(|(value, sigma)| self.reference.take(value, sigma));
        if let Some((drift, sigma)) = drift {
            self.trend.push(hours, drift, sigma);
            self.level
                .update(drift.abs() / tolerance, sigma / tolerance, SIGNIFICANCE, &LEVELS);
        }
        SensorState {
            quantity,
            value,
            drift,
            trend_per_h: self.trend.slope(),
            level: self.level(),
        }
    }

    /// Level of the drift; unknown while there is no reference.
    fn level(&self) -> HealthState {
        if self.reference.is_complete() {
            self.level.state()
        } else {
            HealthState::Unknown
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A deterministic error of unit variance that repeats itself only after a long time.
    fn error(n: usize) -> f64 {
        12_f64.sqrt() * ((n as f64 * 0.618_034).fract() - 0.5)
    }

    /// Levels of the sum of the currents over windows of an hour, by its offset, A, with 3 mA of noise; and the last state.
    fn levels(windows: usize, offset_a: impl Fn(usize) -> f64) -> (Vec<HealthState>, SensorState) {
        let params = ActuatorParams::bench();
        let mut health = SensorHealth::default();
        let mut last = None;
        let levels = (0..windows).map(|n| {
            let readings = SensorReadings {
                current_sum: Some((offset_a(n) + 3e-3 * error(n), 3e-3)),
                ..SensorReadings::default()
            };
            let states = health.update(n as f64, Some(&readings), &params, &Tolerances::USUAL);
            assert!(states[1..].iter().all(|state| state.level == HealthState::Unknown));
            last = Some(states[0]);
            assert!(health.is_possible());
            states[0].level
        });
        (levels.collect(), last.unwrap())
    }

    #[test]
    fn a_steady_offset_is_nominal_however_large() {
        let (found, last) = levels(100, |_| 0.5);
        assert!(
            found[..9].iter().all(|level| *level == HealthState::Unknown),
            "{found:?}"
        );
        assert!(
            found[9..].iter().all(|level| *level == HealthState::Nominal),
            "{found:?}"
        );
        let (slope, sigma) = last.trend_per_h.unwrap();
        assert!(slope.abs() < 3.0 * sigma, "{slope} ± {sigma}");
    }

    #[test]
    fn a_new_sensor_has_a_reference_of_its_own() {
        let params = ActuatorParams::bench();
        let mut health = SensorHealth::default();
        let level = |health: &mut SensorHealth, n: usize, offset_a: f64| {
            let readings = SensorReadings {
                current_sum: Some((offset_a + 3e-3 * error(n), 3e-3)),
                ..SensorReadings::default()
            };
            health.update(n as f64, Some(&readings), &params, &Tolerances::USUAL)[0].level
        };
        let before = (0..20).map(|n| level(&mut health, n, 0.0)).last();
        health.forget(&[SensorQuantity::CurrentSum]);
        let after: Vec<HealthState> = (20..50).map(|n| level(&mut health, n, 0.3)).collect();
        assert_eq!((before, after[0]), (Some(HealthState::Nominal), HealthState::Unknown));
        assert!(after.iter().all(|level| *level <= HealthState::Nominal), "{after:?}");
    }

    #[test]
    fn a_growing_offset_reaches_one_level_after_the_other() {
        // 2 mA in each window after the twentieth.
        let drift = |n: usize| 2e-3 * n.saturating_sub(20) as f64;
        let (found, last) = levels(100, drift);
        assert!(found.is_sorted(), "{found:?}");
        let first = |level| found.iter().position(|found| *found == level).unwrap();
        assert!((34..42).contains(&first(HealthState::Watch)), "{found:?}");
        assert!((49..58).contains(&first(HealthState::Warning)), "{found:?}");
        assert!((79..88).contains(&first(HealthState::Critical)), "{found:?}");
        let (slope, sigma) = last.trend_per_h.unwrap();
        assert!((slope - 2e-3).abs() < 3.0 * sigma && sigma < 5e-4, "{slope} ± {sigma}");
    }

    #[test]
    fn what_is_no_number_counts_as_not_shown() {
        let mut health = SensorHealth::default();
        for value in [f64::NAN, f64::INFINITY] {
            let readings = SensorReadings {
                dc_link: Some((value, 0.1)),
                current_sum: Some((0.0, value)),
                ..SensorReadings::default()
            };
            for n in 0..20 {
                let states = health.update(
                    f64::from(n),
                    Some(&readings),
                    &ActuatorParams::bench(),
                    &Tolerances::NONE,
                );
                assert!(
                    states
                        .iter()
                        .all(|state| state.value.is_none() && state.drift.is_none())
                );
            }
        }
        assert!(health.is_possible());
    }
}
