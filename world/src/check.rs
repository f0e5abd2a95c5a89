//! What must be true after every run of the world.

mod replayed;
mod stored;

use std::collections::BTreeMap;
use std::sync::PoisonError;
use std::time::Duration;

use hmd_core::window::CutShort;

use crate::disk::Removed;
use crate::health_oracle::HealthOracle;
use crate::host::{Host, Reported};
use crate::plan::{BUSES, DEVICES};
use crate::run::{World, actuator, place};
use crate::stand_in::StandIn;

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
    let (stored, unreadable) = stored::read_all(&world, &mut outcome);
    stored::check_published(&reported, &stored, &removed, &unreadable, &mut outcome);
    stored::check_rotten(&removed, &world, &mut outcome);
    stored::check_contents(&reported, &stored, &world, &mut outcome);
    stored::check_frames(&removed, &world, &mut outcome)?;
    check_counts(&reported, &world, &mut outcome);
    check_numbers(&reported, &world, &mut outcome);
    check_health(&reported, &world, &mut outcome);
    check_progress(&reported, &world, &mut outcome);
    let all_names = world.disk.names();
    for run in 0..world.runs.len() {
        replayed::check(run, &all_names, &reported, &stored, &removed, &world, &mut outcome)?;
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

/// Every frame has its count.
fn check_counts(reported: &[Reported], world: &World, outcome: &mut Outcome) {
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
        // A changed bit may be one of the counter, and a device that starts again begins to count anew.
        let is_countable = !given.counts_back.contains(&true);
        let cut = CutShort::CounterWentBack.to_string();
        let devices = (0..BUSES).flat_map(|bus| (0..DEVICES).map(move |device| (bus, device)));
        let rises: Vec<String> = devices
            .filter(|&(bus, device)| !given.counts_back[place(bus, device)])
            .map(|(bus, device)| actuator(bus, device))
            .collect();
        let went_back =
            |of: &&Reported| of.run == run && of.health.reason.contains(&cut) && rises.contains(&of.health.actuator);
        if let Some(of) = reported.iter().find(went_back) {
            let (actuator, window) = (&of.health.actuator, of.health.window);
            outcome
                .violations
                .push(format!("{actuator}: window {window} of run {run}: {cut}, but it rose"));
        }
        let whole = if is_countable { given.whole } else { status.samples };
        for (what, expected, found) in [
            ("frames", given.frames, status.frames_received),
            ("whole samples", whole, status.samples),
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
        for Reported { health, at, .. } in reported.iter().filter(|reported| reported.run == run) {
            let (expected, before) = next.entry(&health.actuator).or_insert((0, facts.began));
            left_out += health.window.saturating_sub(*expected);
            // The oldest that waits is dropped: never one that came after a window which was assessed later.
            let is_between = |drop: &Duration| drop > before && drop <= at;
            if health.window > *expected && !facts.drops.iter().any(is_between) {
                let (before, at) = (before.as_secs_f64(), at.as_secs_f64());
                outcome.violations.push(format!(
                    "{}: windows {expected} to {} of run {run} were not dropped between {before:.1} and {at:.1} s, when those beside \
                     them were assessed",
                    health.actuator, health.window
                ));
            }
            (*expected, *before) = (health.window + 1, *at);
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
