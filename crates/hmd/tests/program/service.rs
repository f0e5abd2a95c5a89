//! `hmd run` under a service manager: this test is the manager, and reads its notifications.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use hmd::daemon::Daemon;
use hmd_core::config::Config;
use hmd_core::record::{Record, Status};
use hmd_ingest::feed::Input;
use hmd_ingest::live::LiveSource;
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::mcap::McapMessages;
use prost::Message;

use super::lines::Lines;

struct Manager {
    folder: tempfile::TempDir,
    socket: UnixDatagram,
    child: Child,
    stderr: BufReader<ChildStderr>,
}

const CONFIG: &str = "[[actuator]]\nid = 3\nbus = \"nosuchbus0\"\npassive = true\n";

impl Manager {
    fn start(output: &str, more: &[&str]) -> Self {
        Self::start_with(output, more, |_| ())
    }

    /// The same in a folder with something in it.
    fn start_with(output: &str, more: &[&str], fill: impl FnOnce(&Path)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fill(folder.path());
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("hmd.toml"), CONFIG).unwrap();
        let socket = UnixDatagram::bind(at("notify")).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        // A path keeps its slash only when written as text.
        let output = format!("{}/{output}", folder.path().display());
        let mut child = Command::new(env!("CARGO_BIN_EXE_hmd"))
            .args(["run", "-c"])
            .arg(at("hmd.toml"))
            .args(["-o", &output])
            .args(more)
            .current_dir(folder.path())
            .env("NOTIFY_SOCKET", at("notify"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Self {
            folder,
            socket,
            child,
            stderr,
        }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The next message that is no heartbeat; how many of those came before it.
    fn next_message(&self) -> (String, u32) {
        let mut heartbeats = 0;
        loop {
            let mut text = [0; 512];
            let length = self.socket.recv(&mut text).unwrap();
            match std::str::from_utf8(&text[..length]).unwrap().trim_end() {
                "WATCHDOG=1" => heartbeats += 1,
                other => return (other.to_owned(), heartbeats),
            }
        }
    }

    fn expect_heartbeat(&self) {
        let mut text = [0; 512];
        let length = self.socket.recv(&mut text).unwrap();
        assert_eq!(&text[..length], b"WATCHDOG=1\n");
    }

    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }

    /// Reads stderr up to a line with this text, and returns it.
    fn read_until(&mut self, text: &str) -> String {
        let mut line = String::new();
        while !line.contains(text) {
            line.clear();
            let read = self.stderr.read_line(&mut line).unwrap();
            assert_ne!(read, 0, "ended without {text:?}");
        }
        line
    }

    fn stop(&mut self) {
        self.signal("-TERM");
        assert_eq!(self.next_message().0, "STOPPING=1");
        assert_eq!(self.child.wait().unwrap().code(), Some(0));
    }
}

#[test]
fn metrics_come_to_a_file_and_over_http_on_this_computer() {
    let more = ["--metrics", "hmd.prom", "--metrics-listen", "127.0.0.1:0"];
    let mut manager = Manager::start("segments/", &more);
    let line = manager.read_until("metrics: http://");
    let address = line.trim().strip_prefix("metrics: http://").unwrap();
    let address = address.strip_suffix("/metrics").unwrap();
    assert_eq!(manager.next_message().0, "READY=1");
    manager.expect_heartbeat();
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    let mut served = String::new();
    stream.read_to_string(&mut served).unwrap();
    let file = std::fs::read_to_string(manager.at("hmd.prom")).unwrap();
    assert!(
        served.contains("# TYPE hmd_frames counter\n") && served.ends_with("# EOF\n"),
        "{served}"
    );
    assert!(
        file.contains("# TYPE hmd_frames_total counter\n") && !file.contains("# EOF"),
        "{file}"
    );
    for text in [served, file] {
        assert!(text.contains("hmd_link_up{interface=\"nosuchbus0\"} 0"), "{text}");
        assert!(text.contains("hmd_storage_state{state=\"ok\"} 1"), "{text}");
    }
    manager.stop();

    let everybody = Command::new(env!("CARGO_BIN_EXE_hmd"))
        .args(["run", "-c", "hmd.toml", "--metrics-listen", "0.0.0.0:9464"])
        .output()
        .unwrap();
    assert_eq!(everybody.status.code(), Some(2));
}

/// The newest status records of a folder of closed segments.
fn last_status(folder: &Path) -> Status {
    let mut last = None;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        for message in McapMessages::new(File::open(&path).unwrap(), "segment").unwrap() {
            let message = message.unwrap();
            if *message.schema == *Status::SCHEMA_NAME {
                last = Some(Status::decode(message.data.as_slice()).unwrap());
            }
        }
    }
    last.unwrap()
}

