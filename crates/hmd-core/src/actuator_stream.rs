//! One actuator's frames -> samples on the device's own time -> windows.
//!
//! Goes in: the frames of one actuator, in the order of their stamps. Comes out, into an [`Outbox`]: the windows that they
//! end, notices, and every sample if they are collected. In order:
//!
//! 1. the assembler of `ema_wire` puts frames together into samples; wrapping counters are continued;
//! 2. the sample rate is measured by the device's own time. Until it is known, samples wait: at least 16, at most 64. It is checked on, and
//!    where it changes, windows are cut at the new rate;
//! 3. a [`Windower`] at that rate cuts windows. An actuator that cannot be monitored at its rate is refused: its samples are
//!    counted and dropped.
//!
//! Memory is bounded by those 64 samples and by one window. In the steady state a frame allocates nothing.

mod free_zero;
mod numbering;
mod rate;
mod windowing;

use std::sync::Arc;

use ema_models::{SensedSample, Setpoint};
use ema_wire::{
    Assembler, AssemblerStats, Frame, Mode, Sample, SampleFd, quantity, unwrap_motor_counts, unwrap_output_counts,
};

use crate::config::{ActuatorConfig, Config};
use crate::dbc::{DecodedUpdate, Role};
use crate::history::RunEnd;
use crate::log_map::{LogMap, Quantity};
use crate::outbox::{AssembledSample, Notice, Outbox, WindowJob};
use crate::sample::{MeasuredConditions, SampleRate};
use crate::sensor_checks::UncutMotions;
use crate::window::{TimedSample, Window, WindowConfig, Windower};
use numbering::Numbering;
use rate::{RateState, Settled};
use windowing::{Windowing, unseen_notice};

/// Times further apart than this are a pause where nothing counts the samples.
const PAUSE_NS: u64 = 500_000_000;

/// Samples after which the counter byte of position and command frames repeats.
const COUNTER_ROUND: f64 = 256.0;

/// The stream of one actuator, from its frames to its windows.
#[derive(Debug)]
pub struct ActuatorStream {
    actuator: Arc<ActuatorConfig>,
    window_config: WindowConfig,
    assembler: Assembler,
    /// The newest sample and its device time, µs.
    last: Option<(TimedSample, u16)>,
    /// Receive stamp of the newest currents frame, by its counter.
    currents_stamp: Option<(u16, u64)>,
    rate: RateState,
    conditions: MeasuredConditions,
    numbering: Numbering,
    counts: StreamCounts,
    /// What windows go on with that are cut anew.
    continued: RunEnd,
    /// The traffic ended, so that a counter that goes back is no device that restarted.
    is_ended: bool,
    /// The next sample is the first of a log that does not say whether it goes on.
    is_other_log: bool,
    windowing: Windowing,
}

/// What became of an actuator's samples beside those delivered, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounts {
    /// Samples lost: missing by their counter, in a log without one by their times where those are no pause; or dropped because the
    /// actuator cannot be monitored at its sample rate.
    pub lost: u64,
    /// Times the sample counter began anew or went back.
    pub restarts: u64,
    /// Times the samples changed their rate.
    pub rate_changes: u64,
}

/// Silence, ns, after which a counter that begins anew is no news: the actuator was off.
const OFF_NS: u64 = 60_000_000_000;

impl ActuatorStream {
    /// For one actuator of a configuration.
    #[must_use]
    pub fn new(actuator: Arc<ActuatorConfig>, config: &Config) -> Self {
        Self {
            assembler: Assembler::new(actuator.id),
            actuator,
            window_config: *config.window(),
            last: None,
            currents_stamp: None,
            rate: RateState::new(),
            conditions: MeasuredConditions::default(),
            numbering: Numbering::default(),
            counts: StreamCounts::default(),
            continued: RunEnd::default(),
            is_ended: false,
            is_other_log: false,
            windowing: Windowing::Waiting,
        }
    }

