//! The catalogue of the suite: mistakes in sensors, wires and configured numbers, each with the law of its size.
//!
//! A mistake changes the recorded samples, the reported conditions or the configuration, whichever it is in reality; the actuator
//! and its drive work on.

mod shown;

use ema_models::{SensedSample, Setpoint};
use ema_wire::can::Status;
use hmd_core::sensor_checks::Suspect;
use rand::{Rng, RngExt};

pub(super) use shown::Truth;

/// One mistake of the catalogue.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mistake {
    /// Name of the entry.
    pub(super) name: &'static str,
    /// What it is.
    kind: Kind,
    /// The suspects that name it rightly; empty where nothing is wrong.
    pub(super) suspects: &'static [Suspect],
}

/// What is wrong.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Nothing,
    /// The load reads this many times itself.
    LoadTimes(f64),
    /// The load reads that of another actuation.
    LoadStuck,
    /// The link reads this many times itself.
    LinkTimes(f64, f64),
    /// The link reads its nominal voltage while the supply is at this share of it.
    LinkStuck(f64, f64),
    /// The temperature reads this, °C.
    TemperatureReads(f64),
    /// One phase is off by this current, A for `bench`.
    OffsetOfOne(f64, f64),
    /// Two phases are off by as much to either side.
    OffsetsOpposite(f64, f64),
    /// All currents read this many times themselves.
    GainOfAll(f64, f64),
    /// One current does.
    GainOfOne(f64, f64),
    PhasesSwapped,
    OnePhaseReversed,
    AllPhasesReversed,
    /// The resolver is off by this angle, degrees electrical, to either side.
    ResolverOff(f64, f64),
    ResolverReversed,
    ResolverTwice,
    /// One pole pair more or fewer in the configuration.
    PolePairOff,
    EncoderReversed,
    /// The output angle is off by this much, rad, to either side.
    EncoderOff(f64, f64),
    /// The configured gear ratio is this many times the real one.
    GearRatioTimes(f64, f64),
    /// The set point reads this many times itself.
    SetpointTimes(f64),
    /// The set point is this late, s.
    SetpointLate(f64, f64),
    AlwaysIdle,
    /// A channel stands still from an instant of the motion on.
    Frozen(Channel),
    /// One of so many samples holds what the one before held.
    Repeated(u64, u64),
    /// A channel is late by one sample.
    Late(Channel),
}

/// Part of a sample.
#[derive(Clone, Copy, Debug)]
enum Channel {
    OneCurrent,
    Currents,
    Resolver,
    Encoder,
}

const fn mistake(name: &'static str, kind: Kind, suspects: &'static [Suspect]) -> Mistake {
    Mistake { name, kind, suspects }
}

/// Name of the entry without a mistake.
pub(super) const CONTROL: &str = "none";

/// All entries.
pub(super) const MISTAKES: [Mistake; 33] = {
    use Channel::{Currents, Encoder, OneCurrent, Resolver};
    use Kind::{
        AllPhasesReversed, AlwaysIdle, EncoderOff, EncoderReversed, Frozen, GainOfAll, GainOfOne, GearRatioTimes, Late,
        LinkStuck, LinkTimes, LoadStuck, LoadTimes, Nothing, OffsetOfOne, OffsetsOpposite, OnePhaseReversed,
        PhasesSwapped, PolePairOff, Repeated, ResolverOff, ResolverReversed, ResolverTwice, SetpointLate,
        SetpointTimes, TemperatureReads,
    };
    [
        mistake(CONTROL, Nothing, &[]),
        mistake("load_zero", LoadTimes(0.0), &[Suspect::LoadSensor]),
        mistake("load_inverted", LoadTimes(-1.0), &[Suspect::LoadSensor]),
        mistake("load_tenth", LoadTimes(0.1), &[Suspect::LoadSensor]),
        mistake("load_stuck", LoadStuck, &[Suspect::LoadSensor]),
        mistake("link_low", LinkTimes(0.8, 0.9), &[Suspect::DcLink]),
        mistake("link_high", LinkTimes(1.1, 1.25), &[Suspect::DcLink]),
        mistake("link_stuck", LinkStuck(0.75, 0.88), &[Suspect::DcLink]),
        mistake(
            "temperature_stuck",
            TemperatureReads(-40.0),
            &[Suspect::WindingTemperature],
        ),
        mistake("offset_one", OffsetOfOne(0.15, 0.3), &[Suspect::CurrentOffset]),
        mistake("offset_opposite", OffsetsOpposite(0.15, 0.3), &[Suspect::CurrentOffset]),
        mistake("gain_low", GainOfAll(0.8, 0.92), &[Suspect::CurrentGain]),
        mistake("gain_high", GainOfAll(1.08, 1.3), &[Suspect::CurrentGain]),
        mistake("gain_one", GainOfOne(0.85, 0.93), &[Suspect::PhaseGain]),
        mistake("phases_swapped", PhasesSwapped, &[Suspect::PhaseOrder]),
        mistake("phase_reversed", OnePhaseReversed, &[Suspect::CurrentSign]),
        mistake("currents_reversed", AllPhasesReversed, &[Suspect::CurrentSign]),
        mistake("resolver_zero", ResolverOff(5.0, 15.0), &[Suspect::ResolverZero]),
        mistake("resolver_reversed", ResolverReversed, &[Suspect::ResolverDirection]),
        mistake("resolver_twice", ResolverTwice, &[Suspect::ResolverCounts]),
        mistake("pole_pair_off", PolePairOff, &[Suspect::PolePairs]),
        mistake("encoder_reversed", EncoderReversed, &[Suspect::EncoderDirection]),
        mistake("encoder_zero", EncoderOff(0.01, 0.1), &[Suspect::EncoderZero]),
        mistake("gear_ratio", GearRatioTimes(1.15, 1.3), &[Suspect::GearRatio]),
        mistake("setpoint_thousandth", SetpointTimes(1e-3), &[Suspect::SetpointUnit]),
        mistake(
            "setpoint_degrees",
            SetpointTimes(180.0 / core::f64::consts::PI),
            &[Suspect::SetpointUnit],
        ),
        mistake("setpoint_late", SetpointLate(0.03, 0.07), &[Suspect::SetpointDelay]),
        mistake("mode_idle", AlwaysIdle, &[Suspect::Mode]),
        mistake("phase_frozen", Frozen(OneCurrent), &[Suspect::CurrentFrozen]),
        mistake("resolver_frozen", Frozen(Resolver), &[Suspect::ResolverFrozen]),
        mistake("encoder_frozen", Frozen(Encoder), &[Suspect::EncoderFrozen]),
        mistake("sample_repeated", Repeated(4, 12), &[Suspect::RepeatedSamples]),
        mistake("currents_late", Late(Currents), &[Suspect::SampleOrder]),
    ]
};

