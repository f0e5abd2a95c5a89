//! Actuators on the bench: their traffic, and the whole chain from frames to records, in virtual time.

use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd_core::assess::{AssessedWindow, Assessor, Models};
use hmd_core::config::Config;
use hmd_core::demux::{Demux, FrameCounts};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_lab::simulate::{EPOCH_NS, traffic};

/// A `bench` unit at 400 Hz with 12-bit converters and 50 mA rms of noise, one mixed actuation after 60 ms of rest.
pub(crate) fn unit(fault: FaultVector, seed: u64) -> Scenario {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    Scenario {
        sensing: CurrentSensing {
            quantised: true,
            noise_rms: 0.05,
        },
        actuations: Actuations {
            rest: 0.06,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(params, fault, seed)
    }
}

/// Frames of a unit from the epoch on, on bus 0.
pub(crate) fn frames(scenario: &Scenario, actuator: u8) -> Vec<RawFrame> {
    let id = ActuatorId::new(actuator).expect("0 to 15");
    traffic(scenario, id, EPOCH_NS).collect()
}

/// What came of some frames.
pub(crate) struct Outcome {
    /// Records of all windows, in order.
    pub(crate) windows: Vec<AssessedWindow>,
    /// Frames by what became of them.
    pub(crate) frames: FrameCounts,
    /// Samples missing by their counters.
    pub(crate) lost: u64,
}

/// Settings under which every number of the type is known, as of the simulated units here.
pub(crate) const EXACT: &str = "type.bench.tolerances = \"exact\"\n";

/// The whole chain over one stream of frames, with the settings of [`EXACT`].
pub(crate) fn watch(frames: impl IntoIterator<Item = RawFrame>) -> Outcome {
    watch_all([frames])
}

/// The same over one stream after the other, each to its end, as the logs of several sorties.
pub(crate) fn watch_all(streams: impl IntoIterator<Item = impl IntoIterator<Item = RawFrame>>) -> Outcome {
    watch_all_with(Config::from_toml_str(EXACT, "test").expect("a configuration"), streams)
}

/// The same with other settings.
pub(crate) fn watch_all_with(
    config: Config,
    streams: impl IntoIterator<Item = impl IntoIterator<Item = RawFrame>>,
) -> Outcome {
    let config = Arc::new(config);
    let mut names = BusNames::new();
    names.intern("can0").expect("room for one interface");
    let (mut demux, mut assessor) = (
        Demux::new(config.clone()),
        Assessor::new(config.clone(), Models::without_files(&config).expect("no files"), 1),
    );
    let mut windows = Vec::new();
    for stream in streams {
        for frame in stream {
            demux.push(&frame, &names);
            windows.extend(
                demux
                    .take_windows()
                    .into_iter()
                    .map(|job| assessor.assess(job).expect("a usable configuration")),
            );
        }
        demux.finish();
        windows.extend(
            demux
                .take_windows()
                .into_iter()
                .map(|job| assessor.assess(job).expect("a usable configuration")),
        );
    }
    // The default type is sampled at 2 kHz, and every sortie starts its counter anew; nothing else may be worth a notice.
    assert!(
        demux
            .take_notices()
            .iter()
            .all(|notice| ["found 400.0", "found one that went back"]
                .iter()
                .any(|known| notice.message.contains(known))),
        "other notices"
    );
    Outcome {
        windows,
        frames: demux.counts(),
        lost: demux.actuators().map(|(_, _, counts)| counts.lost).sum(),
    }
}

impl Outcome {
    /// The only window.
    pub(crate) fn window(&self) -> &AssessedWindow {
        assert_eq!(self.windows.len(), 1, "windows");
        &self.windows[0]
    }

    /// Names of the detected faults, per window.
    pub(crate) fn faults(&self) -> Vec<&str> {
        self.windows
            .iter()
            .map(|assessed| assessed.health.faults.as_str())
            .collect()
    }
}
