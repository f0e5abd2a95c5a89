//! What a replay found, and what it found instead of what is watched, in words.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::error::ReplayError;
use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::counted::counted;
use hmd_core::dbc::MessageUse;
use hmd_core::demux::FrameCounts;
use hmd_core::record::Status;
use hmd_core::talker::Talker;

/// What became of the data.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Counters of the whole run.
    pub status: Status,
    /// Actuators seen.
    pub actuators: u64,
    /// Windows.
    pub windows: u64,
    /// Frames by what they carry.
    pub frames: FrameCounts,
    /// Places where a recorded file is damaged, whether or not the frames lost there can be counted.
    pub damaged_places: u64,
    /// Windows that were assessed without the unit that their run had learnt, since it is neither in the logs nor kept.
    pub windows_without_unit: u64,
    /// Who talks, and nothing of it is used.
    pub talkers: BTreeSet<Talker>,
}

impl Summary {
    /// Whether anything was lost on the way.
    #[must_use]
    pub fn data_lost(&self) -> bool {
        self.loss().is_some()
    }

    /// Whether the logs had anything to assessor.
    ///
    /// # Errors
    /// No actuator, or no sample of one.
    pub fn check(&self, logs: &[PathBuf], config: &Config) -> Result<(), ReplayError> {
        let logs = || {
            let logs: Vec<String> = logs.iter().map(|log| log.display().to_string()).collect();
            logs.join(", ")
        };
        if self.actuators == 0 {
            return Err(ReplayError::NoActuator {
                logs: logs(),
                expected: watched(config),
                found: other_frames(&self.status, self.talkers.iter().copied()),
            });
        }
        if self.status.samples == 0 {
            let found = self.frames;
            return Err(ReplayError::NoSample { logs: logs(), found });
        }
        Ok(())
    }

    /// What was lost, in one sentence.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        let lost = self.status.lost_in_logs(self.damaged_places);
        let windows = self.windows_without_unit;
        let without = (windows > 0).then(|| {
            let windows = counted(windows, "window", "windows");
            format!("{windows} assessed without what was learnt of the unit")
        });
        let both: Vec<String> = lost.into_iter().chain(without).collect();
        (!both.is_empty()).then(|| both.join("; "))
    }
}

/// Most numbers that are named.
const NAMED_MAX: usize = 8;

/// The frames of others than the actuators watched, in words, and whose they are.
pub(crate) fn other_frames(status: &Status, talkers: impl Iterator<Item = Talker>) -> String {
    let found = match (status.frames_filtered, status.lost_malformed) {
        (other, 0) => counted(other, "other frame", "other frames"),
        (0, malformed) => counted(malformed, "malformed frame", "malformed frames"),
        (other, malformed) => format!(
            "{malformed} malformed and {}",
            counted(other, "other frame", "other frames")
        ),
    };
    let interfaces: Vec<&str> = status.interfaces.iter().map(|on| on.interface.as_str()).collect();
    let talkers: BTreeSet<Talker> = talkers.collect();
    let named: Vec<String> = talkers.iter().take(NAMED_MAX).map(ToString::to_string).collect();
    let more = if talkers.len() > NAMED_MAX { " and others" } else { "" };
    let of = if named.is_empty() {
        String::new()
    } else {
        format!(" of {}{more}", named.join(", "))
    };
    format!("{found}{of} on {}", interfaces.join(", "))
}

/// What is watched, in words: which frames on which bus.
pub(crate) fn watched(config: &Config) -> String {
    if config.is_auto() {
        return "an actuator with the identifiers of ema.dbc, or a configuration (-c) that maps the DBC file of this bus"
            .to_owned();
    }
    let one = |actuator: &ActuatorConfig| {
        let bus = actuator.bus.as_deref().unwrap_or("any bus");
        let ids: Vec<String> = actuator
            .map
            .iter()
            .flat_map(|map| &map.messages)
            .map(MessageUse::shown_id)
            .collect();
        if let Some(drive) = &actuator.drive_bus {
            let (preset, node) = (drive.settings().preset.name(), drive.settings().node);
            return format!("{} on {bus} ({preset} node {node})", actuator.name);
        }
        match ids.as_slice() {
            [] => format!("{} on {bus}", actuator.name),
            ids => format!("{} on {bus} ({})", actuator.name, ids.join(", ")),
        }
    };
    let all: Vec<String> = config.actuators().iter().map(one).collect();
    all.join(", ")
}
