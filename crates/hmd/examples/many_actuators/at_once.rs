//! How long the windows of all actuators take that end at once.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use hmd::daemon::{HostClock, Steps, windows_together};
use hmd_core::assess::Identification;
use hmd_core::config::Config;
use hmd_core::deadline::Clock;
use hmd_core::frame::BusNames;
use hmd_ingest::feed::Input;

use super::traffic::{Bus, RATE_HZ, Template};
use super::{Case, Observed, buses, config, recorder};

/// Seconds of traffic in which all windows end.
const ENDED_S: u64 = 3;

struct SteadyClock(Instant);

impl Clock for SteadyClock {
    fn now(&self) -> Duration {
        self.0.elapsed()
    }
}

impl HostClock for SteadyClock {}

/// Time from the first window that is taken to the last that is stored, when all wait and nothing arrives.
pub(crate) fn at_once(case: &Case, templates: &Arc<[Template; 4]>, folder: &Path) -> anyhow::Result<Duration> {
    let config: Arc<Config> = config(case, folder)?;
    let recorder = recorder(case, &config, folder)?;
    let (clock, observed) = (SteadyClock(Instant::now()), Observed::default());
    let mut names = BusNames::new();
    for number in 0..buses(case) {
        names.intern(&format!("can{number}"))?;
    }
    let watch = Some((config, 1));
    let mut steps = Steps::new(names, recorder, watch, Arc::new(Identification), &clock, &observed)?;
    for bus in 0..buses(case) {
        let traffic = Bus {
            templates: templates.clone(),
            bus,
            actuators: case.actuators,
            spread: false,
            seq: 0,
            end: ENDED_S * RATE_HZ,
            waiting: Vec::new(),
            before: Box::new(|_| {}),
        };
        let of_bus = traffic.filter_map(|input| match input {
            Input::Frame(frame) => Some(Input::Frame(frame.with_bus(bus as u16))),
            _ => None,
        });
        steps.take(&mut of_bus.collect())?;
    }
    let since = Instant::now();
    while steps.assess_together(windows_together())? {}
    let (took, windows) = (since.elapsed(), observed.0.load(Ordering::Acquire));
    steps.finish(Duration::ZERO)?;
    anyhow::ensure!(
        windows == case.actuators,
        "{windows} windows of {} actuators",
        case.actuators
    );
    Ok(took)
}
