//! The windows that wait for identification.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

// The model checker of `model/` compiles this file with locks of its own.
use super::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Windows that may wait: four from each of sixteen actuators, some 80 kB each at 2 kHz. Those being assessed, at most two for each thread,
/// are not among them.
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
    /// Time after which the popping thread takes no further window; of a clock that the queue does not read.
    ends: Option<Duration>,
    /// Since when the windows that were taken together have been assessed, or the last of them was, and how many are left.
    busy: Option<(Instant, u64)>,
}

impl<T> WindowQueue<T> {
    pub(super) fn new() -> Self {
        Self {
            state: Mutex::new(State {
                waiting: VecDeque::new(),
                closed: false,
                ends: None,
                busy: None,
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

    /// Takes a window however many wait, for the end of a run, when no newer one can come.
    pub(super) fn push_last(&self, job: T) {
        self.lock().waiting.push_back(job);
        self.changed.notify_all();
    }

    /// The oldest window; waits for one. `None` when the queue is closed and empty.
    #[cfg(test)]
    pub(super) fn pop(&self) -> Option<T> {
        self.pop_some(|_| 1)?.pop()
    }

    /// The oldest windows, as many as wanted of those that wait, and one at least; waits for one. `None` when the queue is closed and
    /// empty.
    pub(super) fn pop_some(&self, wanted: impl Fn(&VecDeque<T>) -> usize) -> Option<Vec<T>> {
        let mut state = self.lock();
        if state.busy.take().is_some() {
            self.changed.notify_all();
        }
        loop {
            if !state.waiting.is_empty() {
                let count = wanted(&state.waiting).clamp(1, state.waiting.len());
                let taken: Vec<T> = state.waiting.drain(..count).collect();
                state.busy = Some((Instant::now(), count as u64));
                self.changed.notify_all();
                return Some(taken);
            }
            if state.closed {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// One of the windows that were taken together is assessed.
    pub(super) fn one_done(&self) {
        let mut state = self.lock();
        if let Some((since, windows @ 2..)) = &mut state.busy {
            (*since, *windows) = (Instant::now(), *windows - 1);
        }
    }

    /// Takes back windows that were taken and not assessed, before those that wait.
    pub(super) fn give_back(&self, windows: impl DoubleEndedIterator<Item = T>) {
        let mut state = self.lock();
        for window in windows.rev() {
            state.waiting.push_front(window);
        }
    }

    /// Looks at the windows that wait, the oldest first.
    pub(super) fn look<R>(&self, look: impl FnOnce(&VecDeque<T>) -> R) -> R {
        look(&self.lock().waiting)
    }

    /// Windows that wait or are being assessed.
    pub(super) fn unassessed(&self) -> u64 {
        let state = self.lock();
        state.waiting.len() as u64 + state.busy.map_or(0, |(_, windows)| windows)
    }

    /// Windows that wait.
    pub(super) fn len(&self) -> usize {
        self.lock().waiting.len()
    }

    /// For how long no window was assessed of those that were taken; zero when none are left.
    pub(super) fn busy_for(&self) -> Duration {
        self.lock().busy.map_or(Duration::ZERO, |(since, _)| since.elapsed())
    }

    /// The run ends: no further window is to be popped from this time on.
    pub(super) fn end_by(&self, time: Duration) {
        self.lock().ends = Some(time);
    }

    /// Whether the time has come from which on no further window is to be popped.
    pub(super) fn is_over(&self, now: Duration) -> bool {
        self.lock().ends.is_some_and(|ends| now >= ends)
    }

    /// Waits until all windows are assessed or an end has closed the queue, for a time at most. Whether it is so.
    pub(super) fn wait_idle(&self, within: Duration) -> bool {
        let is_busy = |state: &mut State<T>| !state.closed && (!state.waiting.is_empty() || state.busy.is_some());
        let waited = self.changed.wait_timeout_while(self.lock(), within, is_busy);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        !is_busy(&mut state)
    }

    /// Takes out all windows that wait.
    pub(super) fn take_all(&self) -> VecDeque<T> {
        std::mem::take(&mut self.lock().waiting)
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
