//! From frames to windows: decoding, sample assembly and windowing of every actuator. Cheap, bounded, without I/O.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use ema_models::{ActuatorParams, Setpoint};
use ema_wire::{ActuatorId, DeframerStats, Frame, Message, SampleFd, SerialPacket};

use crate::channel::{Channel, MeasuredConditions, SampleRate};
use crate::config::{ActuatorConfig, Config};
use crate::dbc::{Heard, MappedBus, Role};
use crate::frame::{BusNames, RawFrame};
use crate::window::{TimedSample, Window, Windower};

/// A rate that a device's clock tells and that is this near, as a share, to one of whole control periods is that one.
const RATE_ROUNDING: f64 = 0.002;

/// One cut window and whose it is.
#[derive(Clone, Debug)]
pub struct WindowJob {
    /// The actuator.
    pub actuator: Arc<ActuatorConfig>,
    /// Its parameters, with the sample rate that was measured.
    pub params: ActuatorParams,
    /// The samples and what is wrong with them.
    pub window: Window,
    /// What the status frames said when it ended.
    pub conditions: MeasuredConditions,
    /// How long the actuator has been operating, with a mode other than idle, since its first frame; s. Missing samples
    /// do not count.
    pub operating_s: f64,
}

/// One sample as it was taken in.
#[derive(Clone, Debug)]
pub struct TakenSample {
    /// The actuator.
    pub actuator: Arc<ActuatorConfig>,
    /// Rate of its samples.
    pub rate: SampleRate,
    /// The sample.
    pub sample: TimedSample,
    /// What the status frames last said.
    pub conditions: MeasuredConditions,
}

/// Something an operator should read; goes into the log topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// Stamp of the frame that led to it, ns.
    pub stamp_ns: u64,
    /// One sentence.
    pub message: String,
}

/// Frames in, by what became of them. `received = decoded + filtered + error + malformed + unreadable`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// All frames.
    pub received: u64,
    /// Frames of a monitored actuator that were understood.
    pub decoded: u64,
    /// Frames that belong to nobody we watch.
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

/// Decodes and cuts the traffic of all actuators.
#[derive(Debug)]
pub struct Front {
    config: Arc<Config>,
    lanes: BTreeMap<(u16, ActuatorId), Lane>,
    /// Whether any actuator has a map; then, for each bus seen, those that have.
    any_mapped: bool,
    mapped: BTreeMap<u16, Option<MappedBus>>,
    counts: FrameCounts,
    /// What came of the frames of each serial line.
    serial: BTreeMap<u16, DeframerStats>,
    notices: Vec<Notice>,
    /// Whether samples are kept to be taken.
    keeps: bool,
}

/// One actuator. There are at most 16 on each of at most 64 interfaces.
#[derive(Debug)]
struct Lane {
    /// Name of the interface.
    bus: Box<str>,
    actuator: Arc<ActuatorConfig>,
    channel: Channel,
    cutter: Cutter,
    /// Samples since they were last taken, if they are kept.
    kept: Option<Vec<TakenSample>>,
}

/// Made when the sample rate is known.
#[derive(Debug)]
enum Cutter {
    Waiting,
    Ready {
        params: Box<ActuatorParams>,
        windower: Box<Windower>,
        /// Samples with a mode other than idle.
        operating: u64,
    },
    /// Not monitored; the samples dropped since.
    Refused(u64),
}

