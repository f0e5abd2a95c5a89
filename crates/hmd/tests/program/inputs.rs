//! Whatever turns up as an input ends a verb soon: what is no regular file, files that are too long, bombs, repetitions, and text
//! that a terminal or a spreadsheet would obey.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::process::Command;
use std::time::{Duration, Instant};

use hmd_core::record::{Health, Log, LogLevel, Rul};
use hmd_storage::mcap_writer::McapWriter;

use crate::folder::{Ended, Folder};

/// A command that must end within some seconds.
fn within(folder: &Folder, limit: Duration, line: &str) -> Ended {
    let since = Instant::now();
    let mut child = folder
        .command(line)
        .stdout(File::create(folder.path("stdout.txt")).unwrap())
        .stderr(File::create(folder.path("stderr.txt")).unwrap())
        .spawn()
        .unwrap();
    let code = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status.code();
        }
        if since.elapsed() > limit {
            child.kill().unwrap();
            panic!("hmd {line}: not ended after {limit:?}");
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let text = |name: &str| String::from_utf8(folder.read(name)).unwrap();
    Ended {
        code: code.unwrap(),
        stdout: text("stdout.txt"),
        stderr: text("stderr.txt"),
    }
}

const SOON: Duration = Duration::from_secs(20);

#[test]
fn what_is_no_regular_file_is_refused_at_once() {
    let folder = Folder::new();
    assert!(
        Command::new("mkfifo")
            .arg(folder.path("fifo"))
            .status()
            .unwrap()
            .success()
    );
    folder.write(
        "type.toml",
        "[type.own]\nbased_on = \"bench\"\ncalibration = \"fifo\"\n",
    );
    folder.write("unit.toml", "[[actuator]]\nid = 0\ncalibration = \"fifo\"\n");
    folder.write("dbc.toml", "[[actuator]]\nid = 0\ndbc = \"fifo\"\n");
    folder.write(
        "learnt.toml",
        "[[actuator]]\nid = 0\nbus = \"can0\"\n[rul]\nevents = \"fifo\"\n",
    );
    for (line, code) in [
        ("check-config -c fifo", 78),
        ("check-config -c /dev/zero", 78),
        ("run -c fifo", 78),
        ("check-config -c type.toml", 78),
        ("check-config -c unit.toml", 78),
        ("check-config -c dbc.toml", 78),
        ("check-config -c learnt.toml", 78),
        ("replay fifo", 1),
        ("map fifo", 1),
        ("calibrate fifo -o out.toml", 1),
        ("inspect fifo", 1),
        ("inspect /dev/zero", 1),
        ("recover fifo -o out.mcap", 1),
        ("export fifo -o out.csv", 1),
        ("report fifo -o out.html", 1),
        ("simulate --effects fifo -o out.log", 1),
    ] {
        let ended = within(&folder, SOON, line);
        assert_eq!(ended.code, code, "hmd {line}: {}", ended.stderr);
        assert!(
            ended.stderr.contains("regular file") || ended.stderr.contains("it is no file"),
            "hmd {line}: {}",
            ended.stderr
        );
    }
}

#[test]
fn files_have_limits_by_their_kind() {
    let folder = Folder::new();
    for name in ["large.toml", "large.dbc"] {
        // With no blocks of its own.
        File::create(folder.path(name)).unwrap().set_len(1 << 30).unwrap();
    }
    folder.write(
        "type.toml",
        "[type.own]\nbased_on = \"bench\"\ncalibration = \"large.toml\"\n",
    );
    folder.write("dbc.toml", "[[actuator]]\nid = 0\ndbc = \"large.dbc\"\n");
    for line in [
        "check-config -c large.toml",
        "check-config -c type.toml",
        "check-config -c dbc.toml",
    ] {
        let ended = within(&folder, SOON, line);
        assert_eq!(ended.code, 78, "hmd {line}: {}", ended.stderr);
        assert!(ended.stderr.contains("at most"), "hmd {line}: {}", ended.stderr);
    }
}

