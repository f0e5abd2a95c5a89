//! Settings of the windowing, in SI units, and the same in samples.

use serde::{Deserialize, Serialize};

/// What an actuation window is, and how bad its data may be. `docs/windows.md` has the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WindowConfig {
    /// Time in the window before the trigger, s; at most `rest_s`, so that the window begins at rest.
    pub pre_trigger_s: f64,
    /// Length of the window from its first to its last sample, s.
    pub duration_s: f64,
    /// Rest that must precede a trigger, and the time over which the setpoint is compared, s.
    pub rest_s: f64,
    /// Position mode: change of the setpoint that is an actuation, rad at the output.
    pub trigger_position_rad: f64,
    /// Speed mode: the same, rad/s at the motor.
    pub trigger_speed_rad_s: f64,
    /// Largest fraction of a window's samples that may be missing or refused.
    pub missing_max_fraction: f64,
    /// Longest run of missing or refused samples, s.
    pub longest_gap_s: f64,
    /// Largest sum of the three currents, A: offsets, gain errors and noise of three converters together.
    pub current_sum_max_a: f64,
    /// Speeds above this many times ω_max are impossible.
    pub speed_max_factor: f64,
    /// Time for which a signal must stand still, bit for bit, to be stuck, s.
    pub stuck_s: f64,
    /// Movement of the stamps against the sample counter that is a jump of the clock, s.
    pub clock_jump_s: f64,
}

impl Default for WindowConfig {
    fn default() -> Self {
        Self {
            pre_trigger_s: 0.02,
            duration_s: 0.5,
            rest_s: 0.02,
            trigger_position_rad: 1e-3,
            trigger_speed_rad_s: 1.0,
            missing_max_fraction: 0.02,
            longest_gap_s: 5e-3,
            current_sum_max_a: 0.5,
            speed_max_factor: 3.0,
            stuck_s: 0.02,
            clock_jump_s: 0.05,
        }
    }
}

/// A setting that was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{field} = {got}: expected a number from {min} to {max}")]
pub struct WindowConfigError {
    /// Name of the setting.
    pub field: &'static str,
    /// The value found.
    pub got: f64,
    /// Smallest value allowed.
    pub min: f64,
    /// Largest value allowed.
    pub max: f64,
}

impl WindowConfig {
    /// Largest fraction of a window's samples that may be missing or refused while no more than three are in a row.
    #[must_use]
    pub fn scattered_max_fraction(&self) -> f64 {
        (SCATTERED_FACTOR * self.missing_max_fraction).min(1.0)
    }

    /// The same settings, if every one is possible at a sample rate, Hz.
    ///
    /// # Errors
    /// The first setting that is no number or out of its range. The window's length bounds the memory: at most 10 s.
    pub fn checked(self, sample_rate_hz: f64) -> Result<Self, WindowConfigError> {
        let period = 1.0 / sample_rate_hz;
        for (field, got, min, max) in [
            ("sample_rate_hz", sample_rate_hz, 50.0, 20_000.0),
            ("rest_s", self.rest_s, period, 1.0),
            ("pre_trigger_s", self.pre_trigger_s, period, self.rest_s),
            ("duration_s", self.duration_s, self.pre_trigger_s + 2.0 * period, 10.0),
            ("trigger_position_rad", self.trigger_position_rad, 1e-6, 10.0),
            ("trigger_speed_rad_s", self.trigger_speed_rad_s, 1e-3, 1e4),
            ("missing_max_fraction", self.missing_max_fraction, 0.0, 0.5),
            ("longest_gap_s", self.longest_gap_s, 0.0, self.duration_s),
            ("current_sum_max_a", self.current_sum_max_a, 1e-3, 1e4),
            ("speed_max_factor", self.speed_max_factor, 1.0, 100.0),
            ("stuck_s", self.stuck_s, period, self.duration_s),
            ("clock_jump_s", self.clock_jump_s, period, 3600.0),
        ] {
            // Not `contains` on reversed bounds alone: NaN bounds and values fail too.
            if !(min..=max).contains(&got) {
                return Err(WindowConfigError { field, got, min, max });
            }
        }
        Ok(self)
    }
}

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
    /// Of checked settings.
    pub(super) fn new(config: &WindowConfig, sample_rate_hz: f64) -> Self {
        let nearest = |time_s: f64| ((time_s * sample_rate_hz).round() as usize).max(1);
        // A count that is whole but for rounding is not rounded down.
        let whole = |count: f64| (count + 1e-6).floor() as usize;
        let window = nearest(config.duration_s) + 1;
        Self {
            pre_trigger: nearest(config.pre_trigger_s),
            window,
            rest: nearest(config.rest_s),
            missing_max: whole(config.missing_max_fraction * window as f64),
            scattered_max: whole(config.scattered_max_fraction() * window as f64),
            longest_gap: whole(config.longest_gap_s * sample_rate_hz),
            // Fewer than eight equal readings in a row happen by chance at low current and coarse converters.
            stuck: nearest(config.stuck_s).max(8),
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
        let cases: [(&str, Change); 6] = [
            ("rest_s", |c| c.rest_s = f64::NAN),
            ("pre_trigger_s", |c| c.pre_trigger_s = 0.03),
            ("duration_s", |c| c.duration_s = 0.02),
            ("duration_s", |c| c.duration_s = 3600.0),
            ("trigger_position_rad", |c| c.trigger_position_rad = -1e-3),
            ("missing_max_fraction", |c| c.missing_max_fraction = f64::INFINITY),
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
    fn settings_read_from_toml_by_name() {
        let config: WindowConfig = toml::from_str("duration_s = 1.0").unwrap();
        assert_eq!(
            config,
            WindowConfig {
                duration_s: 1.0,
                ..WindowConfig::default()
            }
        );
        assert!(toml::from_str::<WindowConfig>("length_s = 1.0").is_err());
    }
}
