//! What 1, 4, 16 and 64 actuators at 400 Hz cost: `cargo run --release -p hmd --example many_actuators -- [MINUTES [ACTUATORS…]]`.
//!
//! Frames from memory go through the daemon's own queues, windowing, identification and storage, in compressed time. The
//! share of a core is processor time over simulated time. Traffic waits while identification is behind, so that compressed
//! time alone drops no window. Then a window of each actuator waits, and all are assessed, without traffic. Without numbers of actuators it draws `docs/img/many_actuators.svg`.
#![allow(clippy::print_stdout, reason = "it prints figures")]

mod at_once;
mod plot;
mod traffic;

use std::collections::BTreeMap;
use std::fs;
use std::future::pending;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ema_identify::unit_calibration::{UnitCalibration, UnitEstimator};
use hmd::daemon::{Daemon, Observer};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::{Config, Limits};
use hmd_core::record::Status;
use hmd_ingest::live::LiveSource;
use hmd_storage::recorder::{Recorder, metadata};
use plot::Curve;
use traffic::{Bus, PER_BUS, RATE_HZ, SAMPLES_PER_MINUTE, Template};

/// Windows that compressed traffic lets identification lie behind; its queue holds 64, and buses are some seconds apart.
const BACKLOG_MAX: u64 = 16;

/// Time without an assessed window after which traffic goes on: dropped ones never come.
const STALLED: Duration = Duration::from_secs(2);

/// One run.
#[derive(Clone)]
struct Case {
    actuators: u64,
    minutes: u64,
    /// What judges a window.
    judge: &'static str,
    /// Lines of each actuator's configuration that commission it.
    commissioning: &'static str,
    store: bool,
}

/// What a run cost.
struct Cost {
    status: Status,
    took_s: f64,
    /// Processor time by the name of the thread, s: up to the last second of traffic.
    threads: BTreeMap<String, f64>,
    /// Processor time of making the frames, alone, s.
    making_s: f64,
}

#[derive(Default)]
struct Observed(Arc<AtomicU64>);

impl Observer for Observed {
    fn assessed(&self, _: &AssessedWindow) -> io::Result<()> {
        self.0.fetch_add(1, Ordering::Release);
        Ok(())
    }

    fn notice(&self, message: &str) {
        eprintln!("{message}");
    }
}

fn config(case: &Case, folder: &Path) -> anyhow::Result<Arc<Config>> {
    let mut text = format!("type.bench.tolerances = \"exact\"\n[type.bench.sensors]\nsample_rate_hz = {RATE_HZ}\n");
    for actuator in 0..case.actuators {
        let (bus, id) = (actuator / PER_BUS, actuator % PER_BUS);
        text += &format!(
            "[[actuator]]\nname = \"unit{actuator}\"\nid = {id}\nbus = \"can{bus}\"\n{}\n",
            case.commissioning
        );
    }
    let path = folder.join("hmd.toml").display().to_string();
    Ok(Arc::new(Config::from_toml_str(&text, &path)?))
}

/// Buses of a run.
fn buses(case: &Case) -> u64 {
    case.actuators.div_ceil(PER_BUS)
}

fn recorder(case: &Case, config: &Arc<Config>, folder: &Path) -> anyhow::Result<Option<Recorder>> {
    let open = || {
        let limits = Limits::new(16, 60, 256, 16);
        Recorder::open_folder(&folder.join("records"), &metadata(config, "test", 1), limits)
    };
    Ok(case.store.then(open).transpose()?)
}

/// Processor time of each thread, s, by its name; the workers of the search have none of their own.
fn threads() -> io::Result<BTreeMap<String, f64>> {
    let mut found = BTreeMap::new();
    for task in fs::read_dir("/proc/self/task")? {
        let task = task?.path();
        let (Ok(name), Ok(times)) = (
            fs::read_to_string(task.join("comm")),
            fs::read_to_string(task.join("schedstat")),
        ) else {
            continue;
        };
        let is_main = task.ends_with(std::process::id().to_string());
        let name = match name.trim() {
            _ if is_main => "sources",
            "pipeline" => "pipeline",
            _ => "identification",
        };
        let ns: f64 = times.split(' ').next().and_then(|ns| ns.parse().ok()).unwrap_or(0.0);
        *found.entry(name.to_owned()).or_default() += 1e-9 * ns;
    }
    Ok(found)
}

