//! The lives of all actuators, with the maintenance events that end them.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::events::{self, Event, Events};
use super::{Life, StateError, state};
use crate::config::{ActuatorConfig, Config};
use crate::health::LevelsError;

/// All lives of a run. At most one for each of 16 actuators on each of 64 interfaces.
#[derive(Debug)]
pub struct Lives {
    config: Arc<Config>,
    lives: BTreeMap<String, Life>,
    /// Maintenance events, as told last.
    events: Events,
    /// Where lives are kept, if anywhere.
    directory: Option<PathBuf>,
    notices: Vec<String>,
}

impl Lives {
    /// Lives that begin with the run; they are neither read nor kept.
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        Self {
            config,
            lives: BTreeMap::new(),
            events: Events::default(),
            directory: None,
            notices: Vec::new(),
        }
    }

    /// Lives that go on from the directory of the configuration, if it names one, and are kept there.
    pub fn keep(&mut self) {
        self.directory = self.config.rul().state.as_ref().map(|path| self.config.resolve(path));
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
            Entry::Vacant(new) => new.insert(
                match kept(self.directory.as_deref(), &actuator.name, &mut self.notices) {
                    Some(life) => life.resumed(config, serial_number.clone())?,
                    None => Life::new(config, serial_number.clone())?,
                },
            ),
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
    pub(crate) fn pending(&self, actuator: &str) -> u32 {
        self.lives.get(actuator).map_or(0, Life::pending)
    }

    /// Ends the life of an actuator whose unit turns out to be another one; says whether there was one.
    pub fn end(&mut self, actuator: &str) -> bool {
        self.lives.remove(actuator).is_some()
    }

    /// Keeps the life of an actuator, if lives are kept.
    ///
    /// # Errors
    /// [`StateError`].
    pub fn save(&self, actuator: &str) -> Result<(), StateError> {
        match (&self.directory, self.lives.get(actuator)) {
            (Some(directory), Some(life)) => state::save(directory, actuator, life),
            _ => Ok(()),
        }
    }

    /// What an operator should read, since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }
}

/// A life that was kept. A file that cannot be used is told and put aside.
fn kept(directory: Option<&Path>, actuator: &str, notices: &mut Vec<String>) -> Option<Life> {
    let directory = directory?;
    state::load(directory, actuator).unwrap_or_else(|error| {
        notices.push(format!("{error}; a new life begins"));
        if let Err(error) = state::put_aside(directory, actuator) {
            notices.push(error.to_string());
        }
        None
    })
}

/// The maintenance events of a configuration.
///
/// # Errors
/// A file that is there and cannot be read.
pub fn events_of(config: &Config) -> Result<Events, events::EventError> {
    match &config.rul().events {
        Some(path) => events::read(&config.resolve(path)),
        None => Ok(Events::default()),
    }
}
