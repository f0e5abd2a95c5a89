//! What the records say of the present.

use std::collections::{BTreeMap, VecDeque};

use prost::{DecodeError, Message};

use hmd_core::record::{Health, LastShown, Log, LogLevel, PACKAGE, Record, Rul, Sensors, Status, Window};
use hmd_storage::mcap::McapMessage;

/// Most actuators that are known: sixteen on each of 64 interfaces, which is all that the daemon takes.
const ACTUATORS_MAX: usize = 1024;

/// Events that are kept, the newest.
pub(super) const EVENTS_MAX: usize = 100;

/// The newest records of one actuator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// Of the newest window.
    pub health: Health,
    /// Of the newest window that was assessed.
    pub assessed: Option<Health>,
    /// What the windows so far have shown of each fault.
    pub shown: LastShown,
    /// What was left after the newest window; `None` until that is read.
    pub rul: Option<Rul>,
    /// Its sensors by the newest window that has them; older files have none.
    pub sensors: Sensors,
    /// The newest window, without its samples.
    pub window: Option<Window>,
}

/// A line for an operator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// UTC, ns.
    pub at_ns: u64,
    /// How grave it is.
    pub level: LogLevel,
    /// The text.
    pub message: String,
}

/// The newest records of all actuators and of the process that wrote them. Bounded, whatever is read.
#[derive(Clone, Debug, Default)]
pub struct State {
    actuators: BTreeMap<String, Known>,
    status: Option<(u64, Status)>,
    events: VecDeque<Event>,
    newest_ns: u64,
    /// Records of ours so far.
    pub records: u64,
    /// Places in the files, or records, that could not be read.
    pub damaged: u64,
    /// Records of actuators beyond the limit.
    pub refused: u64,
}

impl State {
    /// Takes one message; those that are none of ours are left alone.
    pub fn add_message(&mut self, message: &McapMessage) {
        match self.decode(message) {
            Ok(true) => self.records += 1,
            Ok(false) => {}
            Err(_) => self.damaged += 1,
        }
    }

    /// Whether it was one of ours.
    fn decode(&mut self, message: &McapMessage) -> Result<bool, DecodeError> {
        let (data, at_ns) = (message.data.as_slice(), message.log_time_ns);
        match &*message.schema {
            Window::SCHEMA_NAME => self.window(Window::decode(data)?),
            Health::SCHEMA_NAME => self.health(Health::decode(data)?),
            Rul::SCHEMA_NAME => self.rul(Rul::decode(data)?),
            Sensors::SCHEMA_NAME => self.sensors(Sensors::decode(data)?),
            Status::SCHEMA_NAME => {
                self.status = Some((at_ns, Status::decode(data)?));
                // The writer's clock, even where it was set back.
                self.newest_ns = at_ns;
            }
            Log::SCHEMA_NAME => self.event(at_ns, Log::decode(data)?),
            // Frames and dropped windows show that the file is being written.
            name if name.starts_with(PACKAGE) => {}
            _ => return Ok(false),
        }
        self.newest_ns = self.newest_ns.max(at_ns);
        Ok(true)
    }

    /// Time of the newest record, UTC, ns.
    #[must_use]
    pub fn newest_ns(&self) -> u64 {
        self.newest_ns
    }

    /// The newest counters and when they were written, UTC, ns.
    #[must_use]
    pub fn status(&self) -> Option<&(u64, Status)> {
        self.status.as_ref()
    }

    /// What is known of an actuator.
    #[must_use]
    pub fn actuator(&self, actuator: &str) -> Option<&Known> {
        self.actuators.get(actuator)
    }

    /// The actuators: those that are watched, in the order of the configuration, where the counters name them (a live run);
    /// else all that had a window.
    #[must_use]
    pub fn names(&self) -> Vec<&str> {
        let watched = self
            .status
            .iter()
            .flat_map(|(_, status)| &status.actuators)
            .map(|of| &of.actuator);
        let watched: Vec<&str> = watched.take(ACTUATORS_MAX).map(String::as_str).collect();
        if watched.is_empty() {
            self.actuators.keys().map(String::as_str).collect()
        } else {
            watched
        }
    }

    /// Events, the oldest first.
    pub fn events(&self) -> impl DoubleEndedIterator<Item = &Event> + ExactSizeIterator {
        self.events.iter()
    }

    fn known(&mut self, actuator: &str) -> Option<&mut Known> {
        if self.actuators.len() >= ACTUATORS_MAX && !self.actuators.contains_key(actuator) {
            self.refused += 1;
            return None;
        }
        Some(self.actuators.entry(actuator.to_owned()).or_default())
    }

    fn window(&mut self, mut window: Window) {
        for samples in [
            &mut window.time_s,
            &mut window.setpoint,
            &mut window.measured_i_q_a,
            &mut window.fitted_i_q_a,
            &mut window.measured_speed_rad_s,
            &mut window.fitted_speed_rad_s,
            &mut window.measured_position_rad,
            &mut window.fitted_position_rad,
        ] {
            *samples = Vec::new();
        }
        if let Some(known) = self.known(&window.actuator.clone()) {
            known.window = Some(window);
        }
    }

    fn health(&mut self, health: Health) {
        let Some(known) = self.known(&health.actuator.clone()) else {
            return;
        };
        if health.estimate().is_some() {
            known.assessed = Some(health.clone());
        }
        known.shown.update(&health);
        known.health = health;
        known.rul = None;
    }

    fn rul(&mut self, rul: Rul) {
        if let Some(known) = self
            .known(&rul.actuator.clone())
            .filter(|known| known.health.window == rul.window)
        {
            known.rul = Some(rul);
        }
    }

    fn sensors(&mut self, sensors: Sensors) {
        if let Some(known) = self.known(&sensors.actuator.clone()) {
            known.sensors = sensors;
        }
    }

    fn event(&mut self, at_ns: u64, log: Log) {
        if self.events.len() == EVENTS_MAX {
            self.events.pop_front();
        }
        let level = LogLevel::try_from(log.level).unwrap_or(LogLevel::Unknown);
        self.events.push_back(Event {
            at_ns,
            level,
            message: log.message,
        });
    }
}
