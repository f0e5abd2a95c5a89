//! The parts of one sample while it is being collected.

use crate::can::{ActuatorId, Command, Currents, Position};
use crate::sample::Sample;

/// One classic frame of a sample.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    Currents(Currents),
    Position(Position),
    Command(Command),
}

/// The parts of one sample that are in.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parts {
    currents: Option<Currents>,
    position: Option<Position>,
    command: Option<Command>,
}

/// What a part was to its sample.
pub(super) enum Inserted {
    New,
    Duplicate,
    Conflict,
}

impl Parts {
    /// Adds a part (rules 4 and 5).
    pub(super) fn insert(&mut self, part: Part) -> Inserted {
        match part {
            Part::Currents(currents) => fill(&mut self.currents, currents),
            Part::Position(position) => fill(&mut self.position, position),
            Part::Command(command) => fill(&mut self.command, command),
        }
    }

    /// The sample, once all three are in.
    pub(super) fn join(&self, actuator: ActuatorId) -> Option<Sample> {
        Sample::from_parts(
            actuator,
            self.currents.as_ref()?,
            self.position.as_ref()?,
            self.command.as_ref()?,
        )
    }
}

fn fill<T: PartialEq + Copy>(slot: &mut Option<T>, part: T) -> Inserted {
    match slot {
        None => {
            *slot = Some(part);
            Inserted::New
        }
        Some(present) if *present == part => Inserted::Duplicate,
        Some(_) => Inserted::Conflict,
    }
}
