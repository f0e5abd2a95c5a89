//! `hmd top` on a terminal: beside a daemon that runs, and over a recording.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, SystemTime};

use crate::folder::{Folder, record_demo};
use crate::serial_rig::{Device, Plug};
use crate::terminal_rig::Terminal;

fn hmd() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
    command.env_remove("NO_COLOR");
    command
}

fn top(place: &Path) -> Terminal {
    Terminal::start(hmd().arg("top").arg(place))
}

fn signal(id: u32, name: &str) {
    assert!(
        Command::new("kill")
            .args([name, &id.to_string()])
            .status()
            .unwrap()
            .success()
    );
}

/// A daemon on one serial line; it is ended with the test, whatever comes of that.
struct Daemon(Child);

impl Daemon {
    fn start(folder: &Path, plug: &Plug) -> Self {
        let text = format!(
            "[type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
             [[actuator]]\nid = 0\nname = \"left_inner_elevon\"\nbus = \"uart1\"\ntype = \"slow\"\n\
             [[actuator]]\nid = 1\nname = \"silent\"\nbus = \"uart1\"\ntype = \"slow\"\n\
             [[serial]]\nbus = \"uart1\"\ndevice = \"{}\"\n\
             [identification]\npopulation = 8\ngenerations = 1\n\
             [output]\nsegment_age_s = 10\n",
            plug.path().display()
        );
        fs::write(folder.join("hmd.toml"), text).unwrap();
        let child = hmd()
            .args(["run", "-c", "hmd.toml", "-o", "records/"])
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }

    fn stop(&mut self, name: &str) {
        signal(self.0.id(), name);
        self.0.wait().unwrap();
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_running_daemon_is_watched_across_segments_until_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let records = folder.path().join("records");
    let mut plug = Plug::new(folder.path());
    plug.plug();
    let mut daemon = Daemon::start(folder.path(), &plug);
    while !fs::read_dir(&records).is_ok_and(|mut names| names.next().is_some()) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut terminal = top(&records);
    terminal.wait_for("LIVE, newest record written");
    let playing = std::thread::spawn(move || {
        Device::start(3).play(&plug, Duration::from_secs(16));
        plug
    });
    // Nothing was ever heard of the second.
    terminal.wait_for("  silent     STALE");
    let screen = terminal.wait_for("> left_inne~ fresh");
    assert!(
        screen.contains("2 actuators") && screen.contains("uart1 OK"),
        "{screen}"
    );
    terminal.wait_for("k1 friction [");
    let segments = || {
        let names = fs::read_dir(&records).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.contains("-records.mcap")).count()
    };
    terminal.wait_until("another segment", |_| segments() > 1);
    let window = |screen: &str| -> Option<u32> { screen.split("window   ").nth(1)?.split(' ').next()?.parse().ok() };
    let before = window(&terminal.text());
    terminal.wait_until("a later window", |screen| window(screen) > before.map(|n| n + 1));
    let plug = playing.join().unwrap();
    terminal.wait_for("> left_inne~ STALE");
    drop(plug);
    daemon.stop("-TERM");
    terminal.wait_for("ENDED ");
    terminal.press("q");
    assert_eq!(terminal.end().0.code(), Some(0));
    // Of several segments the age of the newest counts.
    let hour_ago = SystemTime::now() - Duration::from_secs(3600);
    for segment in fs::read_dir(&records).unwrap() {
        let segment = fs::File::options().write(true).open(segment.unwrap().path()).unwrap();
        segment.set_modified(hour_ago).unwrap();
    }
    let again = hmd().args(["top", "--once"]).arg(&records).output().unwrap();
    let text = String::from_utf8(again.stdout).unwrap();
    assert!(
        text.starts_with("hmd top  ENDED 60 min ago") && text.contains("left_inne~"),
        "{text}"
    );
    // Somebody who watches holds no lock: a daemon begins anew in the same folder.
    let watching = top(&records);
    watching.wait_for("ENDED ");
    let mut plug = Plug::new(folder.path());
    fs::remove_file(plug.path()).unwrap();
    plug.plug();
    let mut daemon = Daemon::start(folder.path(), &plug);
    watching.wait_for("LIVE, newest record written");
    daemon.stop("-KILL");
    watching.wait_for("SILENT: nothing written for");
    assert!(watching.wait_for("2 STALE").contains("  silent     STALE"));
    signal(watching.id(), "-TERM");
    assert_eq!(watching.end().0.code(), Some(0));
}

