//! The daemon on real SocketCAN: user-mode Linux with virtual CAN interfaces, real players, and the counts checked.
//!
//! Nothing is checked inside: `can/guest.sh` plays and records, and this compares with what was played.

mod guest;
mod logs;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};

use crate::programs::Programs;
use crate::python::Python;
use crate::readers::PACKAGES;
use crate::shell::{program, target_dir};
use guest::Results;

/// Error frames that the guest sends.
const ERROR_FRAMES: u64 = 5;
/// Frames of each of the two floods.
const FLOOD: u64 = 60_000;

/// Draws the order in which interface, actuator and daemon come and go.
const SEED: u32 = 1;

/// Runs everything.
pub(crate) fn check() -> anyhow::Result<()> {
    guest::install()?;
    let programs = Programs::build()?;
    let hmd = programs.hmd();
    let folder = target_dir()?.join("can");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    logs::streams(&hmd, &folder)?;
    logs::shorts(&programs, &folder)?;
    logs::slcan(&hmd, &folder)?;
    let python = Python::with_packages(&PACKAGES)?;
    let results = guest::start(&folder, &programs, python.interpreter(), SEED)?;
    stream(&results, &hmd, &folder).context("stream")?;
    bus(&results, &folder).context("bus")?;
    link(&results).context("link")?;
    record(&results, &folder).context("record")?;
    slcan(&results, &folder).context("slcan")?;
    order(&results, &folder).context("order")?;
    read_by_others(&results, &folder, &python)
}

/// The MCAP reference library finds as many frames in each file as the daemon says it received.
fn read_by_others(results: &Results, folder: &Path, python: &Python) -> anyhow::Result<()> {
    for name in ["stream", "bus", "link", "record", "slcan"] {
        let phrase = if name == "record" {
            "frames recorded"
        } else {
            "frames received"
        };
        let frames = results.counted(name, phrase)?;
        let file = folder.join(name).with_extension("mcap");
        python.script_with(
            "fixtures/check_mcap.py",
            &[&file],
            &["--frames".to_owned(), frames.to_string()],
        )?;
    }
    Ok(())
}

/// Sixteen actuators: every frame accounted for, the right faults, none sent, and live equals replay.
fn stream(results: &Results, hmd: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut played = 0;
    for bus in 0..3 {
        let frames = logs::frames(&folder.join(format!("stream{bus}.log")))?;
        equal(
            "frames on the interface",
            results.number(&format!("stream.sent{bus}"))?,
            frames,
        )?;
        // The first frame of each log is of no actuator, and stays in the kernel.
        played += frames - 1;
    }
    let lost = results.counted("stream", "frames by full receive queues")?;
    let received = results.counted("stream", "frames received")?;
    equal("received and lost", received + lost, played)?;
    let decoded = results.counted("stream", "decoded")?;
    equal("decoded", decoded, received)?;
    let dropped = results.counted("stream", "windows")?;
    let expected = u64::from(logs::ACTUATORS * logs::STREAM_S);
    let (assessed, with_gap) = windows(&results.output("stream.jsonl")?)?;
    let cut = dropped + assessed + with_gap;
    if with_gap == 0 {
        equal("windows", cut, expected)?;
    } else {
        // A gap within a motion may make two windows of it, or hide its start.
        ensure!(cut >= expected / 2, "expected about {expected} windows, found {cut}");
    }

    let live = folder.join("stream.jsonl");
    let again = folder.join("stream.replayed.jsonl");
    let mut replay = program(hmd, ["replay", "--json", "-c"]);
    replay.arg(folder.join("stream.toml")).arg(folder.join("stream.mcap"));
    replay
        .stdout(fs::File::create(&again)?)
        .stderr(std::process::Stdio::null());
    // 3 when windows were dropped; the bytes are what counts.
    replay.status().context("replay")?;
    ensure!(
        fs::read(&live)? == fs::read(&again)?,
        "live and replay differ: {} and {}",
        live.display(),
        again.display()
    );
    let missing = results.counted("stream", "samples")?;
    eprintln!(
        "stream: {received} frames received, {lost} lost, none sent; {missing} samples not whole; {dropped} of {expected} \
         windows dropped; live equals replay"
    );
    Ok(())
}