/// A mistake with its size drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drawn {
    kind: Kind,
    /// Place of the size in its range, [0, 1).
    share: f64,
    /// The same for the instant.
    instant: f64,
    sign: f64,
    phase: usize,
}

impl Mistake {
    /// Draws the size.
    pub(super) fn draw(&self, rng: &mut impl Rng) -> Drawn {
        Drawn {
            kind: self.kind,
            share: rng.random_range(0.0..1.0),
            instant: rng.random_range(0.0..1.0),
            sign: if rng.random_bool(0.5) { 1.0 } else { -1.0 },
            phase: rng.random_range(0..3),
        }
    }
}

/// What the configuration says of the type.
#[derive(Clone, Copy, Debug)]
pub(super) struct Configured {
    pub(super) pole_pairs: f64,
    pub(super) gear_ratio: f64,
}

/// Largest current of `bench`, A: offsets of other types are scaled by theirs.
const BENCH_I_MAX_A: f64 = 10.7;

/// Time in which a channel may freeze, s from the start of the motion.
const FREEZES_S: [f64; 2] = [0.05, 0.3];

impl Drawn {
    fn between(&self, low: f64, high: f64) -> f64 {
        low + self.share * (high - low)
    }

    /// Share of the nominal supply that the unit gets.
    pub(super) fn supply_share(&self) -> f64 {
        match self.kind {
            Kind::LinkStuck(low, high) => self.between(low, high),
            _ => 1.0,
        }
    }

    /// Numbers of the configuration where the real ones are these.
    pub(super) fn configured(&self, real: Configured) -> Configured {
        match self.kind {
            Kind::PolePairOff => Configured {
                pole_pairs: real.pole_pairs + self.sign,
                ..real
            },
            Kind::GearRatioTimes(low, high) => Configured {
                gear_ratio: real.gear_ratio * self.between(low, high),
                ..real
            },
            _ => real,
        }
    }

    /// What the status reports where it should report this; `nominal_dv` is the nominal supply, 0.1 V, and `other_load_dnm` the
    /// load of another actuation, 0.1 Nm.
    pub(super) fn reported(&self, status: Status, nominal_dv: u16, other_load_dnm: i16) -> Status {
        let times = |value: f64, factor: f64| (value * factor).round();
        match self.kind {
            Kind::LoadTimes(factor) => Status {
                load_torque_dnm: status.load_torque_dnm.map(|load| times(f64::from(load), factor) as i16),
                ..status
            },
            Kind::LoadStuck => Status {
                load_torque_dnm: Some(other_load_dnm),
                ..status
            },
            Kind::LinkTimes(low, high) => Status {
                dc_link_dv: times(f64::from(status.dc_link_dv), self.between(low, high)) as u16,
                ..status
            },
            Kind::LinkStuck(..) => Status {
                dc_link_dv: nominal_dv,
                ..status
            },
            Kind::TemperatureReads(deg_c) => Status {
                winding_temp_dc: (10.0 * deg_c) as i16,
                ..status
            },
            _ => status,
        }
    }

