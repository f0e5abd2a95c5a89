//! Health of a unit's sensors over time: how far offsets, gains, latency, resolver errors and link voltage have drifted.
//!
//! In, window by window: what a window shows of the sensors ([`SensorReadings`]) and the operating hours. Out: value, drift, trend and
//! level of each quantity ([`SensorState`]). The windows of commissioning are its reference; of a unit that is not commissioned, the first
//! windows that show it. Their scatter is a part of every later sigma: model errors are the same before and after. A drifting sensor raises no part; a worn part has columns of its
//! own where it could pass for a sensor ([`sensor_checks`](crate::sensor_checks)).
//!
//! No clock, no files. Bounded: a reference and [`TREND_MAX`] readings for each quantity.

mod quantity;
mod reference;
mod trend;

use serde::{Deserialize, Serialize};

use ema_models::{ActuatorParams, Tolerances};

use ema_identify::unit_calibration::CommissionedSensors;

use crate::health::{HealthState, LevelMemory, Levels, SIGNIFICANCE};
use crate::outbox::WindowJob;
use crate::sensor_checks::{Reading, SensorReadings, sensor_readings};
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
#[serde(default)]
struct Tracked {
    /// Time of the maintenance event that replaced what it is of, UTC ns; 0 without one.
    replaced_ns: u64,
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

    /// Forgets these quantities, of a part that was replaced then, UTC ns: a later commissioning or the next windows are their reference.
    pub fn forget(&mut self, quantities: &[SensorQuantity], replaced_ns: u64) {
        for &quantity in quantities {
            self.tracked[quantity as usize] = Tracked {
                replaced_ns,
                ..Tracked::default()
            };
        }
    }

    /// Forgets the growth of all drifts, where the hours are others than before.
    pub(crate) fn forget_trends(&mut self) {
        for tracked in &mut self.tracked {
            tracked.trend = Trend::default();
        }
    }

    /// Takes what commissioning has shown as the reference, once, but of what was replaced since.
    pub fn compare_with(&mut self, commissioned: &CommissionedSensors) {
        let until_ns = commissioned.until_ns;
        for quantity in SensorQuantity::ALL {
            let tracked = &mut self.tracked[quantity as usize];
            let is_known = tracked.reference.commissioned_ns() == Some(until_ns);
            let is_before = u64::try_from(until_ns).unwrap_or(0) < tracked.replaced_ns;
            if let Some(of) = commissioned.quantities.get(quantity.name())
                && !is_known
                && !is_before
            {
                *tracked = Tracked {
                    replaced_ns: tracked.replaced_ns,
                    reference: Reference::commissioned(of, until_ns),
                    ..Tracked::default()
                };
            }
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

/// Windows of commissioning that must show a quantity: as many as commission a unit.
const COMMISSIONED_MIN: u32 = 5;

/// What the windows of a commissioning show of the sensors. The link voltage is left out: it belongs to the supply, which differs between
/// hangar and flight.
#[must_use]
pub fn commissioned_sensors(jobs: &[WindowJob]) -> CommissionedSensors {
    let readings: Vec<SensorReadings> = jobs.iter().map(sensor_readings).collect();
    let of_unit = SensorQuantity::ALL
        .into_iter()
        .filter(|of| *of != SensorQuantity::DcLink);
    let quantities = of_unit.filter_map(|quantity| {
        let mut reference = Reference::default();
        let values = readings.iter().filter_map(|readings| quantity.of(readings));
        values
            .filter(|(value, sigma)| value.is_finite() && sigma.is_finite())
            .for_each(|(value, _)| reference.add(value));
        Some((quantity.name().to_owned(), reference.to_commissioned(COMMISSIONED_MIN)?))
    });
    let newest_ns = jobs.iter().map(|job| job.window.t_start_ns).max();
    CommissionedSensors {
        until_ns: newest_ns.and_then(|ns| i64::try_from(ns).ok()).unwrap_or(0),
        quantities: quantities.collect(),
    }
}

/// Offsets of the currents along α and β beyond those of commissioning, A, each with its standard deviation; `None` where either does not show
/// them.
pub(crate) fn offset_since(commissioned: &CommissionedSensors, readings: &SensorReadings) -> Option<[Reading; 2]> {
    let since = |quantity: SensorQuantity| {
        let then = commissioned.quantities.get(quantity.name())?;
        let (value, sigma) = quantity.of(readings)?;
        Reference::commissioned(then, commissioned.until_ns).take(value, sigma)
    };
    Some([since(SensorQuantity::OffsetAlpha)?, since(SensorQuantity::OffsetBeta)?])
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
    use ema_identify::unit_calibration::CommissionedQuantity;

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
        health.forget(&[SensorQuantity::CurrentSum], 0);
        let after: Vec<HealthState> = (20..50).map(|n| level(&mut health, n, 0.3)).collect();
        assert_eq!((before, after[0]), (Some(HealthState::Nominal), HealthState::Unknown));
        assert!(after.iter().all(|level| *level <= HealthState::Nominal), "{after:?}");
    }

    #[test]
    fn what_commissioning_has_shown_is_the_reference_unless_the_sensor_is_newer() {
        let params = ActuatorParams::bench();
        let commissioned = |until_ns: i64| CommissionedSensors {
            until_ns,
            quantities: [(
                SensorQuantity::CurrentSum.name().to_owned(),
                CommissionedQuantity {
                    windows: 6,
                    mean: 0.0,
                    scatter: 3e-3,
                },
            )]
            .into(),
        };
        let levels = |health: &mut SensorHealth, at: &CommissionedSensors| -> Vec<HealthState> {
            let level = |n: usize| {
                health.compare_with(at);
                let readings = SensorReadings {
                    current_sum: Some((0.1 + 3e-3 * error(n), 3e-3)),
                    ..SensorReadings::default()
                };
                health.update(n as f64, Some(&readings), &params, &Tolerances::USUAL)[0].level
            };
            (0..12).map(level).collect()
        };
        use HealthState::{Nominal, Unknown, Warning};
        let mut health = SensorHealth::default();
        let found = levels(&mut health, &commissioned(1000));
        assert_eq!(
            (found[0], found[2], found[11]),
            (Nominal, Warning, Warning),
            "{found:?}"
        );
        // A new controller has sensors of its own.
        health.forget(&[SensorQuantity::CurrentSum], 2000);
        let found = levels(&mut health, &commissioned(1000));
        assert_eq!((found[0], found[11]), (Unknown, Nominal), "{found:?}");
        // A later commissioning counts again.
        let found = levels(&mut health, &commissioned(3000));
        assert_eq!(found[11], Warning, "{found:?}");
        assert!(health.is_possible());
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
