//! `hmd run` under a service manager: this test is the manager, and hears what it is told.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::{Duration, Instant};

use hmd_core::record::{Record, Status};
use hmd_storage::mcap::McapMessages;
use prost::Message;

struct Manager {
    folder: tempfile::TempDir,
    socket: UnixDatagram,
    child: Child,
    said: BufReader<ChildStderr>,
}

const CONFIG: &str = "[[actuator]]\nid = 3\nbus = \"nosuchbus0\"\npassive = true\n";

impl Manager {
    fn start(output: &str, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
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
        let said = BufReader::new(child.stderr.take().unwrap());
        Self {
            folder,
            socket,
            child,
            said,
        }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The next message that is no sign of life; how many of those came before it.
    fn told(&self) -> (String, u32) {
        let mut alive = 0;
        loop {
            let mut text = [0; 512];
            let length = self.socket.recv(&mut text).unwrap();
            match std::str::from_utf8(&text[..length]).unwrap().trim_end() {
                "WATCHDOG=1" => alive += 1,
                other => return (other.to_owned(), alive),
            }
        }
    }

    fn alive(&self) {
        let mut text = [0; 512];
        let length = self.socket.recv(&mut text).unwrap();
        assert_eq!(&text[..length], b"WATCHDOG=1\n");
    }

    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }

    /// Reads stderr up to a line with this text, and returns it.
    fn until_said(&mut self, text: &str) -> String {
        let mut line = String::new();
        while !line.contains(text) {
            line.clear();
            let read = self.said.read_line(&mut line).unwrap();
            assert_ne!(read, 0, "ended without saying {text:?}");
        }
        line
    }

    fn stop(&mut self) {
        self.signal("-TERM");
        assert_eq!(self.told().0, "STOPPING=1");
        assert_eq!(self.child.wait().unwrap().code(), Some(0));
    }
}

#[test]
fn metrics_come_to_a_file_and_over_http_on_this_computer() {
    let more = ["--metrics", "hmd.prom", "--metrics-listen", "127.0.0.1:0"];
    let mut manager = Manager::start("segments/", &more);
    let line = manager.until_said("metrics: http://");
    let address = line.trim().strip_prefix("metrics: http://").unwrap();
    let address = address.strip_suffix("/metrics").unwrap();
    assert_eq!(manager.told().0, "READY=1");
    manager.alive();
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .write_all(b"GET /metrics HTTP/1.1\r\nHost: here\r\n\r\n")
        .unwrap();
    let mut served = String::new();
    stream.read_to_string(&mut served).unwrap();
    let file = std::fs::read_to_string(manager.at("hmd.prom")).unwrap();
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
    let line = manager.until_said("STALE");
    assert!(
        line.starts_with("ema3: STALE, no sample for ") && line.ends_with("since the start\n"),
        "{line}"
    );
    // The status follows the word.
    let since = Instant::now();
    let stale = "hmd_data_stale{actuator=\"ema3\"} 1";
    while !std::fs::read_to_string(manager.at("hmd.prom")).unwrap().contains(stale) {
        assert!(since.elapsed() < Duration::from_secs(5), "no {stale}");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(manager.told().0, "READY=1");
    manager.stop();
    let status = last_status(&manager.at("segments"));
    assert_eq!(status.actuator, ["ema3"]);
    assert_eq!(
        (status.data_state, status.health),
        (vec!["STALE".to_owned()], vec!["unknown".to_owned()])
    );
    assert!(status.data_age_s[0] >= 2.5, "{:?}", status.data_age_s);
    assert_eq!((status.persistence, status.passive), (vec![0], vec![true]));
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
fn the_manager_hears_of_readiness_progress_reload_and_end() {
    let since = Instant::now();
    let mut manager = Manager::start("segments/", &[]);
    assert_eq!(manager.told(), ("READY=1".to_owned(), 0));
    assert!(since.elapsed() < Duration::from_secs(5), "{:?}", since.elapsed());
    manager.alive();

    manager.signal("-HUP");
    let reloading = manager.told().0;
    assert!(reloading.starts_with("RELOADING=1\nMONOTONIC_USEC="), "{reloading}");
    assert_eq!(manager.told().0, "READY=1");
    manager.alive();

    std::fs::write(manager.at("hmd.toml"), "[[actuator]]\nid = 99\n").unwrap();
    manager.signal("-HUP");
    assert!(manager.told().0.starts_with("RELOADING=1"));
    assert_eq!(manager.told().0, "READY=1");
    manager.until_said("not reloaded, the configuration stays as it was: ");
    manager.alive();

    manager.stop();
    assert_eq!(segments(&manager.at("segments")), 2, "one of each configuration");
}

#[test]
fn one_file_belongs_to_one_configuration() {
    let mut manager = Manager::start("one.mcap", &[]);
    assert_eq!(manager.told().0, "READY=1");
    manager.signal("-HUP");
    assert!(manager.told().0.starts_with("RELOADING=1"));
    assert_eq!(manager.told().0, "READY=1");
    manager.until_said("not reloaded: the output is one file");
    manager.stop();
    assert!(std::fs::read(manager.at("one.mcap")).unwrap().ends_with(mcap::MAGIC));
}