/// Requirement S-29.
#[test]
fn a_silent_actuator_is_stale_in_log_status_and_metrics() {
    let mut manager = Manager::start("segments/", &["--metrics", "hmd.prom"]);
    let line = manager.read_until("STALE");
    assert!(
        line.starts_with("ema3: STALE, no sample for ") && line.ends_with("since the start\n"),
        "{line}"
    );
    // The status follows the notice.
    let since = Instant::now();
    let stale = "hmd_data_stale{actuator=\"ema3\"} 1";
    while !std::fs::read_to_string(manager.at("hmd.prom")).unwrap().contains(stale) {
        assert!(since.elapsed() < Duration::from_secs(5), "no {stale}");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(manager.next_message().0, "READY=1");
    manager.stop();
    let status = last_status(&manager.at("segments"));
    let [ema3] = status.actuators.as_slice() else {
        panic!("{status:?}");
    };
    assert_eq!(
        (ema3.actuator.as_str(), ema3.data_state.as_str(), ema3.health.as_str()),
        ("ema3", "STALE", "unknown")
    );
    assert!(ema3.data_age_s >= 2.5, "{ema3:?}");
    assert_eq!((ema3.persistence, ema3.passive), (0, true));
}

fn segments(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let names: Vec<_> = names.collect();
    assert!(names.iter().all(|name| name.ends_with("-records.mcap")), "{names:?}");
    names.len()
}

/// Requirements S-10, S-11 and S-12 of `docs/safety.md`.
#[test]
fn the_manager_is_notified_of_readiness_progress_reload_and_end() {
    let since = Instant::now();
    let mut manager = Manager::start("segments/", &[]);
    assert_eq!(manager.next_message(), ("READY=1".to_owned(), 0));
    assert!(since.elapsed() < Duration::from_secs(5), "{:?}", since.elapsed());
    manager.expect_heartbeat();

    manager.signal("-HUP");
    let reloading = manager.next_message().0;
    assert!(reloading.starts_with("RELOADING=1\nMONOTONIC_USEC="), "{reloading}");
    assert_eq!(manager.next_message().0, "READY=1");
    manager.expect_heartbeat();

    std::fs::write(manager.at("hmd.toml"), "[[actuator]]\nid = 99\n").unwrap();
    manager.signal("-HUP");
    assert!(manager.next_message().0.starts_with("RELOADING=1"));
    assert_eq!(manager.next_message().0, "READY=1");
    manager.read_until("not reloaded, the configuration stays as it was: ");
    manager.expect_heartbeat();

    manager.stop();
    assert_eq!(segments(&manager.at("segments")), 2, "one of each configuration");
}

#[test]
fn one_file_belongs_to_one_configuration() {
    let mut manager = Manager::start("one.mcap", &[]);
    assert_eq!(manager.next_message().0, "READY=1");
    manager.signal("-HUP");
    assert!(manager.next_message().0.starts_with("RELOADING=1"));
    assert_eq!(manager.next_message().0, "READY=1");
    manager.read_until("not reloaded: the output is one file");
    manager.stop();
    assert!(std::fs::read(manager.at("one.mcap")).unwrap().ends_with(mcap::MAGIC));
}

/// The folder is gone when the configuration is read again: the run goes on, and stores when the folder is back.
#[test]
fn a_reload_without_its_folder_goes_on() {
    let mut manager = Manager::start("segments/", &[]);
    assert_eq!(manager.next_message().0, "READY=1");
    let folder = manager.at("segments");
    std::fs::rename(&folder, manager.at("before")).unwrap();
    std::fs::write(&folder, "no folder").unwrap();
    manager.signal("-HUP");
    assert!(manager.next_message().0.starts_with("RELOADING=1"));
    assert_eq!(manager.next_message().0, "READY=1");
    manager.read_until("tried again every second");
    manager.expect_heartbeat();
    std::fs::remove_file(&folder).unwrap();
    manager.read_until("storage: written again");
    // As of a start; a manager that knows it already passes over it.
    assert_eq!(manager.next_message().0, "READY=1");
    manager.signal("-TERM");
    assert_eq!(manager.next_message().0, "STOPPING=1");
    assert_eq!(
        manager.child.wait().unwrap().code(),
        Some(3),
        "what was not stored is a loss"
    );
    assert!(segments(&folder) > 0);
}

/// A configuration that turns into a FIFO would make a reload wait for ever.
#[test]
fn a_reload_from_a_fifo_changes_nothing_and_the_end_is_obeyed() {
    let mut manager = Manager::start("segments/", &[]);
    assert_eq!(manager.next_message().0, "READY=1");
    std::fs::remove_file(manager.at("hmd.toml")).unwrap();
    assert!(
        Command::new("mkfifo")
            .arg(manager.at("hmd.toml"))
            .status()
            .unwrap()
            .success()
    );
    manager.signal("-HUP");
    assert!(manager.next_message().0.starts_with("RELOADING=1"));
    assert_eq!(manager.next_message().0, "READY=1");
    let line = manager.read_until("not reloaded, the configuration stays as it was: ");
    assert!(line.contains("expected a regular file"), "{line}");
    manager.expect_heartbeat();
    manager.stop();
}

/// Whoever forgot the line would wait for a device that is sought nowhere.
#[test]
fn a_bus_that_may_be_meant_as_a_serial_line_is_told() {
    let mut manager = Manager::start("segments/", &[]);
    manager.read_until("bus nosuchbus0: no [[serial]] has it, so a CAN interface of this name is sought");
    assert_eq!(manager.next_message().0, "READY=1");
    manager.stop();
}

#[test]
fn a_reload_without_its_folders_changes_nothing() {
    let mut manager = Manager::start_with("segments/", &[], |folder| {
        std::fs::write(folder.join("file"), "no folder").unwrap();
    });
    assert_eq!(manager.next_message().0, "READY=1");
    let learning = |folder: &str| format!("{CONFIG}learn_windows = 5\nlearn_folder = \"{folder}\"\n");
    let keeping = |folder: &str| format!("[rul]\nstate = \"{folder}\"\n{CONFIG}");
    for (config, refused) in [
        (keeping("/proc/x"), "rul.state: /proc/x: "),
        (keeping("file"), "rul.state: "),
        (learning("/proc/x"), "actuator.learn_folder of ema3: "),
        // Its own folder is no other run's.
        (keeping("state"), ""),
        (keeping("state"), ""),
        (keeping("/proc/x"), "rul.state: /proc/x: "),
    ] {
        std::fs::write(manager.at("hmd.toml"), config).unwrap();
        manager.signal("-HUP");
        assert!(manager.next_message().0.starts_with("RELOADING=1"));
        assert_eq!(manager.next_message().0, "READY=1");
        let told = match refused {
            "" => "reloaded, configuration ".to_owned(),
            cause => format!("not reloaded, the configuration stays as it was: {cause}"),
        };
        manager.read_until(&told);
        manager.expect_heartbeat();
    }
    manager.stop();
    assert_eq!(segments(&manager.at("segments")), 3, "one of each run");
}

/// Segments that take long to repair, or are bombs, do not keep the daemon from its work.
#[test]
fn cut_segments_are_repaired_beside_the_watch() {
    let bomb = crate::inputs::bomb(20);
    let since = Instant::now();
    let mut manager = Manager::start_with("segments/", &[], |folder| {
        std::fs::create_dir(folder.join("segments")).unwrap();
        for number in 1..=3 {
            let name = format!("segments/hmd-{number:08}-records.mcap.part");
            std::fs::write(folder.join(name), &bomb[..bomb.len() - 40]).unwrap();
        }
    });
    assert_eq!(manager.next_message().0, "READY=1");
    assert!(since.elapsed() < Duration::from_secs(5), "{:?}", since.elapsed());
    // Not even the first is repaired before.
    manager.read_until("3 cut segments are repaired in the background");
    for _ in 0..3 {
        manager.read_until("was cut");
    }
    manager.stop();
}

#[test]
fn a_folder_that_cannot_be_written_fails_at_the_start() {
    let mut manager = Manager::start("hmd.toml/", &[]);
    assert_eq!(manager.child.wait().unwrap().code(), Some(1));
    // A folder where even root may make no file.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("hmd.toml"), CONFIG).unwrap();
    let socket = UnixDatagram::bind(folder.path().join("notify")).unwrap();
    socket.set_nonblocking(true).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_hmd"))
        .args(["run", "-c", "hmd.toml", "-o", "/proc/"])
        .current_dir(folder.path())
        .env("NOTIFY_SOCKET", folder.path().join("notify"))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let since = Instant::now();
    let code = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status.code();
        }
        if since.elapsed() > Duration::from_secs(10) {
            child.kill().unwrap();
            panic!("it runs without an output");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let mut text = String::new();
    child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("/proc/"), "{text}");
    assert!(socket.recv(&mut [0; 64]).is_err(), "it was not ready");
}

