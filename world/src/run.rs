//! One run of the world: the program's own daemon, step by step, under the disturbances of a plan.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use ema_wire::ActuatorId;
use hmd::commands::run::load;
use hmd::daemon::{ENDING_MAX, HostClock, QUEUE_WINDOWS, STALE_AFTER, Steps};
use hmd_core::config::Config;
use hmd_core::deadline::Clock;
use hmd_core::frame::BusNames;
use hmd_core::history::Event;
use hmd_core::record::Status;
use hmd_ingest::feed::{Input, LinkState};
use hmd_storage::recorder::{Recorder, metadata};
use hmd_storage::segment_store::SegmentStore;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

use crate::bus::{Bus, Given};
use crate::clock::WorldClock;
use crate::disk::{Mood, WorldDisk};
use crate::host::Host;
use crate::plan::{BUSES, CALM, DEVICES, Plan};
use crate::segment::Messages;
use crate::stand_in::StandIn;
use crate::traffic::{Device, PERIOD};

/// Times between two batches of the sources: of a computer that has time, and of one that has little.
const SLICES: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(200)];
/// Time after which a supervisor starts the program again.
const RESTART_AFTER: Duration = Duration::from_secs(1);
/// Time after which a disk that works again takes segments: a second until the next attempt, the tick that makes it, and the one that
/// is looked at.
const RECOVERS_WITHIN: Duration = Duration::from_millis(3500);
/// One run of the program.
#[derive(Clone, Debug)]
pub(crate) struct RunFacts {
    /// Its configuration.
    pub config: Arc<Config>,
    /// When it began.
    pub began: Duration,
    /// When it ended.
    pub ended: Duration,
    /// Its last words, if it had any.
    pub status: Option<Status>,
    /// Frames not stored, as last known.
    pub lost_frames: u64,
    /// When windows were dropped.
    pub drops: Vec<Duration>,
    /// What it was given.
    pub given: Given,
}

/// What all that outlives the program.
pub(crate) struct World {
    pub(crate) plan: Plan,
    pub(crate) root: TempDir,
    pub(crate) store: PathBuf,
    pub(crate) disk: WorldDisk,
    pub(crate) runs: Vec<RunFacts>,
    /// What segments said before bits of them changed.
    pub(crate) before_rot: BTreeMap<String, Messages>,
    pub(crate) events: Vec<Event>,
    pub(crate) violations: Vec<String>,
    pub(crate) rng: ChaCha8Rng,
    pub(crate) devices: Vec<(u16, Device)>,
    pub(crate) buses: [Bus; BUSES as usize],
    /// When each tick of this run was given, and when it was taken.
    ticks: Vec<(Duration, Duration)>,
    /// Actuators that brought a whole sample in this run of the program.
    heard: [bool; BUSES as usize * DEVICES as usize],
    /// Samples of each actuator since its last whole one: nothing tells the program of them if none follows.
    unconfirmed: [u64; BUSES as usize * DEVICES as usize],
    /// Of each device, by how much the wall clock stepped since its last whole sample.
    pub(crate) stepped: [Duration; BUSES as usize * DEVICES as usize],
    /// When the last whole sample of each device came.
    whole_at: [Duration; BUSES as usize * DEVICES as usize],
    /// Up to when the devices have sent.
    sampled: Duration,
    pub(crate) next: usize,
    pub(crate) calms_disk: Duration,
    /// When the disk began to work again.
    pub(crate) works_since: Duration,
    /// Changes of names of the next start until the power fails.
    pub(crate) cuts_start: Option<u64>,
    pub(crate) stalled: Duration,
    /// When the run ends: a slow disk delays disturbances, and the calm comes after them all.
    pub(crate) until: Duration,
    pub(crate) persistence: u32,
    pub(crate) budget_mib: u32,
    /// Time between two batches of the sources.
    slice: Duration,
}

/// How a run of the program ended.
pub(crate) enum End {
    Reload(Arc<Config>),
    Restart,
    Died,
    Over,
}

