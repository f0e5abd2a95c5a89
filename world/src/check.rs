//! What must be true after every run of the world.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, Cursor, Read, Seek};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use hmd::replay::{self, Replay};
use hmd_core::assess::AssessedWindow;
use hmd_core::record::{Health, Record, Rul, Sensors};
use hmd_storage::mcap::McapMessages;
use hmd_storage::recorder::{PublishedRecord, RecordObserver};
use prost::Message;

use crate::disk::{Removed, segment_number};
use crate::health_oracle::HealthOracle;
use crate::host::{Host, Reported};
use crate::plan::{BUSES, DEVICES};
use crate::run::{World, actuator};
use crate::stand_in::StandIn;

/// A run that did not end by itself lacks what was not synced: up to a second, and what was then under way.
const LATE: Duration = Duration::from_millis(2500);

/// What a run of the world showed.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// What was not true.
    pub violations: Vec<String>,
    /// Simulated hours of all actuators.
    pub actuator_hours: f64,
    /// Disturbances.
    pub disturbances: u64,
    /// Runs of the program.
    pub runs: u64,
    /// Windows reported.
    pub windows: u64,
    /// Windows that a replay was compared with.
    pub replayed: u64,
}

impl Outcome {
    /// Adds another run's.
    pub fn add(&mut self, other: &Self) {
        self.violations.extend(other.violations.iter().cloned());
        self.actuator_hours += other.actuator_hours;
        self.disturbances += other.disturbances;
        self.runs += other.runs;
        self.windows += other.windows;
        self.replayed += other.replayed;
    }
}

/// Topic, time and content of a record.
type Found = BTreeMap<(String, u64), Vec<Vec<u8>>>;

/// The records of one segment.
#[derive(Default)]
struct Segment {
    found: Found,
    losses: usize,
}

fn read_segment(input: impl Read + Seek, name: &str) -> io::Result<Segment> {
    let mut segment = Segment::default();
    for message in McapMessages::new(input, name)? {
        match message {
            Ok(message) => {
                let key = (message.topic.to_string(), message.log_time_ns);
                segment.found.entry(key).or_default().push(message.data);
            }
            Err(_) => segment.losses += 1,
        }
    }
    Ok(segment)
}

pub(crate) fn check(mut world: World, host: &Host) -> anyhow::Result<Outcome> {
    let reported = std::mem::take(&mut *host.reported.lock().unwrap_or_else(PoisonError::into_inner));
    let mut outcome = Outcome {
        violations: std::mem::take(&mut world.violations),
        actuator_hours: world.until.as_secs_f64() / 3600.0 * f64::from(BUSES) * f64::from(DEVICES),
        disturbances: world.plan.disturbances.len() as u64,
        runs: world.runs.len() as u64,
        windows: reported.len() as u64,
        replayed: 0,
    };
    let removed = world.disk.take_removed();
    outcome
        .violations
        .extend(removed.iter().filter_map(|removed| wrongly_removed(removed, &world)));
    let (stored, unreadable) = stored(&world, &mut outcome)?;
    check_published(&reported, &stored, &removed, &unreadable, &world, &mut outcome);
    check_counts(&world, &mut outcome);
    check_numbers(&reported, &world, &mut outcome);
    check_health(&reported, &world, &mut outcome);
    check_progress(&reported, &world, &mut outcome);
    let all_names = world.disk.names();
    for run in 0..world.runs.len() {
        check_replay(run, &all_names, &reported, &stored, &removed, &world, &mut outcome)?;
    }
    Ok(outcome)
}

/// Records go only for the budget, and after all raw frames.
fn wrongly_removed(removed: &Removed, world: &World) -> Option<String> {
    if !removed.name.ends_with("-records.mcap") {
        return None;
    }
    let budget = world.runs.last()?.config.output().limits().budget_bytes;
    let raw = removed.names.iter().find(|name| name.ends_with("-raw.mcap"));
    if let Some(raw) = raw {
        return Some(format!("{} was removed before {raw}", removed.name));
    }
    (removed.used_bytes <= budget).then(|| {
        let used = removed.used_bytes;
        format!("{} was removed with {used} bytes of {budget} used", removed.name)
    })
}

