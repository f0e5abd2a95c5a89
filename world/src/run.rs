//! One run of the world: the program's own daemon, step by step, under the disturbances of a plan.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use ema_wire::ActuatorId;
use hmd::commands::run::load;
use hmd::daemon::{HostClock, Observer, QUEUE_WINDOWS, STALE_AFTER, Steps};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::deadline::Clock;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::history::{Event, EventKind};
use hmd_core::record::{Health, Status};
use hmd_ingest::feed::{Input, LinkState, LiveLoss};
use hmd_storage::event_file;
use hmd_storage::recorder::{Recorder, metadata};
use hmd_storage::segment_store::SegmentStore;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

use crate::clock::WorldClock;
use crate::disk::{Mood, WorldDisk};
use crate::plan::{BUSES, CALM, DEVICES, Disturbance, LASTS_MAX, Plan, What};
use crate::stand_in::StandIn;
use crate::traffic::{Device, PERIOD};

/// Time between two batches of the sources.
const SLICE: Duration = Duration::from_millis(20);
/// Time after which a supervisor starts the program again.
const RESTART_AFTER: Duration = Duration::from_secs(1);
/// A bus-off, as the kernel reports it: its class, and that of a restarted controller.
const BUS_OFF: u32 = 0x40;

/// Length of a shortened frame, bytes.
const SHORT: usize = 3;
/// Identifier of a device that nobody watches.
const FOREIGN: u32 = 0x7FE;

/// One window as it was reported.
#[derive(Clone, Debug)]
pub(crate) struct Reported {
    /// Run of the program.
    pub run: usize,
    /// Its records were said to be on the disk.
    pub stored: bool,
    /// When.
    pub at: Duration,
    /// What.
    pub health: Health,
}

/// What was given to one run of the program.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Given {
    /// Frames.
    pub frames: u64,
    /// Of them those that are shorter than their kind.
    pub malformed: u64,
    /// Frames with another bit, which may make them impossible.
    pub flipped: u64,
    /// Of them error frames.
    pub errors: u64,
    /// Frames that the kernel dropped and counted.
    pub overflown: u64,
    /// Samples sent from the first whole one of their actuator to the last; frames of those between may be missing.
    pub samples: u64,
    /// Times that an actuator began anew.
    pub resets: u64,
}

/// One run of the program.
#[derive(Clone, Debug)]
pub(crate) struct RunFacts {
    /// Its configuration.
    pub config: Arc<Config>,
    /// When it ended.
    pub ended: Duration,
    /// Its last words, if it had any.
    pub status: Option<Status>,
    /// Frames not stored, as last known.
    pub lost_frames: u64,
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
    pub(crate) rotten: Vec<String>,
    pub(crate) events: Vec<Event>,
    pub(crate) violations: Vec<String>,
    rng: ChaCha8Rng,
    devices: Vec<(u16, Device)>,
    buses: [Bus; BUSES as usize],
    /// When each tick of this run was given, and when it was taken.
    ticks: Vec<(Duration, Duration)>,
    /// Actuators that brought a whole sample in this run of the program.
    heard: [bool; BUSES as usize * DEVICES as usize],
    /// Samples of each actuator since its last whole one: nothing tells the program of them if none follows.
    unconfirmed: [u64; BUSES as usize * DEVICES as usize],
    /// Up to when the devices have sent.
    sampled: Duration,
    next: usize,
    calms_disk: Duration,
    stalled: Duration,
    /// When the run ends: a slow disk delays disturbances, and the calm comes after them all.
    pub(crate) until: Duration,
    persistence: u32,
    budget_mib: u32,
}

#[derive(Clone, Copy, Default)]
struct Bus {
    silent: Duration,
    /// Comes back from what made it silent by a link.
    link_down: bool,
    drop: u32,
    overflow: u32,
    overflown: u64,
    flip: u32,
    shorten: u32,
    foreign: u32,
    repeat: u32,
    swap: u32,
    jitter: Duration,
    last_stamp: u64,
    /// When it brought a frame last.
    heard: Duration,
}

/// Clock and observer of a world, which the program borrows.
pub(crate) struct Host {
    pub(crate) clock: WorldClock,
    disk: WorldDisk,
    run: AtomicUsize,
    pub(crate) reported: Mutex<Vec<Reported>>,
    notices: Mutex<Vec<String>>,
}

impl Host {
    fn report(&self, assessed: &AssessedWindow, stored: bool) {
        if self.disk.is_dead() {
            return;
        }
        let mut reported = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        reported.push(Reported {
            run: self.run.load(Relaxed),
            stored,
            at: self.clock.now(),
            health: assessed.health.clone(),
        });
        drop(reported);
        let health = &assessed.health;
        self.notice(&format!(
            "{}: window {}{}: {}, {}; {}",
            health.actuator,
            health.window,
            if stored { "" } else { ", not stored" },
            health.status,
            health.health,
            health.reason
        ));
    }
}

