//! Golden estimates: every log of `fixtures/logs` through the whole pipeline, against its truth and the last result.
//!
//! `fixtures/golden/estimates.jsonl` is the table: what each log gave when it was last reviewed. `limits.json` beside
//! it bounds each log's error; a limit fails when exceeded, and also when far too loose, so that a better algorithm
//! brings tighter numbers along. After an intended change:
//!
//! ```text
//! UPDATE_GOLDEN=1 cargo test -p hmd-tests --test golden
//! git diff fixtures/golden
//! ```
//!
//! writes the table, and those limits that no longer hold. The diff is what gets reviewed.
//!
//! The firmware's identification of the same windows comes to the same decisions.

mod target_cases;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use ema_identify::Estimate;
use ema_models::{FAULT_COUNT, FaultVector, rss_pct, wrapped_phase_difference};
use hmd::replay::{Observer, Replay};
use hmd_core::assess::{AssessedWindow, damage_evidence};
use hmd_core::config::Config;
use hmd_core::health::Health;
use hmd_core::record;
use serde_json::Value;
use target_cases::{exact, golden, golden_logs};

/// Seed of every search.
const SEED: u64 = 1;

/// Largest difference between an estimate and its golden one; the arithmetic is the same on every machine, and the
/// table is rounded to a tenth of this.
const TOLERANCE: f64 = 1e-6;

/// Largest difference of two errors in percent whose estimates agree within [`TOLERANCE`].
const TOLERANCE_PCT: f64 = 1e-3;

/// A limit above the measured error times this is too loose.
const LOOSE: f64 = 3.0;

/// No limit up to this is too loose, percent.
const LOOSE_FLOOR_PCT: f64 = 0.3;

/// A fresh limit is the measured error times this, and at least [`FRESH_FLOOR_PCT`].
const FRESH: f64 = 1.5;

/// Smallest fresh limit, percent.
const FRESH_FLOOR_PCT: f64 = 0.2;

const HOW_TO_UPDATE: &str = "if the change is intended: UPDATE_GOLDEN=1 cargo test -p hmd-tests --test golden, then review \
                             `git diff fixtures/golden`";

/// What one log gave: one line of the golden table.
#[derive(Clone, Debug)]
struct Row {
    log: String,
    status: String,
    health: String,
    faults: Vec<String>,
    k: [f64; FAULT_COUNT],
    rss_pct: f64,
    cost: f64,
    evaluations: u64,
}

/// What the host decides of one window.
#[derive(Clone, Debug, PartialEq)]
struct Decision {
    status: String,
    faults: Vec<String>,
    observable: [bool; FAULT_COUNT],
    /// Whether another fault vector explains the window as well.
    ambiguous: bool,
}

/// What every log gives by a replay, computed once.
fn replayed() -> &'static [(Row, Decision)] {
    static REPLAYED: OnceLock<Vec<(Row, Decision)>> = OnceLock::new();
    REPLAYED.get_or_init(|| of_all(&golden_logs(), replay))
}

#[test]
fn every_log_gives_its_golden_estimate() {
    let rows: Vec<Row> = replayed().iter().map(|(row, _)| row.clone()).collect();
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        update(&rows);
        return;
    }
    let golden = read_golden();
    let limits = read_limits();
    let mut failures = Vec::new();
    for row in &rows {
        println!("{}", row.emit());
        match golden.get(&row.log) {
            Some(golden) => row.compare(golden, &mut failures),
            None => failures.push(format!("{}: not in estimates.jsonl", row.log)),
        }
        match limits.get(&row.log) {
            Some(&limit) => failures.extend(complaint(row.rss_pct, limit).map(|c| format!("{}: {c}", row.log))),
            None => failures.push(format!("{}: not in limits.json", row.log)),
        }
    }
    let present: BTreeSet<&String> = rows.iter().map(|row| &row.log).collect();
    for name in golden
        .keys()
        .chain(limits.keys())
        .filter(|name| !present.contains(name))
    {
        failures.push(format!("{name}: golden, but not in fixtures/logs"));
    }
    assert!(
        failures.is_empty(),
        "seed {SEED}:\n{}\n{HOW_TO_UPDATE}",
        failures.join("\n")
    );
}

/// The host's default search has a population before its descents, the firmware's has none.
#[test]
fn the_firmware_decides_as_the_host_does() {
    let found = of_all(&golden_logs(), |log| {
        let case = golden(log);
        let estimate = case.on_the_controller();
        assert_eq!(estimate, case.on_the_host(), "{log}: the same search, bit for bit");
        decision(&estimate)
    });
    for ((row, host), firmware) in replayed().iter().zip(found) {
        assert_eq!(firmware, *host, "{}", row.log);
    }
}

