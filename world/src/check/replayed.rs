//! A replay of the raw frames gives what was stored; of captures alone, the verdicts that asked for them.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use hmd::replay::{self, Replay};
use hmd_core::assess::AssessedWindow;
use hmd_core::health::HealthState;
use hmd_core::record::{Health, Record, Rul, Sensors, WindowStatus};
use hmd_ingest::file::open;
use hmd_storage::recorder::{PublishedRecord, RecordObserver};

use prost::Message;

use super::Outcome;
use crate::disk::{Removed, segment_number};
use crate::host::Reported;
use crate::run::World;
use crate::segment::Messages;
use crate::stand_in::StandIn;

/// A run that did not end by itself lacks what was not synced of a capture: up to a second, and what was then under way.
const LATE: Duration = Duration::from_millis(2500);

/// Records of a replay.
#[derive(Clone, Default)]
struct Replayed(Arc<Mutex<Messages>>);

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
pub(super) fn check(
    run: usize,
    names: &[String],
    reported: &[Reported],
    stored: &BTreeMap<usize, Messages>,
    removed: &[Removed],
    world: &World,
    outcome: &mut Outcome,
) -> anyhow::Result<()> {
    let (facts, owners) = (&world.runs[run], world.owners());
    let captures = !facts.config.output().raw_frames;
    let is_own = |name: &str| segment_number(name).and_then(|number| owners.get(&number)) == Some(&run);
    let raw: Vec<&String> = names
        .iter()
        .filter(|name| is_own(name))
        // A capture whose end could not be written is read as it is, unless no frame has got there: so does `hmd replay` with a folder.
        .filter(|name| {
            let is_open = || captures && name.ends_with("-raw.mcap.part") && open(&world.store.join(name)).is_ok();
            name.ends_with("-raw.mcap") || is_open()
        })
        .collect();
    let is_removed = removed
        .iter()
        .any(|removed| removed.name.contains("-raw.mcap") && removed.owner == Some(run));
    let is_rotten = world.before_rot.keys().any(|name| is_own(name));
    let Some(found) = stored
        .get(&run)
        .filter(|_| !is_removed && !is_rotten && facts.lost_frames == 0)
    else {
        return Ok(());
    };
    if raw.is_empty() {
        if captures {
            check_captures(run, reported, &Messages::default(), world, outcome);
        }
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
    let replayed = std::mem::take(&mut *replayed.0.lock().unwrap_or_else(PoisonError::into_inner));
    if summary.damaged_places > 0 {
        outcome.violations.push(format!(
            "run {run}: {} damaged places in raw frames",
            summary.damaged_places
        ));
    }
    if captures {
        check_captures(run, reported, &replayed, world, outcome);
        return Ok(());
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
    let is_whole = facts.status.is_some();
    let of_run = || reported.iter().filter(|of| of.run == run);
    let key = |of: &'_ Reported| (of.health.actuator.clone(), of.health.t_start_ns);
    let known: BTreeSet<_> = of_run().map(key).collect();
    let kinds = ["/window", "/health", "/rul", "/sensors"];
    for ((topic, at_ns), data) in found
        .iter()
        .filter(|((topic, _), _)| kinds.iter().any(|kind| topic.ends_with(kind)))
    {
        let actuator = topic.trim_start_matches('/').split('/').next().unwrap_or_default();
        // One that was never reported may have lost its frames with its report.
        if !known.contains(&(actuator.to_owned(), *at_ns)) {
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
    let is_new = |(topic, at_ns): &&(String, u64)| {
        let actuator = topic.trim_start_matches('/').split('/').next().unwrap_or_default();
        topic.ends_with("/health") && !known.contains(&(actuator.to_owned(), *at_ns))
    };
    // A run that did not come to its end may have marked a window, and died before it reported it.
    let unreported = usize::from(!is_whole);
    for (topic, at_ns) in replayed.keys().filter(is_new).skip(unreported) {
        outcome
            .violations
            .push(format!("run {run}: {topic} at {at_ns} comes only in the replay"));
    }
    Ok(())
}

/// What asked for its frames has the same estimate by them alone, however late the verdict came.
fn check_captures(run: usize, reported: &[Reported], replayed: &Messages, world: &World, outcome: &mut Outcome) {
    let facts = &world.runs[run];
    let mut before = BTreeMap::new();
    for Reported { at, health, stored, .. } in reported.iter().filter(|of| of.run == run) {
        let last = before.insert(&health.actuator, HealthState::named(&health.health));
        let last = last.unwrap_or_default().max(HealthState::Nominal);
        let asks = HealthState::named(&health.health) > last || health.status == WindowStatus::Unmodelled.name();
        let is_early = facts.status.is_some() || *at + LATE < facts.ended;
        if !asks || !stored || !is_early {
            continue;
        }
        outcome.replayed += 1;
        let again = replayed.get(&(health.topic(), health.t_start_ns));
        let again = again.and_then(|data| Health::decode(data.first()?.as_slice()).ok());
        let is_same = again
            .as_ref()
            .is_some_and(|again| (again.k1, &again.status) == (health.k1, &health.status));
        if !is_same {
            outcome.violations.push(format!(
                "run {run}: window {} of {} became {}, and its capture gives {:?}",
                health.window,
                health.actuator,
                health.health,
                again.map(|again| (again.status, again.k1, again.reason))
            ));
        }
    }
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
