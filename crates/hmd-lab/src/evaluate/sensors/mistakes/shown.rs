//! Whether a motion shows a mistake, by what is true of it and never by what the program finds.
//!
//! A mistake in a reading or in the currents counts as shown where no actuator of the type, whatever is worn, makes this motion with what
//! was read: beyond four standard deviations of noise and tolerances. Other mistakes break a relation between the signals of every motion.
//!
//! | reading | what it contradicts |
//! |---|---|
//! | load | both ways: the load itself; one way: dry friction between that of a new and of a worn-out gear |
//! | link | its configured value; read as configured, the voltage that the motor needs |
//! | gain of all currents, temperature | the torque for each ampere, by the current that accelerates; the limit of the drive |
//! | gain of one current | the sum of the currents |
//! | frozen angle | the angle that moved on |

use ema_models::{ActuatorParams, DriveKind, FaultVector, Real, SensedSample, Tolerances, dq_from_abc};
use nalgebra::{Matrix3, Vector3};

use super::{Channel, Drawn, Kind};

/// What is true of a window, and what was recorded of it.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Truth<'a> {
    /// The type, with the sample rate of the window.
    pub(in super::super) nominal: &'a ActuatorParams,
    pub(in super::super) drive: DriveKind,
    pub(in super::super) fault: &'a FaultVector,
    /// Load at the output, Nm, and what was read of it.
    pub(in super::super) load_nm: f64,
    pub(in super::super) load_read_nm: f64,
    /// Noise of each phase, A rms.
    pub(in super::super) noise_rms_a: f64,
    /// The samples without and with the mistake.
    pub(in super::super) right: &'a [SensedSample],
    pub(in super::super) wrong: &'a [SensedSample],
    /// Whether the unit was commissioned.
    pub(in super::super) is_commissioned: bool,
}

/// Standard deviations that a mistake exceeds.
const SIGMAS: f64 = 4.0;

/// Scatter of the torque for each ampere, and of friction as it warms up, of one unit from window to window, as shares.
const REPEATED_TORQUE: f64 = 5e-3;
const REPEATED_FRICTION: f64 = 0.15;

/// Difference of the frictions in both directions, as a share.
const ONE_WAY_FRICTION: f64 = 0.05;

/// Friction of a worn-out gear, in multiples of a new one's.
const WORN_OUT: f64 = 3.0;

/// Speed from which on a motor moves, rad/s, and time for which it does in one direction, or holds a limit, s.
const SPEED_MIN: f64 = 3.0;
const LASTS_S: f64 = 0.01;

/// Share of a limit from which on it is reached.
const AT_LIMIT: f64 = 0.95;

/// Least change of the torque for each ampere with temperature, 1/K: magnets of samarium-cobalt.
const TORQUE_PER_KELVIN: f64 = 0.4e-3;

/// Winding temperature of the simulated units, °C.
const TEMPERATURE_DEG_C: f64 = 20.0;

/// Counts of the encoder that an angle moves on before anything shows it.
const FROZEN_COUNTS: f64 = 8.0;

impl Drawn {
    /// Whether the motion shows the mistake.
    pub(in super::super) fn is_shown(&self, truth: &Truth<'_>) -> bool {
        let usual = Tolerances::USUAL;
        match self.kind {
            Kind::LoadTimes(_) | Kind::LoadStuck => truth.contradicts_load(),
            Kind::LinkTimes(low, high) => (self.between(low, high) - 1.0).abs() > SIGMAS * usual.v_dc,
            Kind::LinkStuck(..) => truth.needs_voltage(self.supply_share()),
            Kind::TemperatureReads(deg_c) => {
                TORQUE_PER_KELVIN * (deg_c - TEMPERATURE_DEG_C).abs() > SIGMAS * truth.torque_sigma()
            }
            Kind::GainOfAll(low, high) => {
                let gain = self.between(low, high);
                let by_limit =
                    gain - 1.0 > SIGMAS * usual.i_max.hypot(usual.current_gain) && truth.holds_current_limit();
                by_limit || (1.0 / gain - 1.0).abs() > SIGMAS * truth.torque_sigma()
            }
            Kind::GainOfOne(..) => truth.error_of_sum() > SIGMAS,
            Kind::Frozen(Channel::Resolver) => {
                let lsb = truth.nominal.sensors.motor_lsb() / truth.nominal.transmission.gear_ratio;
                truth.moved_on(|sample| lsb * sample.motor_counts as f64)
            }
            Kind::Frozen(Channel::Encoder) => {
                let lsb = truth.nominal.sensors.output_lsb();
                truth.moved_on(|sample| lsb * sample.output_counts as f64)
            }
            _ => true,
        }
    }
}

