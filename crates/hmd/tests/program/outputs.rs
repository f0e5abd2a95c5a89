//! No output destroys what is there: what a run reads, a recording, or the old file when the new one cannot be finished.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::fs;
use std::os::unix::fs::symlink;

use crate::folder::Folder;

/// A folder with a log, its recording, a copy of that, and a configuration for a live run.
fn recorded() -> Folder {
    let folder = Folder::new();
    folder.actuation();
    folder.done("replay actuation.log -o flight.mcap");
    folder.write("other.mcap", folder.read("flight.mcap"));
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 3\nbus = \"nosuchbus0\"\n[rul]\nevents = \"events.jsonl\"\n",
    );
    folder
}

/// Files that a command must leave as they are.
const KEPT: [&str; 4] = ["actuation.log", "flight.mcap", "other.mcap", "hmd.toml"];

fn refused_and_kept(folder: &Folder, code: i32, line: &str) {
    let before = KEPT.map(|name| folder.read(name));
    let ended = folder.hmd(line);
    assert_eq!(ended.code, code, "hmd {line}: {}", ended.stderr);
    for (name, content) in KEPT.into_iter().zip(before) {
        assert!(folder.read(name) == content, "hmd {line}: {name} was changed");
    }
}

#[test]
fn a_link_at_the_place_of_a_sidecar_leads_nowhere() {
    let folder = recorded();
    symlink("flight.mcap", folder.path("a.csv.metadata.json")).unwrap();
    refused_and_kept(&folder, 2, "export flight.mcap -o a.csv");
    fs::hard_link(folder.path("flight.mcap"), folder.path("b.csv.metadata.json")).unwrap();
    refused_and_kept(&folder, 2, "export flight.mcap -o b.csv");
    symlink("other.mcap", folder.path("c.log.truth.jsonl")).unwrap();
    refused_and_kept(&folder, 2, "simulate --rate 400 -o c.log");
    symlink("other.mcap", folder.path("d.mcap.toml")).unwrap();
    refused_and_kept(&folder, 2, "demo -o d.mcap");
    symlink("actuation.log", folder.path("e.csv.metadata.json")).unwrap();
    refused_and_kept(&folder, 2, "export flight.mcap -o e.csv");
    // A file of the same content: its link is replaced, the file stays.
    folder.write("old.json", "{}");
    symlink("old.json", folder.path("f.csv.metadata.json")).unwrap();
    refused_and_kept(&folder, 0, "export flight.mcap -o f.csv");
    assert!(folder.read("old.json") == b"{}" && folder.read("f.csv.metadata.json").len() > 2);
}

#[test]
fn a_recording_is_replaced_by_no_other_kind_of_file() {
    let folder = recorded();
    refused_and_kept(&folder, 2, "report flight.mcap -o other.mcap");
    fs::hard_link(folder.path("other.mcap"), folder.path("other.csv")).unwrap();
    refused_and_kept(&folder, 2, "export flight.mcap -o other.csv");
    for metrics in ["flight.mcap", "actuation.log", "hmd.toml", "events.jsonl"] {
        refused_and_kept(&folder, 2, &format!("run -c hmd.toml --metrics {metrics}"));
    }
    refused_and_kept(&folder, 2, "run -c hmd.toml -o new.prom --metrics ./new.prom");
    refused_and_kept(
        &folder,
        2,
        "run -c hmd.toml -o out/ --metrics out/hmd-00000001-raw.mcap",
    );
    refused_and_kept(&folder, 2, "run -c hmd.toml -o events.jsonl");
}

