//! What was entered of maintenance, and of which unit it is.

use hmd_core::config::Config;
use hmd_core::history::{Event, EventKind, Events};

/// What stands between the name of an actuator and its serial number, where units have one name.
pub(super) const SERIAL: &str = ", serial ";

/// What was entered of maintenance, and when a page is made.
#[derive(Clone, Copy, Debug)]
pub struct Maintenance<'a> {
    /// The events of a configuration.
    pub events: &'a Events,
    /// That configuration.
    pub config: &'a Config,
    /// The present, UTC ns: what is still to come changes nothing.
    pub now_ns: u64,
}

impl<'a> Maintenance<'a> {
    /// The replacements until now that are of the unit of this name. Of units that have one name an event is of that with the configuration's
    /// serial number, without one of each.
    pub(super) fn replacements_of(&self, unit: &str) -> impl Iterator<Item = &'a Event> {
        let Self { events, config, now_ns } = *self;
        let is_meant = move |event: &Event| {
            let is_about = |serial: Option<&str>| event.is_about(&event.actuator, serial, config);
            match unit.strip_prefix(&*event.actuator) {
                Some("") => is_about(None),
                Some(rest) => rest.strip_prefix(SERIAL).is_some_and(|serial| is_about(Some(serial))),
                None => false,
            }
        };
        let has_come = move |event: &Event| event.event == EventKind::Reset && event.t_ns <= now_ns;
        events
            .list
            .iter()
            .filter(move |event| has_come(event) && is_meant(event))
    }
}
