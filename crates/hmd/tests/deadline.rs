//! A deadline for each window: every window is answered in time, and a replay gives the same bytes. The clock is a simulated one that
//! goes on by monitor runs alone, each of which takes the same time.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::future::pending;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ema_identify::effort::{Effort, RecordedGrants};
use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::daemon::{Daemon, HostClock, Observer};
use hmd::replay::{self, Replay};
use hmd_core::assess::{AssessedWindow, Assessor, LearningProgress, Models};
use hmd_core::config::Config;
use hmd_core::deadline::{Clock, TimeLimit, Turns};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{HealthLine, Shortened};
use hmd_ingest::feed::Input;
use hmd_ingest::live::LiveSource;
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::recorder::{Recorder, metadata};

const SEED: u64 = 7;
const MS: Duration = Duration::from_millis(1);

/// A computer on which each monitor run takes the same time.
struct SlowComputer {
    ns_per_run: u64,
    ns: AtomicU64,
}

impl SlowComputer {
    fn new(per_run: Duration) -> Self {
        Self {
            ns_per_run: per_run.as_nanos() as u64,
            ns: AtomicU64::new(0),
        }
    }

    fn wait_until(&self, time: Duration) {
        self.ns.fetch_max(time.as_nanos() as u64, Ordering::Relaxed);
    }
}

impl Clock for SlowComputer {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.ns.load(Ordering::Relaxed))
    }

    fn worked(&self, runs: u64) {
        self.ns.fetch_add(runs * self.ns_per_run, Ordering::Relaxed);
    }
}

/// Two actuators at 400 Hz, with what their data sheets leave open or without it.
fn config(identification: &str, exact: bool) -> Arc<Config> {
    let tolerances = if exact { "tolerances = \"exact\"\n" } else { "" };
    let text = format!(
        "[type.slow]\nbased_on = \"bench\"\n{tolerances}[type.slow.sensors]\nsample_rate_hz = 400\n\
         [[actuator]]\nid = 0\nname = \"a\"\ntype = \"slow\"\n[[actuator]]\nid = 1\nname = \"b\"\ntype = \"slow\"\n\
         [identification]\n{identification}\n"
    );
    Arc::new(Config::from_toml_str(&text, "hmd.toml").unwrap())
}

fn frames(id: u8, actuations: u32) -> Vec<RawFrame> {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let fault = FaultVector::from_array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]);
    let scenario = Scenario {
        actuations: Actuations {
            count: actuations,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(params, fault, u64::from(id))
    };
    traffic(&scenario, ActuatorId::new(id).unwrap(), EPOCH_NS).collect()
}

fn jobs(config: &Arc<Config>, actuations: u32) -> Vec<WindowJob> {
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let mut pipeline = Pipeline::new(config.clone());
    for id in 0..2 {
        for frame in frames(id, actuations) {
            pipeline.push(&frame, &names);
        }
    }
    pipeline.finish();
    pipeline.take_windows()
}

fn line(assessed: &AssessedWindow) -> String {
    HealthLine::from((&assessed.health, &assessed.rul)).to_json()
}

fn assessor(config: &Arc<Config>) -> Assessor {
    Assessor::new(config.clone(), Models::without_files(config).unwrap(), SEED)
}

/// The lines of windows that all arrive at once, with what the deadline left of them.
fn live(config: &Arc<Config>, jobs: &[WindowJob], per_run: Duration) -> Vec<(String, Option<Shortened>)> {
    let computer = SlowComputer::new(per_run);
    let mut assessor = assessor(config);
    let mut turns = Turns::new(config, &computer);
    turns.measure(|effort| assessor.rehearse(&jobs[0].actuator, effort).unwrap());
    let deadline = config.identification().deadline_ms.unwrap() * MS;
    let arrived = computer.now() + MS;
    computer.wait_until(arrived);
    let mut answered = Vec::new();
    for (n, job) in jobs.iter().enumerate() {
        let waiting = vec![arrived; jobs.len() - n - 1];
        let assessed = turns.take(
            arrived,
            || waiting,
            |limit| {
                assessor
                    .assess_within(job.clone(), limit, &LearningProgress::NotToLearn)
                    .unwrap()
            },
        );
        let took = computer.now() - arrived;
        assert!(took <= deadline + MS, "window {n} after {took:?} of {deadline:?}");
        answered.push((line(&assessed), assessed.shortened));
    }
    answered
}

