//! Samples of one actuator -> actuation windows. No I/O, no clock, bounded memory.
//!
//! [`Windower::push`] takes the samples of one actuator as they were received and now and then returns a [`Window`]: the
//! samples of one actuation on an exact grid of 1/f_s, with a [`WindowQuality`]: whether they are fit for an assessment. In order:
//!
//! 1. order: a repeated sample is dropped, a counter that goes back ends what is open ([`Windower::push`]);
//! 2. `glitch`: a setpoint that lasts one sample only is a transmission error, so each sample waits for the next one;
//! 3. `ring`: the last samples by number, places of missing ones included;
//! 4. `trigger`: has an actuation begun?
//! 5. when the window is complete: `signals`, `counters`, `check` find what cannot be used and whether the rest is enough,
//!    `fill` interpolates what is missing.
//!
//! `docs/windows.md` states the rules with their defaults. A window that is not fit has a reason; bad data are
//! never taken for a bad actuator.

#[cfg(test)]
mod bench_slots;
mod check;
mod config;
mod counters;
mod fill;
mod glitch;
mod held;
mod jitter;
mod limits;
mod quality;
mod ring;
mod signals;
mod trigger;

pub use config::WindowConfig;
pub use quality::{Counter, CutShort, Defect, Degradation, Invalidity, Signal, WindowQuality};

use crate::setting::SettingError;
use ema_identify::Prepared;
use ema_identify::relations::SinceCommissioning;
use ema_identify::unit_estimate::AlignedWindow;
use ema_models::{ActuatorParams, SensedSample, Setpoint};
use glitch::Deglitch;
use limits::Limits;
use ring::{Ring, Slot};
use trigger::{Held, Trigger};

/// One decoded sample and when it was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedSample {
    /// Sample number, unwrapped; the sample stands at t₀ + seq / f_s. `sensed.seq` is not read.
    pub seq: u64,
    /// UTC of the sample, ns.
    pub stamp_ns: u64,
    /// Currents, unwrapped counts, setpoint.
    pub sensed: SensedSample,
}

/// One actuation, on a grid of one sample period.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Number of the window, from 0; counts every window, assessed or not.
    pub number: u64,
    /// UTC of the first sample, ns: the trigger's stamp less the pre-trigger time.
    pub t_start_ns: u64,
    /// Index of the trigger in `samples`.
    pub trigger: usize,
    /// Samples on the grid, `seq` rising by one; what was missing or refused is interpolated (see `filled`), in an invalid window
    /// as received.
    pub samples: Vec<SensedSample>,
    /// Samples that a window of full length has.
    pub expected: usize,
    /// Whether the samples are fit for an assessment.
    pub quality: WindowQuality,
    /// Samples missing by their counter.
    pub lost: u64,
    /// Samples received with at least one signal that could not be used.
    pub rejected: u64,
    /// Indices of all samples that are interpolated in whole or in part, rising; weigh them zero where it matters.
    pub filled: Vec<usize>,
    /// Repeated samples dropped while the window was open.
    pub duplicates: u64,
    /// Zero of the output's angle against the motor's behind the gear, rad, but for whole turns of the motor; of a commissioned unit. The
    /// samples are as measured.
    pub output_zero_rad: Option<f64>,
    /// Times the stamp moved against the sample counter by more than 50 ms. Counted, no handicap: time is taken
    /// from the counter.
    pub clock_jumps: u64,
}

impl Window {
    /// The window as the monitor compares it.
    pub(crate) fn prepared(&self, params: &ActuatorParams) -> Prepared {
        Prepared::new(params, &self.samples, &self.filled, self.trigger, self.output_zero_rad)
    }

    /// The window as the relations read it, with this being other than when its unit was commissioned.
    pub(crate) fn aligned<'a>(&'a self, params: &'a ActuatorParams, since: SinceCommissioning) -> AlignedWindow<'a> {
        AlignedWindow::new(params, &self.samples, &self.filled, self.output_zero_rad).with(since)
    }

