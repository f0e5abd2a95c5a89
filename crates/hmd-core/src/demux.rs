//! Routes the frames of all buses to the streams of their actuators, and counts what becomes of each frame.
//!
//! Goes in: raw frames of CAN buses and serial lines. They are decoded by the built-in dictionary of `ema_wire`, or by the
//! signal map of an actuator where one is configured. Comes out, through an [`Outbox`]: the windows, notices and samples of
//! the [`ActuatorStream`]s. CPU-light and bounded, without I/O.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ema_wire::{ActuatorId, DeframerStats, Frame, Message, SampleFd, SerialPacket};

use crate::actuator_stream::{ActuatorStream, StreamCounts};
use crate::config::{ActuatorConfig, Config};
use crate::dbc::MappedBus;
use crate::drive_bus::DriveJoiner;
use crate::frame::{BusNames, RawFrame};
use crate::history::RunEnd;
use crate::outbox::{AssembledSample, Notice, Outbox, WindowJob};
use crate::talker::Talker;

/// Frames in, by what became of them. `received = decoded + filtered + error + malformed + unreadable`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// All frames.
    pub received: u64,
    /// Frames of a monitored actuator that were understood.
    pub decoded: u64,
    /// Frames of no monitored actuator.
    pub filtered: u64,
    /// Error frames of the bus.
    pub error: u64,
    /// Frames with an identifier of ours whose content is impossible.
    pub malformed: u64,
    /// Frames of serial lines that are no packets.
    pub unreadable: u64,
    /// Of the decoded ones: frames with currents.
    pub currents: u64,
    /// Frames with counts.
    pub position: u64,
    /// Frames with setpoint and mode.
    pub command: u64,
}

/// Routes frames to the streams of their actuators.
#[derive(Debug)]
pub struct Demux {
    config: Arc<Config>,
    /// The actuators seen so far; at most 16 on each of at most 64 interfaces.
    streams: BTreeMap<(u16, ActuatorId), NamedStream>,
    /// Whether any actuator has a map; then, for each bus seen, those that have.
    any_mapped: bool,
    any_drive: bool,
    mapped: BTreeMap<u16, Option<MappedBus>>,
    /// The same of drives.
    drives: BTreeMap<u16, Vec<(ActuatorId, DriveJoiner)>>,
    counts: FrameCounts,
    /// Stamp of the newest frame.
    last_ns: u64,
    /// Packets of each serial line, by what became of them.
    serial: BTreeMap<u16, DeframerStats>,
    /// Those who talk on a bus without a stream there; at most as many as there are numbers.
    talkers: BTreeSet<(u16, Talker)>,
    outbox: Outbox,
}

/// The stream of one actuator on one interface.
#[derive(Debug)]
struct NamedStream {
    /// Name of the interface.
    bus: Box<str>,
    stream: ActuatorStream,
}