impl Truth<'_> {
    /// Speed of the motor and quadrature current of each inner sample.
    fn motion(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let (sensors, motor) = (&self.nominal.sensors, &self.nominal.motor);
        self.right.windows(3).map(|near| {
            let turned = (near[2].motor_counts - near[0].motor_counts) as f64;
            let angle = (near[1].motor_counts as f64 + 0.5) * sensors.motor_lsb();
            let [_, i_q] = dq_from_abc(near[1].currents, (motor.pole_pairs * angle).sin_cos_poly());
            (0.5 * turned * sensors.motor_lsb() * sensors.sample_rate, i_q)
        })
    }

    /// Whether a condition holds at so many samples as last [`LASTS_S`].
    fn lasts(&self, holds: impl Fn(f64, f64) -> bool) -> bool {
        let count = self.motion().filter(|&(speed, i_q)| holds(speed, i_q)).count();
        count as f64 >= (LASTS_S * self.nominal.sensors.sample_rate).max(2.0)
    }

    /// Whether the motor could not have moved so under the load that was read. In one direction d the torque `s T_d n + d L'` is known, L'
    /// the load with the losses of the gear, so that the load read asks for another friction s.
    fn contradicts_load(&self) -> bool {
        let transmission = &self.nominal.transmission;
        let friction = transmission.friction_dynamic * transmission.gear_ratio;
        let efficiency = Tolerances::USUAL.efficiency_opposing;
        let (load, read) = (self.load_nm, self.load_read_nm);
        let [forward, backward] = [1.0, -1.0].map(|sign| self.lasts(|speed, _| sign * speed > SPEED_MIN));
        if forward && backward {
            let sigma = (efficiency * load.abs().max(read.abs())).hypot(ONE_WAY_FRICTION * friction);
            return (read - load).abs() > SIGMAS * sigma;
        }
        let direction = if forward { 1.0 } else { -1.0 };
        let [opposing, aiding] = transmission.gear_loss_shares();
        let with_loss = |load: f64| {
            let along = direction * load;
            along * if along > 0.0 { 1.0 + opposing } else { 1.0 - aiding }
        };
        let needed = self.fault.friction_factor() + (with_loss(load) - with_loss(read)) / friction;
        let of_friction = if self.is_commissioned {
            REPEATED_FRICTION
        } else {
            Tolerances::USUAL.friction_dynamic
        };
        let largest = with_loss(load).abs().max(with_loss(read).abs()) / friction;
        let sigma = of_friction.hypot(efficiency * largest);
        (forward || backward) && !(1.0 - SIGMAS * sigma..=WORN_OUT + SIGMAS * sigma).contains(&needed)
    }

    /// Whether the motor needs the voltage that a supply of this share of the nominal one lacks: `|R i_q + k ω, ω_e L i_q|` reaches
    /// `V_dc / √3`.
    fn needs_voltage(&self, supply_share: f64) -> bool {
        let motor = &self.nominal.motor;
        let limit = AT_LIMIT * supply_share * motor.v_dc / 3.0_f64.sqrt();
        self.lasts(|speed, i_q| {
            let across = motor.pole_pairs * speed * motor.l_s * i_q;
            (motor.r_s * i_q + motor.k * speed).hypot(across) > limit
        })
    }

    fn holds_current_limit(&self) -> bool {
        let limit = AT_LIMIT * self.nominal.motor.i_max;
        self.lasts(|_, i_q| i_q.abs() > limit)
    }

    /// Standard deviation of the torque for each ampere, as a share: of a least squares for the part of i_q that neither load, dry friction
    /// nor damping takes, and of what the type or the unit leaves open.
    fn torque_sigma(&self) -> f64 {
        let (mut normal, mut right, mut squares) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros(), 0.0);
        for (speed, i_q) in self.motion() {
            let columns = Vector3::new(
                1.0,
                speed / (speed.abs() + SPEED_MIN),
                speed / self.nominal.controller.omega_max,
            );
            normal += columns * columns.transpose();
            right += columns * i_q;
            squares += i_q * i_q;
        }
        // A column that the motion does not have stays out.
        normal += Matrix3::identity() * 1e-9;
        let explained = normal
            .try_inverse()
            .map_or(squares, |inverse| right.dot(&(inverse * right)));
        let ripple = match self.drive {
            DriveKind::Hysteresis => self.nominal.controller.hysteresis / 3.0_f64.sqrt(),
            DriveKind::Vector => 0.0,
        };
        let noise = (self.noise_of_sample() * (2.0_f64 / 3.0).sqrt()).hypot(ripple);
        let open = if self.is_commissioned {
            REPEATED_TORQUE
        } else {
            Tolerances::USUAL.k.hypot(Tolerances::USUAL.j)
        };
        open.hypot(noise / (squares - explained).max(f64::MIN_POSITIVE).sqrt())
    }

    /// Noise of one current in one sample, A: of the sensor and of its converter.
    fn noise_of_sample(&self) -> f64 {
        self.noise_rms_a
            .hypot(self.nominal.sensors.current_lsb() / 12.0_f64.sqrt())
    }

    /// What the mistake changes in the sum of the currents but for its mean, which is an offset, in standard deviations.
    fn error_of_sum(&self) -> f64 {
        let sum = |sample: &SensedSample| sample.currents.iter().sum::<f64>();
        let errors: Vec<f64> = self
            .right
            .iter()
            .zip(self.wrong)
            .map(|(right, wrong)| sum(wrong) - sum(right))
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let squares = errors.iter().map(|error| (error - mean) * (error - mean)).sum::<f64>();
        squares.sqrt() / (3.0_f64.sqrt() * self.noise_of_sample())
    }

    /// Whether an angle, rad at the output, moved on by more than a few counts of the encoder.
    fn moved_on(&self, angle: impl Fn(&SensedSample) -> f64) -> bool {
        let errors = self
            .right
            .iter()
            .zip(self.wrong)
            .map(|(right, wrong)| (angle(right) - angle(wrong)).abs());
        errors.fold(0.0, f64::max) > FROZEN_COUNTS * self.nominal.sensors.output_lsb()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::Setpoint;

    /// A motor that turns at these speeds, rad/s, 0.1 s each, with this current.
    fn motion(speeds: &[f64], i_q: f64) -> Vec<SensedSample> {
        let nominal = ActuatorParams::bench();
        let mut angle = 0.0;
        let speeds = speeds.iter().flat_map(|&speed| [speed; 200]);
        let samples = speeds.enumerate().map(|(seq, speed)| {
            angle += speed / 2000.0;
            let theta_e = nominal.motor.pole_pairs * angle;
            let third = core::f64::consts::TAU / 3.0;
            SensedSample {
                seq: seq as u64,
                currents: [0.0, 1.0, 2.0].map(|phase| -i_q * (theta_e - phase * third).sin()),
                motor_counts: (angle / nominal.sensors.motor_lsb()) as i64,
                output_counts: 0,
                setpoint: Setpoint::Position(0.0),
            }
        });
        samples.collect()
    }

    fn shows_load(samples: &[SensedSample], load_nm: f64, load_read_nm: f64) -> bool {
        let mut nominal = ActuatorParams::bench();
        nominal.sensors.sample_rate = 2000.0;
        let truth = Truth {
            nominal: &nominal,
            drive: DriveKind::Vector,
            fault: &FaultVector::NOMINAL,
            load_nm,
            load_read_nm,
            noise_rms_a: 0.03,
            right: samples,
            wrong: samples,
            is_commissioned: true,
        };
        truth.contradicts_load()
    }

    #[test]
    fn one_way_only_a_load_that_friction_cannot_replace_is_shown() {
        let transmission = ActuatorParams::bench().transmission;
        let friction = transmission.friction_dynamic * transmission.gear_ratio;
        let (forward, both) = (motion(&[100.0], 1.0), motion(&[100.0, -100.0], 1.0));
        // Read without its load, an opposed motion looks like worn friction, an aided one like friction below zero.
        assert!(!shows_load(&forward, friction, 0.0));
        assert!(shows_load(&forward, -1.5 * friction, 0.0));
        assert!(shows_load(&both, friction, 0.0) && shows_load(&both, -friction, 0.0));
        assert!(!shows_load(&both, friction, 0.9 * friction));
        assert!(!shows_load(&motion(&[0.0], 1.0), friction, 0.0), "nothing moves");
    }

    #[test]
    fn a_motor_near_its_speed_needs_the_voltage() {
        let mut nominal = ActuatorParams::bench();
        nominal.sensors.sample_rate = 2000.0;
        let fastest = nominal.motor.v_dc / 3.0_f64.sqrt() / nominal.motor.k;
        let needs = |speed: f64| {
            let samples = motion(&[speed], 0.0);
            let truth = Truth {
                nominal: &nominal,
                drive: DriveKind::Vector,
                fault: &FaultVector::NOMINAL,
                load_nm: 0.0,
                load_read_nm: 0.0,
                noise_rms_a: 0.03,
                right: &samples,
                wrong: &samples,
                is_commissioned: false,
            };
            truth.needs_voltage(0.8)
        };
        assert!(needs(0.8 * fastest) && !needs(0.7 * fastest));
    }
}