/// All records by the run that wrote them, and the runs of which some cannot be read for what became of the disk.
fn stored(world: &World, outcome: &mut Outcome) -> anyhow::Result<(BTreeMap<usize, Found>, BTreeSet<usize>)> {
    let owners = world.owners();
    let (mut stored, mut unreadable) = (BTreeMap::<usize, Found>::new(), BTreeSet::new());
    for name in world.disk.names() {
        let path = world.store.join(&name);
        let Some(run) = segment_number(&name).and_then(|number| owners.get(&number)) else {
            continue;
        };
        let is_rotten = world.rotten.contains(&name);
        if !name.contains("-records.mcap") || name.ends_with(".damaged") {
            continue;
        }
        let segment = fs::File::open(&path).and_then(|file| read_segment(file, &name));
        let segment = match segment {
            Ok(segment) => segment,
            Err(_) if is_rotten => Segment {
                losses: 1,
                ..Segment::default()
            },
            Err(cause) => {
                outcome.violations.push(format!("{name} cannot be read: {cause}"));
                continue;
            }
        };
        if segment.losses > 0 {
            unreadable.insert(*run);
            if !is_rotten && name.ends_with(".mcap") {
                outcome
                    .violations
                    .push(format!("{name} is damaged in {} places", segment.losses));
            }
        }
        let of_run = stored.entry(*run).or_default();
        for (key, mut data) in segment.found {
            of_run.entry(key).or_default().append(&mut data);
        }
    }
    Ok((stored, unreadable))
}

/// What was reported as stored is there, once, as it was reported.
fn check_published(
    reported: &[Reported],
    stored: &BTreeMap<usize, Found>,
    removed: &[Removed],
    unreadable: &BTreeSet<usize>,
    world: &World,
    outcome: &mut Outcome,
) {
    let owners = world.owners();
    let mut gone = BTreeSet::new();
    for removed in removed.iter().filter(|removed| removed.name.ends_with("-records.mcap")) {
        let run = segment_number(&removed.name).and_then(|number| owners.get(&number));
        let segment = read_segment(Cursor::new(&removed.content), &removed.name).unwrap_or_default();
        gone.extend(segment.found.into_keys().map(|key| (run.copied(), key)));
    }
    for Reported { run, health, at, .. } in reported.iter().filter(|reported| reported.stored) {
        let key = (health.topic(), health.t_start_ns);
        let found = stored.get(run).and_then(|found| found.get(&key));
        let same = found.map_or(0, |found| {
            found.iter().filter(|data| **data == health.encode_to_vec()).count()
        });
        let is_excused = gone.contains(&(Some(*run), key)) || unreadable.contains(run);
        if same != 1 && !(same == 0 && is_excused) {
            outcome.violations.push(format!(
                "{}: window {} of run {run}, reported as stored at {:.1} s, is found {same} times",
                health.actuator,
                health.window,
                at.as_secs_f64()
            ));
        }
    }
}

/// Every frame has its count.
fn check_counts(world: &World, outcome: &mut Outcome) {
    for (run, facts) in world.runs.iter().enumerate() {
        let Some(status) = &facts.status else { continue };
        let given = facts.given;
        // A frame with another bit may also come twice.
        let malformed = given.malformed..=given.malformed + 2 * given.flipped;
        if !malformed.contains(&status.lost_malformed) {
            let found = status.lost_malformed;
            outcome
                .violations
                .push(format!("run {run}: {malformed:?} malformed frames, {found} counted"));
        }
        // Those before the first whole one and after the last are not missed.
        let ends = 2 * u64::from(BUSES) * u64::from(DEVICES);
        let accounted = status.samples + status.lost_samples;
        if given.resets == 0 && accounted + ends < given.samples {
            let text = format!(
                "run {run}: {} samples sent, {accounted} counted as received or lost",
                given.samples
            );
            outcome.violations.push(text);
        }
        if status.samples > given.samples + ends {
            outcome
                .violations
                .push(format!("run {run}: {} samples of {}", status.samples, given.samples));
        }
        let kinds = status.frames_decoded + status.frames_filtered + status.frames_error + status.lost_malformed;
        for (what, expected, found) in [
            ("frames", given.frames, status.frames_received),
            ("frames by kind", given.frames, kinds),
            ("error frames", given.errors, status.frames_error),
            (
                "frames that the kernel dropped",
                given.overflown,
                status.lost_socket_queue,
            ),
        ] {
            if expected != found {
                outcome
                    .violations
                    .push(format!("run {run}: {expected} {what}, {found} counted"));
            }
        }
    }
}

