//! What a live run has decided, beside its raw frames: which windows it assessed, and that it came to its end.

use super::schema::message;

message! {
    /// A window that was assessed, stored and counted in the unit history. Of the last windows of a run, a replay gives those alone that have
    /// one: others were under way when the run was killed.
    pub struct Assessed {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window, assessed or not, from 0.
        window: u64 = 2 uint64;
        /// Start of the window, UTC ns.
        t_start_ns: u64 = 3 uint64;
        /// By what it was assessed where the daemon learns the unit ([`super::UnitMark`]).
        unit: String = 4 string;
        /// Times of the maintenance events that were followed with it, UTC ns: replacements that reset the unit history.
        events_ns: Vec<u64> = 5 uint64 repeated;
    }
}

super::impl_record!(Assessed, |assessed| format!("/{}/assessed", assessed.actuator));

message! {
    /// The end of a run that was not killed: its unit histories have the time of operation up to there.
    pub struct Ended {
        /// When, UTC ns.
        t_ns: u64 = 1 uint64;
    }
}

super::impl_record!(Ended, |_ended| "/hmd/ended".to_owned());
