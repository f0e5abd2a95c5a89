//! [`Joiner`]: frames of a mapped bus back into samples, never mixing two instants whose counters differ.
//!
//! A sample is delivered when every mapped part of it is in (of two commands, the one that the mode asks for). Parts belong
//! together if
//! - both have a counter, equal in the bits that both have, and their stamps are at most 20 ms apart, and at most a quarter
//!   of the time in which the narrowest counter comes round;
//! - or one of them has none, their stamps are at most half a sample period apart, and neither is there already.
//!
//! A part that belongs to no open sample begins a new one, unless its counter is behind: then it is late and dropped. If a
//! part comes twice and says something else, two senders share an identifier, and the sample is rejected. One sample is
//! held, nothing is queued.
//!
//! A counter of 16 bits and more is passed on as it is. A narrower one is continued: of the numbers that it may stand for,
//! the one nearest to the time that has passed by the stamps.

use std::sync::Arc;

use ema_wire::quantity;
use ema_wire::{ActuatorId, Sample};

use super::latched::{Latched, SampleMaker};
use super::map::{Binding, MessageUse, Role, SignalMap};
use crate::sample::MeasuredConditions;

/// Longest distance between the stamps of one sample's frames, ns; as in `ema_wire`.
const SPAN_MAX_NS: f64 = 20e6;

/// What one frame carried for an actuator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DecodedUpdate {
    /// The sample that it completed, and the stamp of the sample's first frame, ns.
    pub sample: Option<(Sample, u64)>,
    /// The conditions that it changed.
    pub conditions: Option<MeasuredConditions>,
}

/// Collects the frames of one mapped actuator into samples, as [`ema_wire::Assembler`] does on a bus of the built-in layout.
#[derive(Clone, Debug)]
pub struct Joiner {
    map: Arc<SignalMap>,
    rate_hz: f64,
    /// Most between two stamps of one sample, ns: with counters, and without.
    counted_span_ns: u64,
    uncounted_span_ns: u64,
    open: Option<Open>,
    /// Of the sample delivered last: its counter as far as it goes, its number, its stamp.
    last: Option<(u64, u64, u64)>,
    maker: SampleMaker,
    conditions: MeasuredConditions,
    late: u64,
}

/// The sample that is being collected.
#[derive(Clone, Copy, Debug)]
struct Open {
    since_ns: u64,
    /// The widest counter so far, and its bits.
    counter: Option<(u64, u16)>,
    latched: Latched,
    /// Delivered or rejected: nothing more comes of it.
    over: bool,
}

/// Where a part stands relative to the open sample.
enum Place {
    Here,
    New,
    Late,
}

impl Joiner {
    /// For one actuator, sampled `rate_hz` times a second.
    #[must_use]
    pub fn new(actuator: ActuatorId, map: Arc<SignalMap>, rate_hz: f64) -> Self {
        let period_ns = 1e9 / rate_hz;
        let round_ns = f64::powi(2.0, i32::from(map.counter_bits.0)) * period_ns;
        let wraps_after =
            [Role::MotorPosition, Role::OutputPosition].map(|role| binding(&map, role).and_then(|of| of.wraps_after));
        let maker = SampleMaker::new(actuator, map.roles(), map.modes, wraps_after);
        Self {
            rate_hz,
            counted_span_ns: f64::min(SPAN_MAX_NS, round_ns / 4.0) as u64,
            uncounted_span_ns: f64::min(SPAN_MAX_NS, period_ns / 2.0) as u64,
            open: None,
            last: None,
            maker,
            conditions: MeasuredConditions::default(),
            late: 0,
            map,
        }
    }

    /// The frames that come are of another recording: no part, angle or condition continues.
    pub fn begin_recording(&mut self) {
        *self = Self {
            late: self.late,
            ..Self::new(self.maker.actuator(), self.map.clone(), self.rate_hz)
        };
    }

    /// Its map.
    #[must_use]
    pub fn map(&self) -> &SignalMap {
        &self.map
    }

    /// Frames that came after a newer sample had begun.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Takes the data of one frame of message `message` of the map; `None` if it is too short, or one of its floats is no
    /// number.
    pub fn push(&mut self, message: usize, data: &[u8], stamp_ns: u64) -> Option<DecodedUpdate> {
        let map = self.map.clone();
        let message = map
            .messages
            .get(message)
            .filter(|message| data.len() >= message.length)?;
        let mut part = Part::default();
        let mut update = DecodedUpdate::default();
        for binding in &message.bindings {
            let Some(value) = binding.signal.value(data) else {
                continue;
            };
            let value = Some(binding.unit.to_internal(value)).filter(|value| value.is_finite())?;
            if binding.role.is_sampled() {
                part.latched.set(binding.role, value);
            } else {
                self.set_condition(binding.role, value);
                update.conditions = Some(self.conditions);
            }
        }
        part.counter = counter(message, data);
        if part.latched.filled() != 0 || part.counter.is_some() {
            update.sample = self.join(&part, stamp_ns);
        }
        Some(update)
    }