    /// The samples as they are recorded: taken at `rate_hz`, the motion begins at `begin_s`, the largest current is `i_max`.
    pub(super) fn recorded(
        &self,
        mut samples: Vec<SensedSample>,
        pole_pairs: f64,
        rate_hz: f64,
        begin_s: f64,
        i_max: f64,
    ) -> Vec<SensedSample> {
        let one_by_one: Box<dyn Fn(&mut SensedSample)> = match self.kind {
            Kind::OffsetOfOne(low, high) => {
                let offset = self.sign * self.between(low, high) * i_max / BENCH_I_MAX_A;
                Box::new(move |s| s.currents[self.phase] += offset)
            }
            Kind::OffsetsOpposite(low, high) => {
                let offset = self.sign * self.between(low, high) * i_max / BENCH_I_MAX_A;
                Box::new(move |s| {
                    s.currents[self.phase] += offset;
                    s.currents[(self.phase + 1) % 3] -= offset;
                })
            }
            Kind::GainOfAll(low, high) => {
                let gain = self.between(low, high);
                Box::new(move |s| s.currents = s.currents.map(|i| gain * i))
            }
            Kind::GainOfOne(low, high) => {
                let gain = self.between(low, high);
                Box::new(move |s| s.currents[self.phase] *= gain)
            }
            Kind::PhasesSwapped => Box::new(move |s| s.currents.swap(self.phase, (self.phase + 1) % 3)),
            Kind::OnePhaseReversed => Box::new(move |s| s.currents[self.phase] *= -1.0),
            Kind::AllPhasesReversed => Box::new(|s| s.currents = s.currents.map(|i| -i)),
            Kind::ResolverOff(low, high) => {
                let turns = self.sign * self.between(low, high) / 360.0 / pole_pairs;
                Box::new(move |s| s.motor_counts += (turns * 65_536.0).round() as i64)
            }
            Kind::ResolverReversed => Box::new(|s| s.motor_counts = -s.motor_counts),
            Kind::ResolverTwice => Box::new(|s| s.motor_counts *= 2),
            Kind::EncoderReversed => Box::new(|s| s.output_counts = -s.output_counts),
            Kind::EncoderOff(low, high) => {
                let turns = self.sign * self.between(low, high) / core::f64::consts::TAU;
                Box::new(move |s| s.output_counts += (turns * 20_000.0).round() as i64)
            }
            Kind::SetpointTimes(factor) => Box::new(move |s| s.setpoint = times(s.setpoint, factor)),
            Kind::AlwaysIdle => Box::new(|s| s.setpoint = Setpoint::Idle),
            _ => Box::new(|_| ()),
        };
        samples.iter_mut().for_each(one_by_one);
        self.in_time(samples, rate_hz, begin_s)
    }

    /// Mistakes that concern the order of the samples.
    fn in_time(&self, mut samples: Vec<SensedSample>, rate_hz: f64, begin_s: f64) -> Vec<SensedSample> {
        let original = samples.clone();
        match self.kind {
            Kind::SetpointLate(low, high) => {
                let late = (self.between(low, high) * rate_hz).round() as usize;
                for (n, sample) in samples.iter_mut().enumerate() {
                    sample.setpoint = original[n.saturating_sub(late)].setpoint;
                }
            }
            Kind::Frozen(channel) => {
                let at = begin_s + FREEZES_S[0] + self.instant * (FREEZES_S[1] - FREEZES_S[0]);
                let from = ((at * rate_hz) as usize).min(original.len() - 1);
                for sample in &mut samples[from..] {
                    self.copy(channel, &original[from], sample);
                }
            }
            Kind::Repeated(least, most) => {
                let every = self.between(least as f64, most as f64).round() as usize;
                for n in (every..samples.len()).step_by(every) {
                    samples[n] = SensedSample {
                        seq: original[n].seq,
                        ..original[n - 1]
                    };
                }
            }
            Kind::Late(channel) => {
                for n in 1..samples.len() {
                    self.copy(channel, &original[n - 1], &mut samples[n]);
                }
            }
            _ => {}
        }
        samples
    }

    fn copy(&self, channel: Channel, from: &SensedSample, to: &mut SensedSample) {
        match channel {
            Channel::OneCurrent => to.currents[self.phase] = from.currents[self.phase],
            Channel::Currents => to.currents = from.currents,
            Channel::Resolver => to.motor_counts = from.motor_counts,
            Channel::Encoder => to.output_counts = from.output_counts,
        }
    }
}

fn times(setpoint: Setpoint, factor: f64) -> Setpoint {
    match setpoint {
        Setpoint::Idle => Setpoint::Idle,
        Setpoint::Position(angle) => Setpoint::Position(factor * angle),
        Setpoint::Speed(speed) => Setpoint::Speed(factor * speed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_are_unique_and_every_mistake_has_a_suspect() {
        let names: BTreeSet<&str> = MISTAKES.iter().map(|mistake| mistake.name).collect();
        assert_eq!(names.len(), MISTAKES.len());
        for mistake in &MISTAKES {
            assert_eq!(mistake.suspects.is_empty(), mistake.name == CONTROL, "{}", mistake.name);
        }
    }
}