#[test]
fn every_window_is_answered_in_time_and_again_by_what_it_was_granted() {
    for exact in [false, true] {
        let jobs = jobs(&config("", exact), 3);
        assert_eq!(jobs.len(), 6);
        let whole: Vec<String> = {
            let mut assessor = assessor(&config("", exact));
            jobs.iter()
                .map(|job| line(&assessor.assess(job.clone()).unwrap()))
                .collect()
        };
        let (mut cut, mut invalid) = (0, 0);
        for (deadline_ms, per_run) in [
            (10_000, Duration::from_micros(20)),
            (100, Duration::from_micros(100)),
            (100, Duration::from_micros(25)),
            (20, Duration::from_micros(4)),
            (2, Duration::from_micros(5)),
            (2, Duration::from_nanos(500)),
        ] {
            let config = config(&format!("deadline_ms = {deadline_ms}"), exact);
            let answered = live(&config, &jobs, per_run);
            let mut assessor = assessor(&config);
            for ((line_live, shortened), job) in answered.iter().zip(&jobs) {
                let mut grants = RecordedGrants::new(shortened.iter().flat_map(Shortened::short_grants).collect());
                let limit = TimeLimit {
                    deadline_ms,
                    effort: Effort::within(&mut grants),
                };
                let again = assessor
                    .assess_within(job.clone(), &limit, &LearningProgress::NotToLearn)
                    .unwrap();
                assert_eq!(line(&again), *line_live);
                assert_eq!(again.shortened, *shortened);
            }
            let of = |part: &str| answered.iter().filter(|(line, _)| line.contains(part)).count();
            cut += of("best of");
            invalid += of("\"status\":\"invalid\"");
            if deadline_ms == 10_000 {
                let lines: Vec<String> = answered.iter().map(|(line, _)| line.clone()).collect();
                assert_eq!(lines, whole, "time enough changes nothing");
            }
        }
        assert!(cut > 0 && invalid > 0, "{cut} cut, {invalid} invalid, exact: {exact}");
    }
}

impl HostClock for SlowComputer {}

#[derive(Default)]
struct Lines(Mutex<Vec<String>>);

impl Observer for Lines {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.0.lock().unwrap().push(line(assessed));
        Ok(())
    }

    fn notice(&self, _: &str) {}
}

impl replay::Observer for &Lines {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        Observer::assessed(*self, assessed)
    }

    fn notice(&mut self, _: &str) {}

    fn progress(&mut self, _: u64) {}
}

fn replayed(log: &Path, output: &Path) -> Vec<String> {
    let lines = Lines::default();
    let replay = Replay {
        logs: &[PathBuf::from(log)],
        output: Some(output),
        config: config("", false),
        seed: SEED,
    };
    replay.run(&mut &lines).unwrap();
    lines.0.into_inner().unwrap()
}

/// The configuration of the replay has no deadline: the record has all that is needed.
#[test]
fn a_run_with_a_deadline_replays_to_the_same_lines() {
    let folder = tempfile::tempdir().unwrap();
    let [live, once, twice] = ["live", "once", "twice"].map(|name| folder.path().join(name).with_extension("mcap"));
    let config = config("deadline_ms = 50", false);
    let lines = Lines::default();
    let inputs = frames(0, 3).into_iter().chain(frames(1, 3)).map(Input::Frame);
    let daemon = Daemon {
        sources: vec![("can0".to_owned(), LiveSource::Playback(Box::new(inputs)))],
        recorder: Some(Recorder::create(&live, &metadata(&config, "test", SEED)).unwrap()),
        watch: Some((config, SEED)),
    };
    daemon
        .run_by(&SlowComputer::new(Duration::from_micros(60)), pending(), &lines)
        .unwrap();
    let lines = lines.0.into_inner().unwrap();
    assert_eq!(lines.len(), 6, "every window is answered");
    assert!(lines.iter().any(|line| line.contains("deadline of 50 ms")), "{lines:?}");
    assert_eq!(replayed(&live, &once), lines);
    assert_eq!(replayed(&once, &twice), lines);
}
