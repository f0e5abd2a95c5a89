//! What the verbs print: the same bytes for the same input, documented keys, and a reader that goes away.

use std::fs;
use std::process::Stdio;

use crate::folder::{Folder, record_demo};

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let folder = Folder::new();
    folder.actuation();
    for line in ["replay --json actuation.log", "replay actuation.log", "check-config"] {
        let mut child = folder
            .command(line)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("hmd starts");
        drop(child.stdout.take());
        let ended = child.wait_with_output().expect("hmd ends");
        let stderr = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "hmd {line}: {stderr}");
        assert!(!stderr.contains("panicked"), "hmd {line}: {stderr}");
    }
}

#[test]
fn a_reader_that_goes_away_leaves_a_whole_output_file() {
    let folder = Folder::new();
    folder.actuation();
    folder.done("replay --json actuation.log -o undisturbed.mcap");
    let mut child = folder
        .command("replay --json actuation.log -o out.mcap")
        .stdout(Stdio::piped())
        .spawn()
        .expect("hmd");
    drop(child.stdout.take());
    child.wait().expect("hmd ends");
    assert_eq!(folder.read("out.mcap"), folder.read("undisturbed.mcap"));
}

#[test]
fn a_demonstration_goes_on_without_a_reader() {
    let folder = Folder::new();
    let mut child = folder
        .command("demo -o d.mcap")
        .stdout(Stdio::piped())
        .spawn()
        .expect("hmd");
    drop(child.stdout.take());
    assert!(child.wait().expect("hmd ends").success());
    let summary = folder.done("inspect d.mcap --summary");
    assert!(summary.starts_with("HMD1/EMA0/W23/"), "{summary}");
}

#[test]
fn one_run_gives_the_same_lines_from_text_and_mcap_on_any_number_of_threads() {
    let folder = Folder::new();
    for log in ["run.log", "run.mcap"] {
        folder.done(&format!(
            "simulate -o {log} --rate 400 --windows 2 --fault backlash=0.3 --noise 0.05 --seed 9"
        ));
    }
    assert_eq!(folder.read("run.log.truth.jsonl"), folder.read("run.mcap.truth.jsonl"));

    let lines = folder.done("replay --json run.log --threads 1 -o one.mcap");
    assert_eq!(lines.lines().count(), 2);
    for line in lines.lines() {
        let record: serde_json::Value = serde_json::from_str(line).expect("a line of JSON");
        assert_eq!(record["faults"], serde_json::json!(["backlash"]), "{line}");
    }
    assert_eq!(folder.done("replay --json run.mcap --threads 4"), lines);

    // Truth is for `evaluate` alone.
    fs::remove_file(folder.path("run.log.truth.jsonl")).expect("a truth file");
    assert_eq!(folder.done("replay --json run.log --threads 4 -o four.mcap"), lines);
    assert!(
        folder.read("one.mcap") == folder.read("four.mcap"),
        "the output files differ"
    );

    // The output holds the frames as they came.
    assert_eq!(folder.done("replay --json four.mcap"), lines);
}

#[test]
fn the_drive_of_the_type_keeps_its_parameters_and_another_is_in_the_truth() {
    let folder = Folder::new();
    let short = "--actuator servo270 --rate 400 --seed 2";
    for (log, drive) in [
        ("own", ""),
        ("named", "--drive vector"),
        ("other", "--drive hysteresis"),
    ] {
        folder.done(&format!("simulate -o {log}.log {short} {drive}"));
    }
    for file in ["log", "log.truth.jsonl"] {
        assert_eq!(
            folder.read(&format!("own.{file}")),
            folder.read(&format!("named.{file}"))
        );
    }
    let drive = |log: &str| -> serde_json::Value {
        let truth = folder.read(&format!("{log}.log.truth.jsonl"));
        let line: serde_json::Value = serde_json::from_slice(&truth).expect("a line of JSON");
        line["drive"].clone()
    };
    assert_eq!([drive("own"), drive("other")], ["vector", "hysteresis"]);
    assert!(folder.read("own.log") != folder.read("other.log"));

    // An effect at its value without effect is off.
    folder.done("simulate -o plain.log --rate 400");
    folder.done("simulate -o off.log --rate 400 --with cogging_nm=0 --with saturation=0");
    for file in ["log", "log.truth.jsonl"] {
        assert_eq!(
            folder.read(&format!("plain.{file}")),
            folder.read(&format!("off.{file}"))
        );
    }
}

#[test]
fn the_same_seed_simulates_the_same_bytes() {
    let folder = Folder::new();
    for (name, seed) in [("a", 1), ("b", 1), ("c", 2)] {
        for kind in ["log", "mcap"] {
            folder.done(&format!(
                "simulate -o {name}.{kind} --rate 400 --noise 0.05 --seed {seed}"
            ));
        }
    }
    for kind in ["log", "mcap"] {
        let [a, b, c] = ["a", "b", "c"].map(|name| folder.read(&format!("{name}.{kind}")));
        assert!(a == b && a != c, "{kind}");
    }
}

