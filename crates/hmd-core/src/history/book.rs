//! The lives of all actuators, with the maintenance events that end them.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use super::Life;
use super::maintenance::{Event, Events};
use crate::config::{ActuatorConfig, Config};
use crate::health::LevelsError;

/// All lives of a run. At most one for each of 16 actuators on each of 64 interfaces.
#[derive(Debug)]
pub struct Lives {
    config: Arc<Config>,
    lives: BTreeMap<String, Life>,
    /// Maintenance events, as told last.
    events: Events,
    /// Histories of an earlier run, which continue with the first window.
    restored: BTreeMap<String, Life>,
    notices: Vec<String>,
}

impl Lives {
    /// Lives that begin with the run.
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        Self {
            config,
            lives: BTreeMap::new(),
            events: Events::default(),
            restored: BTreeMap::new(),
            notices: Vec::new(),
        }
    }

    /// Continues a history of an earlier run at the first window of the actuator.
    pub fn restore(&mut self, actuator: &str, life: Life) {
        self.restored.insert(actuator.to_owned(), life);
    }

    /// The history of an actuator, if it has one.
    #[must_use]
    pub fn get(&self, actuator: &str) -> Option<&Life> {
        self.lives.get(actuator)
    }

    /// Takes the maintenance events as they stand. Each is followed when the frames have come to it, and once.
    pub fn follow(&mut self, events: Events) {
        let told = &self.events.unfinished;
        for line in events.unfinished.iter().filter(|line| !told.contains(line)) {
            self.notices.push(format!(
                "maintenance events, line {line}: never finished and passed over; tell of that event again"
            ));
        }
        self.events = events;
    }

    /// The life of an actuator at the time of a window. Events up to then are followed first.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn at(&mut self, actuator: &ActuatorConfig, t_ns: u64) -> Result<&mut Life, LevelsError> {
        let (config, serial_number) = (&self.config, &actuator.serial_number);
        let life = match self.lives.entry(actuator.name.clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(match self.restored.remove(&actuator.name) {
                Some(life) => life.resumed(config, serial_number.clone())?,
                None => Life::new(config, serial_number.clone())?,
            }),
        };
        let has_come = |event: &&Event| event.actuator == actuator.name && event.t_ns <= t_ns;
        let come = || self.events.list.iter().filter(has_come).map(|event| event.t_ns);
        let count = come().count() as u64;
        let begun_ns = life.begun_ns;
        let before = || come().filter(|t_ns| *t_ns <= begun_ns).count() as u64;
        // The file only grows, so that one more is a new one, whatever time it tells.
        let followed = *life.events_followed.get_or_insert_with(before);
        if let Some(begun_ns) = come().max().filter(|_| count > followed) {
            *life = Life {
                begun_ns,
                events_followed: Some(count),
                ..Life::new(config, serial_number.clone())?
            };
            let notice = format!("{}: a new life begins by a maintenance event", actuator.name);
            self.notices.push(notice);
        }
        Ok(life)
    }

    /// Windows in a row that ask for a worse state of an actuator than it has; 0 without a life.
    #[must_use]
    pub fn pending(&self, actuator: &str) -> u32 {
        self.lives.get(actuator).map_or(0, Life::pending)
    }

    /// Ends the life of an actuator whose unit turns out to be another one; says whether there was one.
    pub fn end(&mut self, actuator: &str) -> bool {
        self.lives.remove(actuator).is_some()
    }

    /// Adds a line that an operator should read.
    pub fn notice(&mut self, line: String) {
        self.notices.push(line);
    }

    /// What an operator should read, since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }
}
