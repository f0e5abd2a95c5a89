//! [`MappedBus`]: which frames of one bus belong to which mapped actuators.

use std::collections::BTreeMap;

use ema_wire::ActuatorId;

use super::joiner::{Heard, Joiner};
use crate::config::Config;
use crate::frame::RawFrame;

/// The mapped actuators of one bus, at most sixteen.
#[derive(Clone, Debug)]
pub struct MappedBus {
    joiners: Vec<(ActuatorId, Joiner)>,
    /// By identifier and its length: the joiner, and the message of its map.
    users: BTreeMap<(bool, u32), Vec<(usize, usize)>>,
}

impl MappedBus {
    /// The mapped actuators that are on `bus`; `None` if there is none.
    #[must_use]
    pub fn new(config: &Config, bus: &str) -> Option<Self> {
        let mut found = Self {
            joiners: Vec::new(),
            users: BTreeMap::new(),
        };
        for actuator in config.actuators() {
            let Some(map) = actuator.map.as_ref().filter(|_| actuator.is_at(bus, actuator.id)) else {
                continue;
            };
            for (n, message) in map.messages.iter().enumerate() {
                let users = found.users.entry((message.extended, message.id)).or_default();
                users.push((found.joiners.len(), n));
            }
            let joiner = Joiner::new(actuator.id, map.clone(), actuator.params.sensors.sample_rate);
            found.joiners.push((actuator.id, joiner));
        }
        (!found.joiners.is_empty()).then_some(found)
    }

    /// Whether this actuator is mapped, so that frames with the built-in identifiers are not its own.
    #[must_use]
    pub fn has(&self, actuator: ActuatorId) -> bool {
        self.joiners.iter().any(|(id, _)| *id == actuator)
    }

    /// Shows `heard` what a frame tells each actuator that uses it, `None` of one that cannot be; false if nobody does.
    pub fn push(&mut self, frame: &RawFrame, mut heard: impl FnMut(ActuatorId, Option<Heard>)) -> bool {
        if frame.is_remote() {
            return false;
        }
        let Some(users) = self.users.get(&(frame.is_extended(), frame.id())) else {
            return false;
        };
        for &(joiner, message) in users {
            let (actuator, joiner) = &mut self.joiners[joiner];
            heard(*actuator, joiner.push(message, frame.data(), frame.stamp_ns));
        }
        true
    }

    /// Frames that came after a newer sample had begun.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.joiners.iter().map(|(_, joiner)| joiner.late()).sum()
    }
}
