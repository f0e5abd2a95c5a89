//! Windows as a controller records them, and what the host makes of the same windows.
#![allow(dead_code, reason = "not every user of this file needs all of it")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::relations::{BalanceShape, CommissionedRelations, MeasuredWindow, RelationsEstimate, commission};
use ema_identify::{
    ActuatorKnowledge, Estimate, Identifier, Method, Prepared, RecordedSample, RecordedWindow, StreamedWindow,
    identify_recorded,
};
use ema_models::reference::{CurrentSensing, Scenario};
use ema_models::{ActuatorParams, Conditions, FaultVector, MotorKnowledge, SensedSample, Setpoint, Tolerances};
use ema_wire::quantity::{current_ma, position_setpoint_urad, speed_setpoint_mrad_s};
use ema_wire::{ActuatorId, Mode, Sample, SerialPacket};
use firmware_image::StoredSample;
use hmd::unit_windows::windows_of;
use hmd_core::assess::{Assessor, Models, conditions};
use hmd_core::config::Config;

/// One window, for both.
pub(crate) struct Case {
    /// What the controller knows of its actuator.
    pub(crate) actuator: ActuatorKnowledge,
    /// Load, supply and temperature.
    pub(crate) conditions: Conditions,
    /// Samples before the trigger.
    pub(crate) rest: usize,
    /// The window as the controller records it.
    pub(crate) samples: Vec<StoredSample>,
    /// The host's identification by descents from health.
    pub(crate) identifier: Identifier,
    /// The host's window.
    pub(crate) prepared: Prepared,
}

/// Samples of [`worn`]: 20 ms before the trigger and 480 ms after, at 2 kHz.
const SAMPLES: usize = 1000;
const REST: usize = 40;

/// The window of a worn actuator with current noise: friction 0.4, backlash 0.1, a short of 0.15 in phase B.
pub(crate) fn worn() -> Case {
    let params = ActuatorParams::bench();
    let worn = FaultVector {
        friction: 0.4,
        backlash: 0.1,
        short_b: 0.15,
        ..FaultVector::NOMINAL
    };
    let scenario = noisy(params, worn, 7);
    let identifier = Identifier {
        params,
        calibration: TypeCalibration::built_in("bench", MonitorForm::ThreePhase).expect("a shipped calibration"),
        method: Method::LeastSquares,
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    };
    let conditions = Conditions {
        load_torque: Some(scenario.load_torque),
        v_dc: scenario.unit.motor.v_dc,
        winding_temp_deg_c: Some(scenario.winding_temp_deg_c),
    };
    Case::new(identifier, conditions, recorded(&scenario), REST)
}

/// Every default, and every number of the type known, as to the controller.
pub(crate) fn exact() -> Arc<Config> {
    let config = Config::from_toml_str("type.bench.tolerances = \"exact\"", "exact");
    Arc::new(config.expect("a configuration"))
}

/// What six healthy windows of the actuator of [`worn`] have in common.
pub(crate) fn commissioned() -> CommissionedRelations {
    let params = ActuatorParams::bench();
    let healthy: Vec<Vec<StoredSample>> = (20..26)
        .map(|seed| recorded(&noisy(params, FaultVector::NOMINAL, seed)))
        .collect();
    let windows: Vec<_> = healthy
        .iter()
        .map(|window| MeasuredWindow::new(&params, window, &[]))
        .collect();
    commission(&windows, &BalanceShape::usual(&params)).expect("healthy windows of one unit")
}

/// An actuation with 30 mA of noise and 12-bit converters.
fn noisy(params: ActuatorParams, fault: FaultVector, seed: u64) -> Scenario {
    Scenario {
        sensing: CurrentSensing {
            quantised: true,
            noise_rms: 0.03,
        },
        ..Scenario::new(params, fault, seed)
    }
}