/// What the host makes of an estimate of a sound window, at the default levels.
fn decision(estimate: &Estimate) -> Decision {
    let mut health = Health::new(*Config::default().health().levels()).expect("the defaults are in order");
    let hidden = (0..FAULT_COUNT).any(|p| p != 6 && !estimate.observable[p]);
    let ambiguous = estimate.competing_optimum.is_some();
    let status = if estimate.is_unmodelled() {
        "unmodelled"
    } else if hidden || ambiguous || estimate.cut {
        "degraded"
    } else {
        "ok"
    };
    let explained = (!estimate.is_unmodelled()).then(|| damage_evidence(estimate));
    let faults = health.update(0, explained.as_ref()).faults;
    Decision {
        status: status.to_owned(),
        faults: faults.into_iter().map(|fault| fault.name().to_owned()).collect(),
        observable: estimate.observable,
        ambiguous,
    }
}

#[test]
fn a_limit_fails_when_exceeded_and_when_too_loose() {
    assert_eq!(complaint(1.0, 1.0), None);
    assert_eq!(complaint(1.0, 3.0), None);
    assert_eq!(complaint(0.0, LOOSE_FLOOR_PCT), None);
    assert!(complaint(1.01, 1.0).is_some_and(|c| c.contains("exceeds")));
    assert!(complaint(1.0, 3.1).is_some_and(|c| c.contains("too loose")));
    assert!(complaint(f64::NAN, 1.0).is_some());
    for error in [0.0, 0.01, 0.2, 1.0 / 3.0, 7.0] {
        assert_eq!(complaint(error, fresh_limit(error)), None, "{error}");
    }
}

/// Why a limit does not hold, if so; both in percent.
fn complaint(error: f64, limit: f64) -> Option<String> {
    if error.is_nan() || error > limit {
        return Some(format!("error {error:.3} % exceeds its limit {limit} %"));
    }
    (limit > (LOOSE * error).max(LOOSE_FLOOR_PCT))
        .then(|| format!("limit {limit} % is too loose for an error of {error:.3} %: tighten it"))
}

/// Limit for a measured error, percent, on whole hundredths.
fn fresh_limit(error: f64) -> f64 {
    (FRESH * error * 100.0).ceil().max(FRESH_FLOOR_PCT * 100.0) / 100.0
}

impl Row {
    fn compare(&self, golden: &Self, failures: &mut Vec<String>) {
        let mut differ = |what: &str, found: String, expected: String| {
            failures.push(format!("{}: {what}: expected {expected}, found {found}", self.log));
        };
        for p in 0..FAULT_COUNT {
            let difference = match p {
                // A direction counts as far as there is something that has it.
                6 => self.k[5] * wrapped_phase_difference(self.k[p], golden.k[p]),
                _ => self.k[p] - golden.k[p],
            };
            if difference.is_nan() || difference.abs() > TOLERANCE {
                let what = format!("k{} {}", p + 1, FaultVector::NAMES[p]);
                differ(&what, self.k[p].to_string(), golden.k[p].to_string());
            }
        }
        if (self.rss_pct - golden.rss_pct).abs() > TOLERANCE_PCT {
            differ("rss_pct", self.rss_pct.to_string(), golden.rss_pct.to_string());
        }
        if (self.cost - golden.cost).abs() > TOLERANCE * golden.cost.max(1.0) {
            differ("cost", self.cost.to_string(), golden.cost.to_string());
        }
        if self.evaluations != golden.evaluations {
            differ(
                "evaluations",
                self.evaluations.to_string(),
                golden.evaluations.to_string(),
            );
        }
        if (&self.status, &self.health, &self.faults) != (&golden.status, &golden.health, &golden.faults) {
            let outcome = |row: &Self| format!("{} {} {:?}", row.status, row.health, row.faults);
            differ("outcome", outcome(self), outcome(golden));
        }
    }

    /// One line of JSON, the fields in the order in which one reads them.
    fn emit(&self) -> String {
        let k: Vec<f64> = self.k.iter().map(|&k| rounded(k, 1e7)).collect();
        format!(
            r#"{{"log":{:?},"status":{:?},"health":{:?},"faults":{:?},"rss_pct":{:?},"k":{k:?},"cost":{:?},"evaluations":{}}}"#,
            self.log,
            self.status,
            self.health,
            self.faults,
            rounded(self.rss_pct, 1e4),
            rounded(self.cost, 1e7),
            self.evaluations
        )
    }

    fn parse(line: &str) -> Self {
        let value: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("estimates.jsonl: {e}: {line}"));
        let text = |value: &Value| {
            value
                .as_str()
                .unwrap_or_else(|| panic!("expected text in {line}"))
                .to_owned()
        };
        let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("expected a number in {line}"));
        Self {
            log: text(&value["log"]),
            status: text(&value["status"]),
            health: text(&value["health"]),
            faults: value["faults"].as_array().into_iter().flatten().map(text).collect(),
            k: std::array::from_fn(|p| number(&value["k"][p])),
            rss_pct: number(&value["rss_pct"]),
            cost: number(&value["cost"]),
            evaluations: value["evaluations"]
                .as_u64()
                .unwrap_or_else(|| panic!("expected a count in {line}")),
        }
    }
}