    /// Checks the samples of an invalid window again, after what made it invalid was taken out of them; they are completed and its quality
    /// is what they have now. A window with missing samples stays invalid.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub fn check_again(&mut self, config: &WindowConfig, params: &ActuatorParams) -> Result<(), SettingError> {
        if self.quality.is_fit() || self.lost > 0 {
            return Ok(());
        }
        let mut limits = Limits::new(&config.checked(params.sensors.sample_rate)?, params);
        limits.rate_is_unconfirmed = false;
        // The rate is known, so that stamps are no evidence.
        let received = |sensed: &SensedSample| {
            Slot::received(&TimedSample {
                seq: sensed.seq,
                stamp_ns: self.t_start_ns,
                sensed: *sensed,
            })
        };
        let mut slots: Vec<Slot> = self.samples.iter().map(received).collect();
        let findings = check::examine(&mut slots, &limits);
        if let Some(why) = findings.invalid {
            self.quality = WindowQuality::Invalid(why);
            return Ok(());
        }
        self.samples = fill::samples(&slots, &limits.rotor);
        self.filled = fill::indices(&slots);
        self.rejected = findings.rejected;
        let degradations = findings.degradations(!self.filled.is_empty(), None);
        self.quality = if degradations.is_empty() {
            WindowQuality::Complete
        } else {
            WindowQuality::Degraded(degradations)
        };
        Ok(())
    }

    /// Refuses the counts of samples that were found wrong afterwards: they are filled as if refused at once. An invalid
    /// window stays as it is.
    pub fn refuse_counts(&mut self, outliers: &[usize]) {
        let mut handicaps = match &mut self.quality {
            WindowQuality::Invalid(_) => return,
            WindowQuality::Complete => Vec::new(),
            WindowQuality::Degraded(handicaps) => std::mem::take(handicaps),
        };
        self.rejected += outliers.len() as u64;
        self.filled.extend(outliers);
        self.filled.sort_unstable();
        self.filled.dedup();
        let filled = &self.filled;
        let good = |n: usize| filled.binary_search(&n).is_err();
        fill::fill_motor(&mut self.samples, good);
        fill::fill_output(&mut self.samples, good);
        handicaps.retain(|handicap| !matches!(handicap, Degradation::Filled { .. }));
        handicaps.insert(
            0,
            Degradation::Filled {
                lost: self.lost,
                rejected: self.rejected,
            },
        );
        self.quality = WindowQuality::Degraded(handicaps);
    }
}

/// What a [`Windower`] has seen since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounts {
    /// Samples accepted.
    pub samples: u64,
    /// Repeated samples, dropped; `samples + duplicates` is the number of calls of `push`.
    pub duplicates: u64,
    /// Samples missing by their counter.
    pub missing: u64,
    /// Times the counter went back.
    pub restarts: u64,
    /// Samples whose setpoint lasted one sample only, or was no number.
    pub glitches: u64,
}

/// Cuts the samples of one actuator into windows. A pure state machine: the memory is reserved in `new`, and only a
/// finished window allocates.
///
/// ```
/// use ema_models::{ActuatorParams, SensedSample, Setpoint};
/// use hmd_core::window::{TimedSample, WindowConfig, WindowQuality, Windower};
/// let mut windower = Windower::new(WindowConfig::default(), &ActuatorParams::bench())?;
/// let at = |seq: u64| TimedSample {
///     seq,
///     stamp_ns: 500_000 * seq, // 2 kHz
///     sensed: SensedSample {
///         seq,
///         currents: [0.0; 3],
///         motor_counts: 0,
///         output_counts: 0,
///         setpoint: Setpoint::Position(if seq < 100 { 0.0 } else { 0.25 }),
///     },
/// };
/// let window = (0..1200).find_map(|seq| windower.push(at(seq))).expect("one actuation");
/// // From 20 ms before the command to 480 ms after it, both ends included.
/// assert_eq!((window.trigger, window.samples.len()), (40, 1001));
/// assert_eq!(window.samples[window.trigger].seq, 100);
/// assert_eq!(window.quality, WindowQuality::Complete);
/// # Ok::<(), hmd_core::setting::SettingError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Windower {
    limits: Limits,
    trigger: Trigger,
    held: Held,
    deglitch: Deglitch,
    ring: Ring,
    open: Option<Open>,
    last_seq: Option<u64>,
    next_number: u64,
    counts: StreamCounts,
}

/// The window that is being filled.
#[derive(Clone, Copy, Debug)]
struct Open {
    first_seq: u64,
    trigger_stamp_ns: u64,
    setpoint: Setpoint,
    another: Option<u64>,
    duplicates_before: u64,
}

