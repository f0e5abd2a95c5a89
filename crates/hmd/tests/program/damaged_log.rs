//! Logs with gaps, damage, wrong stamps or another order: what is counted, what is assessed, how the command ends.

use crate::folder::{Folder, line_of_sample};

/// A candump line with another stamp, µs later (or earlier).
fn shifted(line: &str, by_us: i64) -> String {
    let (stamp, rest) = line.split_once(')').expect("a stamp");
    let stamp = stamp
        .trim_start_matches('(')
        .replace('.', "")
        .parse::<i64>()
        .expect("a number")
        + by_us;
    format!("({}.{:06}){rest}", stamp / 1_000_000, stamp % 1_000_000)
}

/// A line with its data bytes changed.
fn with_bytes(line: &str, change: impl FnOnce(&mut Vec<u8>)) -> String {
    let (head, data) = line.split_once('#').expect("a frame");
    let digits = |at: usize| u8::from_str_radix(&data[at..at + 2], 16).expect("hex");
    let mut bytes: Vec<u8> = (0..data.len() / 2).map(|n| digits(2 * n)).collect();
    change(&mut bytes);
    let data: String = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    format!("{head}#{data}")
}

#[test]
fn a_gap_degrades_the_window_or_makes_it_invalid_and_ends_in_data_loss() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let without = |name: &str, first: usize, count: usize| {
        let (from, to) = (line_of_sample(&lines, first), line_of_sample(&lines, first + count));
        folder.write_lines(name, lines[..from].iter().chain(&lines[to..]));
        let ended = folder.hmd(&format!("replay --json {name}"));
        assert_eq!(ended.code, 3, "{}", ended.stderr);
        assert!(
            ended.stderr.contains(&format!("{name}: data lost: ")),
            "{}",
            ended.stderr
        );
        assert!(ended.stderr.contains(&format!(" {count} samples")), "{}", ended.stderr);
        ended.record()
    };
    let short = without("short.log", 330, 2);
    assert_eq!(short["status"], "degraded");
    assert!(
        short["k"].is_array() && short["faults"].as_array().is_some_and(Vec::is_empty),
        "{short}"
    );

    let long = without("long.log", 330, 20);
    assert_eq!(
        (&long["status"], &long["health"]),
        (&"invalid".into(), &"unknown".into())
    );
    assert!(
        long["k"].is_null() && long["faults"].as_array().is_some_and(Vec::is_empty),
        "{long}"
    );
    assert_eq!(long["reason"], "gap: 20 samples unusable, 20 in a row");
}

#[test]
fn an_unreadable_line_and_a_short_frame_are_counted() {
    let folder = Folder::new();
    let mut lines = folder.actuation();
    lines.truncate(line_of_sample(&lines, 100));
    let short = line_of_sample(&lines, 50);
    let line = &mut lines[short];
    line.truncate(line.len() - 2);
    lines.insert(10, "garbage".to_owned());
    folder.write_lines("bad.log", &lines);
    let ended = folder.hmd("replay --json bad.log");
    assert_eq!((ended.code, ended.stdout.as_str()), (3, ""), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("bad.log:11: expected a stamp"),
        "{}",
        ended.stderr
    );
    assert!(
        ended
            .stderr
            .contains("data lost: 1 unreadable line or frame, 1 malformed frame, 1 sample")
    );
}

#[test]
fn of_many_unreadable_lines_twenty_are_told_and_all_counted() {
    let folder = Folder::new();
    let mut lines = folder.actuation();
    lines.splice(10..10, (0..300).map(|n| format!("garbage {n}")));
    folder.write_lines("bad.log", &lines);
    let ended = folder.hmd("replay --json bad.log -o out.mcap");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert_eq!(ended.stderr.matches("expected a stamp").count(), 20, "{}", ended.stderr);
    for said in [
        "bad.log: data lost at 280 more places",
        "data lost: 300 unreadable lines or frames",
    ] {
        assert!(ended.stderr.contains(said), "{}", ended.stderr);
    }
}

#[test]
fn stamps_that_step_back_do_not_stop_the_monitoring() {
    let folder = Folder::new();
    let lines = folder.actuation();
    // The host's clock is set back by two seconds between two samples, before the window.
    let step = line_of_sample(&lines, 150);
    let stepped = lines.iter().enumerate();
    folder.write_lines(
        "step.log",
        stepped.map(|(n, line)| shifted(line, if n < step { 0 } else { -2_000_000 })),
    );
    let ended = folder.hmd("replay --json step.log");
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    let record = ended.record();
    assert!(
        record["k"].is_array() && record["faults"] == serde_json::json!([]),
        "{record}"
    );
}

#[test]
fn a_log_in_reversed_order_is_never_assessed() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines("reversed.log", lines.iter().rev());
    let ended = folder.hmd("replay --json reversed.log");
    assert!(ended.stderr.contains("reversed.log: "), "{}", ended.stderr);
    for line in ended.stdout.lines() {
        assert!(line.contains("\"status\":\"invalid\""), "{line}");
    }
}

#[test]
fn frames_dropped_for_their_order_are_data_loss() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines("reversed.log", lines.iter().rev());
    assert_eq!(folder.hmd("replay --json reversed.log").code, 3);
}

