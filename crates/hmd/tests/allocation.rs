//! Decoding and windowing take no memory from the heap for a sample, once they have what they need for a window.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::config::Config;
use hmd::frame::BusNames;
use hmd::pipeline::Pipeline;
use hmd::simulate::{EPOCH_NS, traffic};

/// The system's allocator, counting what each thread asks of it.
struct Counting;

thread_local! {
    static ASKED: Cell<u64> = const { Cell::new(0) };
}

#[expect(
    unsafe_code,
    reason = "the one way to count allocations; every call goes to the system's allocator unchanged"
)]
// SAFETY: each method passes its arguments on to `System`, which upholds the contract; counting touches no memory of its own.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ASKED.set(ASKED.get() + 1);
        // SAFETY: as promised by the caller.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as promised by the caller.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ASKED.set(ASKED.get() + 1);
        // SAFETY: as promised by the caller.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

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
    assert_no_sample_takes_memory(Config::from_toml_str(MAP, file).unwrap());
}

fn assert_no_sample_takes_memory(config: Config) {
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
    let mut ended = Vec::with_capacity(16);
    let (mut windows, mut steady, mut taken) = (0, 0u64, 0);
    for frame in &frames {
        let before = ASKED.get();
        pipeline.push(frame, &names, &mut ended);
        let asked = ASKED.get() - before;
        if ended.is_empty() {
            // The first window sets the sizes; only the one that ends may take memory, for itself.
            if windows > 0 {
                (steady, taken) = (steady + 1, taken + asked);
            }
        } else {
            assert!(asked > 0, "the counter counts");
            windows += ended.drain(..).count();
        }
    }
    assert!(windows >= 5 && steady > 10_000, "{windows} windows, {steady} frames");
    assert_eq!(taken, 0, "allocations in {steady} frames");
}
