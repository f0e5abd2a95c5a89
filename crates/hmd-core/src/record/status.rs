//! Counters of the whole process: loss is data.

use super::schema::message;
use crate::counted::counted;

message! {
    /// Totals since the start (or since the start of a replay). Received = decoded + filtered + error + malformed
    /// frames, and the unreadable ones of serial lines.
    pub struct Status
        reserved 14 "lost_own_queue" reserved 31 "interface" reserved 32 "bus_state" reserved 33 "link" reserved 71 "actuator"
        reserved 72 "data_age_s" reserved 73 "data_state" reserved 74 "health" reserved 75 "persistence"
        reserved 76 "changed_ns" reserved 77 "changed_from" reserved 78 "changed_faults" reserved 79 "changed_damage"
        reserved 80 "passive"
    {
        /// Frames received from all sources.
        frames_received: u64 = 1 uint64;
        /// Frames that gave a value.
        frames_decoded: u64 = 2 uint64;
        /// Frames of no monitored actuator.
        frames_filtered: u64 = 3 uint64;
        /// Error frames of the controllers.
        frames_error: u64 = 4 uint64;
        /// Complete samples of all actuators.
        samples: u64 = 5 uint64;
        /// Times a sample counter began anew or went back: a device restarted.
        device_restarts: u64 = 6 uint64;
        /// Times the samples of an actuator changed their rate.
        rate_changes: u64 = 7 uint64;
        /// Losses: lines of a text log, or serial frames, that could not be read.
        lost_unreadable: u64 = 11 uint64;
        /// Losses: frames in damaged or missing parts of a recorded file, as far as they can be counted.
        lost_damaged: u64 = 12 uint64;
        /// Losses: frames dropped by the kernel's receive queue.
        lost_socket_queue: u64 = 13 uint64;
        /// Losses: samples missing by their counters, or of an actuator that cannot be monitored at its sample rate.
        lost_samples: u64 = 15 uint64;
        /// Losses: frames of a mapped identifier whose content makes no sense.
        lost_malformed: u64 = 16 uint64;
        /// Losses: windows not assessed for want of time or room.
        lost_windows: u64 = 17 uint64;
        /// Losses: frames that came after a newer sample of their actuator had begun, or in a log given after a later one.
        lost_late: u64 = 18 uint64;
        /// Losses: frames that were not stored, or are not known to be, because the storage failed or had no room.
        lost_storage_frames: u64 = 19 uint64;
        /// Losses: records of all other kinds, the same.
        lost_storage_records: u64 = 20 uint64;
        /// Windows with status `ok`.
        windows_ok: u64 = 21 uint64;
        /// Windows with status `degraded`.
        windows_degraded: u64 = 22 uint64;
        /// Windows with status `invalid`.
        windows_invalid: u64 = 23 uint64;
        /// Windows with status `unmodelled`.
        windows_unmodelled: u64 = 24 uint64;
        /// Losses: windows whose frames were to be stored and were no longer there, or not all.
        lost_captures: u64 = 25 uint64;
        /// The interfaces, in the order of their sources.
        interfaces: Vec<InterfaceStatus> = 34 message repeated InterfaceStatus;
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
        /// Storage in a folder: `ok`, `raw-paused` for want of room, or `failing`; empty without one.
        storage: String = 51 string;
        /// Bytes of all segments.
        storage_used_bytes: u64 = 52 uint64;
        /// Bytes free on their file system.
        storage_free_bytes: u64 = 53 uint64;
        /// Segments.
        storage_segments: u64 = 54 uint64;
        /// Segments deleted to make room.
        storage_deleted: u64 = 55 uint64;
        /// Live only: inputs that wait for the pipeline.
        queued_inputs: u64 = 61 uint64;
        /// Live only: windows that wait for identification.
        queued_windows: u64 = 62 uint64;
        /// Live only: time spent on identification, s.
        identification_s: f64 = 63 double;
        /// Live only: the longest that one window took, s.
        identification_max_s: f64 = 64 double;
        /// Live only: time since the newest health record was stored, s; absent before the first.
        record_age_s: Option<f64> = 65 double optional;
        /// Live only: the actuators that are watched.
        actuators: Vec<ActuatorStatus> = 81 message repeated ActuatorStatus;
    }
}

message! {
    /// One interface.
    pub struct InterfaceStatus {
        /// Name of the interface.
        interface: String = 1 string;
        /// Error state: `error-active`, `error-warning`, `error-passive` or `bus-off`.
        bus_state: String = 2 string;
        /// Link, live only: `up`, `down` or `missing`.
        link: String = 3 string;
        /// Whether all actuators on it are passive, live only: that it brings no frames raises no alarm.
        passive: bool = 4 bool;
    }
}

