//! The histories of all actuators, and the maintenance events that reset them.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::clock_steps::is_set;
use super::maintenance::{Event, EventKind, Events, ReplacedPart};
use super::{ResumedState, RunEnd, UnitHistory};
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

    /// What holds of each actuator whose history of an earlier run will continue, by the maintenance events until now, UTC ns; not of those
    /// that got another unit since.
    pub fn restored_states(&self, now_ns: u64) -> impl Iterator<Item = (&str, ResumedState)> {
        self.restored.iter().filter_map(move |(name, history)| {
            let actuator = self.config.actuator_named(name)?;
            let is_of_unit = history.serial_number == actuator.serial_number;
            if !is_of_unit || !new_resets(&self.events.list, name, None, history, now_ns).is_empty() {
                return None;
            }
            // What the events reset now they reset again with the next window.
            let mut known = history.clone();
            follow(&mut known, &self.config, &self.events.list, actuator, now_ns).ok()?;
            Some((name.as_str(), known.resumed_state()))
        })
    }

    /// Counts the operation and the dropped windows of the actuators since their last windows in the run that ends; also of those that had none
    /// in it.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn end_run<'a>(&mut self, ends: impl Iterator<Item = (&'a str, RunEnd)>) -> Result<(), LevelsError> {
        for (name, end) in ends {
            let Some(actuator) = self.config.actuator_named(name) else {
                continue;
            };
            let is_of_unit = |history: &UnitHistory| history.serial_number == actuator.serial_number;
            if self.restored.get(name).is_some_and(is_of_unit)
                && let Some(history) = self.restored.remove(name)
            {
                let resumed = history.resumed(&self.config, actuator.serial_number.clone())?;
                self.histories.insert(name.to_owned(), resumed);
            }
            if let Some(history) = self.histories.get_mut(name) {
                history.count_rest(end);
            }
        }
        Ok(())
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
        self.notices.extend(events.ignored_entries(&self.events, &self.config));
        self.events = events;
    }

    /// Times of the maintenance events, UTC ns, that have replaced the unit of an actuator or a part of it by the time of a window, and that its
    /// history has not followed yet.
    #[must_use]
    pub fn replacements_to_follow(&self, actuator: &ActuatorConfig, t_ns: u64) -> Vec<u64> {
        let known = self
            .histories
            .get(&actuator.name)
            .or_else(|| self.restored.get(&actuator.name));
        let new = |history: &UnitHistory| {
            let of = |part| new_resets(&self.events.list, &actuator.name, part, history, t_ns);
            let events = EACH_PART_AND_THE_UNIT.into_iter().flat_map(of);
            events.map(|event| event.t_ns).collect()
        };
        known.map(new).unwrap_or_default()
    }

    /// Whether a maintenance event has replaced the unit of an actuator or a part of it after one time, UTC ns, and by another.
    #[must_use]
    pub fn is_replaced_between(&self, actuator: &ActuatorConfig, from_ns: u64, until_ns: u64) -> bool {
        EACH_PART_AND_THE_UNIT.into_iter().any(|part| {
            let mut resets = resets(&self.events.list, &actuator.name, part, until_ns);
            resets.any(|event| event.t_ns > from_ns)
        })
    }

    /// The history of an actuator at the time of a window, reset first by the maintenance events up to then. One that begins with this window
    /// has nothing that they could reset.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn history_at(&mut self, actuator: &ActuatorConfig, t_ns: u64) -> Result<&mut UnitHistory, LevelsError> {
        let (config, serial_number) = (&self.config, &actuator.serial_number);
        let history = match self.histories.entry(actuator.name.clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let history = match self.restored.remove(&actuator.name) {
                    Some(history) => {
                        if history.serial_number != *serial_number {
                            let [was, is] = [&history.serial_number, serial_number]
                                .map(|number| number.as_deref().unwrap_or("without a serial number"));
                            self.notices.push(format!(
                                "{}: another unit by its serial number ({was} before, {is} now): its history begins anew",
                                actuator.name
                            ));
                        }
                        history.resumed(config, serial_number.clone())?
                    }
                    None => UnitHistory::new(config, serial_number.clone())?,
                };
                let history = new.insert(history);
                if history.last.is_none() {
                    history.begin(&self.events.list, &actuator.name, t_ns);
                }
                history
            }
        };
        let notices = follow(history, config, &self.events.list, actuator, t_ns)?;
        self.notices.extend(notices);
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
        let mut notices = std::mem::take(&mut self.notices);
        for (actuator, history) in &mut self.histories {
            let of_history = std::mem::take(&mut history.notices);
            notices.extend(of_history.into_iter().map(|notice| format!("{actuator}: {notice}")));
        }
        notices
    }
}

