//! A window that was not judged for want of time.

use super::schema::message;

message! {
    /// An actuation that was cut out and then dropped, because newer ones waited. Replay leaves it out as well.
    pub struct Dropped {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window, judged or not, from 0.
        window: u64 = 2 uint64;
        /// Start of the window, UTC ns.
        t_start_ns: u64 = 3 uint64;
    }
}

super::impl_record!(Dropped, |dropped| format!("/{}/dropped", dropped.actuator));
