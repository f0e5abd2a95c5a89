//! The classic frames of one sample, collected until all three are present.

use crate::can::{Command, Currents, Position};
use crate::sample::{ActuatorId, Sample};

/// One classic frame of a sample.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    Currents(Currents),
    Position(Position),
    Command(Command),
}

/// The frames of one sample received so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parts {
    currents: Option<Currents>,
    position: Option<Position>,
    command: Option<Command>,
}

/// Result of adding a frame to a sample.
pub(super) enum Insertion {
    New,
    Duplicate,
    Conflict,
}

impl Parts {
    /// Adds a frame, by rules 4 and 5 of [`crate::assembler`].
    pub(super) fn insert(&mut self, part: Part) -> Insertion {
        match part {
            Part::Currents(currents) => insert_once(&mut self.currents, currents),
            Part::Position(position) => insert_once(&mut self.position, position),
            Part::Command(command) => insert_once(&mut self.command, command),
        }
    }

    /// The sample; `None` until all three frames are present.
    pub(super) fn join(&self, actuator: ActuatorId) -> Option<Sample> {
        Sample::from_parts(
            actuator,
            self.currents.as_ref()?,
            self.position.as_ref()?,
            self.command.as_ref()?,
        )
    }
}

/// Fills an empty slot; compares with the content of a full one.
fn insert_once<T: PartialEq + Copy>(slot: &mut Option<T>, part: T) -> Insertion {
    match slot {
        None => {
            *slot = Some(part);
            Insertion::New
        }
        Some(present) if *present == part => Insertion::Duplicate,
        Some(_) => Insertion::Conflict,
    }
}