    /// Name of the actuator.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.actuator.name
    }

    /// Counts of the assembler: samples delivered, frames that came late.
    #[must_use]
    pub fn stats(&self) -> AssemblerStats {
        self.assembler.stats()
    }

    /// Samples lost, and changes of counter and rate.
    #[must_use]
    pub fn counts(&self) -> StreamCounts {
        self.counts
    }

    /// Takes over which quantities its samples have from now on; an open window ends where they are others.
    pub fn remap(&mut self, map: &Arc<LogMap>, stamp_ns: u64, outbox: &mut Outbox) {
        if self.actuator.log.as_ref().is_some_and(|known| Arc::ptr_eq(known, map)) {
            return;
        }
        let is_other = self.actuator.log.as_ref() != Some(map);
        let mut actuator = ActuatorConfig::clone(&self.actuator);
        actuator.log = Some(map.clone());
        if is_other {
            self.end_window(self.conditions, Windower::finish, outbox);
            self.cut_anew();
            let name = &actuator.name;
            outbox.push_notice(stamp_ns, format!("{name}: its PDO are as its master wrote them"));
        }
        self.actuator = Arc::new(actuator);
    }

    /// Takes what a frame of a mapped bus carried. A sample there is whole, as in CAN FD.
    pub fn push_update(&mut self, update: &DecodedUpdate, outbox: &mut Outbox) {
        if let Some(conditions) = update.conditions {
            self.conditions = conditions;
        }
        if let Some((sample, stamp_ns)) = update.sample
            && let Ok(one) = SampleFd::from_samples(&[sample])
        {
            self.push(&Frame::SampleFd(one), stamp_ns, outbox);
        }
    }

    /// Takes one frame of the built-in dictionary.
    ///
    /// The first samples are delivered together, as soon as device time and counter show the rate, or after 64 of them at
    /// the nominal rate.
    pub fn push(&mut self, frame: &Frame, stamp_ns: u64, outbox: &mut Outbox) {
        // A sample has the conditions that were reported before its frame.
        let conditions = self.conditions;
        let nominal_hz = self.nominal_hz();
        let mut was_on = false;
        let mut first_at_nominal_rate = None;
        match frame {
            Frame::Status(status) => self.conditions = MeasuredConditions::from(status),
            Frame::Currents(currents) => self.currents_stamp = Some((currents.seq, stamp_ns)),
            Frame::Position(_) | Frame::Command(_) | Frame::SampleFd(_) => {}
        }
        for sample in self.assembler.push(frame, stamp_ns) {
            let stamp_ns = match self.currents_stamp {
                Some((seq, stamp)) if seq == sample.seq => stamp,
                _ => stamp_ns,
            };
            let timed = self.continued(&sample, stamp_ns);
            let is_first = std::mem::take(&mut self.is_ended);
            if let Some((last, _)) = self.last.filter(|(last, _)| !is_first && timed.seq < last.seq) {
                self.counts.restarts += 1;
                was_on |= stamp_ns.saturating_sub(last.stamp_ns) < OFF_NS;
            }
            let next = self.last.filter(|(last, _)| timed.seq == last.seq + 1);
            // The number of a sample that stamps number says nothing of a time that is those stamps.
            let next = next.filter(|_| self.rate.known().is_none() || !self.is_numbered_by_time());
            let period_us = next.map(|(_, time_us)| sample.time_us.wrapping_sub(time_us));
            match self.rate.push(timed, period_us, nominal_hz) {
                Settled::Not => {}
                Settled::Before(rate) => self.deliver(rate, timed, conditions, outbox),
                Settled::Changed { before, now } => {
                    self.change_rate(before, now, stamp_ns, outbox);
                    self.deliver(now, timed, conditions, outbox);
                }
                Settled::Now(rate, waiting) => {
                    first_at_nominal_rate = waiting.first().copied().filter(|_| !rate.is_measured);
                    for sample in waiting {
                        self.deliver(rate, sample, conditions, outbox);
                    }
                }
            }
            self.last = Some((timed, sample.time_us));
            if let Some(rate) = self.rate.known() {
                self.numbering.note_delay(&rate);
                self.assembler.set_max_span_ns(longest_sample_ns(&rate));
            }
        }
        if was_on {
            let name = &self.actuator.name;
            outbox.push_notice(
                stamp_ns,
                format!("{name}: expected a sample counter that rises, found one that went back; an open window is cut short"),
            );
        }
        if let (Some(first), Some((last, _))) = (first_at_nominal_rate, self.last) {
            outbox.push_notice(stamp_ns, self.nominal_rate_notice(&first, &last));
        }
    }

    /// End of the traffic: delivers the samples that waited for a rate, at the nominal one, and ends an open window.
    pub fn finish(&mut self, outbox: &mut Outbox) {
        let conditions = self.conditions;
        self.assembler.close();
        let rate = SampleRate::nominal(self.nominal_hz());
        for sample in self.rate.settle(rate) {
            self.deliver(rate, sample, conditions, outbox);
        }
        self.end_window(conditions, Windower::finish, outbox);
        self.is_ended = true;
    }

    /// The frames that come are of another recording: neither their counters nor their rate and conditions continue, and windows and hours
    /// are counted from 0, as by the run that made it. To be called after [`ActuatorStream::finish`].
    pub fn begin_recording(&mut self) {
        self.assembler.begin_stream();
        self.numbering.begin();
        self.last = None;
        self.conditions = MeasuredConditions::default();
        self.rate = RateState::new();
        self.windowing = Windowing::Waiting;
        self.continued = RunEnd::default();
    }

    /// The frames that come are of another log: stamps alone do not tell a pause between logs from loss. To be called after
    /// [`ActuatorStream::finish`].
    pub fn begin_log(&mut self) {
        self.is_other_log = true;
    }

    fn nominal_hz(&self) -> f64 {
        self.actuator.params.sensors.sample_rate
    }

    /// Whether stamps give the numbers of samples: in a log without a counter, and of a drive.
    fn is_numbered_by_time(&self) -> bool {
        let log = self.actuator.log.as_ref();
        log.is_some_and(|log| !log.has(Quantity::Counter))
    }

    /// Whether what lies before a sample is a pause, in a log that nothing counts: a recording ended and another began. On a bus, frames
    /// are lost, but for those between two logs.
    fn is_after_pause(&self, stamp_ns: u64, is_other_log: bool) -> bool {
        let is_of_log = (is_other_log || self.actuator.drive_bus.is_none()) && self.is_numbered_by_time();
        let last = self.last.filter(|_| is_of_log);
        last.is_some_and(|(last, _)| stamp_ns.saturating_sub(last.stamp_ns) > PAUSE_NS)
    }

    /// Windows are cut at another rate from now on.
    fn change_rate(&mut self, before: SampleRate, now: SampleRate, stamp_ns: u64, outbox: &mut Outbox) {
        self.counts.rate_changes += 1;
        self.numbering.forget_delays();
        let (name, before_hz, now_hz) = (self.name(), before.hz, now.hz);
        let message = format!(
            "{name}: the sample rate changed from {before_hz:.1} to {now_hz:.1} samples/s by the device's time; an open window is cut short"
        );
        outbox.push_notice(stamp_ns, message);
        self.end_window(self.conditions, Windower::finish_at_rate, outbox);
        self.cut_anew();
    }

    /// What it has shown so far.
    #[must_use]
    pub fn run_end(&self) -> RunEnd {
        match &self.windowing {
            Windowing::Ready(ready) => ready.continued(),
            Windowing::Waiting | Windowing::Refused => self.continued,
        }
    }

    /// The next sample begins a new windowing, which goes on with the numbers of this one.
    fn cut_anew(&mut self) {
        if let Windowing::Ready(ready) = std::mem::replace(&mut self.windowing, Windowing::Waiting) {
            self.continued = ready.continued();
        }
    }

    /// Continues the wrapping counters, and counts what is missing before the sample. After a restart the sample number steps back too.
    fn continued(&mut self, sample: &Sample, stamp_ns: u64) -> TimedSample {
        let rate = self.rate.known().filter(|_| !self.is_numbered_by_time());
        let numbered = self.numbering.next(sample.seq, stamp_ns, rate);
        let is_other_log = std::mem::take(&mut self.is_other_log);
        if !self.is_after_pause(stamp_ns, is_other_log) {
            self.counts.lost += numbered.lost;
        }
        let seq = numbered.number;
        let (motor_counts, output_counts) = match self.last {
            Some((last, _)) => (
                unwrap_motor_counts(last.sensed.motor_counts, sample.motor_counts),
                unwrap_output_counts(last.sensed.output_counts, sample.output_counts),
            ),
            None => (i64::from(sample.motor_counts), i64::from(sample.output_counts)),
        };
        let setpoint = match sample.mode {
            Mode::Idle => Setpoint::Idle,
            Mode::Position => Setpoint::Position(quantity::position_setpoint_rad(sample.setpoint)),
            Mode::Speed => Setpoint::Speed(quantity::speed_setpoint_rad_s(sample.setpoint)),
        };
        TimedSample {
            seq,
            stamp_ns,
            sensed: SensedSample {
                seq,
                currents: sample.currents_a(),
                motor_counts,
                output_counts,
                setpoint,
            },
        }
    }

    /// One sample with its rate known, to the windows.
    fn deliver(&mut self, rate: SampleRate, sample: TimedSample, conditions: MeasuredConditions, outbox: &mut Outbox) {
        outbox.push_sample(|| AssembledSample {
            actuator: self.actuator.clone(),
            rate,
            sample,
            conditions,
        });
        if matches!(self.windowing, Windowing::Waiting) {
            let (actuator, config, before) = (&self.actuator, self.window_config, self.continued);
            self.windowing = Windowing::begin(actuator, config, rate, before, sample.stamp_ns, outbox);
        }
        match &mut self.windowing {
            Windowing::Waiting => {}
            Windowing::Refused => self.counts.lost += 1,
            Windowing::Ready(ready) => {
                ready.count_operation(&sample.sensed);
                if let Some(sentence) = ready
                    .unseen
                    .push(&sample.sensed)
                    .filter(|_| ready.motor_counts.is_none())
                {
                    outbox.push_notice(sample.stamp_ns, unseen_notice(&self.actuator, &sentence));
                }
                if let Some(window) = ready.windower.push(sample) {
                    ready.unseen.end();
                    outbox.push_window(ready.job(&self.actuator, window, conditions));
                }
                let is_in_window = ready.windower.is_open();
                let uncut = ready.uncut.as_mut();
                if let Some(sentence) = uncut.and_then(|uncut| uncut.push(sample.seq, &sample.sensed, is_in_window)) {
                    outbox.push_notice(sample.stamp_ns, format!("{}: {sentence}", self.actuator.name));
                }
            }
        }
    }

    fn end_window(
        &mut self,
        conditions: MeasuredConditions,
        finish: fn(&mut Windower) -> Option<Window>,
        outbox: &mut Outbox,
    ) {
        if let Windowing::Ready(ready) = &mut self.windowing {
            if let Some(window) = finish(&mut ready.windower) {
                outbox.push_window(ready.job(&self.actuator, window, conditions));
            } else if let (Some(sentence), Some((last, _)), None) =
                (ready.unseen.finish(), self.last, ready.motor_counts)
            {
                outbox.push_notice(last.stamp_ns, unseen_notice(&self.actuator, &sentence));
            }
            let uncut = ready.uncut.as_mut().and_then(UncutMotions::finish);
            if let (Some(sentence), Some((last, _))) = (uncut, self.last) {
                outbox.push_notice(last.stamp_ns, format!("{}: {sentence}", self.actuator.name));
            }
        }
    }

    /// Why windows are cut at the nominal rate, and whether the stamps of the first samples and the last contradict it.
    fn nominal_rate_notice(&self, first: &TimedSample, last: &TimedSample) -> String {
        let nominal_hz = self.nominal_hz();
        let of_log = self.actuator.log.as_ref().is_none_or(|log| log.has_device_time());
        let has_clock = of_log && self.actuator.map.as_ref().is_none_or(|map| map.has(Role::Time));
        let why = if has_clock {
            "expected a device time that advances with the samples, found none in the first samples"
        } else {
            "no sample.time is mapped"
        };
        // Stamps are no measure of the rate, but enough to doubt one that is off by more than a tenth.
        let samples = last.seq.saturating_sub(first.seq) as f64;
        let hz = samples * 1e9 / last.stamp_ns.saturating_sub(first.stamp_ns) as f64;
        let doubt = if hz.is_finite() && (hz - nominal_hz).abs() > 0.1 * nominal_hz {
            let type_name = &self.actuator.type_name;
            format!("; by their stamps they come at {hz:.0}: is sample_rate_hz of type {type_name} right?")
        } else {
            String::new()
        };
        let name = &self.actuator.name;
        format!("{name}: {why}; windows are cut at the nominal {nominal_hz} samples/s{doubt}")
    }
}

