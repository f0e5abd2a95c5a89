//! `hmd run` and `hmd record` as programs, where there is no such bus.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

fn hmd() -> Command {
    Command::new(env!("CARGO_BIN_EXE_hmd"))
}

/// Starts, waits until the missing bus has been reported, sends SIGTERM; exit code and the text on stderr.
fn run_until_first_report(command: &mut Command) -> (Option<i32>, String) {
    let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut text = String::new();
    stderr.read_line(&mut text).unwrap();
    let killed = Command::new("kill").arg(child.id().to_string()).status().unwrap();
    assert!(killed.success());
    stderr.read_to_string(&mut text).unwrap();
    (child.wait().unwrap().code(), text)
}

fn is_complete(file: &Path) {
    assert!(
        std::fs::read(file).unwrap().ends_with(mcap::MAGIC),
        "a footer stands at the end"
    );
}

#[test]
fn run_retries_missing_bus_until_signal() {
    let folder = tempfile::tempdir().unwrap();
    let [config, output] = ["hmd.toml", "out.mcap"].map(|name| folder.path().join(name));
    std::fs::write(&config, "[[actuator]]\nid = 3\nbus = \"nosuchbus0\"\n").unwrap();
    let (code, text) = run_until_first_report(hmd().arg("run").arg("-c").arg(&config).arg("-o").arg(&output));
    assert_eq!(code, Some(0), "{text}");
    // Missing, or down where the kernel has no CAN at all.
    assert!(text.starts_with("nosuchbus0: "), "{text}");
    assert!(text.ends_with("0 frames received: 0 decoded, 0 of others than the actuators watched, 0 error frames\n"));
    is_complete(&output);

    let output = folder.path().join("raw.mcap");
    let (code, text) = run_until_first_report(hmd().args(["record", "nosuchbus0", "-o"]).arg(&output));
    assert_eq!(code, Some(0), "{text}");
    is_complete(&output);
}

#[test]
fn run_retries_missing_serial_device() {
    let folder = tempfile::tempdir().unwrap();
    let [config, output] = ["hmd.toml", "out.mcap"].map(|name| folder.path().join(name));
    let text = "[[actuator]]\nid = 3\nbus = \"uart1\"\n[[serial]]\nbus = \"uart1\"\ndevice = \"nosuchtty\"\n";
    std::fs::write(&config, text).unwrap();
    let (code, text) = run_until_first_report(hmd().arg("run").arg("-c").arg(&config).arg("-o").arg(&output));
    assert_eq!(code, Some(0), "{text}");
    assert!(text.starts_with("uart1: missing (No such file"), "{text}");
    is_complete(&output);

    // What is there and no terminal is down.
    let output = folder.path().join("raw.mcap");
    let line = format!("uart1={}@400000", config.display());
    let (code, text) = run_until_first_report(hmd().args(["record", "--serial", &line, "-o"]).arg(&output));
    assert_eq!(code, Some(0), "{text}");
    assert!(text.starts_with("uart1: down (Inappropriate ioctl"), "{text}");
    is_complete(&output);
}

#[test]
fn a_serial_line_without_a_name_or_a_rate_is_refused() {
    for (line, expected) in [
        ("/dev/ttyS0", "expected BUS=DEVICE"),
        ("a/b=/dev/ttyS0", "1 to 15 printable characters"),
        ("uart1=/dev/ttyS0@fast", "expected a bit rate after @"),
        ("uart1=/dev/ttyS0@0", "expected a bit rate after @"),
    ] {
        let output = hmd()
            .args(["record", "-o", "out.mcap", "--serial", line])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2));
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn a_configuration_that_says_not_where_to_listen_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("hmd.toml");
    let refused = |text: &str| {
        std::fs::write(&config, text).unwrap();
        let output = hmd().arg("run").arg("-c").arg(&config).output().unwrap();
        assert_eq!(output.status.code(), Some(78));
        String::from_utf8(output.stderr).unwrap()
    };
    let text = refused("[[actuator]]\nid = 3\n");
    assert!(text.contains("expected a bus for every [[actuator]] that is watched live, found none for ema3"));
    let text = refused("[[actuator]]\nid = 3\nbus = \"a/b\"\n");
    assert!(text.contains("bus \"a/b\""), "{text}");
    refused("");
}

#[test]
fn a_recording_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [config, output] = ["hmd.toml", "out.mcap"].map(|name| folder.path().join(name));
    std::fs::write(&config, "[[actuator]]\nid = 3\nbus = \"nosuchbus0\"\n").unwrap();
    std::fs::write(&output, "a recording").unwrap();
    for command in [
        hmd().arg("run").arg("-c").arg(&config).arg("-o").arg(&output),
        hmd().args(["record", "nosuchbus0", "-o"]).arg(&output),
    ] {
        let ended = command.output().unwrap();
        let text = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(2), "{text}");
        assert!(text.contains("11 bytes: it is not replaced"), "{text}");
    }
    assert_eq!(std::fs::read(&output).unwrap(), b"a recording");
}

#[test]
fn a_stop_is_not_lost_behind_many_reloads() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("hmd.toml");
    std::fs::write(&config, "[[actuator]]\nid = 3\nbus = \"nosuchbus0\"\n").unwrap();
    let mut child = hmd()
        .arg("run")
        .arg("-c")
        .arg(&config)
        .args(["-o", "records/"])
        .current_dir(folder.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    stderr.read_line(&mut String::new()).unwrap();
    let reader = std::thread::spawn(move || stderr.read_to_string(&mut String::new()).unwrap());
    let id = child.id().to_string();
    for name in std::iter::repeat_n("-HUP", 40).chain(["-TERM"]) {
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }
    let start = std::time::Instant::now();
    let ended = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        assert!(start.elapsed() < std::time::Duration::from_secs(30), "it does not stop");
        std::thread::sleep(std::time::Duration::from_millis(20));
    };
    assert_eq!(ended.code(), Some(0));
    reader.join().unwrap();
}