/// What became of one actuator's windows.
#[derive(Default)]
struct Tally {
    assessed: u64,
    right: u64,
    other: u64,
}

/// Counts the windows with health records, assessed and with a gap, and looks at their faults: none for the healthy
/// actuators, the right one for the others.
///
/// On a busy computer the guest's one processor holds frames back for longer than the parts of a sample may be apart. Such a
/// window is invalid for its gap, and how many are depends on what else this computer does; so the assessed ones count.
fn windows(lines: &str) -> anyhow::Result<(u64, u64)> {
    let mut tally: BTreeMap<u32, Tally> = BTreeMap::new();
    for line in lines.lines() {
        let id: u32 = between(line, "\"actuator\":\"ema", "\"")?.parse()?;
        let found = between(line, "\"faults\":[", "]")?;
        let status = between(line, "\"status\":\"", "\"")?;
        let expected = logs::FAULTS.iter().find(|(at, _, _)| *at == id);
        let expected = expected.map_or(String::new(), |(_, name, _)| format!("\"{name}\""));
        ensure!(
            !expected.is_empty() || found.is_empty(),
            "expected a healthy actuator, found {line}"
        );
        let tally = tally.entry(id).or_default();
        if status == "ok" || status == "degraded" {
            tally.assessed += 1;
            tally.right += u64::from(found == expected);
        } else {
            let by_link = ["gap: ", "cut short: "].map(|reason| line.contains(&format!("\"reason\":\"{reason}")));
            ensure!(
                status == "invalid" && by_link.contains(&true),
                "expected a window that lacks samples, found {line}"
            );
            tally.other += 1;
        }
    }
    equal(
        "actuators with health records",
        tally.len() as u64,
        u64::from(logs::ACTUATORS),
    )?;
    for (id, of) in &tally {
        eprintln!(
            "  ema{id}: {} windows assessed, {} of them right; {} not assessed",
            of.assessed, of.right, of.other
        );
    }
    let total = |count: fn(&Tally) -> u64| tally.values().map(count).sum::<u64>();
    let (assessed, right, other) = (total(|of| of.assessed), total(|of| of.right), total(|of| of.other));
    ensure!(10 * assessed >= other, "expected one of ten windows assessed");
    ensure!(
        10 * right >= 9 * assessed,
        "expected nine of ten assessed windows right"
    );
    for (id, of) in &tally {
        ensure!(of.assessed > 0, "ema{id}: expected an assessed window");
        ensure!(
            2 * of.right > of.assessed,
            "ema{id}: expected most assessed windows right"
        );
    }
    Ok((assessed, other))
}

/// FD, foreign and error frames, and a flood.
fn bus(results: &Results, folder: &Path) -> anyhow::Result<()> {
    let ours = logs::frames(&folder.join("fd.log"))?;
    let foreign = logs::frames(&folder.join("foreign.log"))?;
    equal(
        "frames on vcan0",
        results.number("bus.sent0")?,
        ours + foreign + ERROR_FRAMES + FLOOD,
    )?;
    equal("frames on vcan1", results.number("bus.sent1")?, FLOOD)?;
    let lost = results.counted("bus", "frames by full receive queues")?;
    let received = results.counted("bus", "frames received")?;
    equal("received and lost", received + lost, ours + ERROR_FRAMES + 2 * FLOOD)?;
    let decoded = results.counted("bus", "decoded")?;
    let malformed = results.counted("bus", "malformed frames")?;
    equal("error frames", results.counted("bus", "error frames")?, ERROR_FRAMES)?;
    equal(
        "decoded, malformed and error frames",
        decoded + malformed + ERROR_FRAMES,
        received,
    )?;
    let text = results.output("bus.err")?;
    let states: Vec<_> = text
        .lines()
        .filter_map(|line| line.strip_prefix("vcan0: bus "))
        .collect();
    let expected = [
        "error-warning",
        "error-passive",
        "error-active",
        "bus-off",
        "error-active",
    ];
    ensure!(states == expected, "expected {expected:?}, found {states:?}");
    eprintln!(
        "bus: {received} frames received, {lost} lost in the flood and reported, {malformed} malformed, states as sent"
    );
    Ok(())
}

