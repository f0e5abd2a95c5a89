//! One actuator's frames, continued into samples on the device's own time.

use ema_models::{SensedSample, Setpoint};
use ema_wire::can::Status;
use ema_wire::{
    ActuatorId, Assembler, AssemblerStats, Frame, Mode, Sample, quantity, unwrap_motor_counts, unwrap_output_counts,
};

use crate::window::TimedSample;

/// Samples kept back until the sample rate is known.
const RATE_SAMPLES: usize = 16;

/// Samples after which a rate that the device's time does not tell is taken as nominal.
const RATE_SAMPLES_MAX: usize = 64;

/// A measured rate this near the nominal one, as a share of it, is the nominal one.
const ROUNDING: f64 = 0.002;

/// Samples after which the counter byte of position and command frames repeats.
const COUNTER_ROUND: f64 = 256.0;

/// Longest sample period that 16 bits of microseconds can show, µs; longer ones are not measured.
const LONGEST_PERIOD_US: u16 = 32_768;

/// Decodes the frames of one actuator. Bounded: it keeps at most the samples from which it learns the rate.
#[derive(Debug)]
pub struct Channel {
    assembler: Assembler,
    last: Option<(TimedSample, u16)>,
    /// Receive stamp of the newest currents frame, by its counter.
    currents_stamp: Option<(u16, u64)>,
    rate: Rate,
    conditions: MeasuredConditions,
    restarts: u64,
}

/// What the status frames last said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasuredConditions {
    /// DC link voltage, V.
    pub dc_link_v: Option<f64>,
    /// Winding temperature, °C.
    pub winding_temp_deg_c: Option<f64>,
    /// Load torque at the output, Nm.
    pub load_torque_nm: Option<f64>,
}

/// The rate of an actuator's samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleRate {
    /// Samples per second.
    pub hz: f64,
    /// Whether the device's own time told it; else it is the nominal one.
    pub told: bool,
}

#[derive(Debug)]
enum Rate {
    /// Samples so far and the periods between them, µs.
    Learning {
        waiting: Vec<TimedSample>,
        periods_us: Vec<u16>,
    },
    Known(SampleRate),
}

impl Channel {
    /// A channel for one actuator.
    #[must_use]
    pub fn new(actuator: ActuatorId) -> Self {
        Self {
            assembler: Assembler::new(actuator),
            last: None,
            currents_stamp: None,
            rate: Rate::Learning {
                waiting: Vec::with_capacity(RATE_SAMPLES),
                periods_us: Vec::new(),
            },
            conditions: MeasuredConditions::default(),
            restarts: 0,
        }
    }

