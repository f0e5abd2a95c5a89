//! The watchdog is fed by a tick that went through sources, pipeline and writer while identification goes on, and by nothing else.

use std::io;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::freshness::STALE_AFTER;
use super::host_clock::SteadyClock;
use super::steps::Steps;
use super::{ENDING_MAX, Observer, WaitingWindow, lock};
use hmd_core::assess::{AssessedWindow, Identification};
use hmd_core::config::Config;
use hmd_core::deadline::Clock;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::outbox::WindowJob;
use hmd_core::sample::MeasuredConditions;
use hmd_core::window::{Window, WindowQuality};
use hmd_ingest::feed::{Input, LinkState};
use tokio::sync::mpsc;

/// Counts how often the watchdog is fed.
#[derive(Default)]
struct Fed {
    times: AtomicU32,
    notices: Mutex<Vec<String>>,
}

impl Fed {
    fn times(&self) -> u32 {
        self.times.load(Relaxed)
    }
}

impl Observer for Fed {
    fn assessed(&self, _: &AssessedWindow) -> io::Result<()> {
        Ok(())
    }

    fn notice(&self, message: &str) {
        self.notices.lock().unwrap().push(message.to_owned());
    }

    fn heartbeat(&self) {
        self.times.fetch_add(1, Relaxed);
    }
}

fn config() -> Arc<Config> {
    let text = "[[actuator]]\nid = 0\nbus = \"can0\"\n";
    Arc::new(Config::from_toml_str(text, "hmd.toml").expect("a good configuration"))
}

fn steps<'a>(clock: &'a SteadyClock, fed: &'a Fed) -> Steps<'a, SteadyClock, Fed> {
    let mut names = BusNames::new();
    names.intern("can0").expect("a name");
    Steps::new(names, None, Some((config(), 1)), Arc::new(Identification), clock, fed).expect("no files are named")
}

fn tick() -> Vec<Input> {
    vec![Input::Tick { stamp_ns: 1 }]
}

fn window() -> WaitingWindow {
    let actuator = Arc::new(config().actuators()[0].clone());
    let job = WindowJob {
        params: actuator.params,
        actuator,
        window: Window {
            number: 0,
            t_start_ns: 1,
            trigger: 0,
            samples: Vec::new(),
            expected: 0,
            quality: WindowQuality::Complete,
            lost: 0,
            rejected: 0,
            filled: Vec::new(),
            duplicates: 0,
            output_zero_rad: None,
            clock_jumps: 0,
        },
        conditions: MeasuredConditions::default(),
        operating_s: 0.0,
    };
    WaitingWindow {
        job,
        arrived: Duration::ZERO,
    }
}

#[test]
fn sources_without_ticks_do_not_feed_the_watchdog() {
    let (clock, fed) = (SteadyClock(Instant::now()), Fed::default());
    let mut steps = steps(&clock, &fed);
    let frame = RawFrame::new(1, 0, 0x100, FrameFlags::empty(), &[0; 8]).unwrap();
    let up = Input::Link {
        bus: 0,
        stamp_ns: 1,
        state: LinkState::Up,
        cause: None,
    };
    steps.take(&mut vec![up, Input::Frame(frame)]).unwrap();
    assert_eq!(fed.times(), 0);
    steps.take(&mut tick()).unwrap();
    assert_eq!(fed.times(), 1);
}

#[test]
fn an_assessment_that_hangs_starves_the_watchdog() {
    let (clock, fed) = (SteadyClock(Instant::now()), Fed::default());
    let mut steps = steps(&clock, &fed);
    assert!(steps.windows.push(window()).is_none());
    assert!(steps.windows.pop().is_some());
    steps.take(&mut tick()).unwrap();
    assert_eq!(fed.times(), 1, "it takes its time");
    steps.pipeline.assessing_max = Duration::from_millis(1);
    std::thread::sleep(Duration::from_millis(2));
    steps.take(&mut tick()).unwrap();
    assert_eq!(fed.times(), 1, "it hangs");
    steps.windows.close();
    assert!(steps.windows.pop().is_none());
    steps.take(&mut tick()).unwrap();
    assert_eq!(fed.times(), 2, "it went on");
}

/// Both threads write under one lock, which a disk that hangs keeps.
#[test]
fn a_writer_that_hangs_starves_the_watchdog() {
    let (clock, fed) = (SteadyClock(Instant::now()), Fed::default());
    let mut steps = steps(&clock, &fed);
    let Steps {
        shared,
        windows,
        pipeline,
        ..
    } = &mut steps;
    let writing = lock(shared);
    std::thread::scope(|scope| {
        let taking = scope.spawn(|| pipeline.take(&mut tick(), Duration::ZERO, windows, shared, &fed));
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(fed.times(), 0);
        drop(writing);
        taking.join().unwrap().unwrap();
    });
    assert_eq!(fed.times(), 1);
}

/// No source brings ticks any more while the last windows are assessed.
#[test]
fn an_end_that_waits_for_windows_ticks_and_drops_what_is_left() {
    let (clock, fed) = (SteadyClock(Instant::now()), Fed::default());
    let mut steps = steps(&clock, &fed);
    for _ in 0..3 {
        assert!(steps.windows.push(window()).is_none());
    }
    let Steps {
        shared,
        windows,
        pipeline,
        ..
    } = &mut steps;
    assert!(windows.pop().is_some());
    // Its last sample is old before the run has ended.
    std::thread::sleep(STALE_AFTER.saturating_sub(Duration::from_secs(1)));
    let (sources, inputs) = mpsc::channel(1);
    drop(sources);
    std::thread::scope(|scope| {
        let ending = scope.spawn(|| pipeline.run(inputs, windows, shared, &fed));
        while fed.times() < 2 {
            assert!(!ending.is_finished(), "one is being assessed");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(!windows.is_over(clock.now()) && windows.is_over(clock.now() + ENDING_MAX));
        windows.close();
        ending.join().unwrap().unwrap();
    });
    let status = steps.end(Ok(()), Ok(())).unwrap();
    assert_eq!((status.lost_windows, status.queued_windows), (2, 0));
    let notices = fed.notices.into_inner().unwrap();
    let told = [
        "the run ends: 3 windows to assess; those left after 20 s are dropped, and those in progress are waited for",
        "2 windows dropped: not assessed when the run ended",
    ];
    assert!(
        told.iter().all(|told| notices.iter().any(|notice| notice == told)),
        "{notices:?}"
    );
    assert!(!notices.iter().any(|notice| notice.contains("STALE")), "{notices:?}");
}