/// An interface that comes and goes.
fn link(results: &Results) -> anyhow::Result<()> {
    let text = results.output("link.err")?;
    let states: Vec<_> = text
        .lines()
        .filter_map(|line| line.strip_prefix("vcan0: "))
        .map(|line| line.split(' ').next().unwrap_or_default())
        .collect();
    // An interface that was just made is off for a moment, which the daemon may or may not see.
    let brief = |n: usize| n > 0 && states[n] == "down" && states[n - 1] == "missing";
    let states: Vec<_> = (0..states.len()).filter(|&n| !brief(n)).map(|n| states[n]).collect();
    let expected = ["missing", "up", "down", "up"];
    ensure!(
        states.starts_with(&expected),
        "expected {expected:?} first, found {states:?}"
    );
    ensure!(
        states.last() == Some(&"up"),
        "expected the link up at the end, found {states:?}"
    );
    ensure!(
        results
            .output("link.deleted")?
            .trim_end()
            .lines()
            .next_back()
            .is_some_and(|line| line.contains("missing")),
        "expected a deleted interface to be missing, found {states:?}"
    );
    equal("frames on the first interface", results.number("link.sent0")?, 2)?;
    equal("frames on the second interface", results.number("link.sent1")?, 1)?;
    equal("frames received", results.counted("link", "frames received")?, 3)?;
    eprintln!("link: {}", states.join(", "));
    Ok(())
}

/// Capture without filters.
fn record(results: &Results, folder: &Path) -> anyhow::Result<()> {
    let played = logs::frames(&folder.join("fd.log"))? + logs::frames(&folder.join("foreign.log"))?;
    equal("frames on the interface", results.number("record.sent0")?, played)?;
    equal("frames recorded", results.counted("record", "frames recorded")?, played)?;
    equal("exit code", results.number("record.exit")?, 0)?;
    eprintln!("record: {played} frames");
    Ok(())
}

/// A serial adapter behind the kernel's line discipline: an interface like any other.
fn slcan(results: &Results, folder: &Path) -> anyhow::Result<()> {
    let played = logs::frames(&folder.join("slcan.log"))?;
    equal("frames of the adapter", results.number("slcan.played")?, played)?;
    equal("frames received", results.counted("slcan", "frames received")?, played)?;
    equal("decoded", results.counted("slcan", "decoded")?, played)?;
    equal("frames to send", results.number("slcan.asked")?, 0)?;
    let lines = results.output("slcan.jsonl")?;
    // As in the stream: the guest may tear a sample apart, and then its window is not assessed.
    let assessed = lines.lines().filter(|line| !line.contains("\"k\":null")).count();
    let right = lines
        .lines()
        .filter(|line| line.contains("\"faults\":[\"friction\"]"))
        .count();
    equal("windows", lines.lines().count() as u64, logs::SLCAN_WINDOWS.into())?;
    ensure!(
        assessed > 0 && right == assessed,
        "expected friction in every window that was assessed, found {lines}"
    );
    eprintln!("slcan: {played} frames, none sent; {assessed} windows assessed, all right");
    Ok(())
}

/// Whatever comes and goes, the next actuations are assessed.
fn order(results: &Results, folder: &Path) -> anyhow::Result<()> {
    let missed = fs::read_to_string(folder.join("order.missed")).unwrap_or_default();
    ensure!(missed.is_empty(), "seed {SEED}: {missed}");
    let events = results.number("order.events")?;
    // Once more before the first.
    equal(
        "events after which actuations were assessed",
        results.number("order.good")?,
        events + 1,
    )?;
    equal("daemons that failed", results.number("order.failed")?, 0)?;
    eprintln!("order: {events} events by seed {SEED}, actuations assessed after each");
    Ok(())
}

fn equal(what: &str, found: u64, expected: u64) -> anyhow::Result<()> {
    ensure!(found == expected, "{what}: expected {expected}, found {found}");
    Ok(())
}

fn between<'a>(line: &'a str, before: &str, after: &str) -> anyhow::Result<&'a str> {
    let rest = line.split_once(before).map(|(_, rest)| rest);
    let found = rest.and_then(|rest| rest.split_once(after)).map(|(found, _)| found);
    found.with_context(|| format!("expected {before} in {line}"))
}