/// Cuts the samples of one actuator that were assembled elsewhere, in the same way as those of a log; the windows, and the
/// notices about them.
#[must_use]
pub fn cut_windows(
    config: &Config,
    actuator: &Arc<ActuatorConfig>,
    rate: SampleRate,
    conditions: MeasuredConditions,
    samples: impl IntoIterator<Item = TimedSample>,
) -> (Vec<WindowJob>, Vec<Notice>) {
    let (mut stream, mut outbox) = (ActuatorStream::new(actuator.clone(), config), Outbox::default());
    for sample in samples {
        stream.deliver(rate, sample, conditions, &mut outbox);
    }
    stream.end_window(conditions, Windower::finish, &mut outbox);
    (outbox.take_windows(), outbox.take_notices())
}

/// Largest distance between the stamps of one sample's frames, ns: an eighth of the counter byte's round, so that a stalled
/// receiver splits few samples, and never less than the default. For a nominal rate, the default.
fn longest_sample_ns(rate: &SampleRate) -> u64 {
    if !rate.is_measured {
        return Assembler::DEFAULT_MAX_SPAN_NS;
    }
    ((COUNTER_ROUND / 8.0 / rate.hz * 1e9) as u64).max(Assembler::DEFAULT_MAX_SPAN_NS)
}

#[cfg(test)]
mod tests;
