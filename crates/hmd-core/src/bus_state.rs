//! Error frames of each bus -> the error state of its controller.
//!
//! A bus that fails is no fault of an actuator; its state is reported and recorded, and its windows become `invalid` by the
//! samples that are missing. The state comes from the frames alone, so that replay finds the same.

use std::collections::BTreeMap;
use std::fmt;

use ::socketcan::errors::ControllerProblems;
use ::socketcan::{CanErrorFrame, ErrorCause};

use crate::frame::{RawFrame, socketcan};

/// Error state of a CAN controller (ISO 11898-1), the best first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum BusState {
    /// Takes full part in the bus.
    #[default]
    ErrorActive,
    /// An error counter is at 96 or above.
    ErrorWarning,
    /// An error counter is at 128 or above.
    ErrorPassive,
    /// The transmit error counter passed 255: cut off until restarted.
    BusOff,
}

impl fmt::Display for BusState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ErrorActive => "error-active",
            Self::ErrorWarning => "error-warning",
            Self::ErrorPassive => "error-passive",
            Self::BusOff => "bus-off",
        })
    }
}

/// States of all buses by their index; at most 64 (see [`BusNames`](crate::frame::BusNames)).
#[derive(Clone, Debug, Default)]
pub struct BusStates(BTreeMap<u16, BusState>);

impl BusStates {
    /// State of a bus; error-active until an error frame reports another one.
    #[must_use]
    pub fn state_of(&self, bus: u16) -> BusState {
        self.0.get(&bus).copied().unwrap_or_default()
    }

    /// Takes a frame; the new state of its bus if it changed.
    pub fn push(&mut self, frame: &RawFrame) -> Option<BusState> {
        let before = self.state_of(frame.bus);
        let now = if frame.is_error() {
            state_in(frame)?
        } else if before == BusState::BusOff {
            // A controller that is cut off receives nothing.
            BusState::ErrorActive
        } else {
            return None;
        };
        (now != before).then(|| {
            self.0.insert(frame.bus, now);
            now
        })
    }
}

/// The state that an error frame reports, if it is about the state: the worst of several.
fn state_in(frame: &RawFrame) -> Option<BusState> {
    let error = CanErrorFrame::new_error(frame.id() & !socketcan::ERR, frame.data()).ok()?;
    let states = error.into_error().into_iter().filter_map(|cause| match cause {
        ErrorCause::BusOff => Some(BusState::BusOff),
        ErrorCause::Restarted => Some(BusState::ErrorActive),
        ErrorCause::Controller(problems) => of_controller(problems),
        _ => None,
    });
    states.max()
}

fn of_controller(problems: ControllerProblems) -> Option<BusState> {
    let passive = ControllerProblems::RX_PASSIVE | ControllerProblems::TX_PASSIVE;
    let warning = ControllerProblems::RX_WARNING | ControllerProblems::TX_WARNING;
    if problems.intersects(passive) {
        Some(BusState::ErrorPassive)
    } else if problems.intersects(warning) {
        Some(BusState::ErrorWarning)
    } else if problems.contains(ControllerProblems::ACTIVE) {
        Some(BusState::ErrorActive)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameFlags;

    fn error(class: u32, controller: u8) -> RawFrame {
        RawFrame::new(0, 0, class, FrameFlags::ERROR, &[0, controller, 0, 0, 0, 0, 0, 0]).unwrap()
    }

    #[test]
    fn a_bus_goes_through_all_states_and_back() {
        // Classes and flags of linux/can/error.h: 0x04 controller (0x08 warning, 0x20 passive, 0x40 active), 0x40 bus-off,
        // 0x100 restarted, 0x20 no acknowledgement.
        let mut states = BusStates::default();
        assert_eq!(states.state_of(0), BusState::ErrorActive);
        assert_eq!(states.push(&error(0x04, 0x08)), Some(BusState::ErrorWarning));
        assert_eq!(states.push(&error(0x04, 0x08)), None, "each change once");
        assert_eq!(states.push(&error(0x20, 0)), None, "not about the state");
        assert_eq!(states.push(&error(0x04, 0x20)), Some(BusState::ErrorPassive));
        assert_eq!(states.push(&error(0x04, 0x40)), Some(BusState::ErrorActive));
        assert_eq!(states.push(&error(0x40, 0)), Some(BusState::BusOff));
        assert_eq!(states.push(&error(0x100, 0)), Some(BusState::ErrorActive));
        assert_eq!(
            states.push(&error(0x44, 0x20)),
            Some(BusState::BusOff),
            "the worst of two"
        );
        let data = RawFrame::new(0, 0, 0x100, FrameFlags::NONE, &[]).unwrap();
        assert_eq!(states.push(&data), Some(BusState::ErrorActive));
        assert_eq!(states.push(&data), None);
    }

    #[test]
    fn any_error_frame_is_taken() {
        let mut states = BusStates::default();
        for class in (0..0x2000_0000).step_by(0x1001) {
            for byte in [0, 0x15, 0xFF] {
                states.push(&RawFrame::new(0, 0, class, FrameFlags::ERROR, &[byte; 8]).unwrap());
                states.push(&RawFrame::new(0, 0, class, FrameFlags::ERROR, &[byte; 3]).unwrap());
            }
        }
    }
}
