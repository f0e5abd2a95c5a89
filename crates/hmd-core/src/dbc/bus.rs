//! [`MappedBus`]: which frames of one bus belong to which mapped actuators.

use std::collections::BTreeMap;
use std::sync::Arc;

use ema_wire::ActuatorId;

use super::joiner::{DecodedUpdate, Joiner};
use super::map::SignalMap;
use crate::frame::RawFrame;

/// The mapped actuators of one bus, at most sixteen.
#[derive(Clone, Debug)]
pub struct MappedBus {
    joiners: Vec<(ActuatorId, Joiner)>,
    /// By identifier and its length: the joiner, and the message of its map.
    users: BTreeMap<(bool, u32), Vec<(usize, usize)>>,
}

impl MappedBus {
    /// For the mapped actuators of one bus, each with its map and its nominal sample rate, Hz; `None` if there is none.
    #[must_use]
    pub fn new<'a>(actuators: impl IntoIterator<Item = (ActuatorId, &'a Arc<SignalMap>, f64)>) -> Option<Self> {
        let mut found = Self {
            joiners: Vec::new(),
            users: BTreeMap::new(),
        };
        for (id, map, rate_hz) in actuators {
            for (n, message) in map.messages.iter().enumerate() {
                let users = found.users.entry((message.extended, message.id)).or_default();
                users.push((found.joiners.len(), n));
            }
            found.joiners.push((id, Joiner::new(id, map.clone(), rate_hz)));
        }
        (!found.joiners.is_empty()).then_some(found)
    }

    /// Whether this actuator is mapped, so that frames with the built-in identifiers are not its own.
    #[must_use]
    pub fn has(&self, actuator: ActuatorId) -> bool {
        self.joiners.iter().any(|(id, _)| *id == actuator)
    }

    /// Passes `update` what a frame carries for each actuator that uses it, `None` where it cannot be decoded; false if no
    /// actuator uses it.
    pub fn push(&mut self, frame: &RawFrame, mut update: impl FnMut(ActuatorId, Option<DecodedUpdate>)) -> bool {
        if frame.is_remote() {
            return false;
        }
        let Some(users) = self.users.get(&(frame.is_extended(), frame.id())) else {
            return false;
        };
        for &(joiner, message) in users {
            let (actuator, joiner) = &mut self.joiners[joiner];
            update(*actuator, joiner.push(message, frame.data(), frame.stamp_ns));
        }
        true
    }

    /// The frames that come are of another recording.
    pub fn begin_recording(&mut self) {
        for (_, joiner) in &mut self.joiners {
            joiner.begin_recording();
        }
    }

    /// Frames of an actuator that came after a newer sample had begun.
    #[must_use]
    pub fn late_of(&self, actuator: ActuatorId) -> u64 {
        let of = self.joiners.iter().filter(|(id, _)| *id == actuator);
        of.map(|(_, joiner)| joiner.late()).sum()
    }
}
