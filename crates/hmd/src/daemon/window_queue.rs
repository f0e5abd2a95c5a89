//! The windows that wait for identification.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

// The model checker of `model/` compiles this file with locks of its own.
use super::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Windows that may wait: four from each of sixteen actuators, some 80 kB each at 2 kHz.
///
/// Policy when it is full: the oldest is dropped, so that the newest state of an actuator is assessed; the pushing thread
/// gets it back, to count and record it.
pub const QUEUE_WINDOWS: usize = 64;

/// A bounded queue that keeps the newest.
#[derive(Debug)]
pub(super) struct WindowQueue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    waiting: VecDeque<T>,
    closed: bool,
    /// When the window was taken that is being assessed.
    busy_since: Option<Instant>,
}

impl<T> WindowQueue<T> {
    pub(super) fn new() -> Self {
        Self {
            state: Mutex::new(State {
                waiting: VecDeque::new(),
                closed: false,
                busy_since: None,
            }),
            changed: Condvar::new(),
        }
    }

    /// Takes a window; gives back the oldest one when that is one too many.
    pub(super) fn push(&self, job: T) -> Option<T> {
        let mut state = self.lock();
        state.waiting.push_back(job);
        let dropped = if state.waiting.len() > QUEUE_WINDOWS {
            state.waiting.pop_front()
        } else {
            None
        };
        self.changed.notify_all();
        dropped
    }

    /// Takes a window when there is room for it, for the end of a run, when no newer one can come.
    pub(super) fn push_waiting(&self, job: T) {
        let mut state = self.lock();
        while state.waiting.len() >= QUEUE_WINDOWS && !state.closed {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.waiting.push_back(job);
        self.changed.notify_all();
    }

    /// The oldest window; waits for one. `None` when the queue is closed and empty.
    pub(super) fn pop(&self) -> Option<T> {
        let mut state = self.lock();
        state.busy_since = None;
        loop {
            if let Some(job) = state.waiting.pop_front() {
                state.busy_since = Some(Instant::now());
                self.changed.notify_all();
                return Some(job);
            }
            if state.closed {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Looks at the windows that wait, the oldest first.
    pub(super) fn look<R>(&self, look: impl FnOnce(&VecDeque<T>) -> R) -> R {
        look(&self.lock().waiting)
    }

    /// Windows that wait.
    pub(super) fn len(&self) -> usize {
        self.lock().waiting.len()
    }

    /// For how long the window that was taken last has been assessed; zero when none is.
    pub(super) fn busy_for(&self) -> Duration {
        self.lock().busy_since.map_or(Duration::ZERO, |since| since.elapsed())
    }

    /// No further windows will be pushed, or taken: either end may say so.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether either end has closed it.
    pub(super) fn is_closed(&self) -> bool {
        self.lock().closed
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
