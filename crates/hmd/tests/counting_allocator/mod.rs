//! The system's allocator, counting what each thread asks of it and what the process holds.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

struct Counting;

thread_local! {
    static REQUESTS: Cell<u64> = const { Cell::new(0) };
}

static HELD: AtomicUsize = AtomicUsize::new(0);
static HELD_MAX: AtomicUsize = AtomicUsize::new(0);

/// Allocations of this thread since its start.
#[allow(dead_code, reason = "one of the binaries with this module does not need it")]
pub(crate) fn requests() -> u64 {
    REQUESTS.get()
}

/// What the process holds on the heap, bytes.
#[allow(dead_code, reason = "one of the binaries with this module does not need it")]
pub(crate) fn held_bytes() -> usize {
    HELD.load(Relaxed)
}

/// The most that the process held on the heap while `run` ran, beyond what it held before, bytes.
#[allow(dead_code, reason = "one of the binaries with this module does not need it")]
pub(crate) fn most_held_bytes<T>(run: impl FnOnce() -> T) -> (usize, T) {
    let before = HELD.load(Relaxed);
    HELD_MAX.store(before, Relaxed);
    let result = run();
    (HELD_MAX.load(Relaxed) - before, result)
}

fn grow(bytes: usize) {
    REQUESTS.set(REQUESTS.get() + 1);
    HELD_MAX.fetch_max(HELD.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

#[expect(
    unsafe_code,
    reason = "the one way to count allocations; every call goes to the system's allocator unchanged"
)]
// SAFETY: each method passes its arguments on to `System`, which upholds the contract; counting touches no memory of its own.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grow(layout.size());
        // SAFETY: as promised by the caller.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as promised by the caller.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;
