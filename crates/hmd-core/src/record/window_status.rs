//! Status of a window: whether it was identified, and whether the estimate explains it.

use std::fmt;

/// Status of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WindowStatus {
    /// Identified without handicap.
    Ok,
    /// Identified with a handicap.
    Degraded,
    /// Not fit to be assessed.
    Invalid,
    /// Good data that no fault vector explains.
    Unmodelled,
}

impl WindowStatus {
    /// All, in the order of counters and pages.
    pub const ALL: [Self; 4] = [Self::Ok, Self::Degraded, Self::Invalid, Self::Unmodelled];

    /// The name that records use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Degraded => "degraded",
            Self::Invalid => "invalid",
            Self::Unmodelled => "unmodelled",
        }
    }

    /// The status that a record names.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }
}

impl fmt::Display for WindowStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
