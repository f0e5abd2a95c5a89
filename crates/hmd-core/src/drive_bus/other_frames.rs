//! [`OtherFrames`]: which frames came instead of those that a sample needs, for a sentence at the end.

use std::collections::BTreeSet;
use std::fmt;

use super::layout::{DriveLayout, DriveMessage, Place, Target};
use crate::dbc::Selector;
use crate::frame::RawFrame;

/// The most identifiers that are named.
const NAMED: usize = 8;

/// Identifiers of one interface whose frames are not read, and of those that several drives or values share the number in the frame.
#[derive(Clone, Debug, Default)]
pub(super) struct OtherFrames(BTreeSet<Identifier>);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Identifier {
    id: u32,
    is_extended: bool,
    number: Option<u64>,
}

impl OtherFrames {
    /// Notes a frame, if the values that its identifier stands for are not in it.
    pub(super) fn hear(&mut self, layout: &DriveLayout, frame: &RawFrame) {
        if self.0.len() == NAMED {
            return;
        }
        let known = layout.messages.iter().find(|message| message.has_identifier_of(frame));
        let selector = known.and_then(DriveMessage::selector_of_values);
        if known.is_some() && selector.is_none_or(|selector| selector.selects(frame.data())) {
            return;
        }
        self.0.insert(Identifier {
            id: frame.id(),
            is_extended: frame.is_extended(),
            number: selector.and_then(|selector| selector.multiplexor.raw(frame.data())),
        });
    }

    /// As what was found: `none`, and what there was instead.
    pub(super) fn found(&self) -> String {
        let ids: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        match ids.as_slice() {
            [] => "none".to_owned(),
            ids => format!("none, but identifiers that are not read: {}", ids.join("; ")),
        }
    }
}

impl DriveLayout {
    /// A quantity by its name in the drive's documents, and in which frames it is expected.
    pub(super) fn shown(&self, column: usize) -> String {
        let signal = &self.columns[column].signal;
        let has = |message: &&DriveMessage| {
            let mut fields = message.fields.iter();
            fields.any(|field| matches!(field.target, Target::Column(of) if of == column))
        };
        let Some(message) = self.messages.iter().find(has) else {
            return signal.clone();
        };
        let numbers = message.selector_of_values().map(|selector| selector.ranges.as_slice());
        let identifier = Identifier {
            id: message.id,
            is_extended: message.extended == Some(true),
            number: numbers.and_then(|ranges| ranges.first()).map(|&(first, _)| first),
        };
        format!("{signal} (identifier {identifier})")
    }
}

impl DriveMessage {
    /// Whether it is the identifier of a frame.
    pub(super) fn has_identifier_of(&self, frame: &RawFrame) -> bool {
        frame.id() & self.mask == self.id && self.extended.is_none_or(|extended| extended == frame.is_extended())
    }

    /// What tells the frames with its values from others of the same identifier.
    fn selector_of_values(&self) -> Option<&Selector> {
        let of_values = self
            .fields
            .iter()
            .find_map(|field| match (&field.target, &field.place) {
                (Target::Column(_), Place::Bits(signal)) => signal.selectors.first(),
                _ => None,
            });
        self.selector.as_ref().or(of_values)
    }
}

impl fmt::Display for Identifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_extended {
            write!(f, "{:08X}", self.id)?;
        } else {
            write!(f, "{:03X}", self.id)?;
        }
        self.number.map_or(Ok(()), |number| write!(f, ", number {number}"))
    }
}