/// Runs a plan; `show` prints what the program said.
///
/// # Errors
/// The real folder in which the world lives cannot be used.
pub(crate) fn live(plan: &Plan, show: bool) -> anyhow::Result<(World, Host)> {
    let memory = Path::new("/dev/shm");
    let root = if memory.is_dir() {
        tempfile::tempdir_in(memory)
    } else {
        tempfile::tempdir()
    };
    let root = root.context("a folder for the world")?;
    let store = root.path().join("store");
    let clock = WorldClock::new();
    let disk = WorldDisk::new(&store, clock.clone());
    let mut rng = ChaCha8Rng::seed_from_u64(plan.seed ^ 0x5EED);
    let devices = (0..BUSES)
        .flat_map(|bus| (0..DEVICES).filter_map(move |id| Some((bus, ActuatorId::new(id)?))))
        .map(|(bus, id)| (bus, Device::new(id, &mut rng)))
        .collect();
    let host = Host {
        clock,
        disk: disk.clone(),
        run: AtomicUsize::new(0),
        reported: Mutex::default(),
        notices: Mutex::default(),
    };
    let mut world = World {
        plan: plan.clone(),
        root,
        store,
        disk,
        runs: Vec::new(),
        before_rot: BTreeMap::new(),
        events: Vec::new(),
        violations: Vec::new(),
        devices,
        buses: [Bus::default(); BUSES as usize],
        ticks: Vec::new(),
        heard: Default::default(),
        unconfirmed: Default::default(),
        stepped: Default::default(),
        whole_at: Default::default(),
        sampled: Duration::ZERO,
        next: 0,
        calms_disk: Duration::ZERO,
        works_since: Duration::ZERO,
        cuts_start: None,
        stalled: Duration::ZERO,
        until: plan.length,
        persistence: rng.random_range(2..=3),
        // In some worlds room is scarce; in the others everything is kept, and replayed.
        budget_mib: if rng.random_bool(0.3) { 6 } else { 64 },
        slice: SLICES[rng.random_range(0..SLICES.len())],
        rng,
    };
    world.write_config()?;
    let mut config = load(&world.config_path(), &[])?;
    let mut reopens = false;
    loop {
        let ended = world.one_run(&host, config.clone(), reopens)?;
        reopens = false;
        match ended {
            End::Over => break,
            End::Reload(new) => (config, reopens) = (new, true),
            End::Restart => {}
            End::Died => world.pass(&host, RESTART_AFTER),
        }
        if !reopens {
            world.disk.revive(&mut world.rng)?;
            if let Some(changes) = world.cuts_start.take() {
                world.disk.power_fails_at_change_of_names(changes);
            }
            world.write_config()?;
            config = load(&world.config_path(), &[])?;
        }
    }
    if show {
        for notice in host.notices.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            println!("{notice}");
        }
    }
    Ok((world, host))
}

impl World {
    pub(crate) fn config_path(&self) -> PathBuf {
        self.root.path().join("hmd.toml")
    }

