//! Section `[window]`: what an actuation window is, and how many samples it may lack.

use serde::Serialize;

use super::ConfigError;
use super::reader::Section;
use crate::window;

/// What an actuation window is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WindowConfig {
    /// Part of the window before the trigger, ms.
    pub pre_trigger_ms: f64,
    /// Whole window, the part before the trigger included, ms.
    pub duration_ms: f64,
    /// Rest that a trigger needs, and how far back the setpoint is compared, ms.
    pub rest_ms: f64,
    /// Change of the position setpoint that triggers, rad at the output shaft.
    pub trigger_position_rad: f64,
    /// Change of the speed setpoint that triggers, rad/s at the motor shaft.
    pub trigger_speed_rad_s: f64,
    /// Largest share of samples that may be missing; above, the window is invalid.
    pub max_gap_fraction: f64,
    /// Longest run of missing samples, ms; above, the window is invalid.
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
            // All that the fraction allows of a default window, in one piece.
            longest_gap_ms: 5.0,
        }
    }
}

impl WindowConfig {
    pub(super) const KEYS: &[&str] = &[
        "pre_trigger_ms",
        "duration_ms",
        "rest_ms",
        "trigger_position_rad",
        "trigger_speed_rad_s",
        "max_gap_fraction",
        "longest_gap_ms",
    ];

    /// Reads the section; every setting must be possible at each of the sample rates, Hz.
    pub(super) fn read(
        section: &Section<'_>,
        sample_rates_hz: impl IntoIterator<Item = f64>,
    ) -> Result<Self, ConfigError> {
        let default = Self::default();
        let window = Self {
            pre_trigger_ms: section.number("pre_trigger_ms", default.pre_trigger_ms, 0.05..=1_000.0)?,
            duration_ms: section.number("duration_ms", default.duration_ms, 20.0..=10_000.0)?,
            rest_ms: section.number("rest_ms", default.rest_ms, 1.0..=1_000.0)?,
            trigger_position_rad: section.number("trigger_position_rad", default.trigger_position_rad, 1e-6..=10.0)?,
            trigger_speed_rad_s: section.number("trigger_speed_rad_s", default.trigger_speed_rad_s, 1e-3..=1e4)?,
            max_gap_fraction: section.number("max_gap_fraction", default.max_gap_fraction, 0.0..=0.5)?,
            longest_gap_ms: section.number("longest_gap_ms", default.longest_gap_ms, 0.0..=1_000.0)?,
        };
        if window.pre_trigger_ms >= window.duration_ms {
            let expected = format!("less than duration_ms = {}", window.duration_ms);
            let effective = format!("{} (not set here)", window.pre_trigger_ms);
            return Err(section.refuse_effective("pre_trigger_ms", &expected, &effective));
        }
        if window.pre_trigger_ms > window.rest_ms {
            let expected = format!("at most rest_ms = {}", window.rest_ms);
            let effective = format!("{} (not set here)", window.pre_trigger_ms);
            return Err(section.refuse_effective("pre_trigger_ms", &expected, &effective));
        }
        for rate in sample_rates_hz {
            if let Err(e) = window.in_si().checked(rate) {
                // Lengths in seconds; the other settings have passed their ranges above.
                let key = e.field.replace("_s", "_ms");
                let expected = format!("from {} to {} at {rate} samples/s", e.min * 1e3, e.max * 1e3);
                let effective = format!("{} (not set here)", e.got * 1e3);
                return Err(section.refuse_effective(&key, &expected, &effective));
            }
        }
        Ok(window)
    }

    /// The same rules in SI units, as the windower takes them.
    #[must_use]
    pub fn in_si(&self) -> window::WindowConfig {
        window::WindowConfig {
            pre_trigger_s: self.pre_trigger_ms * 1e-3,
            duration_s: self.duration_ms * 1e-3,
            rest_s: self.rest_ms * 1e-3,
            trigger_position_rad: self.trigger_position_rad,
            trigger_speed_rad_s: self.trigger_speed_rad_s,
            missing_max_fraction: self.max_gap_fraction,
            longest_gap_s: self.longest_gap_ms * 1e-3,
            ..window::WindowConfig::default()
        }
    }
}
