//! Settings of the windowing, as section `[window]` of a configuration has them, and the same in samples.

use std::ops::RangeInclusive;

use serde::Serialize;

use crate::setting::{Expected, SettingError};

/// What an actuation window is, and how many samples it may lack. Section `[window]` of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WindowConfig {
    /// Part of the window before the trigger, ms; at most `rest_ms`, so that the window begins at rest.
    pub pre_trigger_ms: f64,
    /// Length of the window from its first to its last sample, ms; it bounds the memory.
    pub duration_ms: f64,
    /// Rest that must precede a trigger, and the time over which the setpoint is compared, ms.
    pub rest_ms: f64,
    /// Position mode: change of the setpoint that is an actuation, rad at the output shaft.
    pub trigger_position_rad: f64,
    /// Speed mode: the same, rad/s at the motor shaft.
    pub trigger_speed_rad_s: f64,
    /// Largest fraction of a window's samples that may be missing or refused; above, the window is invalid.
    pub max_gap_fraction: f64,
    /// Longest run of missing or refused samples, ms; above, the window is invalid.
    pub longest_gap_ms: f64,
}

impl Default for WindowConfig {
    fn default() -> Self {
        Self {
            pre_trigger_ms: 20.0,
            duration_ms: 500.0,
            rest_ms: 20.0,
            trigger_position_rad: 1e-3,
            trigger_speed_rad_s: 1.0,
            max_gap_fraction: 0.02,
            // Half of what the fraction allows of a default window, in one piece.
            longest_gap_ms: 5.0,
        }
    }
}

impl WindowConfig {
    /// Names of the settings, each with the values that it may have at any sample rate.
    pub(crate) const RANGES: [(&str, RangeInclusive<f64>); 7] = [
        ("pre_trigger_ms", 0.05..=1_000.0),
        ("duration_ms", 20.0..=10_000.0),
        ("rest_ms", 1.0..=1_000.0),
        ("trigger_position_rad", 1e-6..=10.0),
        ("trigger_speed_rad_s", 1e-3..=1e4),
        ("max_gap_fraction", 0.0..=0.5),
        ("longest_gap_ms", 0.0..=1_000.0),
    ];

    /// The settings in the order of [`WindowConfig::RANGES`].
    pub(crate) fn to_array(self) -> [f64; 7] {
        [
            self.pre_trigger_ms,
            self.duration_ms,
            self.rest_ms,
            self.trigger_position_rad,
            self.trigger_speed_rad_s,
            self.max_gap_fraction,
            self.longest_gap_ms,
        ]
    }

    /// From the settings in the order of [`WindowConfig::RANGES`].
    pub(crate) fn from_array(settings: [f64; 7]) -> Self {
        let [
            pre_trigger_ms,
            duration_ms,
            rest_ms,
            trigger_position_rad,
            trigger_speed_rad_s,
            max_gap_fraction,
            longest_gap_ms,
        ] = settings;
        Self {
            pre_trigger_ms,
            duration_ms,
            rest_ms,
            trigger_position_rad,
            trigger_speed_rad_s,
            max_gap_fraction,
            longest_gap_ms,
        }
    }

    /// Largest fraction of a window's samples that may be missing or refused while no more than three are in a row.
    #[must_use]
    pub fn scattered_max_fraction(&self) -> f64 {
        (SCATTERED_FACTOR * self.max_gap_fraction).min(1.0)
    }

    /// The same settings, if every one is possible at a sample rate, Hz.
    ///
    /// # Errors
    /// The first setting that is no number or out of its range, or against another one.
    pub fn checked(self, sample_rate_hz: f64) -> Result<Self, SettingError> {
        SettingError::unless_within("sample_rate_hz", sample_rate_hz, 50.0..=20_000.0)?;
        for ((field, range), got) in Self::RANGES.into_iter().zip(self.to_array()) {
            SettingError::unless_within(field, got, range)?;
        }
        let (duration, rest) = (("duration_ms", self.duration_ms), ("rest_ms", self.rest_ms));
        if self.pre_trigger_ms >= self.duration_ms {
            return Err(SettingError {
                field: "pre_trigger_ms",
                got: self.pre_trigger_ms,
                expected: Expected::LessThan(duration),
            });
        }
        if self.pre_trigger_ms > self.rest_ms {
            return Err(SettingError {
                field: "pre_trigger_ms",
                got: self.pre_trigger_ms,
                expected: Expected::AtMost(rest),
            });
        }
        let period_ms = 1e3 / sample_rate_hz;
        for (field, got, min, max) in [
            ("rest_ms", self.rest_ms, period_ms, 1_000.0),
            ("pre_trigger_ms", self.pre_trigger_ms, period_ms, self.rest_ms),
            (
                "duration_ms",
                self.duration_ms,
                self.pre_trigger_ms + 2.0 * period_ms,
                10_000.0,
            ),
            ("longest_gap_ms", self.longest_gap_ms, 0.0, self.duration_ms),
        ] {
            if !(min..=max).contains(&got) {
                let expected = Expected::AtRate {
                    min,
                    max,
                    sample_rate_hz,
                };
                return Err(SettingError { field, got, expected });
            }
        }
        Ok(self)
    }
}

