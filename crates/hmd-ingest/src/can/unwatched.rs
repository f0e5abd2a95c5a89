//! Frames that the kernel lets pass only to show that a number talks which is not watched.

use std::collections::BTreeSet;

use ema_wire::ActuatorId;
use hmd_core::frame::RawFrame;

use super::{CanId, Wanted};

/// Tells such frames from those that are wanted.
#[derive(Debug)]
pub(super) struct Unwatched<'a> {
    /// `None` where every frame is wanted.
    watched: Option<&'a BTreeSet<CanId>>,
    /// Numbers that were told.
    told: BTreeSet<ActuatorId>,
}

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// One that is wanted.
    Wanted,
    /// The first of a number that is not watched.
    News(ActuatorId),
    /// A further one.
    Known,
}

impl<'a> Unwatched<'a> {
    pub(super) fn new(wanted: &'a Wanted) -> Self {
        let watched = match wanted {
            Wanted::Ids { ids, .. } if wanted.let_pass().is_some() => Some(ids),
            Wanted::Ids { .. } | Wanted::All => None,
        };
        Self {
            watched,
            told: BTreeSet::new(),
        }
    }

    pub(super) fn hear(&mut self, frame: &RawFrame) -> Heard {
        let id = CanId {
            id: frame.id(),
            extended: frame.is_extended(),
        };
        let is_watched = |ids: &BTreeSet<CanId>| frame.is_error() || ids.contains(&id);
        match id.status_of() {
            Some(number) if !self.watched.is_none_or(is_watched) => {
                if self.told.insert(number) {
                    Heard::News(number)
                } else {
                    Heard::Known
                }
            }
            _ => Heard::Wanted,
        }
    }
}

#[cfg(test)]
mod tests {
    use ema_wire::can::Message;
    use hmd_core::config::Config;
    use hmd_core::frame::FrameFlags;

    use super::*;

    #[test]
    fn the_status_of_another_number_is_news_once_and_no_frame() {
        let number = |n| ActuatorId::new(n).expect("up to 15");
        let frame = |n, message: Message, flags| {
            let id = u32::from(message.id(number(n)));
            RawFrame::new(1, 0, id, flags, &[0; 8]).expect("a frame")
        };
        let config = Config::from_toml_str("[[actuator]]\nid = 3\nbus = \"can0\"\n", "hmd.toml").expect("valid");
        let wanted = Wanted::for_interface(&config, "can0");
        let mut unwatched = Unwatched::new(&wanted);
        let mut hear = |n, message, flags| unwatched.hear(&frame(n, message, flags));
        let none = FrameFlags::empty();
        assert_eq!(hear(3, Message::Status, none), Heard::Wanted);
        assert_eq!(hear(4, Message::Status, none), Heard::News(number(4)));
        assert_eq!(hear(4, Message::Status, none), Heard::Known);
        assert_eq!(hear(4, Message::Status, FrameFlags::ERROR), Heard::Wanted);
        assert_eq!(hear(5, Message::Status, none), Heard::News(number(5)));
        let mut all = Unwatched::new(&Wanted::All);
        assert_eq!(all.hear(&frame(4, Message::Status, none)), Heard::Wanted);
    }
}