#[test]
fn a_recording_is_shown_as_it_stood_at_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_demo(folder.path());
    for end in ["q", "\x1b", "\x03"] {
        let mut terminal = top(&path);
        let screen = terminal.wait_for("RECORDED until 2024-02-18 18:13 UTC");
        assert!(
            screen.contains("> ema0")
                && screen.contains("critical")
                && screen.contains("friction      75 %")
                && screen.contains("buses    can0 OK"),
            "{screen}"
        );
        assert!(terminal.is_taken() && terminal.has_colour());
        terminal.press(end);
        assert_eq!(terminal.end().0.code(), Some(0));
    }
    let plain = Terminal::start(hmd().arg("top").arg(&path).env("NO_COLOR", "1"));
    plain.wait_for("RECORDED");
    assert!(!plain.has_colour());
    signal(plain.id(), "-TERM");
    assert_eq!(plain.end().0.code(), Some(0));

    let mut damaged = fs::read(&path).unwrap();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    fs::write(&path, damaged).unwrap();
    let ended = hmd().args(["top", "--once"]).arg(&path).output().unwrap();
    assert_eq!(ended.status.code(), Some(3));
    let text = String::from_utf8(ended.stdout).unwrap();
    assert!(text.contains("damaged place in the file"), "{text}");
}

/// One picture of several actuators: all have a row, the worst is the one in detail, and its health is no failure of the command.
#[test]
fn of_several_actuators_once_shows_each_and_the_worst_in_detail() {
    let folder = Folder::new();
    let mut lines = Vec::new();
    for (id, backlash) in [(0, 0.0), (1, 0.75), (2, 0.45)] {
        folder.done(&format!(
            "simulate -o one.log --id {id} --rate 400 --seed {id} --fault backlash={backlash}"
        ));
        let log = String::from_utf8(folder.read("one.log")).unwrap();
        lines.extend(log.lines().map(str::to_owned));
    }
    lines.sort();
    folder.write_lines("all.log", lines);
    let actuators: String = ["left", "middle", "right"]
        .iter()
        .enumerate()
        .map(|(id, name)| format!("[[actuator]]\nid = {id}\nname = \"{name}\"\n"))
        .collect();
    folder.write(
        "hmd.toml",
        format!(
            "{actuators}[type.bench.sensors]\nsample_rate_hz = 400\n[health]\npersistence = 1\n\
             [identification]\npopulation = 8\ngenerations = 1\n"
        ),
    );
    folder.done("replay all.log -c hmd.toml -o all.mcap");
    let text = folder.done("top --once all.mcap");
    assert!(text.starts_with("hmd top  RECORDED until "), "{text}");
    assert!(text.contains("3 actuators"), "{text}");
    let row = |name: &str| {
        let is_row = |line: &&str| line.trim_start_matches(['>', ' ']).starts_with(name);
        text.lines().find(is_row).unwrap_or_else(|| panic!("{name}: {text}"))
    };
    assert!(row("left").starts_with("  left "), "{text}");
    assert!(
        row("middle").starts_with("> middle ") && row("middle").contains(" critical "),
        "{text}"
    );
    assert!(row("middle").contains("backlash      7"), "{text}");
    assert!(
        row("right").starts_with("  right ") && row("right").contains("backlash      4"),
        "{text}"
    );
    assert!(
        text.contains("-- middle --") && text.contains("k2 backlash [#######"),
        "{text}"
    );
}

