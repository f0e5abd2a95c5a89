//! What a run or a replay says: lines of assessed windows, and notices.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::io;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use hmd::daemon::Observer;
use hmd::replay;
use hmd_core::assess::AssessedWindow;
use hmd_core::record::HealthLine;

/// Longest wait for anything.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Notices and assessed windows.
#[derive(Default)]
pub(crate) struct Lines {
    health: Mutex<Vec<String>>,
    notices: Mutex<Vec<String>>,
}

impl Lines {
    pub(crate) fn health(&self) -> Vec<String> {
        self.health.lock().unwrap().clone()
    }

    pub(crate) fn notices(&self) -> Vec<String> {
        self.notices.lock().unwrap().clone()
    }

    /// Windows that gave an estimate.
    pub(crate) fn assessed(&self) -> usize {
        self.health().iter().filter(|line| !line.contains("\"k\":null")).count()
    }

    pub(crate) fn wait_for_health(&self, count: usize) {
        self.wait_until(|| self.health().len() >= count, &format!("{count} windows"));
    }

    pub(crate) fn wait_for_notice(&self, count: usize, part: &str) {
        let count_of = || self.notices().iter().filter(|line| line.contains(part)).count();
        self.wait_until(|| count_of() >= count, &format!("{part:?}, {count} times"));
    }

    pub(crate) fn wait_until(&self, reached: impl Fn() -> bool, what: &str) {
        let start = Instant::now();
        while !reached() {
            if start.elapsed() > TIMEOUT {
                panic!("expected {what}, found {:?} {:?}", self.notices(), self.health());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Observer for Lines {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        let window = &assessed.window;
        let (times, fitted) = (window.time_s.len(), window.fitted_i_q_a.len());
        assert!(fitted == 0 || fitted == times, "{fitted} values at {times} times");
        let line = HealthLine::from((&assessed.health, &assessed.rul)).to_json();
        self.health.lock().unwrap().push(line);
        Ok(())
    }

    fn notice(&self, message: &str) {
        self.notices.lock().unwrap().push(message.to_owned());
    }
}

impl replay::Observer for &Lines {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        Observer::assessed(*self, assessed)
    }

    fn notice(&mut self, message: &str) {
        Observer::notice(*self, message);
    }

    fn progress(&mut self, _: u64) {}
}
