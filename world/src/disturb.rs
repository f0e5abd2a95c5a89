//! Disturbances of a [`World`]: each begins at its time, and may end the run of the program.

use std::fs;
use std::time::Duration;

use anyhow::Context;
use hmd::commands::run::load;
use hmd::daemon::HostClock;
use hmd_core::deadline::Clock;
use hmd_core::frame::{FrameFlags, RawFrame};
use hmd_core::history::{Event, EventKind};
use hmd_ingest::feed::{Input, LinkState};
use hmd_storage::event_file;
use rand::RngExt;

use crate::disk::Mood;
use crate::host::Host;
use crate::plan::{BUSES, CALM, DEVICES, Disturbance, LASTS_MAX, What};
use crate::run::{End, World, actuator, link, place};
use crate::segment::read_messages;

/// A bus-off, as the kernel reports it: its class, and that of a restarted controller.
const BUS_OFF: u32 = 0x40;

impl World {
    /// Ends a disturbance of the disk that is over.
    pub(crate) fn calm_disk(&mut self, now: Duration) {
        if now >= self.calms_disk && self.disk.mood() != Mood::Works {
            self.disk.set_mood(Mood::Works);
            self.works_since = now;
        }
    }

    /// Begins what is due. How the run ends by it, if it does.
    pub(crate) fn disturb(&mut self, host: &Host, inputs: &mut Vec<Input>) -> anyhow::Result<Option<End>> {
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
                let frame = RawFrame::new(host.clock.utc_ns(), bus, BUS_OFF, FrameFlags::ERROR, &[0; 8]);
                if let (Ok(frame), Some(facts)) = (frame, self.runs.last_mut()) {
                    facts.given.give(Input::Frame(frame), inputs);
                }
            }
            What::LinkDown(bus, lasts) => {
                let state = &mut self.buses[usize::from(bus)];
                (state.silent, state.link_down) = (now + lasts, true);
                inputs.push(link(bus, &host.clock, LinkState::Down));
            }
            What::Reset(bus, device) => {
                let index = place(bus, device);
                self.devices[index].1.reset();
                if let Some(facts) = self.runs.last_mut() {
                    facts.given.resets += 1;
                    facts.given.counts_back[index] = true;
                }
            }
            What::Disk(mood, lasts) => {
                self.disk.set_mood(mood);
                self.calms_disk = now + lasts;
                self.until = self.until.max(self.calms_disk + CALM);
            }
            What::Rot => {
                let names = self.disk.names();
                let closed: Vec<&String> = names.iter().filter(|name| name.ends_with(".mcap")).collect();
                if !closed.is_empty() {
                    let name = closed[self.rng.random_range(0..closed.len())].clone();
                    self.before_rot
                        .entry(name.clone())
                        .or_insert(read_messages(&self.store.join(&name)));
                    self.disk.rot(&name, &mut self.rng)?;
                }
            }
            What::PowerCut(operations) => self.disk.power_fails_after(operations),
            What::PowerCutTwice(changes) => {
                self.disk.power_fails_now();
                self.cuts_start = Some(changes);
                return Ok(Some(End::Died));
            }
            What::Kill => return Ok(Some(End::Died)),
            What::Step(ms) => {
                host.clock.step(ms * 1_000_000);
                self.stepped = self.stepped.map(|by| by + Duration::from_millis(ms.unsigned_abs()));
                self.buses.iter_mut().for_each(|bus| bus.last_stamp = 0);
            }
            What::ReloadGood => {
                self.persistence = 5 - self.persistence;
                self.write_config()?;
                return self.reload();
            }
            What::ReloadBad => {
                // Nothing but this value is wrong with it.
                fs::write(self.config_path(), self.config_text(0)).context("configuration")?;
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
                    part: None,
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
        let is_good =
            fs::read_to_string(self.config_path()).is_ok_and(|text| text == self.config_text(self.persistence));
        if loaded.is_ok() != is_good {
            self.violations.push(format!(
                "a configuration was taken: {}, and is good: {is_good}",
                loaded.is_ok()
            ));
        }
        self.write_config()?;
        Ok(loaded.ok().map(End::Reload))
    }

    /// Writes the good configuration.
    pub(crate) fn write_config(&self) -> anyhow::Result<()> {
        fs::write(self.config_path(), self.config_text(self.persistence)).context("configuration")
    }

    /// The configuration, with this persistence.
    fn config_text(&self, persistence: u32) -> String {
        let mut text = format!(
            "[type.slow]\nbased_on = \"bench\"\ntolerances = \"exact\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
             [health]\npersistence = {}\n[output]\nraw_frames = {}\nsegment_mib = 1\nsegment_age_s = 10\ndisk_budget_mib = {}\n\
             disk_free_min_mib = 1\n[rul]\nevents = \"events.jsonl\"\n",
            persistence,
            !self.plan.captures(),
            self.budget_mib
        );
        for (bus, device) in (0..BUSES).flat_map(|bus| (0..DEVICES).map(move |device| (bus, device))) {
            let name = actuator(bus, device);
            text += &format!("[[actuator]]\nid = {device}\nname = \"{name}\"\nbus = \"can{bus}\"\ntype = \"slow\"\n");
        }
        text
    }
}