/// A recording of `chunks` chunks, each 60 MiB of zeros before compression, with the profile of a segment.
pub(crate) fn bomb(chunks: usize) -> Vec<u8> {
    let options = mcap::WriteOptions::new().profile("hmd-segment").library("hmd/0.1.0");
    let mut writer = options
        .chunk_size(Some(1))
        .create(std::io::Cursor::new(Vec::new()))
        .unwrap();
    let schema = writer.add_schema("hmd.v1.Other", "protobuf", &[]).unwrap();
    let channel = writer
        .add_channel(schema, "/other", "protobuf", &BTreeMap::new())
        .unwrap();
    let zeros = vec![0; 60 << 20];
    for sequence in 0..chunks as u32 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence,
            log_time: 1,
            publish_time: 1,
        };
        writer.write_to_known_channel(&header, &zeros).unwrap();
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn a_bomb_costs_what_its_size_allows() {
    let folder = Folder::new();
    let bomb = bomb(20);
    assert!(bomb.len() < 170_000, "{} bytes", bomb.len());
    folder.write("bomb.mcap", &bomb);
    for line in [
        "inspect bomb.mcap",
        "replay bomb.mcap",
        "recover bomb.mcap -o out.mcap",
        "export bomb.mcap -o out.csv",
    ] {
        let ended = within(&folder, SOON, line);
        assert!([1, 3].contains(&ended.code), "hmd {line}: {}", ended.stderr);
        // Of 1.3 GB, a third is expanded; the other verbs need none of it.
        let given_up = ended.stderr.contains("expand to at most");
        assert!(given_up || !line.starts_with("recover"), "hmd {line}: {}", ended.stderr);
    }
}

/// Health and remaining life of two windows, each in a chunk of its own, and a line for an operator.
fn written(windows: &[u64], actuator: &str, status: &str, notice: &str) -> Vec<u8> {
    let mut writer = McapWriter::new(std::io::Cursor::new(Vec::new()), &BTreeMap::new()).unwrap();
    writer.write(1, &Log::new(1, LogLevel::Info, "hmd", notice)).unwrap();
    for &window in windows {
        let health = Health {
            actuator: actuator.to_owned(),
            window,
            t_start_ns: window,
            status: status.to_owned(),
            health: "nominal".to_owned(),
            ..Health::default()
        };
        let rul = Rul {
            actuator: actuator.to_owned(),
            window,
            ..Rul::default()
        };
        writer.write(window, &health).unwrap();
        writer.write(window, &rul).unwrap();
        writer.flush_window().unwrap();
    }
    writer.finish().unwrap().0.into_inner()
}

/// Places and lengths of the chunk records of a file.
fn chunks(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut found = Vec::new();
    let mut at = mcap::MAGIC.len();
    while at + 9 < bytes.len() - mcap::MAGIC.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == mcap::records::op::CHUNK {
            found.push(at..at + 9 + length);
        }
        at += 9 + length;
    }
    found
}

/// The file with its last-but-`back` chunk once more before its data end.
fn with_a_chunk_twice(bytes: &[u8], back: usize) -> Vec<u8> {
    let chunks = chunks(bytes);
    let again = bytes[chunks[chunks.len() - 1 - back].clone()].to_vec();
    let end = chunks.last().unwrap().end;
    [&bytes[..end], &again, &bytes[end..]].concat()
}

#[test]
fn a_chunk_that_comes_twice_publishes_nothing_twice() {
    let folder = Folder::new();
    let whole = written(&[1, 2, 3], "ema0", "ok", "a notice");
    folder.write("twice.mcap", with_a_chunk_twice(&whole, 0));
    let ended = folder.hmd("inspect --csv twice.mcap");
    assert_eq!(ended.stdout.lines().count(), 4, "{}", ended.stdout);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("2 messages that were read before"),
        "{}",
        ended.stderr
    );

    folder.actuation();
    folder.done("simulate -o two.mcap --rate 400 --windows 2 --seed 5");
    let whole = folder.hmd("replay --json two.mcap");
    assert_eq!(whole.stdout.lines().count(), 2, "{}", whole.stderr);
    let bytes = folder.read("two.mcap");
    for back in 0..chunks(&bytes).len().min(3) {
        folder.write("twice.mcap", with_a_chunk_twice(&bytes, back));
        let ended = folder.hmd("replay --json twice.mcap");
        assert_eq!(ended.code, 3, "{}", ended.stderr);
        assert_eq!(ended.stdout, whole.stdout, "{back} from the end");
    }
}