/// The window of a log in `fixtures/logs`, as a replay with every default cuts it.
pub(crate) fn golden(log: &str) -> Case {
    let path = logs().join(log);
    let config = exact();
    // A log of another sample rate says so; nothing is lost in any.
    let found = windows_of(&[path], &config, None, &mut |_| ());
    let found = found.unwrap_or_else(|e| panic!("{log}: {e}"));
    assert!(!found.data_lost, "{log}: whole");
    let [job] = &found.jobs[..] else {
        panic!("{log}: expected one window")
    };
    assert!(job.window.filled.is_empty(), "{log}: every sample is there");
    let models = Models::without_files(&config).expect("the defaults name no file");
    let identifier = Identifier {
        method: Method::LeastSquares,
        ..Assessor::new(config, models, 1)
            .identifier_of(job)
            .expect("a known type")
    };
    let conditions = conditions(job).unwrap_or_else(|e| panic!("{log}: {e}"));
    let sensed = &job.window.samples;
    let samples: Vec<StoredSample> = sensed.iter().map(stored).collect();
    for (sensed, stored) in sensed.iter().zip(&samples) {
        assert_eq!(stored.sensed(sensed.seq), *sensed, "{log}: the words are the sample's");
    }
    Case::new(identifier, conditions, samples, job.window.trigger)
}

/// Names of the logs in `fixtures/logs`, sorted.
pub(crate) fn golden_logs() -> Vec<String> {
    let directory = logs();
    let entries = directory
        .read_dir()
        .unwrap_or_else(|e| panic!("{}: {e}", directory.display()));
    let mut names: Vec<String> = entries
        .flatten()
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| !name.ends_with(".truth.jsonl"))
        .collect();
    names.sort();
    assert!(!names.is_empty(), "{}: no logs", directory.display());
    names
}

fn logs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/logs")
}

impl Case {
    fn new(identifier: Identifier, conditions: Conditions, samples: Vec<StoredSample>, rest: usize) -> Self {
        let sensed: Vec<SensedSample> = (0..).zip(&samples).map(|(seq, stored)| stored.sensed(seq)).collect();
        let Identifier {
            params,
            calibration,
            motor,
            ..
        } = &identifier;
        Self {
            actuator: ActuatorKnowledge {
                params: *params,
                calibration: calibration.coefficients(),
                mismatch: *calibration.mismatch_near(params.sensors.sample_rate),
                motor: *motor,
            },
            conditions,
            rest,
            samples,
            prepared: Prepared::new(params, &sensed, &[], rest, None),
            identifier,
        }
    }

    /// What the controller finds.
    pub(crate) fn on_the_controller(&self) -> Estimate {
        let window = RecordedWindow::new(&self.actuator.params, &self.samples, self.rest).expect("a window");
        let streamed = StreamedWindow::new(&window, &self.actuator, self.conditions);
        identify_recorded(&streamed, &self.actuator.mismatch)
    }

    /// What the relations of a unit find, on either machine.
    pub(crate) fn by_relations(&self, unit: &CommissionedRelations) -> RelationsEstimate {
        unit.estimate(&MeasuredWindow::new(&self.actuator.params, &self.samples, &[]))
    }

    /// What the host finds by the same search.
    pub(crate) fn on_the_host(&self) -> Estimate {
        let found = self.identifier.identify(&self.prepared, self.conditions, 1);
        found.expect("descents have no settings")
    }
}

/// The first window of a scenario as the words that the actuator sends.
fn recorded(scenario: &Scenario) -> Vec<StoredSample> {
    let actuator = ActuatorId::new(0).expect("0 to 15");
    let sent: Vec<Sample> = firmware_sim::packets(scenario, actuator)
        .filter_map(|packet| match packet {
            SerialPacket::Sample(sample) => Some(sample),
            SerialPacket::Status { .. } => None,
        })
        .collect();
    let rest = sent[0].setpoint;
    let is_command = |sample: &Sample| (sample.setpoint - rest).abs() > 1000;
    let trigger = sent.iter().position(is_command).expect("an actuation");
    sent[trigger - REST..][..SAMPLES]
        .iter()
        .map(StoredSample::from)
        .collect()
}

/// A sample as the words it came from.
fn stored(sensed: &SensedSample) -> StoredSample {
    let (mode, setpoint) = match sensed.setpoint {
        Setpoint::Idle => (Mode::Idle, 0),
        Setpoint::Position(angle) => (Mode::Position, position_setpoint_urad(angle)),
        Setpoint::Speed(speed) => (Mode::Speed, speed_setpoint_mrad_s(speed)),
    };
    StoredSample {
        currents_ma: sensed.currents.map(current_ma),
        mode,
        motor_counts: i32::try_from(sensed.motor_counts).expect("a counter of 32 bits"),
        output_counts: i32::try_from(sensed.output_counts).expect("a counter of 24 bits"),
        setpoint,
    }
}
