//! What a setting must be: the rule that the configuration and the code behind it share, and the refusal of a value.

use core::fmt;
use core::ops::RangeInclusive;

/// What the value of a setting must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expected {
    /// From `min` to `max`, both included.
    Between {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// The same, because of the sample rate.
    AtRate {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// The rate, Hz.
        sample_rate_hz: f64,
    },
    /// More than another setting: its name and value.
    MoreThan((&'static str, f64)),
    /// Less than another setting.
    LessThan((&'static str, f64)),
    /// Not more than another setting.
    AtMost((&'static str, f64)),
}

/// A setting that was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{field} = {got}: expected {expected}")]
pub struct SettingError {
    /// Name of the setting, as in a configuration file.
    pub field: &'static str,
    /// The value found.
    pub got: f64,
    /// What it must be.
    pub expected: Expected,
}

impl SettingError {
    /// Refuses a number that is not within a range; NaN is within none.
    ///
    /// # Errors
    /// The refusal.
    pub(crate) fn unless_within(field: &'static str, got: f64, range: RangeInclusive<f64>) -> Result<(), Self> {
        if range.contains(&got) {
            return Ok(());
        }
        let (min, max) = range.into_inner();
        let expected = Expected::Between { min, max };
        Err(Self { field, got, expected })
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Between { min, max } => write!(f, "a number from {min} to {max}"),
            Self::AtRate {
                min,
                max,
                sample_rate_hz,
            } => write!(f, "from {min} to {max} at {sample_rate_hz} samples/s"),
            Self::MoreThan((other, value)) => write!(f, "more than {other} = {value}"),
            Self::LessThan((other, value)) => write!(f, "less than {other} = {value}"),
            Self::AtMost((other, value)) => write!(f, "at most {other} = {value}"),
        }
    }
}
