//! What a run of the program borrows, and what it tells: clock and observer.

use std::io;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use hmd::daemon::Observer;
use hmd_core::assess::AssessedWindow;
use hmd_core::deadline::Clock;
use hmd_core::record::Health;

use crate::clock::WorldClock;
use crate::disk::WorldDisk;

/// One window as it was reported.
#[derive(Clone, Debug)]
pub(crate) struct Reported {
    /// Run of the program.
    pub run: usize,
    /// Its records were said to be on the disk.
    pub stored: bool,
    /// When.
    pub at: Duration,
    /// What.
    pub health: Health,
}

/// Clock and observer of a world, which the program borrows.
pub(crate) struct Host {
    pub(crate) clock: WorldClock,
    pub(crate) disk: WorldDisk,
    /// Number of the run of the program.
    pub(crate) run: AtomicUsize,
    pub(crate) reported: Mutex<Vec<Reported>>,
    /// Its messages, with their time.
    pub(crate) notices: Mutex<Vec<String>>,
}

impl Host {
    fn report(&self, assessed: &AssessedWindow, stored: bool) {
        if self.disk.is_dead() {
            return;
        }
        let mut reported = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        reported.push(Reported {
            run: self.run.load(Relaxed),
            stored,
            at: self.clock.now(),
            health: assessed.health.clone(),
        });
        drop(reported);
        let health = &assessed.health;
        self.notice(&format!(
            "{}: window {}{}: {}, {}; {}",
            health.actuator,
            health.window,
            if stored { "" } else { ", not stored" },
            health.status,
            health.health,
            health.reason
        ));
    }
}

impl Observer for Host {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.report(assessed, true);
        Ok(())
    }

    fn assessed_unstored(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.report(assessed, false);
        Ok(())
    }

    fn notice(&self, message: &str) {
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        let at = self.clock.now().as_secs_f64();
        notices.push(format!("{at:8.3} s  {message}"));
    }
}