fn rounded(x: f64, per_unit: f64) -> f64 {
    (x * per_unit).round() / per_unit
}

/// Does the same work for every log, on all processors; results in the order of the names.
fn of_all<T: Send>(names: &[String], work: impl Fn(&str) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut done = Vec::new();
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            let Some(name) = names.get(n) else { return done };
            done.push((n, work(name)));
        }
    };
    let threads = thread::available_parallelism().map_or(2, usize::from);
    let mut results: Vec<(usize, T)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(worker)).collect();
        workers
            .into_iter()
            .flat_map(|w| w.join().unwrap_or_else(|e| std::panic::resume_unwind(e)))
            .collect()
    });
    results.sort_by_key(|&(n, _)| n);
    results.into_iter().map(|(_, result)| result).collect()
}

/// The one window of a log, assessed with every default, and every number of the type known.
fn replay(name: &str) -> (Row, Decision) {
    let log = fixtures().join("logs").join(name);
    let logs = [log.clone()];
    let mut windows = Windows::default();
    let summary = Replay {
        logs: &logs,
        output: None,
        config: exact(),
        seed: SEED,
    }
    .run(&mut windows)
    .unwrap_or_else(|e| panic!("{name}: {e}"));
    assert!(!summary.data_lost(), "{name}: data lost: {:?}", summary.status);
    let [health] = &windows.0[..] else {
        panic!("{name}: expected one window, found {}", windows.0.len())
    };
    let record::Estimate { k, observable, .. } = health
        .estimate()
        .unwrap_or_else(|| panic!("{name}: no estimate: {}", health.reason));
    let decision = Decision {
        status: health.status.clone(),
        faults: health.fault_list.clone(),
        observable,
        ambiguous: health.reason.contains("ambiguous"),
    };
    let row = Row {
        log: name.to_owned(),
        status: health.status.clone(),
        health: health.health.clone(),
        faults: health.fault_list.clone(),
        k,
        rss_pct: rss_pct(&FaultVector::from_array(k), &read_truth(&log)),
        cost: health.cost.unwrap_or(f64::NAN),
        evaluations: health.evaluations,
    };
    (row, decision)
}

#[derive(Default)]
struct Windows(Vec<record::Health>);

impl Observer for Windows {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        self.0.push(assessed.health.clone());
        Ok(())
    }

    fn notice(&mut self, _message: &str) {}

    fn progress(&mut self, _position: u64) {}
}

/// Writes the table, and those limits that no longer hold.
fn update(rows: &[Row]) {
    let old = read_limits();
    let mut limits = BTreeMap::new();
    let mut table = String::new();
    for row in rows {
        writeln!(table, "{}", row.emit()).unwrap_or_else(|e| panic!("{}: {e}", row.log));
        let kept = old
            .get(&row.log)
            .copied()
            .filter(|&limit| complaint(row.rss_pct, limit).is_none());
        let limit = kept.unwrap_or_else(|| fresh_limit(row.rss_pct));
        if let Some(before) = old.get(&row.log).filter(|&&before| before < limit) {
            eprintln!("{}: LOOSENED from {before} % to {limit} %", row.log);
        }
        limits.insert(&row.log, limit);
    }
    let limits = serde_json::to_string_pretty(&limits).unwrap_or_else(|e| panic!("limits.json: {e}"));
    for (name, text) in [("estimates.jsonl", table), ("limits.json", limits + "\n")] {
        let path = golden_file(name);
        std::fs::write(&path, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }
}

/// The fault vector of the log's only window.
fn read_truth(log: &Path) -> FaultVector {
    let mut path = log.as_os_str().to_owned();
    path.push(".truth.jsonl");
    let line: Value =
        serde_json::from_str(&read(Path::new(&path))).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let k = |p: usize| {
        line["k"][p]
            .as_f64()
            .unwrap_or_else(|| panic!("{}: no k{}", path.display(), p + 1))
    };
    FaultVector::from_array(std::array::from_fn(k))
}

fn read_golden() -> BTreeMap<String, Row> {
    read(&golden_file("estimates.jsonl"))
        .lines()
        .map(Row::parse)
        .map(|row| (row.log.clone(), row))
        .collect()
}

/// Percent by name of the log; none when there is no file yet.
fn read_limits() -> BTreeMap<String, f64> {
    let path = golden_file("limits.json");
    if !path.exists() {
        return BTreeMap::new();
    }
    serde_json::from_str(&read(&path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn golden_file(name: &str) -> PathBuf {
    fixtures().join("golden").join(name)
}

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures")
}