#[test]
fn a_cut_mcap_gives_what_is_whole_and_ends_in_data_loss() {
    let folder = Folder::new();
    folder.done("simulate -o whole.mcap --rate 400 --seed 5");
    let whole = folder.read("whole.mcap");
    // Without its end only the index is missing: the one chunk of this file is whole.
    folder.write("cut.mcap", &whole[..whole.len() - 20]);
    let ended = folder.hmd("replay --json cut.mcap");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("cut.mcap: at byte "), "{}", ended.stderr);
    assert!(
        ended
            .stderr
            .contains("found the end of the file: it was cut or never finished"),
        "{}",
        ended.stderr
    );
    assert_eq!(ended.stdout, folder.done("replay --json whole.mcap"));

    folder.write("stump.mcap", &whole[..whole.len() / 2]);
    let sentence = folder.refused("replay --json stump.mcap", 1);
    assert!(
        sentence.starts_with("hmd: stump.mcap: expected raw frames") && sentence.contains("it was cut"),
        "{sentence}"
    );

    // A damaged chunk has another checksum, and is not used.
    let mut damaged = whole.clone();
    damaged[whole.len() / 3] ^= 0x10;
    folder.write("damaged.mcap", damaged);
    let sentence = folder.refused("replay --json damaged.mcap", 1);
    assert!(sentence.starts_with("hmd: damaged.mcap: "), "{sentence}");
}

#[test]
fn a_device_time_that_stands_still_is_reported_and_the_window_assessed_at_the_nominal_rate() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines(
        "still.log",
        lines.iter().map(|line| match line.contains(" 102#") {
            true => with_bytes(line, |bytes| bytes[5..7].fill(0)),
            false => line.clone(),
        }),
    );
    folder.write("400.toml", "[type.bench.sensors]\nsample_rate_hz = 400\n");
    let ended = folder.hmd("replay --json still.log -c 400.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("ema0: expected a device time that advances") && ended.stderr.contains("nominal 400"),
        "{}",
        ended.stderr
    );
    assert!(ended.record()["k"].is_array());
}

#[test]
fn a_rate_at_which_no_window_can_be_cut_is_data_loss() {
    let folder = Folder::new();
    folder.actuation();
    // Possible at the nominal 2 kHz, not at the 400 Hz found.
    folder.write("short.toml", "[window]\npre_trigger_ms = 1\n");
    let ended = folder.hmd("replay --json actuation.log -c short.toml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("ema0: not monitored: "), "{}", ended.stderr);
    assert!(ended.stderr.contains(" 600 samples"), "{}", ended.stderr);
}

#[test]
fn frames_of_an_earlier_log_are_not_used_again() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let once = folder.done("replay --json actuation.log");
    let named_twice = folder.done("replay --json actuation.log ./actuation.log");
    assert_eq!(named_twice, once, "one file");
    folder.write("again.log", folder.read("actuation.log"));
    let twice = folder.hmd("replay --json actuation.log again.log");
    assert_eq!((twice.code, &twice.stdout), (3, &once), "{}", twice.stderr);
    let expected = format!(
        "again.log: expected frames later than those of the logs before, found {} that are not",
        lines.len()
    );
    assert!(twice.stderr.contains(&expected), "{}", twice.stderr);

    let middle = line_of_sample(&lines, 100);
    folder.write_lines("a.log", &lines[..middle]);
    folder.write_lines("b.log", &lines[middle..]);
    let ordered = folder.hmd("replay --json a.log b.log");
    assert_eq!(ordered.code, 0, "{}", ordered.stderr);
    let reversed = folder.hmd("replay --json b.log a.log");
    assert_eq!(reversed.code, 3, "{}", reversed.stderr);
    assert!(
        reversed.stderr.contains("a.log: expected frames later"),
        "{}",
        reversed.stderr
    );
}

#[test]
fn malformed_frames_alone_are_counted_as_such() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let short = lines.iter().map(|line| with_bytes(line, |bytes| bytes.truncate(7)));
    folder.write_lines("short.log", short);
    let sentence = folder.refused("replay --json short.log", 1);
    assert!(
        sentence.ends_with(&format!("found none ({} malformed frames on can0)", lines.len())),
        "{sentence}"
    );
}

#[test]
fn a_lost_footer_is_no_lost_frame() {
    let folder = Folder::new();
    folder.done("simulate -o whole.mcap --rate 400 --seed 5");
    let whole = folder.read("whole.mcap");
    folder.write("cut.mcap", &whole[..whole.len() - 20]);
    let ended = folder.hmd("replay --json cut.mcap");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains(" 1 damaged place of a file"), "{}", ended.stderr);
}

#[test]
fn a_device_that_restarts_in_the_window_is_reported() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let (from, to) = (line_of_sample(&lines, 100), line_of_sample(&lines, 300));
    folder.write_lines("restart.log", lines[..to].iter().chain(&lines[from..]));
    let ended = folder.hmd("replay --json restart.log");
    assert!(
        ended
            .stderr
            .contains("ema0: expected a sample counter that rises, found one that went back"),
        "{}",
        ended.stderr
    );
    let first = ended.stdout.lines().next().unwrap_or_default();
    assert!(
        first.contains("\"status\":\"invalid\"") && first.contains("cut short"),
        "{first}"
    );
}

#[test]
fn a_compressed_log_and_a_damaged_only_chunk_are_named() {
    let folder = Folder::new();
    folder.write("log.gz", b"\x1f\x8b\x08\0anything\n");
    assert_eq!(
        folder.refused("replay log.gz", 1),
        "hmd: log.gz: expected a log of a format that is known (candump, MCAP, ASC, BLF, MF4, CSV, Parquet), found gzip data; decompress it first"
    );
    folder.done("simulate -o flip.mcap --rate 400 --seed 5");
    let mut bytes = folder.read("flip.mcap");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    folder.write("flip.mcap", bytes);
    let sentence = folder.refused("replay flip.mcap", 1);
    assert!(
        sentence.contains("/bus/<interface>/raw, found none that is intact; flip.mcap: at byte "),
        "{sentence}"
    );
}
