//! Nothing but its tests: the queue of windows, compiled from the daemon's own source, under a scheduler that tries orders; health,
//! learning, requests of an operator and the segment store, explored state by state.

#[cfg(test)]
mod health;
#[cfg(test)]
mod learning;
#[cfg(test)]
mod reload;
#[cfg(test)]
mod segment_store;

#[cfg(test)]
#[path = "../crates/hmd-core/src/learning/kept_windows.rs"]
mod kept_windows;
#[cfg(test)]
#[path = "../crates/hmd/src/commands/requests.rs"]
mod requests;

#[cfg(test)]
mod sync {
    pub(super) use shuttle::sync::{Condvar, Mutex, MutexGuard};
    pub(super) use std::sync::PoisonError;
}

#[cfg(test)]
#[path = "../crates/hmd/src/daemon/window_queue.rs"]
#[allow(dead_code, reason = "the daemon uses all of it")]
mod window_queue;

#[cfg(test)]
mod tests;