/// Largest sum of the three currents, A: offsets, gain errors and noise of three converters together.
pub(super) const CURRENT_SUM_MAX_A: f64 = 0.5;

/// Speeds above this many times ω_max are impossible.
pub(super) const SPEED_MAX_FACTOR: f64 = 3.0;

/// Time for which a signal must stand still, bit for bit, to be stuck, s.
const STUCK_S: f64 = 0.02;

/// Movement of the stamps against the sample counter that is a jump of the clock, s.
pub(super) const CLOCK_JUMP_S: f64 = 0.05;

/// Longest run of missing samples that are called scattered.
pub(super) const SCATTERED_RUN: usize = 3;

/// Scattered samples may be this many times as many: what lies between two good samples that are near is known well, and
/// they have no weight.
const SCATTERED_FACTOR: f64 = 5.0;

/// Times of the settings as whole sample periods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lengths {
    /// Samples before the trigger.
    pub(super) pre_trigger: usize,
    /// Samples of the window, both ends included.
    pub(super) window: usize,
    /// Samples of rest, and distance of the compared setpoints.
    pub(super) rest: usize,
    /// Samples that may lack in all.
    pub(super) missing_max: usize,
    /// Samples that may lack in all while no more than [`SCATTERED_RUN`] of them are in a row.
    pub(super) scattered_max: usize,
    /// Samples that may lack in one run.
    pub(super) longest_gap: usize,
    /// Samples after which a constant signal may be called stuck.
    pub(super) stuck: usize,
}

