//! The quantities of one instant -> [`Sample`], in the steps of the built-in dictionary, whatever they came from.

use ema_wire::quantity;
use ema_wire::{ActuatorId, Mode, Sample};

use super::map::{ModeCodes, Role};

/// Quantities latched at one instant, in internal units.
#[derive(Clone, Copy, Debug, Default)]
pub struct Latched {
    values: [f64; Role::SAMPLED],
    filled: u16,
}

impl Latched {
    /// Sets a quantity of a sample; one that changes slowly has no place here.
    pub fn set(&mut self, role: Role, value: f64) {
        if let Some(place) = self.values.get_mut(role as usize) {
            *place = value;
            self.filled |= bit(role);
        }
    }

    /// The value of a quantity; 0 where it is not there.
    #[must_use]
    pub fn value(&self, role: Role) -> f64 {
        self.values.get(role as usize).copied().unwrap_or(0.0)
    }

    fn has(&self, role: Role) -> bool {
        self.filled & bit(role) != 0
    }

    /// The quantities that are there, a bit each.
    pub(super) fn filled(&self) -> u16 {
        self.filled
    }

    /// Takes over what another has; whether both had a quantity and it was another value.
    pub(super) fn add(&mut self, other: &Self) -> bool {
        let mut differs = false;
        for n in (0..Role::SAMPLED).filter(|n| other.filled & (1 << n) != 0) {
            differs |= self.filled & (1 << n) != 0 && self.values[n].to_bits() != other.values[n].to_bits();
            self.values[n] = other.values[n];
        }
        self.filled |= other.filled;
        differs
    }
}

/// Makes samples of one actuator.
#[derive(Clone, Debug)]
pub struct SampleMaker {
    actuator: ActuatorId,
    mapped: u16,
    modes: ModeCodes,
    /// Of the motor's angle and of the output's.
    turns: [Turns; 2],
    part_of_count: Option<PartOfCount>,
}

/// Where the output angles of a log lie between counts. Rounding would move them by that part of a count, and the command not.
#[derive(Clone, Copy, Debug)]
struct PartOfCount {
    rad_per_count: f64,
    /// Part of a count at the first sample, −0.5 to 0.5.
    part: Option<f64>,
}

impl PartOfCount {
    /// Part of a count that is taken for none: what conversions round.
    const LEAST: f64 = 0.01;

    /// The part of a count, by the first angle that is given, counts; and the angle that it is, rad.
    fn of(&mut self, angle: f64) -> [f64; 2] {
        let found = angle - angle.round();
        let found = if found.abs() >= Self::LEAST { found } else { 0.0 };
        let part = *self.part.get_or_insert(found);
        [part, part * self.rad_per_count]
    }
}

/// An angle that begins again.
#[derive(Clone, Copy, Debug, Default)]
struct Turns {
    wraps_after: Option<f64>,
    last: Option<f64>,
    done: f64,
    /// The value continued last.
    continued: f64,
}

impl SampleMaker {
    /// For an actuator of which these quantities are mapped; `wraps_after` is the difference after which the motor's angle and the
    /// output's begin again, in the internal unit.
    #[must_use]
    pub fn new(
        actuator: ActuatorId,
        mapped: impl Iterator<Item = Role>,
        modes: ModeCodes,
        wraps_after: [Option<f64>; 2],
    ) -> Self {
        let sampled = mapped.filter(|role| role.is_sampled());
        Self {
            actuator,
            mapped: sampled.fold(0, |bits, role| bits | bit(role)),
            modes,
            turns: wraps_after.map(|wraps_after| Turns {
                wraps_after,
                ..Turns::default()
            }),
            part_of_count: None,
        }
    }

    /// The same for angles whose zero may lie anywhere between counts of the output, of this size: the part of a count is taken from
    /// output and command alike. For what is read from its beginning: the first sample decides.
    #[must_use]
    pub fn with_any_zero(mut self, output_rad_per_count: f64) -> Self {
        self.part_of_count = Some(PartOfCount {
            rad_per_count: output_rad_per_count,
            part: None,
        });
        self
    }

    /// Whose samples they are.
    pub(super) fn actuator(&self) -> ActuatorId {
        self.actuator
    }

    /// Whether every quantity is there that belongs to a sample; of two commands, the one that the mode asks for.
    #[must_use]
    pub fn is_complete(&self, latched: &Latched) -> bool {
        let commands = bit(Role::CommandPosition) | bit(Role::CommandSpeed);
        let command = match self.mode(latched) {
            Mode::Idle => 0,
            Mode::Position => bit(Role::CommandPosition),
            Mode::Speed => bit(Role::CommandSpeed),
        };
        let wanted = self.mapped & !commands | command;
        latched.filled & wanted == wanted
    }

    /// What is commanded; a mode whose command is not mapped counts as idle.
    fn mode(&self, latched: &Latched) -> Mode {
        let has = |role: Role| self.mapped & bit(role) != 0;
        let mode = if has(Role::Mode) {
            let code = latched.value(Role::Mode).round() as i64;
            let modes = [(self.modes.position, Mode::Position), (self.modes.speed, Mode::Speed)];
            modes
                .into_iter()
                .find(|(of, _)| *of == code)
                .map_or(Mode::Idle, |(_, mode)| mode)
        } else if has(Role::CommandPosition) {
            Mode::Position
        } else {
            Mode::Speed
        };
        match mode {
            Mode::Position if has(Role::CommandPosition) => mode,
            Mode::Speed if has(Role::CommandSpeed) => mode,
            _ => Mode::Idle,
        }
    }