    fn set_condition(&mut self, role: Role, value: f64) {
        // By way of the built-in dictionary's steps, so that a mapped bus gives the same value as a built-in one.
        let conditions = &mut self.conditions;
        match role {
            Role::DcLink => {
                let raw = quantity::dc_link_dv(value);
                conditions.dc_link_v = (raw > 0).then(|| quantity::dc_link_v(raw));
            }
            Role::WindingTemp => {
                let raw = quantity::winding_temp_dc(value);
                conditions.winding_temp_deg_c = Some(quantity::winding_temp_deg_c(raw));
            }
            _ => conditions.load_torque_nm = Some(quantity::load_torque_nm(quantity::load_torque_dnm(value))),
        }
    }

    fn join(&mut self, part: &Part, stamp_ns: u64) -> Option<(Sample, u64)> {
        match self.place(part, stamp_ns) {
            Place::Here => {}
            Place::New => {
                self.open = Some(Open {
                    since_ns: stamp_ns,
                    counter: None,
                    latched: Latched::default(),
                    over: false,
                });
            }
            Place::Late => {
                self.late += 1;
                return None;
            }
        }
        let open = self.open.as_mut()?;
        open.add(part);
        // The widest counter numbers the sample.
        let counted = open.counter.is_some_and(|(_, bits)| bits == self.map.counter_bits.1);
        if open.over || !counted || !self.maker.is_complete(&open.latched) {
            return None;
        }
        open.over = true;
        let open = *open;
        let number = self.number(&open);
        Some((self.maker.sample(&open.latched, number), open.since_ns))
    }

    fn place(&self, part: &Part, stamp_ns: u64) -> Place {
        let Some(open) = &self.open else { return Place::New };
        let apart_ns = open.since_ns.abs_diff(stamp_ns);
        match (open.counter, part.counter) {
            (Some((open_count, open_bits)), Some((count, bits))) => {
                if apart_ns > self.counted_span_ns {
                    return Place::New;
                }
                let bits = open_bits.min(bits).min(64);
                let ahead = count.wrapping_sub(open_count) << (64 - bits);
                match ahead.cast_signed() {
                    0 => Place::Here,
                    1.. => Place::New,
                    _ => Place::Late,
                }
            }
            _ if apart_ns <= self.uncounted_span_ns && open.latched.filled() & part.latched.filled() == 0 => {
                Place::Here
            }
            _ => Place::New,
        }
    }

    /// The sample's number, its low 16 bits.
    fn number(&mut self, open: &Open) -> u16 {
        let (counter, bits) = open.counter.unwrap_or_default();
        if bits >= 16 {
            return counter as u16;
        }
        let number = self.last.map_or(counter, |(last_counter, last_number, last_ns)| {
            let round = 1_u64 << bits;
            let ahead = counter.wrapping_sub(last_counter) % round;
            let periods = open.since_ns.saturating_sub(last_ns) as f64 * 1e-9 * self.rate_hz;
            let rounds = f64::round((periods - ahead as f64) / round as f64).max(0.0) as u64;
            last_number.wrapping_add(ahead).wrapping_add(rounds.wrapping_mul(round))
        });
        self.last = Some((counter, number, open.since_ns));
        number as u16
    }
}

/// What one frame adds to a sample.
#[derive(Default)]
struct Part {
    counter: Option<(u64, u16)>,
    latched: Latched,
}

impl Open {
    fn add(&mut self, part: &Part) {
        self.over |= self.latched.add(&part.latched);
        let bits = |counter: Option<(u64, u16)>| counter.map_or(0, |(_, bits)| bits);
        if bits(part.counter) > bits(self.counter) {
            self.counter = part.counter;
        }
    }
}

fn binding(map: &SignalMap, role: Role) -> Option<&Binding> {
    map.messages
        .iter()
        .flat_map(|of| &of.bindings)
        .find(|of| of.role == role)
}

fn counter(message: &MessageUse, data: &[u8]) -> Option<(u64, u16)> {
    let counter = message.counters.iter().find(|counter| counter.is_in(data))?;
    Some((counter.layout.raw(data)?, counter.layout.size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dbc::{Layout, ModeCodes, Signal, SignalKind, Unit};

    #[test]
    fn no_condition_of_a_recording_holds_in_the_next() {
        let binding = |role, start| Binding {
            role,
            signal: Signal {
                layout: Layout {
                    start,
                    size: 8,
                    big_endian: false,
                },
                kind: SignalKind::Unsigned,
                factor: 1.0,
                offset: 0.0,
                selectors: Vec::new(),
            },
            unit: Unit::SAME,
            wraps_after: None,
        };
        let message = |id, role| MessageUse {
            name: "status".to_owned(),
            id,
            extended: false,
            length: 1,
            bindings: vec![binding(role, 0)],
            counters: Vec::new(),
        };
        let map = SignalMap {
            messages: vec![message(1, Role::DcLink), message(2, Role::WindingTemp)],
            modes: ModeCodes::default(),
            counter_bits: (16, 16),
        };
        let mut joiner = Joiner::new(ActuatorId::new(0).expect("a number"), Arc::new(map), 400.0);
        let mut links = Vec::new();
        for _ in 0..2 {
            let update = joiner.push(1, &[60], 1).expect("a frame");
            links.push(update.conditions.expect("conditions").dc_link_v);
            let update = joiner.push(0, &[48], 2).expect("a frame");
            links.push(update.conditions.expect("conditions").dc_link_v);
            joiner.begin_recording();
        }
        assert_eq!(links, [None, Some(48.0), None, Some(48.0)]);
    }
}