impl Front {
    /// For the actuators of a configuration.
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        Self {
            any_mapped: config.actuators().iter().any(|actuator| actuator.map.is_some()),
            config,
            lanes: BTreeMap::new(),
            mapped: BTreeMap::new(),
            counts: FrameCounts::default(),
            serial: BTreeMap::new(),
            notices: Vec::new(),
            keeps: false,
        }
    }

    /// The same, keeping every sample until [`Front::take_samples`]: whoever asks for them also bounds them.
    #[must_use]
    pub fn keeping_samples(mut self) -> Self {
        self.keeps = true;
        self
    }

    /// Samples since the last call, of one actuator after the other.
    pub fn take_samples(&mut self) -> Vec<TakenSample> {
        let kept = self.lanes.values_mut().filter_map(|lane| lane.kept.as_mut());
        kept.flat_map(std::mem::take).collect()
    }

    /// Takes one frame and appends the windows that it ends.
    pub fn push(&mut self, frame: &RawFrame, names: &BusNames, ended: &mut Vec<WindowJob>) {
        self.counts.received += 1;
        if frame.is_error() {
            self.counts.error += 1;
            return;
        }
        if self.any_mapped && !frame.is_serial() && self.push_mapped(frame, names, ended) {
            return;
        }
        let parsed = if frame.is_serial() {
            self.parse_serial(frame)
        } else {
            self.parse(frame)
        };
        let Some((actuator, parsed)) = parsed else {
            return;
        };
        let key = (frame.bus, actuator);
        if !self.lanes.contains_key(&key) {
            let bus = names.name(frame.bus).unwrap_or("");
            let Some(lane) = Lane::new(&self.config, bus, actuator, self.keeps) else {
                self.counts.filtered += 1;
                return;
            };
            self.lanes.insert(key, lane);
        }
        self.counts.decoded += 1;
        match parsed {
            Frame::Currents(_) => self.counts.currents += 1,
            Frame::Position(_) => self.counts.position += 1,
            Frame::Command(_) => self.counts.command += 1,
            Frame::SampleFd(_) | Frame::Status(_) => {}
        }
        if let Some(lane) = self.lanes.get_mut(&key) {
            lane.push(&parsed, frame.stamp_ns, &self.config, ended, &mut self.notices);
        }
    }

    /// Takes a frame of a bus with mapped actuators, unless it is to be read by the built-in dictionary; then false.
    fn push_mapped(&mut self, frame: &RawFrame, names: &BusNames, ended: &mut Vec<WindowJob>) -> bool {
        let Self {
            config,
            lanes,
            mapped,
            counts,
            notices,
            keeps,
            ..
        } = self;
        let bus = names.name(frame.bus).unwrap_or("");
        let Some(mapped) = mapped.entry(frame.bus).or_insert_with(|| MappedBus::new(config, bus)) else {
            return false;
        };
        let mut understood = false;
        let used = mapped.push(frame, |id, heard| {
            let Some(heard) = heard else { return };
            let lane = match lanes.entry((frame.bus, id)) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(place) => match Lane::new(config, bus, id, *keeps) {
                    Some(lane) => place.insert(lane),
                    None => return,
                },
            };
            understood = true;
            lane.hear(&heard, config, ended, notices);
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

    fn parse(&mut self, frame: &RawFrame) -> Option<(ActuatorId, Frame)> {
        let id = u16::try_from(frame.id())
            .ok()
            .filter(|_| !frame.is_extended() && !frame.is_remote());
        match id.map(|id| Frame::parse(id, frame.data())) {
            Some(Ok(Some(ours))) => Some(ours),
            Some(Err(_)) => {
                self.counts.malformed += 1;
                None
            }
            Some(Ok(None)) | None => {
                self.counts.filtered += 1;
                None
            }
        }
    }

    /// What a packet of a serial line says. A sample there is whole, as in CAN FD.
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
    /// interface depends on the source, and would tell live from replay.)
    pub fn finish(&mut self, ended: &mut Vec<WindowJob>) {
        let mut lanes: Vec<_> = self.lanes.iter_mut().collect();
        lanes.sort_by(|((_, a), x), ((_, b), y)| (&x.bus, a).cmp(&(&y.bus, b)));
        for (_, lane) in lanes {
            lane.finish(&self.config, ended, &mut self.notices);
        }
    }

    /// Frames so far.
    #[must_use]
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// What came of the frames of each serial line, by its index.
    pub fn serial(&self) -> impl Iterator<Item = (u16, DeframerStats)> {
        self.serial.iter().map(|(&bus, &stats)| (bus, stats))
    }

    /// Names of the actuators seen so far, with the number of samples delivered and lost: missing, or
    /// dropped because the actuator cannot be monitored at its sample rate.
    pub fn actuators(&self) -> impl Iterator<Item = (&str, u64, u64)> {
        self.lanes.values().map(|lane| {
            let stats = lane.channel.stats();
            let dropped = match lane.cutter {
                Cutter::Refused(dropped) => dropped,
                Cutter::Waiting | Cutter::Ready { .. } => 0,
            };
            (lane.actuator.name.as_str(), stats.samples, stats.missing + dropped)
        })
    }

    /// Frames dropped because a newer sample had begun.
    #[must_use]
    pub fn late(&self) -> u64 {
        let joined: u64 = self.mapped.values().flatten().map(MappedBus::late).sum();
        joined + self.lanes.values().map(|lane| lane.channel.stats().late).sum::<u64>()
    }

    /// Notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }
}

impl Lane {
    fn new(config: &Config, bus: &str, id: ActuatorId, keeps: bool) -> Option<Self> {
        let actuator = Arc::new(config.actuator_for(bus, id)?.clone());
        Some(Self {
            bus: bus.into(),
            actuator,
            channel: Channel::new(id),
            cutter: Cutter::Waiting,
            kept: keeps.then(Vec::new),
        })
    }

    /// Takes what a frame of a mapped bus told. A sample there is whole, as in CAN FD.
    fn hear(&mut self, heard: &Heard, config: &Config, ended: &mut Vec<WindowJob>, notices: &mut Vec<Notice>) {
        if let Some(conditions) = heard.conditions {
            self.channel.set_conditions(conditions);
        }
        if let Some((sample, stamp_ns)) = heard.sample
            && let Ok(one) = SampleFd::from_samples(&[sample])
        {
            self.push(&Frame::SampleFd(one), stamp_ns, config, ended, notices);
        }
    }

    fn push(
        &mut self,
        frame: &Frame,
        stamp_ns: u64,
        config: &Config,
        ended: &mut Vec<WindowJob>,
        notices: &mut Vec<Notice>,
    ) {
        let conditions = self.channel.conditions();
        let (actuator, cutter, kept) = (&self.actuator, &mut self.cutter, &mut self.kept);
        let nominal = actuator.params.sensors.sample_rate;
        let restarts = self.channel.restarts();
        let learning = !self.channel.rate_is_settled();
        let mut heard = StampedRate::default();
        self.channel.push(frame, stamp_ns, nominal, |rate, sample| {
            if learning {
                heard.push(&sample);
            }
            keep(kept, actuator, rate, sample, conditions);
            cutter.push(actuator, rate, sample, config, conditions, ended, notices);
        });
        if self.channel.restarts() > restarts {
            notices.push(Notice {
                stamp_ns,
                message: format!(
                    "{}: expected a sample counter that rises, found one that went back; an open window is cut short",
                    actuator.name
                ),
            });
        }
        if learning && self.channel.rate_is_assumed() {
            let has_clock = actuator.map.as_ref().is_none_or(|map| map.has(Role::Time));
            let why = if has_clock {
                "expected a device time that advances with the samples, found none in the first samples"
            } else {
                "no sample.time is mapped"
            };
            notices.push(Notice {
                stamp_ns,
                message: format!(
                    "{}: {why}; windows are cut at the nominal {nominal} samples/s{}",
                    actuator.name,
                    heard.doubt(nominal, &actuator.type_name)
                ),
            });
        }
    }

    fn finish(&mut self, config: &Config, ended: &mut Vec<WindowJob>, notices: &mut Vec<Notice>) {
        let conditions = self.channel.conditions();
        let (actuator, cutter, kept) = (&self.actuator, &mut self.cutter, &mut self.kept);
        let nominal = actuator.params.sensors.sample_rate;
        self.channel.finish(nominal, |rate, sample| {
            keep(kept, actuator, rate, sample, conditions);
            cutter.push(actuator, rate, sample, config, conditions, ended, notices);
        });
        cutter.finish(actuator, conditions, ended);
    }
}

/// The rate of samples by their stamps: no measure, but enough to doubt a configured one.
#[derive(Debug, Default)]
struct StampedRate {
    /// Number and stamp, ns.
    first: Option<(u64, u64)>,
    last: (u64, u64),
}

impl StampedRate {
    fn push(&mut self, sample: &TimedSample) {
        self.last = (sample.seq, sample.stamp_ns);
        self.first.get_or_insert(self.last);
    }

    /// What to say beside a nominal rate that is off by more than a tenth; nothing if it is not.
    fn doubt(&self, nominal_hz: f64, type_name: &str) -> String {
        let (seq, stamp_ns) = self.first.unwrap_or(self.last);
        let samples = self.last.0.saturating_sub(seq) as f64;
        let hz = samples * 1e9 / self.last.1.saturating_sub(stamp_ns) as f64;
        if hz.is_finite() && (hz - nominal_hz).abs() > 0.1 * nominal_hz {
            format!("; by their stamps they come at {hz:.0}: is sample_rate_hz of type {type_name} right?")
        } else {
            String::new()
        }
    }
}

fn keep(
    kept: &mut Option<Vec<TakenSample>>,
    actuator: &Arc<ActuatorConfig>,
    rate: SampleRate,
    sample: TimedSample,
    conditions: MeasuredConditions,
) {
    if let Some(kept) = kept {
        let actuator = actuator.clone();
        kept.push(TakenSample {
            actuator,
            rate,
            sample,
            conditions,
        });
    }
}

/// Windows of samples of one actuator that were assembled elsewhere, cut as those of a log are, and what an operator
/// should read about them.
#[must_use]
pub fn cut(
    config: &Config,
    actuator: &Arc<ActuatorConfig>,
    rate: SampleRate,
    conditions: MeasuredConditions,
    samples: impl IntoIterator<Item = TimedSample>,
) -> (Vec<WindowJob>, Vec<Notice>) {
    let (mut cutter, mut ended, mut notices) = (Cutter::Waiting, Vec::new(), Vec::new());
    for sample in samples {
        cutter.push(actuator, rate, sample, config, conditions, &mut ended, &mut notices);
    }
    cutter.finish(actuator, conditions, &mut ended);
    (ended, notices)
}

impl Cutter {
    #[expect(
        clippy::too_many_arguments,
        reason = "borrows of one lane and one front, taken apart for the closure"
    )]
    fn push(
        &mut self,
        actuator: &Arc<ActuatorConfig>,
        rate: SampleRate,
        sample: TimedSample,
        config: &Config,
        conditions: MeasuredConditions,
        ended: &mut Vec<WindowJob>,
        notices: &mut Vec<Notice>,
    ) {
        if matches!(self, Self::Waiting) {
            *self = Self::new(actuator, rate, config, sample.stamp_ns, notices);
        }
        match self {
            Self::Waiting => {}
            Self::Refused(dropped) => *dropped += 1,
            Self::Ready {
                params,
                windower,
                operating,
            } => {
                *operating += u64::from(sample.sensed.setpoint != Setpoint::Idle);
                if let Some(window) = windower.push(sample) {
                    ended.push(WindowJob {
                        actuator: actuator.clone(),
                        params: **params,
                        window,
                        conditions,
                        operating_s: *operating as f64 / params.sensors.sample_rate,
                    });
                }
            }
        }
    }

    fn finish(&mut self, actuator: &Arc<ActuatorConfig>, conditions: MeasuredConditions, ended: &mut Vec<WindowJob>) {
        if let Self::Ready {
            params,
            windower,
            operating,
        } = self
            && let Some(window) = windower.finish()
        {
            ended.push(WindowJob {
                actuator: actuator.clone(),
                params: **params,
                window,
                conditions,
                operating_s: *operating as f64 / params.sensors.sample_rate,
            });
        }
    }

    fn new(
        actuator: &ActuatorConfig,
        rate: SampleRate,
        config: &Config,
        stamp_ns: u64,
        notices: &mut Vec<Notice>,
    ) -> Self {
        let name = &actuator.name;
        let nominal = actuator.params.sensors.sample_rate;
        let mut params = actuator.params;
        // The device samples in whole control periods; its clock and its sender jitter by more than that is off.
        let control_s = params.controller.period;
        let whole = (1.0 / (rate.hz * control_s)).round().max(1.0);
        let whole_hz = 1.0 / (whole * control_s);
        let is_whole = rate.told && (whole_hz / rate.hz - 1.0).abs() < RATE_ROUNDING;
        let rate = SampleRate {
            hz: if is_whole { whole_hz } else { rate.hz },
            ..rate
        };
        params.sensors.sample_rate = rate.hz;
        if (rate.hz - nominal).abs() > 1e-3 * nominal {
            let found = rate.hz;
            let message =
                format!("{name}: expected {nominal} samples/s, found {found:.1}; windows are cut at the rate found");
            notices.push(Notice { stamp_ns, message });
        }
        let made = match params.checked() {
            Ok(params) => Windower::new(*config.window(), &params)
                .map(|windower| Self::Ready {
                    params: Box::new(params),
                    windower: Box::new(if rate.told { windower.at_device_time() } else { windower }),
                    operating: 0,
                })
                .map_err(|e| e.to_string()),
            Err(_) if rate.told => Err(format!(
                "its clock tells {:.1} samples/s, of a period that is no whole number of control periods of {} ms; if that is \
                 wrong, leave sample.time out of the map and set sensors.sample_rate_hz of type {}",
                rate.hz,
                1e3 * control_s,
                actuator.type_name
            )),
            Err(e) => Err(e.to_string()),
        };
        made.unwrap_or_else(|why| {
            notices.push(Notice {
                stamp_ns,
                message: format!("{name}: not monitored: {why}"),
            });
            Self::Refused(0)
        })
    }
}