fn run(case: &Case, templates: &Arc<[Template; 4]>, folder: &Path) -> anyhow::Result<Cost> {
    let config = config(case, folder)?;
    let buses = buses(case);
    let bus = |bus: u64, before: Box<dyn FnMut(u64) + Send>| Bus {
        templates: templates.clone(),
        bus,
        actuators: case.actuators,
        spread: true,
        seq: 0,
        end: case.minutes * SAMPLES_PER_MINUTE,
        waiting: Vec::new(),
        before,
    };
    let alone = threads()?;
    for number in 0..buses {
        bus(number, Box::new(|_| {})).for_each(|input| {
            std::hint::black_box(input);
        });
    }
    let start = threads()?;
    let of = |times: &BTreeMap<String, f64>, name: &str| times.get(name).copied().unwrap_or(0.0);
    let making_s = of(&start, "sources") - of(&alone, "sources");

    let recorder = recorder(case, &config, folder)?;
    let observed = Observed::default();
    let newest = Arc::new(Mutex::new(start.clone()));
    let since = Instant::now();
    // Second that the traffic of each bus has reached: one that waits stops all, so none waits for the windows of another that is behind.
    let reached: Arc<Vec<AtomicU64>> = Arc::new((0..buses).map(|_| AtomicU64::new(0)).collect());
    let sources = (0..buses).map(|number| {
        let (assessed, newest, reached) = (observed.0.clone(), newest.clone(), reached.clone());
        let actuators = case.actuators;
        let before = move |second: u64| {
            reached[number as usize].store(second, Ordering::Relaxed);
            let by_all = reached.iter().map(|of| of.load(Ordering::Relaxed)).min().unwrap_or(0);
            let ended = actuators * by_all / 60;
            let (mut last, mut since) = (0, Instant::now());
            while ended > assessed.load(Ordering::Acquire) + BACKLOG_MAX && since.elapsed() < STALLED {
                let now = assessed.load(Ordering::Acquire);
                if now != last {
                    (last, since) = (now, Instant::now());
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            if number == 0
                && let (Ok(times), Ok(mut newest)) = (threads(), newest.lock())
            {
                *newest = times;
            }
        };
        let source = LiveSource::Playback(Box::new(bus(number, Box::new(before))));
        (format!("can{number}"), source)
    });
    let daemon = Daemon {
        sources: sources.collect(),
        recorder,
        watch: Some((config, 1)),
    };
    let status = daemon.run(pending(), &observed)?;
    let took_s = since.elapsed().as_secs_f64();
    let newest = newest.lock().map(|newest| newest.clone()).unwrap_or_default();
    let threads = newest
        .iter()
        .map(|(name, s)| (name.clone(), s - of(&start, name)))
        .collect();
    Ok(Cost {
        status,
        took_s,
        threads,
        making_s,
    })
}

/// What a run cost, % of a core.
struct Shares {
    queue: f64,
    pipeline: f64,
    identification: f64,
}

impl Shares {
    fn of(case: &Case, cost: &Cost) -> Self {
        let simulated = 60.0 * case.minutes as f64;
        let share = |name: &str| 100.0 * cost.threads.get(name).copied().unwrap_or(0.0) / simulated;
        Self {
            queue: share("sources") - 100.0 * cost.making_s / simulated,
            pipeline: share("pipeline"),
            identification: share("identification"),
        }
    }

    /// All but identification.
    fn front(&self) -> f64 {
        self.queue + self.pipeline
    }
}

fn print(case: &Case, cost: &Cost, at_once: Option<Duration>) {
    let status = &cost.status;
    let shares = Shares::of(case, cost);
    let (queue, front) = (shares.queue, shares.front());
    let windows = status.windows_ok + status.windows_degraded + status.windows_invalid + status.windows_unmodelled;
    let mean_s = status.identification_s / windows.max(1) as f64;
    println!(
        "| {} | {} | {} | {:.0} | {windows} | {} | {queue:.2} | {:.2} | {front:.2} | {:.3} | {:.2} | {:.1} | {} |",
        case.actuators,
        case.judge,
        if case.store { "yes" } else { "no" },
        status.frames_received as f64 / cost.took_s,
        status.lost_windows,
        shares.pipeline,
        front / case.actuators as f64,
        shares.identification,
        1e3 * mean_s,
        at_once.map_or_else(String::new, |took| format!("{:.3}", took.as_secs_f64())),
    );
}

/// Has the daemon learn one healthy unit; its calibration stands for all, as it was learnt and without its monitor.
fn commission(learning: &Case, templates: &Arc<[Template; 4]>, folder: &Path) -> anyhow::Result<()> {
    run(learning, templates, folder)?;
    let learnt = fs::read_to_string(folder.join("units/unit0.unit.toml"))?;
    let mut unit = UnitCalibration::parse(&learnt, "unit0.unit.toml", "bench")?;
    unit.estimator = UnitEstimator::Relations;
    unit.monitor = None;
    fs::write(folder.join("relations.toml"), unit.emit())?;
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let arguments: Result<Vec<u64>, _> = std::env::args().skip(1).map(|text| text.parse()).collect();
    let arguments = arguments?;
    let minutes = arguments.first().copied().unwrap_or(10);
    let sizes = arguments.get(1..).filter(|sizes| !sizes.is_empty());
    let folder = tempfile::tempdir()?;
    let templates = Template::all();
    let searched = Case {
        actuators: 1,
        minutes,
        judge: "search",
        commissioning: "",
        store: true,
    };
    let learning = Case {
        minutes: 8,
        commissioning: "learn_windows = 5\nlearn_folder = \"units\"",
        store: false,
        ..searched.clone()
    };
    commission(&learning, &templates, folder.path())?;
    let by_relations = Case {
        judge: "relations",
        commissioning: "calibration = \"relations.toml\"",
        ..searched.clone()
    };
    let by_monitor = Case {
        judge: "unit's monitor",
        commissioning: "calibration = \"units/unit0.unit.toml\"",
        ..searched.clone()
    };
    println!(
        "{minutes} minutes at {RATE_HZ} Hz; % of a core: queue of inputs, pipeline (with storage), both, both per actuator, \
         identification; ms per window; time for a window of each actuator when all wait and nothing arrives, with storage, s\n\n\
         | actuators | judged by | stored | frames/s | assessed | dropped | queue | pipeline | both | each | \
         identification | window, ms | at once, s |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    let (mut front, mut identification) = (Vec::new(), Vec::new());
    for base in [by_relations, by_monitor, searched] {
        let (mut stored, mut unstored, mut judged) = (Vec::new(), Vec::new(), Vec::new());
        for &actuators in sizes.unwrap_or(&[1, 4, 16, 64]) {
            for store in [true, false] {
                let case = Case {
                    actuators,
                    store,
                    ..base.clone()
                };
                let cost = run(&case, &templates, folder.path())?;
                let at_once = store.then(|| at_once::at_once(&case, &templates, folder.path()));
                print(&case, &cost, at_once.transpose()?);
                let shares = Shares::of(&case, &cost);
                let each = |share: f64| (actuators, share / actuators as f64);
                if store {
                    stored.push(each(shares.front()));
                    judged.push(each(shares.identification));
                } else {
                    unstored.push(each(shares.front()));
                }
            }
        }
        if front.is_empty() {
            front = vec![
                Curve {
                    name: "with storage",
                    points: stored,
                },
                Curve {
                    name: "without",
                    points: unstored,
                },
            ];
        }
        identification.push(Curve {
            name: base.judge,
            points: judged,
        });
    }
    if sizes.is_none() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/img/many_actuators.svg");
        plot::draw(&path, &front, &identification)?;
    }
    Ok(())
}
