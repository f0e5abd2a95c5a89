//! Decoding and windowing take no memory from the heap for a sample, once they have what they need for a window.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::sync::Arc;

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::pipeline::Pipeline;
use hmd_lab::simulate::{EPOCH_NS, traffic};

use crate::ALONE;
use crate::counting_allocator::requests;

#[test]
fn no_sample_takes_memory() {
    assert_no_sample_takes_memory(Config::default());
}

/// The built-in dictionary, by its DBC file.
const MAP: &str = r#"
[[actuator]]
id = 0
dbc = "ema.dbc"
[actuator.signals]
currents.a = "EMA0_Currents.i_a"
currents.b = "EMA0_Currents.i_b"
currents.c = "EMA0_Currents.i_c"
position.motor = "EMA0_Position.motor_counts"
position.output = "EMA0_Position.output_counts"
command.position = { signal = "EMA0_Command.setpoint", unit = "urad" }
command.mode = "EMA0_Command.mode"
sample.counter = ["EMA0_Currents.seq", "EMA0_Position.seq8", "EMA0_Command.seq8"]
sample.time = "EMA0_Command.time_us"
status.dc_link = "EMA0_Status.dc_link"
"#;

#[test]
fn no_sample_of_a_mapped_bus_takes_memory() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/hmd.toml");
    assert_no_sample_takes_memory(hmd_storage::config_file::config_from_text(MAP, file).unwrap());
}

fn assert_no_sample_takes_memory(config: Config) {
    let _alone = ALONE.lock();
    let scenario = Scenario {
        actuations: Actuations {
            count: 6,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 1)
    };
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let frames: Vec<_> = traffic(&scenario, ActuatorId::new(0).unwrap(), EPOCH_NS).collect();
    let mut pipeline = Pipeline::new(Arc::new(config));
    let (mut windows, mut steady, mut taken) = (0, 0u64, 0);
    for frame in &frames {
        let before = requests();
        pipeline.push(frame, &names);
        let ended = pipeline.take_windows();
        let asked = requests() - before;
        if ended.is_empty() {
            // The first window sets the sizes; only the one that ends may take memory, for itself.
            if windows > 0 {
                (steady, taken) = (steady + 1, taken + asked);
            }
        } else {
            assert!(asked > 0, "the counter counts");
            windows += ended.len();
        }
    }
    assert!(windows >= 5 && steady > 10_000, "{windows} windows, {steady} frames");
    assert_eq!(taken, 0, "allocations in {steady} frames");
}