impl Observer for Host {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.report(assessed, true);
        Ok(())
    }

    fn assessed_unstored(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.report(assessed, false);
        Ok(())
    }

    fn notice(&self, message: &str) {
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        let at = self.clock.now().as_secs_f64();
        notices.push(format!("{at:8.3} s  {message}"));
    }
}

/// How a run of the program ended.
enum End {
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
        rotten: Vec::new(),
        events: Vec::new(),
        violations: Vec::new(),
        devices,
        buses: [Bus::default(); BUSES as usize],
        ticks: Vec::new(),
        heard: Default::default(),
        unconfirmed: Default::default(),
        sampled: Duration::ZERO,
        next: 0,
        calms_disk: Duration::ZERO,
        stalled: Duration::ZERO,
        until: plan.length,
        persistence: rng.random_range(2..=3),
        // In some worlds room is scarce; in the others everything is kept, and replayed.
        budget_mib: if rng.random_bool(0.3) { 6 } else { 64 },
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

    fn write_config(&mut self) -> anyhow::Result<()> {
        fs::write(self.config_path(), self.config_text()).context("configuration")
    }

    fn config_text(&self) -> String {
        let mut text = format!(
            "[type.slow]\nbased_on = \"bench\"\ntolerances = \"exact\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
             [health]\npersistence = {}\n[output]\nsegment_mib = 1\nsegment_age_s = 10\ndisk_budget_mib = {}\n\
             disk_free_min_mib = 1\n[rul]\nevents = \"events.jsonl\"\n",
            self.persistence, self.budget_mib
        );
        for (bus, device) in (0..BUSES).flat_map(|bus| (0..DEVICES).map(move |device| (bus, device))) {
            let name = actuator(bus, device);
            text += &format!("[[actuator]]\nid = {device}\nname = \"{name}\"\nbus = \"can{bus}\"\ntype = \"slow\"\n");
        }
        text
    }

