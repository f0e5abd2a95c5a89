//! Notifications to the service manager (`sd_notify`); without one, nothing happens.

use sd_notify::NotifyState;

/// Sources and output are open, or a reload is over.
pub(super) fn ready() {
    notify(&[NotifyState::Ready]);
}

/// Everything makes progress.
pub(super) fn heartbeat() {
    notify(&[NotifyState::Watchdog]);
}

/// A reload begins; newer managers want to know since when.
pub(super) fn reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(since) => notify(&[NotifyState::Reloading, since]),
        Err(_) => notify(&[NotifyState::Reloading]),
    }
}

/// The end has begun.
pub(super) fn stopping() {
    notify(&[NotifyState::Stopping]);
}

fn notify(states: &[NotifyState<'_>]) {
    // A failure cannot be reported; a manager that gets no notification acts by itself.
    let _ = sd_notify::notify(states);
}