impl Windower {
    /// For one actuator of the given type, sampled at `params.sensors.sample_rate`.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub fn new(config: WindowConfig, params: &ActuatorParams) -> Result<Self, SettingError> {
        let config = config.checked(params.sensors.sample_rate)?;
        let limits = Limits::new(&config, params);
        let trigger = Trigger::new(&config, limits.lengths.rest);
        Ok(Self {
            held: Held::new(&trigger),
            deglitch: Deglitch::new(trigger.thresholds, limits.lengths.longest_gap as u64),
            ring: Ring::with_capacity(limits.lengths.window.max(limits.lengths.rest + 1)),
            trigger,
            limits,
            open: None,
            last_seq: None,
            next_number: 0,
            counts: StreamCounts::default(),
        })
    }

    /// The same for samples whose rate was measured by the device's own time: stamps are then no evidence against it.
    #[must_use]
    pub fn at_device_time(mut self) -> Self {
        self.limits.rate_is_unconfirmed = false;
        self
    }

    /// The same for samples that nothing counts: their numbers follow from their stamps.
    #[must_use]
    pub fn numbered_by_time(mut self) -> Self {
        self.limits.is_numbered_by_time = true;
        self
    }

    /// The same for samples of a drive whose frames hold no larger quadrature current, A, and no direct one: what is there is clipped.
    #[must_use]
    pub fn with_quadrature_max(mut self, quadrature_max_a: Option<f64>) -> Self {
        self.limits.quadrature_max_a = quadrature_max_a;
        self
    }

    /// The same for currents of which only the quadrature one is measured, which may read 0 A for a while.
    #[must_use]
    pub fn of_quadrature_alone(mut self) -> Self {
        self.limits.is_quadrature_alone = true;
        self
    }

    /// The same for samples without set point: motion of the motor begins a window.
    #[must_use]
    pub fn triggered_by_motion(mut self) -> Self {
        let limits = &self.limits;
        self.trigger.of_motion(limits.rotor.motor_lsb / limits.gear_ratio);
        self
    }

    /// The same, whose windows are numbered from this number on: it takes the place of another one.
    #[must_use]
    pub fn numbered_from(mut self, number: u64) -> Self {
        self.next_number = number;
        self
    }

    /// Number of the next window.
    #[must_use]
    pub fn next_number(&self) -> u64 {
        self.next_number
    }

    /// Counts since the start.
    #[must_use]
    pub fn counts(&self) -> StreamCounts {
        self.counts
    }

    /// Whether a window is being filled.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Takes the next sample; returns the window that it completed or ended, one sample after its last one.
    pub fn push(&mut self, sample: TimedSample) -> Option<Window> {
        let mut ended = None;
        if let Some(last) = self.last_seq {
            if sample.seq == last || (sample.seq < last && self.is_late_copy(&sample, last)) {
                self.counts.duplicates += 1;
                return None;
            }
            if sample.seq < last {
                self.counts.restarts += 1;
                ended = self.end_stream(CutShort::CounterWentBack);
            }
        }
        self.last_seq = Some(sample.seq);
        self.counts.samples += 1;
        let completed = self.deglitch.push(sample).and_then(|slot| self.accept(slot, true));
        debug_assert!(ended.is_none() || completed.is_none(), "one sample ends one window");
        ended.or(completed)
    }

    /// End of the stream, or a known break in it: an open window is returned, cut short unless this was its last sample.
    /// The next sample begins afresh; numbers and counts continue.
    pub fn finish(&mut self) -> Option<Window> {
        self.end_stream(CutShort::StreamEnded)
    }

    /// As [`Windower::finish`], where the stream goes on at another sample rate.
    pub fn finish_at_rate(&mut self) -> Option<Window> {
        self.end_stream(CutShort::RateChanged)
    }

    fn end_stream(&mut self, why: CutShort) -> Option<Window> {
        // No sample follows that could confirm a jump of the setpoint in this last one, so it opens no window.
        let completed = self.deglitch.flush().and_then(|slot| self.accept(slot, false));
        let cut = self.close(Some(Invalidity::CutShort(why)));
        self.ring.clear();
        self.held.forget();
        self.last_seq = None;
        debug_assert!(
            completed.is_none() || cut.is_none(),
            "a sample that completes a window opens none"
        );
        completed.or(cut)
    }

    /// Whether a sample of a lower number is one that came a moment ago; further back it is a restart, where a device at
    /// rest repeats itself to the bit.
    fn is_late_copy(&self, sample: &TimedSample, last: u64) -> bool {
        last - sample.seq <= self.limits.lengths.longest_gap as u64 && self.ring.holds_copy_of(sample)
    }

    /// A sample in its place: first what is missing before it, then itself, which may open a window.
    fn accept(&mut self, slot: Slot, may_open: bool) -> Option<Window> {
        self.counts.glitches += u64::from(slot.is_command_glitch());
        let gap = self
            .ring
            .latest()
            .map_or(0, |latest| slot.sample.seq - latest.sample.seq - 1);
        self.counts.missing = self.counts.missing.saturating_add(gap);
        let completed = self.bridge(gap);
        completed.or(self.advance(slot, may_open))
    }

    /// Places for `gap` missing samples. They hold the setpoint before them, so that rest continues through a short gap;
    /// what lies before a gap longer than the rest is forgotten.
    fn bridge(&mut self, mut gap: u64) -> Option<Window> {
        let mut completed = None;
        while gap > 0 && self.open.is_some() {
            completed = self.advance(self.ring.latest()?.missing_next(), false);
            gap -= 1;
        }
        if gap > self.limits.lengths.rest as u64 {
            self.ring.clear();
            self.held.forget();
        } else {
            for _ in 0..gap {
                let next = self.ring.latest()?.missing_next();
                self.held.push(self.trigger.watched(&next.sample));
                self.ring.push(next);
            }
        }
        completed
    }

    fn advance(&mut self, slot: Slot, may_open: bool) -> Option<Window> {
        let setpoint = slot.sample.setpoint;
        if let Some(open) = &self.open
            && !trigger::same_mode(setpoint, open.setpoint)
        {
            let why = match setpoint {
                Setpoint::Idle => Invalidity::CutShort(CutShort::WentIdle),
                _ => Invalidity::ModeChanged,
            };
            let ended = self.close(Some(why));
            self.held.push(self.trigger.watched(&slot.sample));
            self.ring.push(slot);
            return ended;
        }
        let was_held = self.held.was_held();
        self.held.push(self.trigger.watched(&slot.sample));
        self.ring.push(slot);
        let Some(open) = &mut self.open else {
            if may_open && self.trigger.fires(&self.ring) {
                self.open = Some(Open {
                    first_seq: slot.sample.seq - self.limits.lengths.pre_trigger as u64,
                    trigger_stamp_ns: slot.stamp_ns,
                    setpoint,
                    another: None,
                    duplicates_before: self.counts.duplicates,
                });
                self.held.forget();
            }
            return None;
        };
        if was_held && self.trigger.moved(&self.ring) {
            open.another.get_or_insert(slot.sample.seq - open.first_seq);
            self.held.forget();
        }
        let length = slot.sample.seq - open.first_seq + 1;
        if length >= self.limits.lengths.window as u64 {
            self.close(None)
        } else {
            None
        }
    }

    /// Ends the open window with what the ring holds of it.
    fn close(&mut self, why: Option<Invalidity>) -> Option<Window> {
        let open = self.open.take()?;
        let number = self.next_number;
        self.next_number += 1;
        let slots = self.ring.since(open.first_seq);
        let findings = check::examine(slots, &self.limits);
        let filled = fill::indices(slots);
        let invalid = why.or(findings.invalid);
        let samples = if invalid.is_some() {
            fill::as_received(slots, &self.limits.rotor)
        } else {
            fill::samples(slots, &self.limits.rotor)
        };

        let degradations = findings.degradations(!filled.is_empty(), open.another);
        let pre_trigger_ns = 1e9 * self.limits.lengths.pre_trigger as f64 / self.limits.sample_rate;
        Some(Window {
            number,
            t_start_ns: open.trigger_stamp_ns.saturating_sub(pre_trigger_ns.round() as u64),
            trigger: self.limits.lengths.pre_trigger,
            samples,
            expected: self.limits.lengths.window,
            quality: match invalid {
                Some(why) => WindowQuality::Invalid(why),
                None if degradations.is_empty() => WindowQuality::Complete,
                None => WindowQuality::Degraded(degradations),
            },
            lost: findings.lost,
            rejected: findings.rejected,
            filled,
            duplicates: self.counts.duplicates - open.duplicates_before,
            clock_jumps: findings.clock_jumps,
            output_zero_rad: None,
        })
    }
}