    /// Takes one frame; shows each sample that it completes, in order, to `deliver` with the sample rate.
    ///
    /// The first samples are delivered together, as soon as device time and counter have told the rate, or after 64 of
    /// them at `nominal_rate`.
    pub fn push(
        &mut self,
        frame: &Frame,
        stamp_ns: u64,
        nominal_rate: f64,
        mut deliver: impl FnMut(SampleRate, TimedSample),
    ) {
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
            if self.last.is_some_and(|(last, _)| timed.seq < last.seq) {
                self.restarts += 1;
            }
            self.rate.push(
                timed,
                self.last
                    .map(|(_, time_us)| (timed, sample.time_us.wrapping_sub(time_us))),
                nominal_rate,
                &mut deliver,
            );
            self.last = Some((timed, sample.time_us));
            if let Rate::Known(rate) = self.rate {
                self.assembler.set_max_span_ns(rate.longest_sample_ns());
            }
        }
    }

    /// Delivers what was kept back for a rate that never became known, at the rate given.
    pub fn finish(&mut self, nominal_rate: f64, mut deliver: impl FnMut(SampleRate, TimedSample)) {
        self.assembler.close();
        self.rate.settle(SampleRate::assumed(nominal_rate), &mut deliver);
    }

    /// Times the sample counter went back.
    #[must_use]
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Whether samples are delivered as they come.
    #[must_use]
    pub fn rate_is_settled(&self) -> bool {
        !matches!(self.rate, Rate::Learning { .. })
    }

    /// Whether the rate is the nominal one because the device's time told none.
    #[must_use]
    pub fn rate_is_assumed(&self) -> bool {
        matches!(self.rate, Rate::Known(SampleRate { told: false, .. }))
    }

    /// What the status frames last said.
    #[must_use]
    pub fn conditions(&self) -> MeasuredConditions {
        self.conditions
    }

    /// What a bus with a layout of its own says.
    pub fn set_conditions(&mut self, conditions: MeasuredConditions) {
        self.conditions = conditions;
    }

    /// Counts of samples delivered and lost.
    #[must_use]
    pub fn stats(&self) -> AssemblerStats {
        self.assembler.stats()
    }

    /// Continues the wrapping counters. A counter that steps back by less than half its range is a restart, and stays
    /// one: the sample number steps back too.
    fn continued(&self, sample: &Sample, stamp_ns: u64) -> TimedSample {
        let (seq, motor_counts, output_counts) = match self.last {
            Some((last, _)) => {
                let step = i64::from(sample.seq.wrapping_sub(last.seq as u16) as i16);
                (
                    last.seq.saturating_add_signed(step),
                    unwrap_motor_counts(last.sensed.motor_counts, sample.motor_counts),
                    unwrap_output_counts(last.sensed.output_counts, sample.output_counts),
                )
            }
            // Far from zero, so that stepping back never saturates; a multiple of 2^16 keeps the low bits.
            None => (
                (1 << 32) + u64::from(sample.seq),
                i64::from(sample.motor_counts),
                i64::from(sample.output_counts),
            ),
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
}

impl SampleRate {
    fn assumed(nominal_hz: f64) -> Self {
        Self {
            hz: nominal_hz,
            told: false,
        }
    }

    /// By the periods that the device's time shows, µs: the mean of those near their median, so that neither one bad stamp
    /// nor the steps of a coarse clock decide. Within a clock's rounding of the nominal rate it is the nominal rate; a
    /// clock that stands still from one sample to the next is too coarse to tell any.
    fn told(periods_us: &mut [u16], nominal_hz: f64) -> Self {
        periods_us.sort_unstable();
        if periods_us[0] == 0 {
            return Self::assumed(nominal_hz);
        }
        let median = f64::from(periods_us[periods_us.len() / 2]);
        let near = periods_us
            .iter()
            .map(|&us| f64::from(us))
            .filter(|us| (0.4 * median..=2.5 * median).contains(us));
        let (count, sum) = near
            .clone()
            .fold((0.0, 0.0), |(count, sum), us| (count + 1.0, sum + us));
        let hz = 1e6 * count / sum;
        // The clock's own step, where it shows: the mean is off by at most one step in all the time summed up.
        let step = near.clone().fold(0, |step, us| gcd(step, us as u16));
        let coarse = near.clone().any(|us| us as u16 != step);
        let rounding = if coarse {
            ROUNDING.max(f64::from(step) / sum)
        } else {
            ROUNDING
        };
        let is_nominal = (hz - nominal_hz).abs() <= rounding * nominal_hz;
        Self {
            hz: if is_nominal { nominal_hz } else { hz },
            told: true,
        }
    }

    /// Largest distance between the stamps of one sample's frames, ns: an eighth of the counter byte's round, so that a
    /// stalled receiver tears few samples apart, and never less than the default. Of a rate that is only assumed, the default.
    fn longest_sample_ns(&self) -> u64 {
        if !self.told {
            return Assembler::DEFAULT_MAX_SPAN_NS;
        }
        ((COUNTER_ROUND / 8.0 / self.hz * 1e9) as u64).max(Assembler::DEFAULT_MAX_SPAN_NS)
    }
}

/// Greatest common divisor; of 0 and a number the number.
fn gcd(a: u16, b: u16) -> u16 {
    if b == 0 { a } else { gcd(b, a % b) }
}

impl Rate {
    fn push(
        &mut self,
        sample: TimedSample,
        since_last: Option<(TimedSample, u16)>,
        nominal_rate: f64,
        deliver: &mut impl FnMut(SampleRate, TimedSample),
    ) {
        match self {
            Self::Known(rate) => deliver(*rate, sample),
            Self::Learning { waiting, periods_us } => {
                if let (Some(previous), Some((_, elapsed_us))) = (waiting.last(), since_last) {
                    let steps = sample.seq.wrapping_sub(previous.seq);
                    if steps == 1 && elapsed_us < LONGEST_PERIOD_US {
                        periods_us.push(elapsed_us);
                    }
                }
                waiting.push(sample);
                if waiting.len() >= RATE_SAMPLES && periods_us.iter().any(|&period_us| period_us > 0) {
                    let rate = SampleRate::told(periods_us, nominal_rate);
                    self.settle(rate, deliver);
                } else if waiting.len() >= RATE_SAMPLES_MAX {
                    // No two samples in a row with a period between them: the nominal rate will have to do.
                    self.settle(SampleRate::assumed(nominal_rate), deliver);
                }
            }
        }
    }

    /// Nothing more is learnt: delivers what has waited.
    fn settle(&mut self, rate: SampleRate, deliver: &mut impl FnMut(SampleRate, TimedSample)) {
        if let Self::Learning { waiting, .. } = self {
            let waiting = std::mem::take(waiting);
            *self = Self::Known(rate);
            for sample in waiting {
                deliver(rate, sample);
            }
        }
    }
}

impl From<&Status> for MeasuredConditions {
    fn from(status: &Status) -> Self {
        Self {
            dc_link_v: (status.dc_link_dv > 0).then(|| quantity::dc_link_v(status.dc_link_dv)),
            winding_temp_deg_c: Some(quantity::winding_temp_deg_c(status.winding_temp_dc)),
            load_torque_nm: status.load_torque_dnm.map(quantity::load_torque_nm),
        }
    }
}

#[cfg(test)]
mod tests {
    use ema_wire::Mode;

    use super::*;

    /// Frames of a 400 Hz stream whose last sample takes `torn_ns` to come in; how many samples came out.
    fn delivered(torn_ns: u64) -> usize {
        let actuator = ActuatorId::new(0).expect("0 to 15");
        let mut channel = Channel::new(actuator);
        let mut count = 0;
        for n in 0..40_u16 {
            let sample = Sample {
                actuator,
                seq: n,
                time_us: n.wrapping_mul(2500),
                i_a_ma: 0,
                i_b_ma: 0,
                i_c_ma: 0,
                motor_counts: 0,
                output_counts: 0,
                setpoint: 0,
                mode: Mode::Idle,
            };
            let sent_ns = u64::from(n) * 2_500_000;
            let torn_ns = if n == 39 { torn_ns } else { 0 };
            for (place, frame) in sample.to_frames().iter().enumerate() {
                let stamp_ns = sent_ns + if place == 0 { 0 } else { torn_ns };
                channel.push(frame, stamp_ns, 400.0, |_, _| count += 1);
            }
        }
        count
    }

    /// The rate by a device clock of so many microseconds, sampled at `hz`, where 400 Hz are expected.
    fn rate(hz: f64, lsb_us: f64) -> SampleRate {
        let count = |n: usize| (((n as f64 * 1e6 / hz) / lsb_us).floor() * lsb_us) as u16;
        let mut periods: Vec<u16> = (1..RATE_SAMPLES).map(|n| count(n) - count(n - 1)).collect();
        SampleRate::told(&mut periods, 400.0)
    }

    #[test]
    fn a_coarse_device_clock_tells_the_nominal_rate() {
        for lsb_us in [1.0, 16.0, 32.0, 64.0, 100.0, 500.0, 1000.0] {
            assert_eq!(rate(400.0, lsb_us).hz.to_bits(), 400f64.to_bits(), "{lsb_us}");
        }
        let too_coarse = rate(400.0, 4000.0);
        assert!(!too_coarse.told);
        assert_eq!(too_coarse.hz.to_bits(), 400f64.to_bits());
        // Jitter does not make the clock coarse: a step of 1 µs.
        let mut jitter: Vec<u16> = (0..15).map(|n| 2490 + 3 * (n % 3)).collect();
        assert!((SampleRate::told(&mut jitter, 402.0).hz - 401.1).abs() < 0.1);
        // Another rate is no rounding.
        assert!((rate(402.3, 1.0).hz - 402.3).abs() < 0.1);
        assert!((rate(625.0, 100.0).hz - 625.0).abs() < 6.0);
    }

    #[test]
    fn a_stall_of_the_receiver_tears_no_sample_apart() {
        assert_eq!(delivered(0), 40);
        assert_eq!(delivered(79_000_000), 40, "32 periods of 2.5 ms");
        assert_eq!(delivered(81_000_000), 39);
    }
}