/// Windows are numbered one by one, and what is left out was dropped and counted.
fn check_numbers(reported: &[Reported], world: &World, outcome: &mut Outcome) {
    for (run, facts) in world.runs.iter().enumerate() {
        let Some(status) = &facts.status else { continue };
        let mut next = BTreeMap::new();
        let mut left_out = 0;
        for Reported { health, .. } in reported.iter().filter(|reported| reported.run == run) {
            let expected = next.entry(&health.actuator).or_insert(0);
            left_out += health.window.saturating_sub(*expected);
            *expected = health.window + 1;
        }
        if left_out > status.lost_windows {
            let text = format!(
                "run {run}: {left_out} windows left out, {} counted",
                status.lost_windows
            );
            outcome.violations.push(text);
        }
    }
}

/// States are those that levels and persistence ask for.
fn check_health(reported: &[Reported], world: &World, outcome: &mut Outcome) {
    let stand_in = StandIn { seed: world.plan.seed };
    let mut oracles = BTreeMap::new();
    for Reported { run, health, .. } in reported {
        let levels = world.runs[*run].config.health().levels();
        let oracle = oracles
            .entry((*run, health.actuator.clone()))
            .or_insert_with(|| HealthOracle::new(levels[0].persistence));
        let events = world.events.iter().filter(|event| event.actuator == health.actuator);
        let come = events.filter(|event| event.t_ns <= health.t_start_ns).count();
        let expected = oracle.next(health, come);
        let window = || format!("{}: window {} of run {run}", health.actuator, health.window);
        if health.health != expected {
            outcome
                .violations
                .push(format!("{} is {}, expected {expected}", window(), health.health));
        }
        let answered = stand_in.friction(&health.actuator, health.t_start_ns);
        if let (Some(answered), Some(found)) = (answered, health.damage_friction)
            && answered.to_bits() != found.to_bits()
        {
            outcome
                .violations
                .push(format!("{}: friction {answered} was found, {found} reported", window()));
        }
    }
}

/// After the last disturbance everything works again.
fn check_progress(reported: &[Reported], world: &World, outcome: &mut Outcome) {
    for (bus, device) in (0..BUSES).flat_map(|bus| (0..DEVICES).map(move |device| (bus, device))) {
        let name = actuator(bus, device);
        let is_calm = |of: &&Reported| of.stored && of.at >= world.calm_since() && of.health.actuator == name;
        let mut calm = reported.iter().filter(is_calm).peekable();
        if calm.peek().is_none() {
            outcome
                .violations
                .push(format!("{name}: nothing stored since the last disturbance"));
        } else if !calm.any(|of| of.health.status != "invalid") {
            outcome
                .violations
                .push(format!("{name}: only invalid windows since the last disturbance"));
        }
    }
    let ended = world.runs.last().and_then(|facts| facts.status.as_ref());
    if let Some(status) = ended.filter(|status| status.storage != "ok") {
        outcome
            .violations
            .push(format!("storage is {} at the end", status.storage));
    }
}

/// Records of a replay.
#[derive(Clone, Default)]
struct Replayed(Arc<Mutex<Found>>);

impl RecordObserver for Replayed {
    fn publish(&self, record: PublishedRecord) {
        let mut found = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        found.entry((record.topic, record.at_ns)).or_default().push(record.data);
    }
}

struct Silent;

impl replay::Observer for Silent {
    fn assessed(&mut self, _: &AssessedWindow) -> io::Result<()> {
        Ok(())
    }

    fn notice(&mut self, _: &str) {}

    fn progress(&mut self, _: u64) {}
}

