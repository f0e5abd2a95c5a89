//! `hmd run` and `hmd record` as programs, where there is no such bus.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};

use crate::serial_rig::Plug;

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
    std::fs::write(&config, "[[actuator]]\nid = 3\nbus = \"nosuchcan0\"\n").unwrap();
    let (code, text) = run_until_first_report(hmd().arg("run").arg("-c").arg(&config).arg("-o").arg(&output));
    assert_eq!(code, Some(0), "{text}");
    // Missing, or down where the kernel has no CAN at all.
    assert!(text.starts_with("nosuchcan0: "), "{text}");
    assert!(text.ends_with("0 frames received: 0 decoded, 0 of others than the actuators watched, 0 error frames\n"));
    is_complete(&output);

    let output = folder.path().join("raw.mcap");
    let (code, text) = run_until_first_report(hmd().args(["record", "nosuchcan0", "-o"]).arg(&output));
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
    for (n, (device, found)) in [
        (config.display().to_string(), "a regular file"),
        (folder.path().display().to_string(), "a folder"),
        ("/dev/null".to_owned(), "another device"),
    ]
    .iter()
    .enumerate()
    {
        let output = folder.path().join(format!("raw{n}.mcap"));
        let line = format!("uart1={device}@400000");
        let (code, text) = run_until_first_report(hmd().args(["record", "--serial", &line, "-o"]).arg(&output));
        assert_eq!(code, Some(0), "{text}");
        let told = format!("uart1: down (expected a terminal, found {found}); waiting");
        assert!(text.starts_with(&told), "{text}");
        is_complete(&output);
    }
}

/// A run that is ended with the test, whatever comes of that.
struct Run {
    child: Child,
    stderr: BufReader<ChildStderr>,
}

impl Run {
    fn start(config: &Path) -> Self {
        let mut command = hmd();
        let command = command.arg("run").arg("-c").arg(config).stdout(Stdio::null());
        let mut child = command.stderr(Stdio::piped()).spawn().expect("hmd starts");
        let stderr = BufReader::new(child.stderr.take().expect("a pipe"));
        Self { child, stderr }
    }

    /// Its next line.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.stderr.read_line(&mut line).expect("a line");
        line.trim_end().to_owned()
    }

    fn stop(&mut self) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").arg(id).status().expect("kill").success());
        self.child.wait().expect("an end");
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Two readers of one device would each get a part of its bytes.
#[test]
fn a_second_reader_of_a_serial_device_waits_until_the_first_has_ended() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("hmd.toml");
    let mut plug = Plug::new(folder.path());
    plug.plug();
    let text = "[[actuator]]\nid = 3\nbus = \"uart1\"\n[[serial]]\nbus = \"uart1\"\ndevice = \"line\"\n";
    std::fs::write(&config, text).unwrap();
    let mut first = Run::start(&config);
    assert_eq!(first.line(), "uart1: up");
    let mut second = Run::start(&config);
    assert_eq!(second.line(), "uart1: down (another reader has it); waiting");
    first.stop();
    while second.line() != "uart1: up" {
        assert!(second.child.try_wait().unwrap().is_none(), "it waits");
    }

    // The same device under two names, which no configuration shows.
    second.stop();
    std::os::unix::fs::symlink(plug.path(), folder.path().join("link")).unwrap();
    let other = "[[actuator]]\nid = 4\nbus = \"uart2\"\n[[serial]]\nbus = \"uart2\"\ndevice = \"link\"\n";
    std::fs::write(&config, format!("{text}{other}")).unwrap();
    let mut both = Run::start(&config);
    let mut lines = [both.line(), both.line()];
    lines.sort_by_key(|line| line.ends_with(": up"));
    assert!(
        lines[0].ends_with(": down (another reader has it); waiting"),
        "{lines:?}"
    );
    assert!(lines[1].ends_with(": up"), "{lines:?}");

    std::fs::write(&config, format!("{text}{}", other.replace("link", "line"))).unwrap();
    let refused = hmd().arg("run").arg("-c").arg(&config).output().unwrap();
    assert_eq!(refused.status.code(), Some(78));
    let sentence = String::from_utf8(refused.stderr).unwrap();
    assert!(
        sentence.contains("serial[1].device: expected a device that no other serial line has, found \"line\""),
        "{sentence}"
    );
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
fn a_name_that_is_given_twice_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for (interfaces, expected) in [
        (
            &["can0", "can1", "can0"][..],
            "expected each interface once, found \"can0\" twice",
        ),
        (&["uart1", "--serial", "uart1=/dev/null"], "found \"uart1\" twice"),
        (&["a/b"], "interface \"a/b\": "),
    ] {
        let mut record = hmd();
        record.args(["record", "-o", "out.mcap"]).args(interfaces);
        let output = record.current_dir(folder.path()).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains(expected), "{text}");
        assert!(!folder.path().join("out.mcap").exists());
    }
}

#[test]
fn a_stop_does_not_wait_for_a_reader_of_stderr() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("hmd.toml"),
        "[[actuator]]\nid = 3\nbus = \"nosuchcan0\"\n",
    )
    .unwrap();
    for line in ["run -c hmd.toml", "record nosuchcan0 -o out.mcap"] {
        let (reader, mut writer) = std::io::pipe().unwrap();
        // As much as a pipe holds.
        writer.write_all(&[b'x'; 1 << 16]).unwrap();
        let mut child = hmd()
            .args(line.split(' '))
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(writer)
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_secs(1));
        let id = child.id().to_string();
        assert!(Command::new("kill").arg(&id).status().unwrap().success());
        let start = std::time::Instant::now();
        let ended = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status.code();
            }
            if start.elapsed() > std::time::Duration::from_secs(30) {
                child.kill().unwrap();
                break None;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        };
        assert_eq!(ended, Some(0), "hmd {line}");
        drop(reader);
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
    std::fs::write(&config, "[[actuator]]\nid = 3\nbus = \"nosuchcan0\"\n").unwrap();
    std::fs::write(&output, "a recording").unwrap();
    for command in [
        hmd().arg("run").arg("-c").arg(&config).arg("-o").arg(&output),
        hmd().args(["record", "nosuchcan0", "-o"]).arg(&output),
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
    std::fs::write(&config, "[[actuator]]\nid = 3\nbus = \"nosuchcan0\"\n").unwrap();
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