    /// One run of the program.
    fn one_run(&mut self, host: &Host, config: Arc<Config>, reopens: bool) -> anyhow::Result<End> {
        let clock = &host.clock;
        host.run.store(self.runs.len(), Relaxed);
        self.disk.begin_run(self.runs.len());
        self.heard = Default::default();
        self.unconfirmed = Default::default();
        self.runs.push(RunFacts {
            config: config.clone(),
            ended: clock.now(),
            status: None,
            lost_frames: 0,
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
        let mut ticked = clock.now();
        self.ticks.clear();
        let end = loop {
            if let Some(end) = self.disturb(host, &mut inputs)? {
                break end;
            }
            if clock.now() >= self.until {
                break End::Over;
            }
            clock.advance(SLICE);
            self.send(host, &mut inputs);
            let mut given = None;
            while clock.now() >= ticked {
                ticked += Duration::from_secs(1);
                inputs.push(Input::Tick {
                    stamp_ns: clock.utc_ns(),
                });
                self.look(&steps.status());
                given = Some(clock.now());
            }
            let mut failed = steps.take(&mut inputs).err();
            self.ticks.extend(given.map(|given| (given, clock.now())));
            while failed.is_none() && clock.now() >= self.stalled {
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
            match taken.and_then(|()| steps.finish()) {
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
    fn look(&mut self, status: &Status) {
        if self.disk.is_dead() {
            return;
        }
        if let Some(facts) = self.runs.last_mut() {
            facts.lost_frames = status.lost_storage_frames;
            let limits = facts.config.output().limits();
            // Of each kind, the segment in progress grows until the next tick.
            let most = limits.budget_bytes + 2 * limits.segment_bytes;
            if self.disk.mood() == Mood::Works && status.storage_used_bytes > most {
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

    fn calm_disk(&self, now: Duration) {
        if now >= self.calms_disk {
            self.disk.set_mood(Mood::Works);
        }
    }

    /// Begins what is due. How the run ends by it, if it does.
    fn disturb(&mut self, host: &Host, inputs: &mut Vec<Input>) -> anyhow::Result<Option<End>> {
        let now = host.clock.now();
        self.calm_disk(now);
        for (bus, state) in (0..).zip(&mut self.buses) {
            if state.silent != Duration::ZERO && now >= state.silent {
                state.silent = Duration::ZERO;
                if std::mem::take(&mut state.link_down) {
                    inputs.push(link(bus, &host.clock, LinkState::Up));
                }
            }
        }
        while let Some(Disturbance { what, .. }) = self.plan.disturbances.get(self.next).filter(|next| next.at <= now) {
            let what = what.clone();
            self.next += 1;
            self.until = self.until.max(now + LASTS_MAX + CALM);
            if let Some(end) = self.begin(&what, host, inputs)? {
                return Ok(Some(end));
            }
        }
        Ok(None)
    }

    fn begin(&mut self, what: &What, host: &Host, inputs: &mut Vec<Input>) -> anyhow::Result<Option<End>> {
        let now = host.clock.now();
        match *what {
            What::Drop(bus, frames) => self.buses[usize::from(bus)].drop += frames,
            What::Overflow(bus, frames) => self.buses[usize::from(bus)].overflow += frames,
            What::Flip(bus) => self.buses[usize::from(bus)].flip += 1,
            What::Shorten(bus) => self.buses[usize::from(bus)].shorten += 1,
            What::Foreign(bus) => self.buses[usize::from(bus)].foreign += 1,
            What::Repeat(bus) => self.buses[usize::from(bus)].repeat += 1,
            What::Swap(bus) => self.buses[usize::from(bus)].swap += 1,
            What::Jitter(bus, lasts) => self.buses[usize::from(bus)].jitter = now + lasts,
            What::BusOff(bus, lasts) => {
                self.buses[usize::from(bus)].silent = now + lasts;
                if let Ok(frame) = RawFrame::new(host.clock.utc_ns(), bus, BUS_OFF, FrameFlags::ERROR, &[0; 8]) {
                    self.give(Input::Frame(frame), inputs);
                }
            }
            What::LinkDown(bus, lasts) => {
                let state = &mut self.buses[usize::from(bus)];
                (state.silent, state.link_down) = (now + lasts, true);
                inputs.push(link(bus, &host.clock, LinkState::Down));
            }
            What::Reset(bus, device) => {
                let index = usize::from(bus) * usize::from(DEVICES) + usize::from(device);
                self.devices[index].1.reset();
                if let Some(facts) = self.runs.last_mut() {
                    facts.given.resets += 1;
                }
            }
            What::Disk(mood, lasts) => {
                self.disk.set_mood(mood);
                self.calms_disk = now + lasts;
            }
            What::Rot => {
                let names = self.disk.names();
                let closed: Vec<&String> = names.iter().filter(|name| name.ends_with(".mcap")).collect();
                if !closed.is_empty() {
                    let name = closed[self.rng.random_range(0..closed.len())].clone();
                    self.disk.rot(&name, &mut self.rng)?;
                    self.rotten.push(name);
                }
            }
            What::PowerCut(operations) => self.disk.power_fails_after(operations),
            What::Kill => return Ok(Some(End::Died)),
            What::Step(ms) => {
                host.clock.step(ms * 1_000_000);
                self.buses.iter_mut().for_each(|bus| bus.last_stamp = 0);
            }
            What::ReloadGood => {
                self.persistence = 5 - self.persistence;
                self.write_config()?;
                return self.reload();
            }
            What::ReloadBad => {
                // Nothing but this value is wrong with it.
                let good = format!("persistence = {}\n", self.persistence);
                let bad = self.config_text().replace(&good, "persistence = 0\n");
                fs::write(self.config_path(), bad).context("configuration")?;
                return self.reload();
            }
            What::ReloadAbsent => {
                fs::remove_file(self.config_path()).context("configuration")?;
                return self.reload();
            }
            What::Restart => return Ok(Some(End::Restart)),
            What::Stall(lasts) => {
                self.stalled = now + lasts;
                self.until = self.until.max(self.stalled + CALM);
            }
            What::Maintenance(bus, device) => {
                let event = Event {
                    t_ns: host.clock.utc_ns(),
                    actuator: actuator(bus, device),
                    event: EventKind::Reset,
                    note: None,
                };
                event_file::append(&self.root.path().join("events.jsonl"), &event)?;
                self.events.push(event);
            }
        }
        Ok(None)
    }

    /// `SIGHUP`: the program's own decision.
    fn reload(&mut self) -> anyhow::Result<Option<End>> {
        let loaded = load(&self.config_path(), &[]);
        let is_good = fs::read_to_string(self.config_path()).is_ok_and(|text| text == self.config_text());
        if loaded.is_ok() != is_good {
            self.violations.push(format!(
                "a configuration was taken: {}, and is good: {is_good}",
                loaded.is_ok()
            ));
        }
        self.write_config()?;
        Ok(loaded.ok().map(End::Reload))
    }

    /// What the devices send until now.
    fn send(&mut self, host: &Host, inputs: &mut Vec<Input>) {
        let now = host.clock.now();
        let mut frames = Vec::new();
        while self.sampled + PERIOD <= now {
            self.sampled += PERIOD;
            let mut stamps = [host.clock.utc_at(self.sampled); BUSES as usize];
            for index in 0..self.devices.len() {
                let (bus, device) = &mut self.devices[index];
                let bus = *bus;
                frames.clear();
                device.next_sample(&mut stamps[usize::from(bus)], &mut self.rng, &mut frames);
                if self.buses[usize::from(bus)].silent == Duration::ZERO {
                    let is_whole = self.carry(bus, &mut frames, inputs);
                    self.heard[index] |= is_whole;
                    self.unconfirmed[index] += u64::from(self.heard[index]);
                    if let Some(facts) = self.runs.last_mut().filter(|_| is_whole) {
                        facts.given.samples += std::mem::take(&mut self.unconfirmed[index]);
                    }
                }
            }
        }
    }

    /// Frames of a sample go over their bus. Whether they all arrive as they were sent.
    fn carry(&mut self, bus: u16, frames: &mut [RawFrame], inputs: &mut Vec<Input>) -> bool {
        let number = bus;
        let mut bus = self.buses[usize::from(bus)];
        let spoilt = |bus: &Bus| bus.drop + bus.overflow + bus.flip + bus.shorten;
        let spoilt_before = spoilt(&bus);
        if bus.swap > 0 && frames.len() > 1 {
            bus.swap -= 1;
            frames.swap(0, 1);
        }
        for frame in frames {
            let mut frame = frame.with_bus(number);
            if self.sampled < bus.jitter {
                frame.stamp_ns += self.rng.random_range(0..4_000_000);
            }
            frame.stamp_ns = frame.stamp_ns.max(bus.last_stamp);
            bus.last_stamp = frame.stamp_ns;
            if bus.drop > 0 {
                bus.drop -= 1;
                continue;
            }
            if bus.overflow > 0 {
                bus.overflow -= 1;
                bus.overflown += 1;
                continue;
            }
            if bus.overflown > 0 {
                // As the kernel tells it: with the next frame that it has room for.
                let lost = Input::Lost {
                    bus: number,
                    loss: LiveLoss::SocketQueue,
                    frames: std::mem::take(&mut bus.overflown),
                };
                self.give(lost, inputs);
            }
            let stamp_ns = frame.stamp_ns;
            let made = |id, data: &[u8]| RawFrame::new(stamp_ns, number, id, FrameFlags::NONE, data);
            let is_sample = frame.data().len() == 8;
            if bus.flip > 0 && is_sample {
                bus.flip -= 1;
                let mut data = frame.data().to_vec();
                data[self.rng.random_range(0..8)] ^= 1 << self.rng.random_range(0..8);
                frame = made(frame.id(), &data).unwrap_or(frame);
                if let Some(facts) = self.runs.last_mut() {
                    facts.given.flipped += 1;
                }
            } else if bus.shorten > 0 && is_sample {
                bus.shorten -= 1;
                frame = made(frame.id(), &frame.data()[..SHORT]).unwrap_or(frame);
            }
            if bus.foreign > 0 {
                bus.foreign -= 1;
                if let Ok(foreign) = made(FOREIGN, &[1, 2, 3]) {
                    self.give(Input::Frame(foreign), inputs);
                }
            }
            self.give(Input::Frame(frame), inputs);
            bus.heard = self.sampled;
            if bus.repeat > 0 {
                bus.repeat -= 1;
                self.give(Input::Frame(frame), inputs);
            }
        }
        self.buses[usize::from(number)] = bus;
        spoilt(&bus) == spoilt_before
    }

    fn give(&mut self, input: Input, inputs: &mut Vec<Input>) {
        if let Some(facts) = self.runs.last_mut() {
            match &input {
                Input::Frame(frame) => {
                    facts.given.frames += 1;
                    facts.given.errors += u64::from(frame.is_error());
                    let is_short = frame.data().len() == SHORT && frame.id() != FOREIGN;
                    facts.given.malformed += u64::from(is_short);
                }
                Input::Lost { frames, .. } => facts.given.overflown += frames,
                Input::Link { .. } | Input::Tick { .. } => {}
            }
        }
        inputs.push(input);
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

fn link(bus: u16, clock: &WorldClock, state: LinkState) -> Input {
    Input::Link {
        bus,
        stamp_ns: clock.utc_ns(),
        state,
        cause: None,
    }
}

/// Name of an actuator.
pub(crate) fn actuator(bus: u16, device: u8) -> String {
    format!("ema{}", bus * u16::from(DEVICES) + u16::from(device))
}
