//! [`Gap`]: what a log does not have, and the faults that are not observable without it.

use std::fmt;

use ema_models::FaultId;

use super::{LogMap, Quantity, Resampling};
use crate::dbc::Role;

/// Something that a log does not have, so that less is known of every window in it. A missing counter is a handicap of the window, with
/// the jitter of its times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gap {
    /// The third phase current.
    ThirdPhase,
    /// Phase currents; there are those in the rotor's frame.
    Phases,
    /// The current along the rotor's north pole, beside the torque-producing one.
    DirectCurrent,
    /// The output angle.
    OutputAngle,
    /// A set point.
    SetPoint,
    /// Currents as they flow: the drive filters them at so many Hz.
    FilteredCurrents(u32),
    /// Values of all signals at the same times, or at even ones.
    Resampled(Resampling),
}

impl Gap {
    /// Those that follow from the columns.
    pub(super) const OF_COLUMNS: [Self; 5] = [
        Self::ThirdPhase,
        Self::Phases,
        Self::DirectCurrent,
        Self::OutputAngle,
        Self::SetPoint,
    ];

    pub(super) fn is_in(self, map: &LogMap) -> bool {
        let lacks = |quantity: Quantity| !map.has(quantity);
        let is_dq = map.has(Quantity::CurrentQ);
        match self {
            Self::ThirdPhase => !is_dq && lacks(Quantity::Of(Role::CurrentC)),
            Self::Phases => is_dq,
            Self::DirectCurrent => is_dq && lacks(Quantity::CurrentD),
            Self::OutputAngle => lacks(Quantity::Of(Role::OutputPosition)),
            Self::SetPoint => !map.has_command(),
            Self::FilteredCurrents(_) | Self::Resampled(_) => true,
        }
    }

    /// Faults that are not observable without it.
    #[must_use]
    pub fn hides(self) -> &'static [FaultId] {
        match self {
            Self::ThirdPhase | Self::Phases | Self::FilteredCurrents(_) | Self::Resampled(_) => &[],
            // Shorted turns unbalance the phases, which shows as ripple of both currents of the rotor's frame.
            Self::DirectCurrent => &[FaultId::ShortA, FaultId::ShortB, FaultId::ShortC],
            Self::OutputAngle => &[FaultId::Backlash],
            Self::SetPoint => &[FaultId::Gain],
        }
    }
}

impl fmt::Display for Gap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FilteredCurrents(hz) => {
                return write!(f, "currents filtered at {hz} Hz by the drive: faster ones are not seen");
            }
            Self::ThirdPhase => "no currents.c: the sum of the currents is not checked",
            Self::Phases => "currents of d and q: the sum of the phases is not checked",
            Self::DirectCurrent => "no currents.d: it is taken as 0, and shorts are not observable",
            Self::OutputAngle => "no position.output: the gear is taken as rigid, and backlash is not observable",
            Self::Resampled(Resampling::AtCurrents) => {
                "signals of several rates: interpolated at the times of the currents"
            }
            Self::Resampled(Resampling::Even(hz)) => return write!(f, "currents and angles interpolated at {hz} Hz"),
            Self::SetPoint => "no set point: motion begins a window, and controller gain is not observable",
        })
    }
}