impl Demux {
    /// For the actuators of a configuration.
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        Self {
            any_mapped: config.actuators().iter().any(|actuator| actuator.map.is_some()),
            any_drive: config.actuators().iter().any(|actuator| actuator.drive_bus.is_some()),
            config,
            streams: BTreeMap::new(),
            mapped: BTreeMap::new(),
            drives: BTreeMap::new(),
            counts: FrameCounts::default(),
            last_ns: 0,
            serial: BTreeMap::new(),
            talkers: BTreeSet::new(),
            outbox: Outbox::default(),
        }
    }

    /// The same, collecting every sample until [`Demux::take_samples`]; the caller bounds them by taking them.
    #[must_use]
    pub fn collecting_samples(mut self) -> Self {
        self.outbox = Outbox::collecting_samples();
        self
    }

    /// Routes one frame. The windows that it ends wait for [`Demux::take_windows`].
    pub fn push(&mut self, frame: &RawFrame, names: &BusNames) {
        self.counts.received += 1;
        self.last_ns = frame.stamp_ns;
        if frame.is_error() {
            self.counts.error += 1;
            return;
        }
        let has_drives = self.any_drive && !frame.is_serial();
        if has_drives && self.push_of_drive(frame, names) {
            return;
        }
        let decoded = self.counts.decoded;
        self.push_of_device(frame, names);
        if has_drives && self.counts.decoded == decoded {
            for (_, joiner) in self.drives.get_mut(&frame.bus).into_iter().flatten() {
                joiner.hear_other(frame);
            }
        }
    }

    /// Routes a frame by the maps of its bus, or by the built-in dictionary.
    fn push_of_device(&mut self, frame: &RawFrame, names: &BusNames) {
        if self.any_mapped && !frame.is_serial() && self.push_mapped(frame, names) {
            return;
        }
        let parsed = if frame.is_serial() {
            self.parse_serial(frame)
        } else {
            self.parse_can(frame, names.name(frame.bus).unwrap_or(""))
        };
        let Some((actuator, parsed)) = parsed else {
            return;
        };
        let key = (frame.bus, actuator);
        if !self.streams.contains_key(&key) {
            let bus = names.name(frame.bus).unwrap_or("");
            let Some(stream) = NamedStream::new(&self.config, bus, actuator) else {
                self.counts.filtered += 1;
                self.talkers.insert((frame.bus, Talker::Actuator(actuator)));
                return;
            };
            self.streams.insert(key, stream);
        }
        self.counts.decoded += 1;
        match parsed {
            Frame::Currents(_) => self.counts.currents += 1,
            Frame::Position(_) => self.counts.position += 1,
            Frame::Command(_) => self.counts.command += 1,
            Frame::SampleFd(_) | Frame::Status(_) => {}
        }
        if let Some(NamedStream { stream, .. }) = self.streams.get_mut(&key) {
            stream.push(&parsed, frame.stamp_ns, &mut self.outbox);
        }
    }

    /// Routes a frame that a drive sends or is sent; false if it is of none.
    fn push_of_drive(&mut self, frame: &RawFrame, names: &BusNames) -> bool {
        let Self {
            config,
            streams,
            drives,
            counts,
            talkers,
            outbox,
            ..
        } = self;
        let bus = names.name(frame.bus).unwrap_or("");
        let drives = drives.entry(frame.bus).or_insert_with(|| config.drives(bus).collect());
        let hearers = drives
            .iter_mut()
            .filter_map(|(_, joiner)| joiner.push_broadcast(frame).then_some(()));
        if hearers.count() > 0 {
            counts.decoded += 1;
            return true;
        }
        let updates = drives.iter_mut().find_map(|(id, joiner)| {
            let update = joiner.push(frame)?;
            Some((*id, joiner, update))
        });
        let Some((id, joiner, update)) = updates else {
            let nodes = drives.iter().filter_map(|(_, joiner)| joiner.node_of(frame));
            talkers.extend(nodes.map(|(preset, node)| (frame.bus, Talker::Node(preset, node))));
            return false;
        };
        let Some(update) = update else {
            counts.malformed += 1;
            return true;
        };
        counts.decoded += 1;
        let Ok(map) = joiner.map() else {
            let (preset, node) = joiner.node();
            talkers.insert((frame.bus, Talker::Node(preset, node)));
            return true;
        };
        let named = match streams.entry((frame.bus, id)) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => match NamedStream::new(config, bus, id) {
                Some(stream) => place.insert(stream),
                None => return true,
            },
        };
        named.stream.remap(map, frame.stamp_ns, outbox);
        named.stream.push_update(&update, outbox);
        true
    }

    /// Routes a frame of a bus with mapped actuators; false if the built-in dictionary is to decode it.
    fn push_mapped(&mut self, frame: &RawFrame, names: &BusNames) -> bool {
        let Self {
            config,
            streams,
            mapped,
            counts,
            outbox,
            ..
        } = self;
        let bus = names.name(frame.bus).unwrap_or("");
        let Some(mapped) = mapped
            .entry(frame.bus)
            .or_insert_with(|| MappedBus::new(config.mapped_actuators(bus)))
        else {
            return false;
        };
        let mut understood = false;
        let used = mapped.push(frame, |id, update| {
            let Some(update) = update else { return };
            let named = match streams.entry((frame.bus, id)) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(place) => match NamedStream::new(config, bus, id) {
                    Some(stream) => place.insert(stream),
                    None => return,
                },
            };
            understood = true;
            named.stream.push_update(&update, outbox);
        });
        if used {
            *(if understood {
                &mut counts.decoded
            } else {
                &mut counts.malformed
            }) += 1;
            return true;
        }
        let ours = u16::try_from(frame.id()).ok().and_then(Message::from_id);
        let watched = ours.is_some_and(|(id, _)| !mapped.has(id) && config.actuator_for(bus, id).is_some());
        counts.filtered += u64::from(!watched);
        !watched
    }

    /// The frame of the built-in dictionary, and of which actuator; none of one that has frames of its own, whatever its number.
    fn parse_can(&mut self, frame: &RawFrame, bus: &str) -> Option<(ActuatorId, Frame)> {
        let id = u16::try_from(frame.id())
            .ok()
            .filter(|_| !frame.is_extended() && !frame.is_remote());
        let configured = |actuator| self.config.actuator_for(bus, actuator);
        let has_own = |of: &ActuatorConfig| of.drive_bus.is_some() || of.map.is_some();
        match id.map(|id| (Frame::parse(id, frame.data()), Message::from_id(id))) {
            Some((Ok(Some(ours)), _)) if !configured(ours.0).is_some_and(has_own) => Some(ours),
            Some((Err(_), Some((actuator, _)))) if configured(actuator).is_some_and(|of| !has_own(of)) => {
                self.counts.malformed += 1;
                None
            }
            _ => {
                self.counts.filtered += 1;
                None
            }
        }
    }

    /// The packet of a serial line, as a frame, and of which actuator. A sample there is whole, as in CAN FD.
    fn parse_serial(&mut self, frame: &RawFrame) -> Option<(ActuatorId, Frame)> {
        let packet = SerialPacket::parse(frame.data());
        self.serial.entry(frame.bus).or_default().count(&packet);
        match packet {
            Ok(SerialPacket::Sample(sample)) => {
                let one = SampleFd::from_samples(&[sample]).ok()?;
                Some((sample.actuator, Frame::SampleFd(one)))
            }
            Ok(SerialPacket::Status { actuator, status }) => Some((actuator, Frame::Status(status))),
            Err(_) => {
                self.counts.unreadable += 1;
                None
            }
        }
    }

    /// End of the traffic: ends every open window, in the order of interface names and numbers. (The index of an
    /// interface depends on the source: in its order, a live run and a replay would differ.)
    pub fn finish(&mut self) {
        let waiting = self.drives.values().flatten().filter_map(|(_, joiner)| {
            let (expected, found) = joiner.lacking()?;
            let name = joiner.name();
            Some(format!("{name}: not monitored: expected {expected}, found {found}"))
        });
        let mut waiting: Vec<String> = waiting.collect();
        waiting.sort_unstable();
        for notice in waiting {
            self.outbox.push_notice(self.last_ns, notice);
        }
        let mut streams: Vec<_> = self.streams.iter_mut().collect();
        streams.sort_by(|((_, a), x), ((_, b), y)| (&x.bus, a).cmp(&(&y.bus, b)));
        for (_, NamedStream { stream, .. }) in streams {
            stream.finish(&mut self.outbox);
        }
    }

    /// The frames that come are of another recording. To be called after [`Demux::finish`].
    pub fn begin_recording(&mut self) {
        for joiner in self.drives.values_mut().flatten() {
            joiner.1.begin_recording();
        }
        for mapped in self.mapped.values_mut().flatten() {
            mapped.begin_recording();
        }
        for named in self.streams.values_mut() {
            named.stream.begin_recording();
        }
    }

    /// The frames that come are of another log, which may be of another time. To be called after [`Demux::finish`].
    pub fn begin_log(&mut self) {
        for named in self.streams.values_mut() {
            named.stream.begin_log();
        }
    }

    /// Windows ended since the last call.
    pub fn take_windows(&mut self) -> Vec<WindowJob> {
        self.outbox.take_windows()
    }

    /// Samples since the last call, if they are collected.
    pub fn take_samples(&mut self) -> Vec<AssembledSample> {
        self.outbox.take_samples()
    }

    /// Notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        self.outbox.take_notices()
    }

    /// Frames so far.
    #[must_use]
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// Packets of each serial line by what became of them, by the index of the line.
    pub fn serial(&self) -> impl Iterator<Item = (u16, DeframerStats)> {
        self.serial.iter().map(|(&bus, &stats)| (bus, stats))
    }

    /// Those who talk on a bus, by its index, and of whom nothing is used.
    pub fn talkers(&self) -> impl Iterator<Item = (u16, Talker)> {
        self.talkers.iter().copied()
    }

    /// Names of the actuators seen so far, with the number of samples delivered, and what became of others.
    pub fn actuators(&self) -> impl Iterator<Item = (&str, u64, StreamCounts)> {
        self.streams
            .values()
            .map(|NamedStream { stream, .. }| (stream.name(), stream.stats().samples, stream.counts()))
    }

    /// Names of the actuators seen so far, with what they have shown.
    pub fn run_ends(&self) -> impl Iterator<Item = (&str, RunEnd)> {
        let streams = self.streams.values();
        streams.map(|NamedStream { stream, .. }| (stream.name(), stream.run_end()))
    }

    /// Names of the actuators seen so far, with their frames dropped because a newer sample had begun.
    pub fn late(&self) -> impl Iterator<Item = (&str, u64)> {
        self.streams.iter().map(|((bus, id), NamedStream { stream, .. })| {
            let mapped = self.mapped.get(bus).and_then(Option::as_ref);
            let joined = mapped.map_or(0, |mapped| mapped.late_of(*id));
            (stream.name(), joined + stream.stats().late)
        })
    }
}

impl NamedStream {
    /// `None` if this actuator is not monitored.
    fn new(config: &Config, bus: &str, id: ActuatorId) -> Option<Self> {
        let actuator = Arc::new(config.actuator_for(bus, id)?.clone());
        Some(Self {
            bus: bus.into(),
            stream: ActuatorStream::new(actuator, config),
        })
    }
}