/// Resets a history by the maintenance events up to a time, UTC ns, that it has not followed yet. Returns what an operator should read.
fn follow(
    history: &mut UnitHistory,
    config: &Config,
    events: &[Event],
    actuator: &ActuatorConfig,
    t_ns: u64,
) -> Result<Vec<String>, LevelsError> {
    let name = &actuator.name;
    let of_unit = new_resets(events, name, None, history, t_ns);
    let of_parts = ReplacedPart::ALL.map(|part| new_resets(events, name, Some(part), history, t_ns));
    let mut notices = Vec::new();
    let is_new_unit = !of_unit.is_empty();
    if let Some(newest) = of_unit.into_iter().max_by_key(|event| event.t_ns) {
        let mut anew = UnitHistory::new(config, actuator.serial_number.clone())?;
        anew.followed = history.followed.take();
        anew.last = history.last;
        *history = anew;
        history.begin(events, name, t_ns);
        history.note_replaced("unit");
        notices.push(format!("{name}: history reset by a maintenance event{}", noted(newest)));
    }
    for (part, new) in ReplacedPart::ALL.into_iter().zip(of_parts) {
        let Some(newest) = new.last() else { continue };
        // Parts of the unit before went with it. A clock that was never set tells no order.
        if newest.t_ns <= history.begun_ns && (is_new_unit || is_set(newest.t_ns)) {
            if !is_new_unit {
                notices.push(format!(
                    "{name}: {} replaced before the unit itself was: nothing begins anew; where that time is wrong, record the event again{}",
                    part.name(),
                    noted(newest)
                ));
            }
            continue;
        }
        history.replace(part, newest.t_ns);
        let faults: Vec<&str> = part.faults().iter().map(|fault| fault.plain_name()).collect();
        notices.push(format!(
            "{name}: {} replaced, its faults begin anew ({}){}",
            part.name(),
            faults.join(", "),
            noted(newest)
        ));
    }
    history
        .followed
        .get_or_insert_default()
        .add(FollowedEvents::until(t_ns, events, name));
    Ok(notices)
}

impl UnitHistory {
    /// Notes the events up to the time of the first window, UTC ns: the newest unit came with one, and parts of it since. They reset nothing.
    fn begin(&mut self, events: &[Event], actuator: &str, t_ns: u64) {
        let newest = |part| resets(events, actuator, part, t_ns).map(|event| event.t_ns).max();
        self.begun_ns = newest(None).unwrap_or(0);
        for part in ReplacedPart::ALL {
            if let Some(replaced_ns) = newest(Some(part)).filter(|replaced_ns| *replaced_ns > self.begun_ns) {
                self.sensors.forget(part.sensors(), replaced_ns);
            }
        }
        self.followed
            .get_or_insert_default()
            .add(FollowedEvents::until(t_ns, events, actuator));
    }
}

/// What a maintenance event may replace; `None` is the whole unit.
const EACH_PART_AND_THE_UNIT: [Option<ReplacedPart>; ReplacedPart::COUNT + 1] = [
    None,
    Some(ReplacedPart::Motor),
    Some(ReplacedPart::Gearbox),
    Some(ReplacedPart::Controller),
];

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

/// Those of [`resets`] that a history has not followed yet, in the order of time.
fn new_resets<'a>(
    events: &'a [Event],
    actuator: &'a str,
    part: Option<ReplacedPart>,
    history: &UnitHistory,
    until_ns: u64,
) -> Vec<&'a Event> {
    let has_followed = |nth: usize, event: &Event| match (&history.followed, part) {
        (Some(followed), part) => followed.of(part).contains(&event.t_ns),
        // Of an older file it is known how many were followed: as many.
        (None, Some(part)) => (nth as u64) < history.parts_followed[part as usize],
        (None, None) => match history.events_followed {
            Some(count) => (nth as u64) < count,
            None => event.t_ns <= history.begun_ns,
        },
    };
    let all = resets(events, actuator, part, until_ns).enumerate();
    all.filter(|(nth, event)| !has_followed(*nth, event))
        .map(|(_, event)| event)
        .collect()
}

/// Times of the maintenance events that a history has followed, UTC ns. They are remembered one by one: an event that is added later may have
/// an earlier time, where a clock was wrong, and the file may lose lines or be another one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct FollowedEvents {
    unit: BTreeSet<u64>,
    parts: [BTreeSet<u64>; ReplacedPart::COUNT],
}

impl FollowedEvents {
    /// All events of an actuator up to a time.
    fn until(until_ns: u64, events: &[Event], actuator: &str) -> Self {
        let times = |part| {
            let all = resets(events, actuator, part, until_ns);
            all.map(|event| event.t_ns).collect()
        };
        Self {
            unit: times(None),
            parts: ReplacedPart::ALL.map(|part| times(Some(part))),
        }
    }

    fn of(&self, part: Option<ReplacedPart>) -> &BTreeSet<u64> {
        part.map_or(&self.unit, |part| &self.parts[part as usize])
    }

    fn add(&mut self, others: Self) {
        self.unit.extend(others.unit);
        for (part, others) in self.parts.iter_mut().zip(others.parts) {
            part.extend(others);
        }
    }
}

/// The note of an event, behind a colon.
fn noted(event: &Event) -> String {
    event.note.as_ref().map_or_else(String::new, |note| format!(": {note}"))
}