    /// One run of the program.
    fn one_run(&mut self, host: &Host, config: Arc<Config>, reopens: bool) -> anyhow::Result<End> {
        let clock = &host.clock;
        host.run.store(self.runs.len(), Relaxed);
        self.disk.begin_run(self.runs.len());
        self.heard = Default::default();
        self.unconfirmed = Default::default();
        self.stepped = Default::default();
        self.runs.push(RunFacts {
            config: config.clone(),
            began: clock.now(),
            ended: clock.now(),
            status: None,
            lost_frames: 0,
            drops: Vec::new(),
            given: Given::default(),
        });
        let about = metadata(&config, "host", self.plan.seed);
        let (limits, now) = (config.output().limits(), clock.instant());
        let disk = Box::new(self.disk.clone());
        let store = if reopens {
            SegmentStore::reopen(&self.store, &about, limits, disk, now)
        } else {
            match SegmentStore::open(&self.store, &about, limits, disk, now) {
                Ok(store) => store,
                Err(cause) => {
                    if !self.disk.is_dead() && self.disk.mood() == Mood::Works {
                        self.violations.push(format!("a store does not open: {cause}"));
                    }
                    return Ok(if clock.now() >= self.until {
                        End::Over
                    } else {
                        End::Died
                    });
                }
            }
        };
        let mut names = BusNames::new();
        let mut inputs = Vec::new();
        for bus in 0..BUSES {
            names.intern(&format!("can{bus}"))?;
            inputs.push(link(bus, clock, LinkState::Up));
        }
        let watch = Some((config, self.plan.seed));
        let estimator = Arc::new(StandIn { seed: self.plan.seed });
        let recorder = Some(Recorder::of_store(store));
        let mut steps = Steps::new(names, recorder, watch, estimator, clock, host)?;
        let (mut ticked, mut dropped) = (clock.now(), 0);
        self.ticks.clear();
        let end = loop {
            if let Some(end) = self.disturb(host, &mut inputs)? {
                break end;
            }
            if clock.now() >= self.until {
                break End::Over;
            }
            clock.advance(self.slice);
            self.send(host, &mut inputs);
            let mut given = None;
            while clock.now() >= ticked {
                ticked += Duration::from_secs(1);
                inputs.push(Input::Tick {
                    stamp_ns: clock.utc_ns(),
                });
                self.look(&steps.status(), clock.now());
                given = Some(clock.now());
            }
            let mut failed = steps.take(&mut inputs).err();
            let lost_windows = steps.status().lost_windows;
            if lost_windows > dropped
                && let Some(facts) = self.runs.last_mut()
            {
                dropped = lost_windows;
                facts.drops.push(clock.now());
            }
            self.ticks.extend(given.map(|given| (given, clock.now())));
            // On a slow disk it goes on beside the next inputs.
            let until = clock.now() + self.slice;
            while failed.is_none() && clock.now() >= self.stalled && clock.now() < until {
                match steps.assess() {
                    Ok(true) => {}
                    Ok(false) => break,
                    Err(error) => failed = Some(error),
                }
            }
            if self.disk.is_dead() {
                break End::Died;
            }
            if let Some(error) = failed {
                self.violations.push(format!("the daemon ended: {error}"));
                break End::Died;
            }
        };
        let facts = self.runs.len() - 1;
        if matches!(end, End::Died) {
            self.disk.kill();
            drop(steps);
        } else {
            // What the sources had received by then they still send.
            let taken = steps.take(&mut inputs);
            // One that is stalled assesses no window more.
            let within = if clock.now() < self.stalled {
                Duration::ZERO
            } else {
                ENDING_MAX
            };
            match taken.and_then(|()| steps.finish(within)) {
                Ok(status) => {
                    self.runs[facts].lost_frames = status.lost_storage_frames;
                    self.runs[facts].status = Some(status).filter(|_| !self.disk.is_dead());
                }
                Err(error) => self.violations.push(format!("the daemon ended: {error}")),
            }
        }
        self.runs[facts].ended = clock.now();
        // The power may have failed at the end.
        Ok(match end {
            End::Over => End::Over,
            _ if self.disk.is_dead() => End::Died,
            end => end,
        })
    }