#[test]
fn a_file_is_replaced_by_its_own_kind_alone() {
    let folder = recorded();
    folder.write("notes.txt", "what I saw");
    folder.write("notes.toml", "[own]\n");
    folder.write("notes.csv", "t,I_A\n0,1\n");
    folder.write("notes.parquet", "PAR1 somebody else's PAR1");
    folder.write("demo.mcap.toml", "[[actuator]]\nid = 1\n");
    folder.write("notes.mcap", "no recording");
    let own = [
        "notes.txt",
        "notes.toml",
        "notes.csv",
        "notes.parquet",
        "demo.mcap.toml",
        "notes.mcap",
    ];
    let before = own.map(|name| folder.read(name));
    for line in [
        "recover flight.mcap -o hmd.toml",
        "recover flight.mcap -o actuation.log",
        "replay actuation.log -o notes.mcap",
        "calibrate flight.mcap -o actuation.log",
        "calibrate flight.mcap -o notes.toml",
        "calibrate flight.mcap -o new.toml --report actuation.log",
        "calibrate --type -o notes.toml",
        "demo -o actuation.log",
        "demo -o demo.mcap",
        "demo -o hmd",
        "simulate --rate 400 -o notes.mcap",
        "export flight.mcap -o notes.csv",
        "export flight.mcap -o notes.parquet",
        "report flight.mcap -o notes.txt",
        "run -c hmd.toml -o notes.txt",
    ] {
        refused_and_kept(&folder, 2, line);
        for (name, content) in own.iter().zip(&before) {
            assert!(folder.read(name) == *content, "hmd {line}: {name} was changed");
        }
    }
    for line in [
        "export flight.mcap -o again.csv",
        "export flight.mcap -o again.parquet",
        "report flight.mcap -o again.html",
        "simulate --rate 400 -o again.log",
        "simulate --rate 400 -o again.mcap",
    ] {
        folder.done(line);
        folder.done(line);
    }
}

#[test]
fn a_replay_with_nothing_to_assess_leaves_the_old_recording() {
    let folder = recorded();
    folder.write("foreign.log", "(1.000000) can0 7FF#00\n");
    refused_and_kept(&folder, 1, "replay foreign.log -o other.mcap");
    refused_and_kept(&folder, 1, "replay foreign.log -o new.mcap");
    assert!(!folder.path("new.mcap").exists());
}

#[test]
fn a_served_replay_looks_at_its_input_before_it_waits_for_viewers() {
    let folder = recorded();
    folder.refused("replay none.log --serve=127.0.0.1:0", 1);
    folder.refused("replay actuation.log -c none.toml --serve=127.0.0.1:0", 78);
    folder.refused("replay actuation.log -o actuation.log --serve=127.0.0.1:0", 2);
}

#[test]
fn events_go_to_a_file_of_events_alone() {
    let folder = recorded();
    for events in ["flight.mcap", "actuation.log", "own.toml"] {
        folder.write(
            "own.toml",
            format!("[[actuator]]\nid = 3\n[rul]\nevents = \"{events}\"\n"),
        );
        let before = folder.read(events);
        let ended = folder.hmd("event --reset ema3 -c own.toml");
        assert!([2, 78].contains(&ended.code), "{events}: {}", ended.stderr);
        assert!(folder.read(events) == before, "{events} was changed");
    }
}

/// A disk that takes nothing, as a full one.
#[test]
fn an_event_that_cannot_be_noted_is_no_bad_configuration() {
    let folder = recorded();
    let full = format!(
        "trap '' XFSZ; ulimit -f 0; {} event --reset ema3 -c hmd.toml",
        env!("CARGO_BIN_EXE_hmd")
    );
    let mut shell = std::process::Command::new("sh");
    let ended = shell.args(["-c", &full]).current_dir(folder.path("")).output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("events.jsonl: the event is not noted: "), "{stderr}");
    assert!(!folder.path("events.jsonl").exists());
}