#[test]
fn a_json_line_has_the_documented_keys_in_order() {
    let folder = Folder::new();
    folder.actuation();
    let line = folder.done("replay --json actuation.log");
    let mut at = 0;
    for key in [
        "actuator",
        "window",
        "t_start_ns",
        "status",
        "k",
        "sigma",
        "observable",
        "cost",
        "residual_rms_a",
        "evaluations",
        "health",
        "faults",
        "rul_h",
        "rul_cycles",
    ] {
        let found = line[at..]
            .find(&format!("\"{key}\":"))
            .unwrap_or_else(|| panic!("{key} is not in its place: {line}"));
        at += found;
    }
    let timed = folder.done("replay --json --timings actuation.log");
    assert!(timed.contains("elapsed_ms") && !line.contains("elapsed_ms"));
}

#[test]
fn the_robust_suite_resumes_and_refuses_the_state_of_another_run() {
    let folder = Folder::new();
    let line = "evaluate robust --n 1 --rate 400 --actuator servo28 --entry resistance --resume state.jsonl --json";
    let first = folder.done(line);
    let report: serde_json::Value = serde_json::from_str(&first).expect("JSON");
    assert_eq!(report["units"], 1);
    assert!(report["before"]["judged_rate"].is_f64() && report["after"]["named_rate"].is_f64());
    let state = folder.read("state.jsonl");
    assert_eq!(folder.done(line), first);
    assert_eq!(folder.read("state.jsonl"), state);
    let sentence = folder.refused(&line.replace("--n 1", "--n 2"), 1);
    assert!(
        sentence.contains("state.jsonl: expected the state of the run"),
        "{sentence}"
    );
}

#[test]
fn a_text_from_another_system_is_the_same_log() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let text: String = lines.iter().map(|line| format!("{line}\r\n")).collect();
    folder.write("windows.log", format!("\u{feff}{text}"));
    assert_eq!(
        folder.done("replay --json windows.log"),
        folder.done("replay --json actuation.log")
    );
}

#[test]
fn the_demo_wears_out_in_order_and_its_forecast_converges() {
    let folder = Folder::new();
    let ended = folder.command("demo").output().expect("hmd starts");
    assert_eq!(ended.status.code(), Some(0));
    let text = String::from_utf8(ended.stdout).expect("text");
    let rows: Vec<&str> = text.lines().filter(|line| line.contains(" ema0 ")).collect();
    let mut states: Vec<&str> = rows
        .iter()
        .filter_map(|row| {
            ["nominal", "watch", "warning", "critical"]
                .into_iter()
                .find(|state| row.contains(state))
        })
        .collect();
    assert_eq!(states.len(), rows.len(), "every row has its state: {text}");
    states.dedup();
    assert_eq!(states, ["nominal", "watch", "warning", "critical"]);
    // Friction reaches 80 % at 0.8 / 0.75 of the hours shown.
    let hours = |row: &str| row.split_whitespace().next().and_then(|h| h.parse::<f64>().ok());
    let end = rows.last().and_then(|row| hours(row)).expect("hours") * 0.8 / 0.75;
    for row in &rows[rows.len() / 2..] {
        let now = hours(row).expect("hours");
        let left: f64 = row
            .split_whitespace()
            .nth(1)
            .and_then(|left| left.parse().ok())
            .expect("a forecast");
        assert!(
            (now + left - end).abs() < 0.1 * end,
            "{row}: expected the end at {end:.0} h"
        );
    }
}

#[test]
fn a_recorded_history_is_shown_in_three_forms() {
    let folder = Folder::new();
    record_demo(&folder.path("."));
    let shown = |options: &str| {
        let ended = folder
            .command(&format!("inspect life.mcap {options}"))
            .output()
            .expect("hmd starts");
        assert_eq!(ended.status.code(), Some(0));
        String::from_utf8(ended.stdout).expect("text")
    };
    let (table, json, csv) = (shown(""), shown("--json"), shown("--csv"));
    let windows = json.lines().count();
    assert!(windows > 10 && csv.lines().count() == windows + 1 && table.lines().count() == windows + 1);
    let last: serde_json::Value = serde_json::from_str(json.lines().last().expect("a line")).expect("JSON");
    assert_eq!(last["health"], "critical");
    assert_eq!(last["dominant_fault"], "friction");
    assert!(last["rul_h"]["p50"].is_f64() && last["damage"]["friction"].is_f64());
    let columns = |line: &str| line.split(',').count();
    assert!(
        csv.lines()
            .all(|line| columns(line) == columns(csv.lines().next().expect("a head")))
    );
    // Replay of the same frames says the same.
    let replayed = folder
        .command("replay life.mcap -c life.mcap.toml --json")
        .output()
        .expect("hmd starts");
    let replayed = String::from_utf8(replayed.stdout).expect("text");
    assert_eq!(replayed.lines().count(), windows);
    for (shown, replayed) in json.lines().zip(replayed.lines()) {
        let [shown, replayed]: [serde_json::Value; 2] =
            [shown, replayed].map(|line| serde_json::from_str(line).expect("JSON"));
        for key in ["window", "health", "rul_h", "rul_cycles"] {
            assert_eq!(shown[key], replayed[key], "{key}");
        }
    }
    folder.refused("inspect missing.mcap", 1);
    fs::write(folder.path("text.log"), "no log\n").expect("a file");
    assert!(
        folder
            .refused("inspect text.log", 1)
            .contains("expected records of windows")
    );
}
