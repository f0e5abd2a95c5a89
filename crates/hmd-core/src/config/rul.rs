//! Section `[rul]`: how use is counted, which remaining lives are short, and where unit histories are stored.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::ConfigError;
use super::reader::Section;

/// What counts as operating hours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HoursOf {
    /// Time with a mode other than idle, as the frames show it.
    #[default]
    Operating,
    /// Time between the stamps of windows, for logs that show only part of the operation.
    Elapsed,
}

impl HoursOf {
    /// Each under its name in the file.
    pub const NAMES: [(&str, Self); 2] = [("operating", Self::Operating), ("elapsed", Self::Elapsed)];

    /// Its name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Operating => "operating",
            Self::Elapsed => "elapsed",
        }
    }
}

/// Remaining useful life.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RulConfig {
    /// What counts as operating hours.
    pub hours: HoursOf,
    /// The records say how probable the end of life within so many hours is.
    pub horizon_h: f64,
    /// Health is at least `warning` when the 10 % quantile of the hours left is below this; 0: never.
    pub warning_h: f64,
    /// Health is `critical` when it is below this; 0: never. At most `warning_h`.
    pub critical_h: f64,
    /// Directory in which the daemon stores unit histories; `None`: they end with the daemon.
    pub state: Option<PathBuf>,
    /// File of maintenance events that `hmd event` writes; `None`: there are none.
    pub events: Option<PathBuf>,
}

impl Default for RulConfig {
    fn default() -> Self {
        Self {
            hours: HoursOf::default(),
            horizon_h: 100.0,
            warning_h: 0.0,
            critical_h: 0.0,
            state: None,
            events: None,
        }
    }
}

impl RulConfig {
    pub(super) const KEYS: &[&str] = &["hours", "horizon_h", "warning_h", "critical_h", "state", "events"];

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let default = Self::default();
        let hours = |key, default| section.number(key, default, 0.0..=1e6);
        let config = Self {
            hours: section.choice("hours", default.hours, &HoursOf::NAMES)?,
            horizon_h: hours("horizon_h", default.horizon_h)?,
            warning_h: hours("warning_h", default.warning_h)?,
            critical_h: hours("critical_h", default.critical_h)?,
            state: section.text("state")?.map(PathBuf::from),
            events: section.text("events")?.map(PathBuf::from),
        };
        if config.critical_h > config.warning_h {
            let effective = format!("{} (not set here)", config.critical_h);
            let expected = format!("at most warning_h = {}", config.warning_h);
            return Err(section.refuse_effective("critical_h", &expected, &effective));
        }
        Ok(config)
    }
}