#[test]
fn an_output_that_cannot_be_finished_leaves_the_old_file() {
    let folder = recorded();
    folder.write("page.html", "<!DOCTYPE html>the old page");
    folder.write("table.csv", "t_ns,actuator,the old table");
    folder.write("copy.mcap", folder.read("flight.mcap"));
    folder.write("text.mcap", "no recording at all");
    let names = || {
        let mut names: Vec<_> = fs::read_dir(folder.path("."))
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        names
    };
    let before = names();
    for (file, line) in [
        ("page.html", "report flight.mcap -o page.html"),
        ("table.csv", "export --table samples flight.mcap -o table.csv"),
        ("copy.mcap", "recover flight.mcap -o copy.mcap"),
        ("copy.mcap", "replay actuation.log -o copy.mcap"),
        ("copy.mcap", "simulate --rate 400 -o copy.mcap"),
        ("actuation.log", "simulate --rate 400 --seed 6 -o actuation.log"),
    ] {
        let old = folder.read(file);
        // The limit is an error of the write, as a full disk is.
        let limited = std::process::Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f 8; exec \"$0\" $1"])
            .arg(env!("CARGO_BIN_EXE_hmd"))
            .arg(line)
            .current_dir(folder.path("."))
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&limited.stderr).into_owned();
        assert_eq!(limited.status.code(), Some(1), "{line}: {text}");
        assert!(text.contains("File too large"), "{line}: {text}");
        assert!(folder.read(file) == old, "{line}: the old {file} is gone");
    }
    assert_eq!(names(), before, "nothing is left over");
    // An input in which nothing is intact.
    let ended = folder.hmd("recover text.mcap -o copy.mcap");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(folder.read("copy.mcap") == folder.read("flight.mcap"));
    assert_eq!(names(), before, "nothing is left over");
}

#[test]
fn an_event_says_what_it_noted_and_refuses_what_means_nothing() {
    let folder = Folder::new();
    let config = |output: &str| {
        let text = format!("[[actuator]]\nid = 3\n[rul]\nevents = \"events.jsonl\"\n[output]\n{output}\n");
        folder.write("hmd.toml", text);
    };
    config("raw_frames = false");
    let said = folder.done("event --reset ema3 --part gearbox -c hmd.toml --at 2026-11-20T14:00Z");
    let noted = "from 2026-11-20 14:00 UTC on, with the next movement; noted in events.jsonl (to withdraw it, delete that line before then)";
    assert_eq!(
        said.trim(),
        format!("ema3: gearbox replaced, its faults begin anew {noted}")
    );
    let ended = folder.hmd("event --keep ema3 -c hmd.toml --at 2026-11-20T14:00Z");
    assert!(
        ended
            .stderr
            .contains(" s ago; a daemon that keeps up holds frames for 7.5 s"),
        "{}",
        ended.stderr
    );
    assert_eq!(folder.hmd("event --keep ema3 -c hmd.toml").stderr, "");
    assert_eq!(
        ended.stdout.trim(),
        "ema3: frames from 2 s before to 1 s after 2026-11-20 14:00 UTC asked for; noted in events.jsonl"
    );
    let ended = folder.hmd("event --reset ema3 -c hmd.toml --at 2200-01-01T00:00Z");
    assert_eq!(ended.stderr, "--at: warning: 2200-01-01 00:00 UTC is still to come\n");
    let lines = String::from_utf8(folder.read("events.jsonl")).unwrap();
    assert!(lines.contains("\"event\":\"reset\",\"part\":\"gearbox\"") && lines.contains("\"event\":\"keep\""));

    let refused = folder.misused("event --reset ema3 --part wing -c hmd.toml");
    assert!(
        refused.contains("expected one of motor, gearbox, controller, found \"wing\""),
        "{refused}"
    );
    folder.misused("event --keep ema3 --part gearbox -c hmd.toml");
    folder.misused("event --keep ema3 --reset ema3 -c hmd.toml");
    for (output, found) in [
        ("raw_frames = true", "output.raw_frames = true: all frames are stored"),
        ("raw_frames = false\ncaptures = false", "output.captures = false"),
    ] {
        config(output);
        let refused = folder.refused("event --keep ema3 -c hmd.toml", 2);
        assert!(
            refused.ends_with(&format!("expected a configuration with captures, found {found}")),
            "{refused}"
        );
    }
    assert_eq!(String::from_utf8(folder.read("events.jsonl")).unwrap(), lines);
}