impl Lengths {
    /// Of checked settings: the one place where milliseconds become samples.
    pub(super) fn new(config: &WindowConfig, sample_rate_hz: f64) -> Self {
        let samples = |time_ms: f64| time_ms * 1e-3 * sample_rate_hz;
        let nearest = |time_ms: f64| (samples(time_ms).round() as usize).max(1);
        // A count that is whole but for rounding is not rounded down.
        let whole = |count: f64| (count + 1e-6).floor() as usize;
        let window = nearest(config.duration_ms) + 1;
        Self {
            pre_trigger: nearest(config.pre_trigger_ms),
            window,
            rest: nearest(config.rest_ms),
            missing_max: whole(config.max_gap_fraction * window as f64),
            scattered_max: whole(config.scattered_max_fraction() * window as f64),
            longest_gap: whole(samples(config.longest_gap_ms)),
            // Fewer than eight equal readings in a row happen by chance at low current and coarse converters.
            stuck: ((STUCK_S * sample_rate_hz).round() as usize).max(8),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_in_samples() {
        let lengths = |rate| Lengths::new(&WindowConfig::default().checked(rate).unwrap(), rate);
        let at_2k = Lengths {
            pre_trigger: 40,
            window: 1001,
            rest: 40,
            missing_max: 20,
            scattered_max: 100,
            longest_gap: 10,
            stuck: 40,
        };
        let at_400 = Lengths {
            pre_trigger: 8,
            window: 201,
            rest: 8,
            missing_max: 4,
            scattered_max: 20,
            longest_gap: 2,
            stuck: 8,
        };
        assert_eq!((lengths(2000.0), lengths(400.0)), (at_2k, at_400));
    }

    #[test]
    fn impossible_settings_are_refused_by_name() {
        type Change = fn(&mut WindowConfig);
        let cases: [(&str, Change); 8] = [
            ("rest_ms", |c| c.rest_ms = f64::NAN),
            ("pre_trigger_ms", |c| c.pre_trigger_ms = 30.0),
            ("pre_trigger_ms", |c| c.duration_ms = 20.0),
            ("duration_ms", |c| c.duration_ms = 20.5),
            ("duration_ms", |c| c.duration_ms = 3.6e6),
            ("trigger_position_rad", |c| c.trigger_position_rad = -1e-3),
            ("max_gap_fraction", |c| c.max_gap_fraction = f64::INFINITY),
            ("longest_gap_ms", |c| c.longest_gap_ms = 501.0),
        ];
        for (field, change) in cases {
            let mut config = WindowConfig::default();
            change(&mut config);
            assert_eq!(config.checked(2000.0).map_err(|e| e.field), Err(field));
        }
        assert_eq!(
            WindowConfig::default().checked(0.0).map_err(|e| e.field),
            Err("sample_rate_hz")
        );
    }

    #[test]
    fn settings_are_possible_up_to_their_limits_at_the_rate() {
        let checked = |change: &dyn Fn(&mut WindowConfig), rate: f64| {
            let mut config = WindowConfig::default();
            change(&mut config);
            config.checked(rate).map(|_| ()).map_err(|refused| refused.field)
        };
        // Rest and what is before the trigger: a period at least, and the latter no longer than the former.
        assert_eq!(checked(&|c| (c.rest_ms, c.pre_trigger_ms) = (2.5, 2.5), 400.0), Ok(()));
        assert_eq!(
            checked(&|c| (c.rest_ms, c.pre_trigger_ms) = (2.4, 2.4), 400.0),
            Err("rest_ms")
        );
        assert_eq!(checked(&|c| c.pre_trigger_ms = 2.4, 400.0), Err("pre_trigger_ms"));
        assert_eq!(
            checked(&|c| (c.rest_ms, c.pre_trigger_ms) = (1000.0, 20.0), 400.0),
            Ok(())
        );
        // Two periods behind the trigger at least.
        let short = |duration: f64| checked(&|c: &mut WindowConfig| c.duration_ms = duration, 400.0);
        assert_eq!((short(25.0), short(24.9)), (Ok(()), Err("duration_ms")));
        assert_eq!((short(10_000.0), short(10_001.0)), (Ok(()), Err("duration_ms")));
        // As long as the window or as the time before the trigger.
        assert_eq!(checked(&|c| c.longest_gap_ms = 500.0, 400.0), Ok(()));
        assert_eq!(
            checked(
                &|c| (c.duration_ms, c.rest_ms, c.pre_trigger_ms) = (50.0, 50.0, 50.0),
                400.0
            ),
            Err("pre_trigger_ms")
        );
    }

    #[test]
    fn a_setting_that_is_refused_for_another_or_for_the_rate_says_so() {
        let refused = |change: fn(&mut WindowConfig)| {
            let mut config = WindowConfig::default();
            change(&mut config);
            config.checked(400.0).map_err(|refused| refused.to_string())
        };
        let texts = [
            (
                refused(|c| c.duration_ms = 20.0),
                "pre_trigger_ms = 20: expected less than duration_ms",
            ),
            (
                refused(|c| c.pre_trigger_ms = 21.0),
                "pre_trigger_ms = 21: expected at most rest_ms",
            ),
            (
                refused(|c| c.duration_ms = 24.0),
                "duration_ms = 24: expected from 25 to 10000",
            ),
        ];
        for (found, expected) in texts {
            let found = found.err().unwrap_or_default();
            assert!(found.starts_with(expected), "{found}");
        }
    }

    #[test]
    fn settings_as_an_array_are_in_the_order_of_their_names() {
        let values = [1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5];
        let config = WindowConfig::from_array(values);
        assert_eq!(config.to_array().map(f64::to_bits), values.map(f64::to_bits));
        for ((name, _), value) in WindowConfig::RANGES.into_iter().zip(values) {
            let written = serde_json::to_value(config).unwrap();
            assert_eq!(
                written[name].as_f64().map(f64::to_bits),
                Some(value.to_bits()),
                "{name}"
            );
        }
    }

    #[test]
    fn scattered_samples_may_be_five_times_as_many_up_to_all() {
        for (fraction, expected) in [(0.0, 0.0), (0.02, 0.1), (0.2, 1.0), (0.5, 1.0)] {
            let config = WindowConfig {
                max_gap_fraction: fraction,
                ..WindowConfig::default()
            };
            assert!((config.scattered_max_fraction() - expected).abs() < 1e-12, "{fraction}");
        }
    }

    #[test]
    fn lengths_are_the_nearest_whole_periods_and_gaps_are_not_rounded_up() {
        let config = WindowConfig {
            pre_trigger_ms: 3.0,
            duration_ms: 500.9,
            rest_ms: 3.8,
            max_gap_fraction: 0.0149,
            longest_gap_ms: 7.4,
            ..WindowConfig::default()
        };
        let lengths = Lengths::new(&config, 400.0);
        let expected = Lengths {
            pre_trigger: 1,
            window: 201,
            rest: 2,
            missing_max: 2,
            scattered_max: 14,
            longest_gap: 2,
            stuck: 8,
        };
        assert_eq!(lengths, expected);
        // Never none before the trigger; and a tenth of a second of 2 kHz is exactly 200.
        let config = WindowConfig {
            pre_trigger_ms: 0.1,
            rest_ms: 1.0,
            longest_gap_ms: 100.0,
            ..WindowConfig::default()
        };
        let lengths = Lengths::new(&config, 2000.0);
        assert_eq!((lengths.pre_trigger, lengths.rest, lengths.longest_gap), (1, 2, 200));
    }
}
