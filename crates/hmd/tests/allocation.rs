//! Decoding and windowing take no memory from the heap for a sample, once they have what they need for a window.

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
    let scenario = Scenario {
        actuations: Actuations {
            count: 6,
            ..Actuations::one(Profile::Mixed)
        },
        ..Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 1)
    };
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let frames: Vec<_> = traffic(&scenario, ActuatorId::new(0).unwrap(), EPOCH_NS).collect();
    let mut pipeline = Pipeline::new(Arc::new(Config::default()));
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
