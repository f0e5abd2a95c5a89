//! Counters of the whole process: loss is data.

use super::schema::message;

message! {
    /// Totals since the start (or since the start of a replay). Received = decoded + filtered + error + malformed
    /// frames, and the unreadable ones of serial lines.
    pub struct Status {
        /// Frames received from all sources.
        frames_received: u64 = 1 uint64;
        /// Frames that gave a value.
        frames_decoded: u64 = 2 uint64;
        /// Frames that no mapping wants.
        frames_filtered: u64 = 3 uint64;
        /// Error frames of the controllers.
        frames_error: u64 = 4 uint64;
        /// Complete samples of all actuators.
        samples: u64 = 5 uint64;
        /// Losses: lines of a text log, or serial frames, that could not be read.
        lost_unreadable: u64 = 11 uint64;
        /// Losses: frames in damaged or missing parts of a recorded file, as far as they can be counted.
        lost_damaged: u64 = 12 uint64;
        /// Losses: frames dropped by the kernel's receive queue.
        lost_socket_queue: u64 = 13 uint64;
        /// Losses: frames dropped because an own queue was full.
        lost_own_queue: u64 = 14 uint64;
        /// Losses: samples missing by their counters, or of an actuator that cannot be monitored at its sample rate.
        lost_samples: u64 = 15 uint64;
        /// Losses: frames of a mapped identifier whose content makes no sense.
        lost_malformed: u64 = 16 uint64;
        /// Losses: windows not judged for want of time or room.
        lost_windows: u64 = 17 uint64;
        /// Losses: frames that came after a newer sample of their actuator had begun, or in a log given after a later one.
        lost_late: u64 = 18 uint64;
        /// Windows with status `ok`.
        windows_ok: u64 = 21 uint64;
        /// Windows with status `degraded`.
        windows_degraded: u64 = 22 uint64;
        /// Windows with status `invalid`.
        windows_invalid: u64 = 23 uint64;
        /// Windows with status `unmodelled`.
        windows_unmodelled: u64 = 24 uint64;
        /// Interfaces; the two lists below have one entry for each.
        interface: Vec<String> = 31 string repeated;
        /// Error state: `error-active`, `error-warning`, `error-passive` or `bus-off`.
        bus_state: Vec<String> = 32 string repeated;
        /// Link, live only: `up`, `down` or `missing`.
        link: Vec<String> = 33 string repeated;
        /// Of the unreadable: serial frames longer than any packet.
        unreadable_too_long: u64 = 41 uint64;
        /// Of the unreadable: serial frames that are no COBS.
        unreadable_cobs: u64 = 42 uint64;
        /// Of the unreadable: serial frames with a wrong CRC.
        unreadable_crc: u64 = 43 uint64;
        /// Of the unreadable: serial frames of another version.
        unreadable_version: u64 = 44 uint64;
        /// Of the unreadable: serial frames whose CRC is right and whose content is no packet.
        unreadable_decode: u64 = 45 uint64;
    }
}

impl Status {
    /// Whether anything was lost on the way.
    #[must_use]
    pub fn data_lost(&self) -> bool {
        self.lost_unreadable
            + self.lost_damaged
            + self.lost_socket_queue
            + self.lost_own_queue
            + self.lost_samples
            + self.lost_malformed
            + self.lost_windows
            + self.lost_late
            > 0
    }
}

super::impl_record!(Status, |_status| "/hmd/status".to_owned());
