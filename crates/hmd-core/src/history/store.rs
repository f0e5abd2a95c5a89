//! The histories of all actuators, and the maintenance events that reset them.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use super::maintenance::{Event, EventKind, Events, ReplacedPart};
use super::{ResumedState, UnitHistory};
use crate::config::{ActuatorConfig, Config};
use crate::health::LevelsError;

/// The unit histories of a run. At most one for each of 16 actuators on each of 64 interfaces.
#[derive(Debug)]
pub struct HistoryStore {
    config: Arc<Config>,
    histories: BTreeMap<String, UnitHistory>,
    /// Maintenance events, as last set.
    events: Events,
    /// Histories of an earlier run, which continue with the first window.
    restored: BTreeMap<String, UnitHistory>,
    notices: Vec<String>,
}

impl HistoryStore {
    /// Without histories: each begins with the first window of its actuator.
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        Self {
            config,
            histories: BTreeMap::new(),
            events: Events::default(),
            restored: BTreeMap::new(),
            notices: Vec::new(),
        }
    }

    /// Continues a history of an earlier run at the first window of the actuator.
    pub fn restore(&mut self, actuator: &str, history: UnitHistory) {
        self.restored.insert(actuator.to_owned(), history);
    }

    /// What holds of each actuator whose history of an earlier run will continue; not of those that got another unit since.
    pub fn restored_states(&self) -> impl Iterator<Item = (&str, ResumedState)> {
        self.restored.iter().filter_map(|(name, history)| {
            let actuator = self.config.actuator_named(name)?;
            (history.serial_number == actuator.serial_number).then(|| (name.as_str(), history.resumed_state()))
        })
    }

    /// The windows that come are of another run: all histories go on as those that a run reads.
    pub fn begin_run(&mut self) {
        self.histories.values_mut().for_each(UnitHistory::begin_run);
    }

    /// The history of an actuator, if it has one.
    #[must_use]
    pub fn get(&self, actuator: &str) -> Option<&UnitHistory> {
        self.histories.get(actuator)
    }

    /// Sets the maintenance events. Each resets its history once, when a window begins at or after it.
    pub fn set_events(&mut self, events: Events) {
        let reported = &self.events.unfinished;
        for line in events.unfinished.iter().filter(|line| !reported.contains(line)) {
            self.notices.push(format!(
                "rul.events, line {line}: never finished and ignored; record that event again"
            ));
        }
        let reported = &self.events.unreadable;
        for bad in events.unreadable.iter().filter(|bad| !reported.contains(bad)) {
            self.notices.push(bad.to_string());
        }
        let of_nobody = |event: &&Event| self.config.actuator_named(&event.actuator).is_none();
        let reported: Vec<&Event> = self.events.list.iter().filter(of_nobody).collect();
        for event in events
            .list
            .iter()
            .filter(of_nobody)
            .filter(|event| !reported.contains(event))
        {
            let name = &event.actuator;
            self.notices.push(format!(
                "rul.events: expected an actuator of this configuration, found {name:?}; that event is ignored"
            ));
        }
        self.events = events;
    }

    /// Whether a maintenance event has replaced the unit of an actuator by the time of a window, and its history has not followed yet.
    #[must_use]
    pub fn is_replaced(&self, actuator: &ActuatorConfig, t_ns: u64) -> bool {
        let known = self
            .histories
            .get(&actuator.name)
            .or_else(|| self.restored.get(&actuator.name));
        known.is_some_and(|history| {
            let (come, followed) = counts_of_unit(&self.events.list, &actuator.name, history, t_ns);
            come > followed
        })
    }

    /// The history of an actuator at the time of a window, reset first by the maintenance events up to then.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn history_at(&mut self, actuator: &ActuatorConfig, t_ns: u64) -> Result<&mut UnitHistory, LevelsError> {
        let (config, serial_number) = (&self.config, &actuator.serial_number);
        let history = match self.histories.entry(actuator.name.clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(match self.restored.remove(&actuator.name) {
                Some(history) => history.resumed(config, serial_number.clone())?,
                None => UnitHistory::new(config, serial_number.clone())?,
            }),
        };
        let of = |part: Option<ReplacedPart>| resets(&self.events.list, &actuator.name, part, t_ns);
        let of_parts = ReplacedPart::ALL.map(|part| of(Some(part)).count() as u64);
        let (count, followed) = counts_of_unit(&self.events.list, &actuator.name, history, t_ns);
        history.events_followed = Some(followed);
        if let Some(newest) = of(None).max_by_key(|event| event.t_ns).filter(|_| count > followed) {
            *history = UnitHistory {
                begun_ns: newest.t_ns,
                events_followed: Some(count),
                parts_followed: of_parts,
                last: history.last.map(|last| last.not_before(newest.t_ns)),
                ..UnitHistory::new(config, serial_number.clone())?
            };
            history.note_replaced("unit");
            let notice = format!(
                "{}: history reset by a maintenance event{}",
                actuator.name,
                noted(newest)
            );
            self.notices.push(notice);
        }
        for (n, part) in ReplacedPart::ALL.into_iter().enumerate() {
            if let Some(newest) = of(Some(part))
                .next_back()
                .filter(|_| of_parts[n] > history.parts_followed[n])
            {
                history.parts_followed[n] = of_parts[n];
                history.replace(part, newest.t_ns);
                let faults: Vec<&str> = part.faults().iter().map(|fault| fault.plain_name()).collect();
                let notice = format!(
                    "{}: {} replaced, its faults begin anew ({}){}",
                    actuator.name,
                    part.name(),
                    faults.join(", "),
                    noted(newest)
                );
                self.notices.push(notice);
            }
        }
        Ok(history)
    }

    /// Windows in a row that ask for a worse state of an actuator than it has; 0 without a history.
    #[must_use]
    pub fn pending(&self, actuator: &str) -> u32 {
        self.histories.get(actuator).map_or(0, UnitHistory::pending)
    }

    /// Removes the history of an actuator whose unit turns out to be another one; returns whether there was one.
    pub fn remove(&mut self, actuator: &str) -> bool {
        self.histories.remove(actuator).is_some()
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

/// Replacements of the unit of an actuator (`None`) or of a part of it, up to a time.
fn resets<'a>(
    events: &'a [Event],
    actuator: &'a str,
    part: Option<ReplacedPart>,
    until_ns: u64,
) -> impl DoubleEndedIterator<Item = &'a Event> {
    let is_meant = move |event: &&Event| {
        event.event == EventKind::Reset && event.actuator == actuator && event.part == part && event.t_ns <= until_ns
    };
    events.iter().filter(is_meant)
}

/// Replacements of the unit of an actuator up to a time, and how many of them its history has followed. The file only grows, so that one
/// more is a new one, whatever its time.
fn counts_of_unit(events: &[Event], actuator: &str, history: &UnitHistory, until_ns: u64) -> (u64, u64) {
    let count = |until_ns: u64| resets(events, actuator, None, until_ns).count() as u64;
    let before = || count(history.begun_ns.min(until_ns));
    (count(until_ns), history.events_followed.unwrap_or_else(before))
}

/// The note of an event, behind a colon.
fn noted(event: &Event) -> String {
    event.note.as_ref().map_or_else(String::new, |note| format!(": {note}"))
}