/// stderr follows stdout unless it is told not to, and a least system has no `kill` beside the shell's.
#[test]
fn the_unit_sends_messages_to_the_journal_and_reloads_by_the_shell() {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../dist/systemd/hmd.service");
    let unit = std::fs::read_to_string(unit).unwrap();
    let has = |line: &str| unit.lines().any(|found| found == line);
    assert!(has("StandardOutput=null") && has("StandardError=journal"), "{unit}");
    assert!(has("ExecReload=/bin/sh -c \"kill -HUP $MAINPID\""), "{unit}");
}

/// The unit that is shipped: a check before the start would hide exit code 78 from the manager, which then restarts for ever.
#[test]
fn a_bad_configuration_is_not_tried_again_by_the_unit() {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../dist/systemd/hmd.service");
    let unit = std::fs::read_to_string(unit).unwrap();
    assert!(!unit.lines().any(|line| line.starts_with("ExecStartPre=")), "{unit}");
    assert!(unit.contains("\nRestartPreventExitStatus=78\n"), "{unit}");
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("hmd.toml"), "[[actuator]]\nid = 99\n").unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_hmd"))
        .args(["run", "-c", "hmd.toml", "-o", "segments/"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(ended.status.code(), Some(78));
    assert_eq!(String::from_utf8(ended.stderr).unwrap().lines().count(), 1);
    assert!(!folder.path().join("segments").exists());
}

/// Keeps the history of a worn actuator as a run before does, whose last window was cut short. How many of the last were not assessed.
fn keep_worn_history(folder: &Path) -> usize {
    let text = format!("{CONFIG}[rul]\nstate = \"{}\"\n", folder.join("state").display());
    let config = Arc::new(Config::from_toml_str(&text, "hmd.toml").unwrap());
    let worn = FaultVector::from_array([0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5]);
    let scenario = Scenario {
        actuations: Actuations {
            count: 3,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(ActuatorParams::bench(), worn, 5)
    };
    let mut frames: Vec<_> = traffic(&scenario, config.actuators()[0].id, EPOCH_NS).collect();
    frames.truncate(frames.len() - frames.len() / 9);
    let inputs = frames.into_iter().map(Input::Frame);
    let daemon = Daemon {
        sources: vec![("nosuchbus0".to_owned(), LiveSource::Playback(Box::new(inputs)))],
        recorder: None,
        watch: Some((config, 1)),
    };
    let lines = Lines::default();
    let status = daemon.run(std::future::pending(), &lines).unwrap();
    assert_eq!(status.actuators[0].health, "critical");
    let health = lines.health();
    health
        .iter()
        .rev()
        .take_while(|line| line.contains("\"k\":null"))
        .count()
}

/// An alert on a worn part must not be resolved by a restart.
#[test]
fn what_the_history_knows_is_in_the_metrics_from_ready_on() {
    let more = ["--metrics", "hmd.prom", "--set", "rul.state=state"];
    let mut unassessed = 0;
    let mut manager = Manager::start_with("segments/", &more, |folder| unassessed = keep_worn_history(folder));
    assert!(unassessed > 0, "the last window was cut");
    let unassessed = format!("hmd_unassessed_windows{{actuator=\"ema3\"}} {unassessed}");
    for _ in ["start", "reload"] {
        while manager.next_message().0 != "READY=1" {}
        let text = std::fs::read_to_string(manager.at("hmd.prom")).unwrap();
        for line in [
            "hmd_health{actuator=\"ema3\"} 4",
            "hmd_fault_state{actuator=\"ema3\",fault=\"backlash\",part=\"gear and screw\"} 4",
            "hmd_fault_state{actuator=\"ema3\",fault=\"short_a\",part=\"stator winding, phase A\"} ",
            &unassessed,
            "hmd_last_window_timestamp_seconds{actuator=\"ema3\"} ",
        ] {
            assert!(text.lines().any(|found| found.starts_with(line)), "{line} in\n{text}");
        }
        std::fs::remove_file(manager.at("hmd.prom")).unwrap();
        manager.signal("-HUP");
    }
    while manager.next_message().0 != "READY=1" {}
    manager.stop();
}
