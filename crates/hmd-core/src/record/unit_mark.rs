//! By what a window was assessed, where the daemon learns the unit.

/// By what a window was assessed whose actuator has `learn_windows`: a replay learns from those windows alone that its run learnt from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum UnitMark {
    /// The actuator does not learn, or the recording does not say.
    #[default]
    Untold,
    /// By its type; the window counted as one of a healthy unit that is to be learnt.
    Learning,
    /// By its type; the unit was not to be learnt yet.
    Waiting,
    /// By what was learnt: the SHA-256 of the unit's file, in hexadecimal.
    Learnt(String),
}

impl UnitMark {
    /// As in a record.
    #[must_use]
    pub fn to_text(&self) -> &str {
        match self {
            Self::Untold => "",
            Self::Learning => "learning",
            Self::Waiting => "waiting",
            Self::Learnt(sha256) => sha256,
        }
    }

    /// Out of a record.
    #[must_use]
    pub fn from_text(text: &str) -> Self {
        match text {
            "" => Self::Untold,
            "learning" => Self::Learning,
            "waiting" => Self::Waiting,
            sha256 => Self::Learnt(sha256.to_owned()),
        }
    }
}