    /// What must hold at any time.
    fn look(&mut self, status: &Status, now: Duration) {
        if self.disk.is_dead() {
            return;
        }
        if let Some(facts) = self.runs.last_mut() {
            facts.lost_frames = status.lost_storage_frames;
            let limits = facts.config.output().limits();
            // Of each kind, the segment in progress grows until the next tick.
            let most = limits.budget_bytes + 2 * limits.segment_bytes;
            let works = self.disk.mood() == Mood::Works;
            let since = self.works_since.max(facts.began);
            if works && status.storage == "failing" && now > since + RECOVERS_WITHIN {
                let (now, since) = (now.as_secs_f64(), since.as_secs_f64());
                let text = format!("storage still fails at {now:.1} s, the disk works since {since:.1} s");
                self.violations.push(text);
            }
            if works && status.storage_used_bytes > most {
                let text = format!(
                    "{} bytes stored, the budget is {}",
                    status.storage_used_bytes, limits.budget_bytes
                );
                self.violations.push(text);
            }
        }
        for actuator in &status.actuators {
            let number = actuator
                .actuator
                .trim_start_matches("ema")
                .parse::<u16>()
                .unwrap_or_default();
            let heard = self.buses[usize::from(number / u16::from(DEVICES))].heard;
            // Its last sample is seen with a tick, and found to be old with another, which a slow disk may delay.
            let seen = self
                .ticks
                .iter()
                .find(|(given, _)| *given >= heard)
                .map(|(_, taken)| *taken);
            let is_due = |seen: Duration| self.ticks.iter().any(|(given, _)| *given > seen + STALE_AFTER);
            if seen.is_some_and(is_due) && !actuator.is_stale() {
                let text = format!(
                    "{} is fresh, its last sample came at {:.1} s",
                    actuator.actuator,
                    heard.as_secs_f64()
                );
                self.violations.push(text);
            }
        }
        if status.queued_windows > QUEUE_WINDOWS as u64 {
            self.violations.push(format!("{} windows wait", status.queued_windows));
        }
    }

    /// Time passes without the program.
    fn pass(&mut self, host: &Host, time: Duration) {
        host.clock.advance(time);
        self.calm_disk(host.clock.now());
        self.send(host, &mut Vec::new());
    }

    /// What the devices send until now.
    fn send(&mut self, host: &Host, inputs: &mut Vec<Input>) {
        let now = host.clock.now();
        let Some(facts) = self.runs.last_mut() else { return };
        let given = &mut facts.given;
        let mut frames = Vec::new();
        while self.sampled + PERIOD <= now {
            self.sampled += PERIOD;
            let mut stamps = [host.clock.utc_at(self.sampled); BUSES as usize];
            for index in 0..self.devices.len() {
                let (bus, device) = &mut self.devices[index];
                let number = usize::from(*bus);
                frames.clear();
                device.next_sample(&mut stamps[number], &mut self.rng, &mut frames);
                let mut came = false;
                let flipped = given.flipped;
                if self.buses[number].silent == Duration::ZERO {
                    let at = (*bus, self.sampled);
                    let is_whole = self.buses[number].carry(at, &mut frames, &mut self.rng, given, inputs);
                    came = is_whole;
                    self.heard[index] |= is_whole;
                    self.unconfirmed[index] += u64::from(self.heard[index]);
                    if is_whole {
                        given.whole += 1;
                        given.samples += std::mem::take(&mut self.unconfirmed[index]);
                    }
                }
                if came {
                    let stepped = std::mem::take(&mut self.stepped[index]);
                    let silence = self.sampled - std::mem::replace(&mut self.whole_at[index], self.sampled);
                    let is_untold = silence > PERIOD && stepped > Duration::ZERO;
                    given.counts_back[index] |= is_untold && device.may_have_begun_within(silence + stepped);
                }
                given.counts_back[index] |= given.flipped > flipped;
            }
        }
    }

    /// Actuators of which each must be stored again in the last seconds of the calm.
    pub(crate) fn calm_since(&self) -> Duration {
        self.until - CALM / 2
    }

    /// Segments by their number, and the run that began them.
    pub(crate) fn owners(&self) -> BTreeMap<u64, usize> {
        self.disk.owners()
    }
}

/// State of a bus's link, now.
pub(crate) fn link(bus: u16, clock: &WorldClock, state: LinkState) -> Input {
    Input::Link {
        bus,
        stamp_ns: clock.utc_ns(),
        state,
        cause: None,
    }
}

/// Name of an actuator.
pub(crate) fn actuator(bus: u16, device: u8) -> String {
    format!("ema{}", place(bus, device))
}

/// Place of a device among all.
pub(crate) fn place(bus: u16, device: u8) -> usize {
    usize::from(bus) * usize::from(DEVICES) + usize::from(device)
}