/// What is stored of a run is what its raw frames give again.
fn check_replay(
    run: usize,
    names: &[String],
    reported: &[Reported],
    stored: &BTreeMap<usize, Found>,
    removed: &[Removed],
    world: &World,
    outcome: &mut Outcome,
) -> anyhow::Result<()> {
    let (facts, owners) = (&world.runs[run], world.owners());
    let is_own = |name: &str| segment_number(name).and_then(|number| owners.get(&number)) == Some(&run);
    let raw: Vec<&String> = names
        .iter()
        .filter(|name| name.ends_with("-raw.mcap") && is_own(name))
        .collect();
    let is_removed = removed
        .iter()
        .any(|removed| removed.name.ends_with("-raw.mcap") && is_own(&removed.name));
    let is_rotten = world.rotten.iter().any(|name| is_own(name));
    let Some(found) = stored
        .get(&run)
        .filter(|_| !is_removed && !is_rotten && facts.lost_frames == 0)
    else {
        return Ok(());
    };
    if raw.is_empty() {
        return Ok(());
    }
    let logs: Vec<PathBuf> = raw.iter().map(|name| world.store.join(name)).collect();
    let replay = Replay {
        logs: &logs,
        output: None,
        config: facts.config.clone(),
        seed: world.plan.seed,
    };
    let replayed = Replayed::default();
    let estimator = Arc::new(StandIn { seed: world.plan.seed });
    let summary = replay.run_with(&mut Silent, Some(Box::new(replayed.clone())), estimator);
    let summary = match summary {
        Ok(summary) => summary,
        Err(error) => {
            outcome
                .violations
                .push(format!("run {run} cannot be replayed: {error}"));
            return Ok(());
        }
    };
    if summary.damaged_places > 0 {
        outcome.violations.push(format!(
            "run {run}: {} damaged places in raw frames",
            summary.damaged_places
        ));
    }
    if let Some(live) = &facts.status {
        let again = &summary.status;
        for (what, live, again) in [
            ("frames", live.frames_received, again.frames_received),
            ("error frames", live.frames_error, again.frames_error),
            ("samples", live.samples, again.samples),
            ("lost samples", live.lost_samples, again.lost_samples),
            ("late frames", live.lost_late, again.lost_late),
            ("malformed frames", live.lost_malformed, again.lost_malformed),
            ("dropped windows", live.lost_windows, again.lost_windows),
        ] {
            if live != again {
                outcome
                    .violations
                    .push(format!("run {run}: {live} {what} live, {again} in the replay"));
            }
        }
    }
    let replayed = std::mem::take(&mut *replayed.0.lock().unwrap_or_else(PoisonError::into_inner));
    let is_whole = facts.status.is_some();
    let of_run = || reported.iter().filter(|of| of.run == run);
    let key = |of: &'_ Reported| (of.health.actuator.clone(), of.health.t_start_ns);
    let known: BTreeSet<_> = of_run().map(key).collect();
    // What came last may have been stored before its frames were.
    let early = |of: &&Reported| is_whole || of.at + LATE < facts.ended;
    let early: BTreeSet<_> = of_run().filter(early).map(key).collect();
    let kinds = ["/window", "/health", "/rul", "/sensors"];
    for ((topic, at_ns), data) in found
        .iter()
        .filter(|((topic, _), _)| kinds.iter().any(|kind| topic.ends_with(kind)))
    {
        let actuator = topic.trim_start_matches('/').split('/').next().unwrap_or_default();
        if !early.contains(&(actuator.to_owned(), *at_ns)) {
            continue;
        }
        outcome.replayed += u64::from(topic.ends_with("/health"));
        let again = replayed.get(&(topic.clone(), *at_ns));
        if again != Some(data) {
            let what = if again.is_some() { "is another" } else { "is missing" };
            outcome.violations.push(format!(
                "run {run}: {topic} at {at_ns} {what} in the replay{}",
                shown(topic, data, again)
            ));
        }
    }
    if is_whole {
        for (topic, at_ns) in replayed.keys().filter(|(topic, _)| topic.ends_with("/health")) {
            let actuator = topic.trim_start_matches('/').split('/').next().unwrap_or_default();
            if !known.contains(&(actuator.to_owned(), *at_ns)) {
                outcome
                    .violations
                    .push(format!("run {run}: {topic} at {at_ns} comes only in the replay"));
            }
        }
    }
    Ok(())
}

/// Both records, where they differ.
fn shown(topic: &str, data: &[Vec<u8>], again: Option<&Vec<Vec<u8>>>) -> String {
    fn decoded<R: Record + Default + std::fmt::Debug>(data: &[Vec<u8>]) -> String {
        let records = data.iter().filter_map(|data| R::decode(data.as_slice()).ok());
        records.map(|record| format!("{record:?} ")).collect()
    }
    let text = |data: &[Vec<u8>]| match topic.rsplit('/').next() {
        Some("health") => decoded::<Health>(data),
        Some("rul") => decoded::<Rul>(data),
        Some("sensors") => decoded::<Sensors>(data),
        _ => String::new(),
    };
    let (once, again) = (text(data), again.map(|again| text(again)).unwrap_or_default());
    // From a little before the first difference on.
    let same = once
        .chars()
        .zip(again.chars())
        .take_while(|(one, other)| one == other)
        .count();
    let from = |text: &str| text.chars().skip(same.saturating_sub(40)).take(120).collect::<String>();
    format!(": …{}…, …{}…", from(&once), from(&again))
}
