//! What lies on the disk at the end.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, Cursor, Read, Seek};

use hmd_core::frame::BusNames;
use hmd_core::record::Record as _;
use hmd_storage::mcap::McapFrames;
use prost::Message;

use super::Outcome;
use crate::disk::{Removed, segment_number};
use crate::host::Reported;
use crate::run::World;
use crate::segment::{Messages, Segment, read_messages, read_segment};

/// All records by the run that wrote them, and the runs of which some cannot be read for what became of the disk.
pub(super) fn read_all(world: &World, outcome: &mut Outcome) -> (BTreeMap<usize, Messages>, BTreeSet<usize>) {
    let owners = world.owners();
    let (mut stored, mut unreadable) = (BTreeMap::<usize, Messages>::new(), BTreeSet::new());
    for name in world.disk.names() {
        let path = world.store.join(&name);
        let Some(run) = segment_number(&name).and_then(|number| owners.get(&number)) else {
            continue;
        };
        let is_rotten = world.before_rot.contains_key(&name);
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
    (stored, unreadable)
}

/// What was reported as stored is there, once, as it was reported.
pub(super) fn check_published(
    reported: &[Reported],
    stored: &BTreeMap<usize, Messages>,
    removed: &[Removed],
    unreadable: &BTreeSet<usize>,
    outcome: &mut Outcome,
) {
    let mut gone = BTreeSet::new();
    for removed in removed.iter().filter(|removed| removed.name.ends_with("-records.mcap")) {
        let segment = read_segment(Cursor::new(&removed.content), &removed.name).unwrap_or_default();
        gone.extend(segment.found.into_keys().map(|key| (removed.owner, key)));
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

/// What is read of a segment with wrong bits is what it said before.
pub(super) fn check_rotten(removed: &[Removed], world: &World, outcome: &mut Outcome) {
    // The name of one that was removed may be given again.
    let is_left = |name: &str| removed.iter().all(|removed| removed.name != name);
    for (name, before) in world.before_rot.iter().filter(|(name, _)| is_left(name)) {
        let now = read_messages(&world.store.join(name));
        for ((topic, at_ns), data) in now {
            let before = before.get(&(topic.clone(), at_ns));
            if data
                .iter()
                .any(|data| !before.is_some_and(|before| before.contains(data)))
            {
                let text = format!("{name}: {topic} at {at_ns} is read otherwise since a bit changed");
                outcome.violations.push(text);
            }
        }
    }
}

/// No window is stored otherwise than it was reported, whatever became of the disk.
pub(super) fn check_contents(
    reported: &[Reported],
    stored: &BTreeMap<usize, Messages>,
    world: &World,
    outcome: &mut Outcome,
) {
    let mut known = BTreeMap::<_, Vec<Vec<u8>>>::new();
    for Reported { run, health, .. } in reported {
        let key = (*run, health.topic(), health.t_start_ns);
        known.entry(key).or_default().push(health.encode_to_vec());
    }
    for (run, found) in stored {
        // One that died may have stored windows that it did not report.
        let is_whole = world.runs[*run].status.is_some();
        for ((topic, at_ns), data) in found.iter().filter(|((topic, _), _)| topic.ends_with("/health")) {
            let reported = known.get(&(*run, topic.clone(), *at_ns));
            let is_another = |data: &&Vec<u8>| reported.map_or(is_whole, |reported| !reported.contains(data));
            if data.iter().any(|data| is_another(&data)) {
                let text = format!("run {run}: {topic} at {at_ns} is stored otherwise than it was reported");
                outcome.violations.push(text);
            }
        }
    }
}

/// Every frame of a run that ended by itself is stored or counted as lost.
pub(super) fn check_frames(removed: &[Removed], world: &World, outcome: &mut Outcome) -> anyhow::Result<()> {
    let owners = world.owners();
    let run_of = |name: &str| segment_number(name).and_then(|number| owners.get(&number)).copied();
    let is_raw = |name: &str| name.ends_with("-raw.mcap") || name.ends_with("-raw.mcap.part");
    // By run and number: a power cut may bring back what was removed, and the source of a repair lies beside its copy for a while.
    let mut frames = BTreeMap::<(usize, Option<u64>), u64>::new();
    let mut count = |run: Option<usize>, name: &str, input: Box<dyn ReadSeek>| -> io::Result<()> {
        if let Some(run) = run.filter(|run| world.runs[*run].status.is_some()) {
            let readable = McapFrames::new(input, name, BusNames::new())?.flatten().count() as u64;
            let most = frames.entry((run, segment_number(name))).or_default();
            *most = readable.max(*most);
        }
        Ok(())
    };
    for name in world.disk.names().iter().filter(|name| is_raw(name)) {
        count(run_of(name), name, Box::new(fs::File::open(world.store.join(name))?))?;
    }
    for removed in removed.iter().filter(|removed| is_raw(&removed.name)) {
        count(
            removed.owner,
            &removed.name,
            Box::new(Cursor::new(removed.content.clone())),
        )?;
    }
    // The name of a segment that was removed may be another run's by now.
    let is_rotten = |name: &str| world.before_rot.contains_key(name);
    let removed_rotten = removed.iter().filter(|removed| is_rotten(&removed.name));
    let rotten: BTreeSet<_> = world
        .before_rot
        .keys()
        .filter_map(|name| run_of(name))
        .chain(removed_rotten.filter_map(|removed| removed.owner))
        .collect();
    for (run, facts) in world.runs.iter().enumerate().filter(|(run, _)| !rotten.contains(run)) {
        let Some(status) = &facts.status else { continue };
        let stored: u64 = frames
            .range((run, None)..(run + 1, None))
            .map(|(_, frames)| frames)
            .sum();
        let (received, lost) = (status.frames_received, status.lost_storage_frames);
        let all = facts.config.output().raw_frames;
        if stored > received || all && stored + lost < received {
            outcome.violations.push(format!(
                "run {run}: of {received} frames {stored} are stored and {lost} counted as lost"
            ));
        }
    }
    Ok(())
}

trait ReadSeek: Read + Seek {}

impl<T: Read + Seek> ReadSeek for T {}