#[test]
fn a_file_is_followed_until_its_writer_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(record_demo(folder.path())).unwrap();
    let path = folder.path().join("growing.mcap");
    let (begun, rest) = whole.split_at(whole.len() / 2);
    fs::write(&path, begun).unwrap();
    let mut terminal = top(&path);
    let screen = terminal.wait_for("LIVE, newest record written");
    assert!(screen.contains("> ema0") && !screen.contains("critical"), "{screen}");
    terminal.wait_for("SILENT: nothing written for");
    let mut out = fs::OpenOptions::new().append(true).open(&path).unwrap();
    for piece in rest.chunks(100_000) {
        out.write_all(piece).unwrap();
    }
    terminal.wait_for("RECORDED until 2024-02-18 18:13 UTC");
    terminal.wait_for("critical");
    terminal.press("q");
    assert_eq!(terminal.end().0.code(), Some(0));
}

#[test]
fn the_screen_follows_the_size_of_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let mut terminal = top(&record_demo(folder.path()));
    terminal.wait_for("q quit");
    terminal.resize(100, 12);
    terminal.wait_until("less", |screen| {
        !screen.contains("k1 friction") && screen.contains("> ema0")
    });
    terminal.resize(20, 5);
    terminal.wait_for("60x8 needed, q ends");
    terminal.resize(120, 40);
    terminal.wait_for("last events");
    terminal.press("q");
    assert_eq!(terminal.end().0.code(), Some(0));
}

#[test]
fn a_terminal_that_hangs_up_ends_the_watch() {
    let folder = tempfile::tempdir().unwrap();
    let terminal = top(&record_demo(folder.path()));
    terminal.wait_for("RECORDED");
    assert_eq!(terminal.hang_up().code(), Some(0));
}

#[test]
fn what_cannot_be_shown_is_reported_in_one_sentence_on_the_terminal_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let text = folder.path().join("a.log");
    fs::write(&text, "(1700000000.0) can0 100#00\n").unwrap();
    let foreign = folder.path().join("foreign.mcap");
    mcap::Writer::new(fs::File::create(&foreign).unwrap())
        .unwrap()
        .finish()
        .unwrap();
    let frames = folder.path().join("frames.mcap");
    assert!(
        hmd()
            .args(["simulate", "-o"])
            .arg(&frames)
            .stderr(Stdio::null())
            .status()
            .unwrap()
            .success()
    );
    for (place, expected) in [
        (&frames, "expected records of windows or of a live run, found none"),
        (&empty, "expected a folder that hmd run writes to, found no segment"),
        (&text, "expected an MCAP file, found one that begins differently"),
        (&foreign, "expected records of windows or of a live run, found none"),
    ] {
        for args in [&["top", "--once"][..], &["top"]] {
            let terminal = Terminal::start(hmd().args(args).arg(place));
            let (status, text) = terminal.end();
            let text = text.replace('\n', "");
            assert!(text.contains(expected), "{text}");
            assert_eq!(status.code(), Some(1));
        }
    }
    let piped = hmd().arg("top").arg(record_demo(folder.path())).output().unwrap();
    assert_eq!(piped.status.code(), Some(2));
    assert!(
        String::from_utf8(piped.stderr)
            .unwrap()
            .contains("expected a terminal on stdout, found none")
    );
}

#[test]
fn a_folder_that_goes_away_gives_the_terminal_back() {
    let folder = tempfile::tempdir().unwrap();
    let records = folder.path().join("records");
    let mut plug = Plug::new(folder.path());
    plug.plug();
    let mut daemon = Daemon::start(folder.path(), &plug);
    while !fs::read_dir(&records).is_ok_and(|mut names| names.next().is_some()) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let terminal = top(&records);
    terminal.wait_for("LIVE");
    daemon.stop("-TERM");
    fs::remove_dir_all(&records).unwrap();
    let (status, text) = terminal.end();
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(
        text.replace('\n', "").contains("records: No such file or directory"),
        "{text}"
    );
}