#[test]
fn frames_that_come_again_are_counted_and_not_used() {
    // By another program, so that only the frames' own count shows it.
    let folder = Folder::new();
    folder.done("simulate -o two.mcap --rate 400 --windows 2 --seed 5");
    let whole = folder.done("replay --json two.mcap");
    let bytes = folder.read("two.mcap");
    let places = chunks(&bytes);
    let twice = with_a_chunk_twice(&bytes, places.len() / 2);
    let at = twice.windows(4).position(|four| four == b"hmd/").unwrap();
    let mut foreign = twice;
    foreign[at..at + 4].copy_from_slice(b"abc/");
    folder.write("twice.mcap", foreign);
    let ended = folder.hmd("replay --json twice.mcap");
    assert_eq!((ended.code, ended.stdout), (3, whole), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("frames that were read before"),
        "{}",
        ended.stderr
    );
}

#[test]
fn a_terminal_is_given_no_command() {
    let folder = Folder::new();
    let evil = "\u{1b}]0;owned\u{7}\u{9b}31m\r\u{202e}evil\nHMD: all is well";
    folder.write("evil.mcap", written(&[1], "ema0", evil, evil));
    let control = |text: &str| text.chars().any(|c| c.is_control() && c != '\n' || c == '\u{202e}');
    for line in [
        "inspect evil.mcap",
        "inspect --csv evil.mcap",
        "inspect --summary evil.mcap",
    ] {
        let ended = folder.hmd(line);
        assert!(!control(&ended.stdout), "hmd {line}: {:?}", ended.stdout);
        assert!(!ended.stdout.contains("\nHMD: all"), "hmd {line}: {:?}", ended.stdout);
    }
    let json = folder.done("inspect --json evil.mcap");
    let event: serde_json::Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!(event["event"], evil);
    // Names of files and what is in them, in errors.
    let name = "a\u{1b}[31m.log";
    folder.write(name, "\u{1b}]0;owned\u{7}\n");
    for line in ["replay", "inspect", "check-config -c"] {
        let mut command = folder.command(line);
        let ended = command.arg(name).output().unwrap();
        let text = String::from_utf8(ended.stderr).unwrap();
        assert!(!text.is_empty() && !control(&text), "hmd {line}: {text:?}");
    }
}

#[test]
fn a_spreadsheet_is_given_no_formula() {
    let folder = Folder::new();
    for start in ["=", "+", "-", "@"] {
        let evil = format!("{start}cmd|' /C calc'!A0,\"x\"");
        folder.write("evil.mcap", written(&[1], "ema0", &evil, "a notice"));
        folder.done("export evil.mcap -o evil.csv");
        let exported = String::from_utf8(folder.read("evil.csv")).unwrap();
        for text in [folder.done("inspect --csv evil.mcap"), exported] {
            let mut reader = csv::Reader::from_reader(text.as_bytes());
            let status = reader.headers().unwrap().iter().position(|head| head == "status");
            let row = reader.records().next().unwrap().unwrap();
            assert_eq!(row[status.unwrap()], format!("'{evil}"), "{text}");
        }
    }
}

#[test]
fn a_dbc_file_that_is_none_is_refused_soon_and_not_printed() {
    let folder = Folder::new();
    folder.write("map.toml", "[[actuator]]\nid = 0\ndbc = \"bus.dbc\"\n");
    folder.write("bus.dbc", "root:x:0:0:secret\n");
    let sentence = folder.refused("check-config -c map.toml", 78);
    assert!(sentence.contains("no valid DBC: line 1"), "{sentence}");
    assert!(!sentence.contains("secret") && !sentence.contains("root"), "{sentence}");
    folder.write("bus.dbc", "\n".repeat(16 << 20));
    within(&folder, SOON, "check-config -c map.toml");
    fs::remove_file(folder.path("bus.dbc")).unwrap();
}

#[test]
fn names_that_are_paths_or_options_are_refused() {
    let folder = Folder::new();
    for name in [".", "..", "-rf", ".hidden"] {
        folder.write("name.toml", format!("[[actuator]]\nid = 0\nname = \"{name}\"\n"));
        let sentence = folder.refused("check-config -c name.toml", 78);
        assert!(sentence.contains("actuator[0].name: expected a name"), "{sentence}");
        folder.write("name.toml", format!("[type.\"{name}\"]\nbased_on = \"bench\"\n"));
        folder.refused("check-config -c name.toml", 78);
    }
}
