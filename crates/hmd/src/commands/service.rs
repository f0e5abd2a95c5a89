//! What the service manager is told (`sd_notify`); without one, nothing happens.

use sd_notify::NotifyState;

/// Sources and output are open, or a reload is over.
pub(super) fn ready() {
    tell(&[NotifyState::Ready]);
}

/// Everything makes progress.
pub(super) fn alive() {
    tell(&[NotifyState::Watchdog]);
}

/// A reload begins; newer managers want to know since when.
pub(super) fn reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(since) => tell(&[NotifyState::Reloading, since]),
        Err(_) => tell(&[NotifyState::Reloading]),
    }
}

/// The end has begun.
pub(super) fn stopping() {
    tell(&[NotifyState::Stopping]);
}

fn tell(states: &[NotifyState<'_>]) {
    // Nobody is there to hear of a failure; a manager that hears nothing acts by itself.
    let _ = sd_notify::notify(states);
}