    /// The motor's angle of the next sample, with all its turns; asking twice changes nothing.
    pub fn continue_motor(&mut self, angle: f64) -> f64 {
        self.turns[0].continued(angle)
    }

    /// Counts of the motor's angle in the sample made last, with all its turns.
    #[must_use]
    pub fn motor_counts(&self) -> f64 {
        self.turns[0].continued
    }

    /// The mode of a sample: idle as long as the mode, or the command that it asks for, never had a value.
    fn commanded(&self, latched: &Latched) -> Mode {
        let is_known = self.mapped & bit(Role::Mode) == 0 || latched.has(Role::Mode);
        match self.mode(latched) {
            Mode::Position if is_known && latched.has(Role::CommandPosition) => Mode::Position,
            Mode::Speed if is_known && latched.has(Role::CommandSpeed) => Mode::Speed,
            _ => Mode::Idle,
        }
    }

    /// The sample of number `seq`; without a third current the star point gives it.
    pub fn sample(&mut self, latched: &Latched, seq: u16) -> Sample {
        let value = |role: Role| latched.value(role);
        let [a, b] = [value(Role::CurrentA), value(Role::CurrentB)];
        let c = if latched.has(Role::CurrentC) {
            value(Role::CurrentC)
        } else {
            -a - b
        };
        let mode = self.commanded(latched);
        let angles =
            [(0, Role::MotorPosition), (1, Role::OutputPosition)].map(|(n, role)| self.turns[n].continued(value(role)));
        let of_count = self.part_of_count.as_mut();
        let [part, part_rad] = of_count.map_or([0.0; 2], |of_count| of_count.of(angles[1]));
        let setpoint = match mode {
            Mode::Idle => 0,
            Mode::Position => quantity::position_setpoint_urad(value(Role::CommandPosition) - part_rad),
            Mode::Speed => quantity::speed_setpoint_mrad_s(value(Role::CommandSpeed)),
        };
        let counts = [angles[0], angles[1] - part].map(|angle| angle.round() as i64);
        Sample {
            actuator: self.actuator,
            seq,
            time_us: value(Role::Time).rem_euclid(65_536.0) as u16,
            i_a_ma: quantity::current_ma(a),
            i_b_ma: quantity::current_ma(b),
            i_c_ma: quantity::current_ma(c),
            motor_counts: counts[0] as i32,
            output_counts: quantity::wrap_s24(counts[1]),
            setpoint,
            mode,
        }
    }
}

impl Turns {
    /// The value with all the turns before it: the nearest to the one before.
    fn continued(&mut self, value: f64) -> f64 {
        let range = self.wraps_after.unwrap_or(0.0);
        if let (Some(range), Some(last)) = (self.wraps_after, self.last) {
            self.done += f64::round((last - value) / range);
        }
        self.last = Some(value);
        self.continued = value + self.done * range;
        self.continued
    }
}

fn bit(role: Role) -> u16 {
    1 << role as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    const RAD_PER_COUNT: f64 = 3.2e-4;

    /// Output counts and set points of angles and commands, counts, of a log.
    fn samples(angles: &[[f64; 2]]) -> Vec<(i32, i32)> {
        let roles = [Role::OutputPosition, Role::CommandPosition];
        let actuator = ActuatorId::new(0).unwrap();
        let maker = SampleMaker::new(actuator, roles.into_iter(), ModeCodes::default(), [None; 2]);
        let mut maker = maker.with_any_zero(RAD_PER_COUNT);
        let mut sample = |[angle, command]: &[f64; 2]| {
            let mut latched = Latched::default();
            latched.set(Role::OutputPosition, *angle);
            latched.set(Role::CommandPosition, command * RAD_PER_COUNT);
            let sample = maker.sample(&latched, 0);
            (sample.output_counts, sample.setpoint)
        };
        angles.iter().map(&mut sample).collect()
    }

    #[test]
    fn angles_between_counts_keep_their_distance_from_the_command() {
        let on_counts = [[3.0, 3.0], [7.0, 7.25], [-12.0, -40.5]];
        for part in [0.0_f64, 0.009, 0.3, -0.45, 0.499] {
            let between = on_counts.map(|both| both.map(|angle| angle + part));
            let expected = if part.abs() < PartOfCount::LEAST {
                between
            } else {
                on_counts
            };
            let setpoints = expected.map(|[_, command]| (command * RAD_PER_COUNT * 1e6).round() as i32);
            let found = samples(&between);
            assert_eq!(
                found.iter().map(|(output, _)| *output).collect::<Vec<_>>(),
                [3, 7, -12],
                "{part}"
            );
            for ((_, found), expected) in found.iter().zip(setpoints) {
                assert!((found - expected).abs() <= 1, "{part}: {found} for {expected}");
            }
        }
        // A first value that is no number decides nothing.
        assert_eq!(samples(&[[f64::NAN, 0.0], [5.3, 5.0]])[1], (5, 1600));
    }
}