message! {
    /// One actuator that is watched live.
    pub struct ActuatorStatus {
        /// Actuator name, as in the topics.
        actuator: String = 1 string;
        /// Time since the newest sample, or since the start, s; to a second.
        data_age_s: f64 = 2 double;
        /// `fresh` or `STALE`.
        data_state: String = 3 string;
        /// State by the last window: `nominal`, `watch`, `warning`, `critical` or `unknown`.
        health: String = 4 string;
        /// Windows in a row that ask for a worse state.
        persistence: u64 = 5 uint64;
        /// Last change of the state: start of its window, UTC ns; 0 before the first.
        changed_ns: u64 = 6 uint64;
        /// State before the last change; empty before the first.
        changed_from: String = 7 string;
        /// Faults after the last change, joined by commas.
        changed_faults: String = 8 string;
        /// Largest damage in the window of the last change, 0…1.
        changed_damage: f64 = 9 double;
        /// Whether changes of its state raise no alarm.
        passive: bool = 10 bool;
        /// Level of its sensors by the last window, as `health`.
        sensors: String = 11 string;
    }
}

/// Whether samples of an actuator come in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataState {
    /// A sample came lately.
    Fresh,
    /// No sample came for a while.
    Stale,
}

impl DataState {
    /// The name that records use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fresh => "fresh",
            Self::Stale => "STALE",
        }
    }
}

impl ActuatorStatus {
    /// Whether the data of the actuator are stale.
    #[must_use]
    pub fn is_stale(&self) -> bool {
        self.data_state == DataState::Stale.name()
    }
}

/// How the storage of a folder of segments stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StorageState {
    /// Everything is stored.
    #[default]
    Ok,
    /// Raw frames are not stored, for want of room.
    RawPaused,
    /// Writing fails.
    Failing,
}

impl StorageState {
    /// All, from good to bad.
    pub const ALL: [Self; 3] = [Self::Ok, Self::RawPaused, Self::Failing];

    /// The name that records use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::RawPaused => "raw-paused",
            Self::Failing => "failing",
        }
    }
}

/// What became of the data, and what lies on the disk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StoreStatus {
    /// Frames that were not stored, or are not known to be.
    pub lost_frames: u64,
    /// Records of all other kinds, the same.
    pub lost_records: u64,
    /// Bytes of all segments.
    pub used_bytes: u64,
    /// Bytes free for an ordinary user; 0 when that is unknown.
    pub free_bytes: u64,
    /// Segments on the disk.
    pub segments: u64,
    /// Segments deleted to make room, since the start.
    pub deleted: u64,
    /// How the storage stands.
    pub state: StorageState,
}

impl Status {
    /// What was lost, by cause.
    #[must_use]
    pub fn losses(&self) -> [(&'static str, u64); 10] {
        [
            ("unreadable", self.lost_unreadable),
            ("damaged", self.lost_damaged),
            ("socket_queue", self.lost_socket_queue),
            ("samples", self.lost_samples),
            ("malformed", self.lost_malformed),
            ("windows", self.lost_windows),
            ("late", self.lost_late),
            ("storage_frames", self.lost_storage_frames),
            ("storage_records", self.lost_storage_records),
            ("captures", self.lost_captures),
        ]
    }

    /// Whether anything was lost on the way.
    #[must_use]
    pub fn data_lost(&self) -> bool {
        self.losses().iter().any(|(_, count)| *count > 0)
    }

    /// What was lost in recorded logs, in one sentence, beside a number of damaged places of a file whether or not the frames
    /// lost there can be counted; `None` if nothing was.
    #[must_use]
    pub fn lost_in_logs(&self, damaged_places: u64) -> Option<String> {
        if !self.data_lost() && damaged_places == 0 {
            return None;
        }
        let counts = [
            (
                self.lost_unreadable,
                "unreadable line or frame",
                "unreadable lines or frames",
            ),
            (damaged_places, "damaged place of a file", "damaged places of a file"),
            (self.lost_damaged, "frame missing by count", "frames missing by count"),
            (self.lost_malformed, "malformed frame", "malformed frames"),
            (self.lost_samples, "sample", "samples"),
            (self.lost_late, "frame out of order", "frames out of order"),
            (
                self.lost_windows,
                "window that the live run did not assess",
                "windows that the live run did not assess",
            ),
        ];
        let lost = counts.iter().filter(|(count, ..)| *count > 0);
        let lost: Vec<String> = lost.map(|(count, one, many)| counted(*count, one, many)).collect();
        Some(format!("data lost: {}", lost.join(", ")))
    }

    /// Takes over how the storage stands.
    pub fn set_storage(&mut self, store: &StoreStatus) {
        self.lost_storage_frames = store.lost_frames;
        self.lost_storage_records = store.lost_records;
        self.storage = store.state.name().to_owned();
        self.storage_used_bytes = store.used_bytes;
        self.storage_free_bytes = store.free_bytes;
        self.storage_segments = store.segments;
        self.storage_deleted = store.deleted;
    }
}

super::impl_record!(Status, |_status| "/hmd/status".to_owned());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_loss_that_a_log_can_have_is_in_the_sentence() {
        assert_eq!(Status::default().lost_in_logs(0), None);
        let dropped = Status {
            lost_windows: 7,
            ..Status::default()
        };
        assert_eq!(
            dropped.lost_in_logs(2).unwrap(),
            "data lost: 2 damaged places of a file, 7 windows that the live run did not assess"
        );
    }
}
