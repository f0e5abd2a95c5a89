//! Parameters of an actuator type: motor, transmission, controller and sensors, in SI units, with a check of their ranges.
//!
//! Three types are built in: [`ActuatorParams::bench`], the test bench of \[P\], Table I; [`ActuatorParams::servo28`], a small
//! 28 V servo, and [`ActuatorParams::servo270`], a 270 V actuator between the two, both defined here.

use crate::temperature::temperature_factors;

/// Permanent-magnet synchronous motor in star connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorParams {
    /// Number of pole pairs P; `theta_e = P theta_m`.
    pub pole_pairs: f64,
    /// Phase resistance R at 20 °C, Ω.
    pub r_s: f64,
    /// Cyclic phase inductance L, H.
    pub l_s: f64,
    /// Coefficient k of the peak phase back-EMF, with respect to the mechanical angle, V·s/rad. The torque per ampere of `i_q`
    /// is `G_T = 1.5 k`.
    pub k: f64,
    /// Largest quadrature current I_max, A.
    pub i_max: f64,
    /// Nominal DC link voltage V_dc, V.
    pub v_dc: f64,
    /// Inertia J at the motor shaft, including that of the load, kg·m².
    pub j: f64,
    /// Viscous damping C at the motor shaft, Nm·s/rad.
    pub c: f64,
}

impl MotorParams {
    /// Torque per ampere of `i_q`, Nm/A: `G_T = 1.5 k`.
    #[must_use]
    pub fn torque_gain(&self) -> f64 {
        1.5 * self.k
    }

    /// The motor at a winding temperature, °C.
    #[must_use]
    pub fn at_temperature(&self, temperature_deg_c: f64) -> Self {
        let [resistance, back_emf] = temperature_factors(temperature_deg_c);
        Self {
            r_s: self.r_s * resistance,
            k: self.k * back_emf,
            ..*self
        }
    }
}

/// Gearbox between motor and output shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransmissionParams {
    /// Gear ratio n: motor revolutions per output revolution.
    pub gear_ratio: f64,
    /// Efficiency η_o while the load opposes the motion, in (0, 1].
    pub efficiency_opposing: f64,
    /// Efficiency η_a while the load aids the motion, in (0, 1].
    pub efficiency_aiding: f64,
    /// Dynamic friction torque T_d at the motor shaft, Nm.
    pub friction_dynamic: f64,
    /// Static friction torque T_s at the motor shaft, Nm; at least T_d.
    pub friction_static: f64,
    /// Total backlash b₀ at the output shaft of a healthy unit, rad.
    pub backlash: f64,
}

impl TransmissionParams {
    /// Shares `[1/η_o − 1, 1 − η_a]` of the load torque that the gear adds to friction while the load opposes and aids the
    /// motion; dimensionless. Source: \[P\] 5.1.5.
    #[must_use]
    pub fn gear_loss_shares(&self) -> [f64; 2] {
        [1.0 / self.efficiency_opposing - 1.0, 1.0 - self.efficiency_aiding]
    }
}

/// Actuator control electronics: position loop, speed loop, current loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerParams {
    /// Control period, s.
    pub period: f64,
    /// Proportional gain G_p of the position loop, (rad/s at the motor)/(rad at the output).
    pub g_p: f64,
    /// Proportional gain of the speed loop, Nm/(rad/s).
    pub k_p: f64,
    /// Integral gain of the speed loop, Nm/rad.
    pub k_i: f64,
    /// Derivative gain of the speed loop, Nm·s/(rad/s).
    pub k_d: f64,
    /// Speed saturation ω_max at the motor shaft, rad/s.
    pub omega_max: f64,
    /// Half band h of the hysteresis current comparators, A.
    pub hysteresis: f64,
}

/// Sensors and sampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorParams {
    /// Output encoder resolution, counts per revolution (after ×4).
    pub output_counts_per_rev: f64,
    /// Motor resolver resolution, counts per revolution.
    pub motor_counts_per_rev: f64,
    /// Full scale of the current converters, ±A.
    pub current_full_scale: f64,
    /// Resolution of the current converters, bits.
    pub current_bits: u32,
    /// Sampling rate f_s, Hz; the sample period is a whole number of control periods.
    pub sample_rate: f64,
}

impl SensorParams {
    /// Angle of one output count, rad.
    #[must_use]
    pub fn output_lsb(&self) -> f64 {
        core::f64::consts::TAU / self.output_counts_per_rev
    }

    /// Angle of one resolver count, rad.
    #[must_use]
    pub fn motor_lsb(&self) -> f64 {
        core::f64::consts::TAU / self.motor_counts_per_rev
    }

    /// Current of one converter step, A.
    #[must_use]
    pub fn current_lsb(&self) -> f64 {
        2.0 * self.current_full_scale / f64::from(1u32 << self.current_bits)
    }
}

/// Parameters of one type of actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorParams {
    /// Motor.
    pub motor: MotorParams,
    /// Gearbox.
    pub transmission: TransmissionParams,
    /// Controller.
    pub controller: ControllerParams,
    /// Sensors.
    pub sensors: SensorParams,
}

/// Why a set of parameters was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParamsError {
    /// Name of the parameter, as a field path (`motor.r_s`).
    pub field: &'static str,
    /// The value found.
    pub got: f64,
    /// What it must be.
    pub expected: Expected,
}

/// What a parameter must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expected {
    /// Finite, and within the two bounds, both included.
    Within(f64, f64),
    /// A whole number times the given one.
    MultipleOf(f64),
    /// At least the value of another parameter, named here.
    AtLeast(&'static str, f64),
}

impl core::fmt::Display for ParamsError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} = {}: expected ", self.field, self.got)?;
        match self.expected {
            Expected::Within(min, max) => write!(f, "a number from {min} to {max}"),
            Expected::MultipleOf(unit) => write!(f, "a whole multiple of {unit}"),
            Expected::AtLeast(name, value) => write!(f, "at least {name} = {value}"),
        }
    }
}

impl core::error::Error for ParamsError {}

/// Largest electrical turn in a control period at the largest speed reference, rad: within more than a whole turn a controller's set
/// point says little about the currents, and the monitor's work grows with it.
const CONTROL_TURN_MAX: f64 = 8.0;

/// Shortest control period, s.
const PERIOD_MIN: f64 = 10e-6;

/// Integration step of the reference, s; control and sample periods are whole multiples of it.
pub const REFERENCE_STEP: f64 = 1e-6;

impl ActuatorParams {
    /// Names of the built-in types.
    pub const BUILT_IN: [&'static str; 3] = ["bench", "servo28", "servo270"];

    /// The test bench of \[P\]: Siemens 1FK7060 motor (Table I) with a printed compound planetary gearbox.
    ///
    /// ```
    /// let bench = ema_models::ActuatorParams::bench();
    /// // Table I gives 1.91 Nm per ampere rms, which is 1.35 Nm per peak ampere of i_q.
    /// assert!((bench.motor.torque_gain() * 2f64.sqrt() - 1.91).abs() < 1e-3);
    /// ```
    #[must_use]
    pub fn bench() -> Self {
        Self {
            motor: MotorParams {
                pole_pairs: 4.0,
                r_s: 2.75,
                l_s: 30.5e-3,
                k: 0.900,
                i_max: 10.7,
                v_dc: 380.0,
                j: 1.0e-3,
                c: 1.0e-3,
            },
            transmission: TransmissionParams {
                gear_ratio: 100.0,
                efficiency_opposing: 0.65,
                efficiency_aiding: 0.51,
                friction_dynamic: 0.15,
                friction_static: 0.30,
                backlash: 1e-4,
            },
            controller: ControllerParams {
                period: 100e-6,
                g_p: 2500.0,
                k_p: 0.4,
                k_i: 6.0,
                k_d: 0.0,
                omega_max: 200.0,
                hysteresis: 0.05,
            },
            sensors: SensorParams::standard(),
        }
    }

    /// A small 28 V servo, far from the bench in every respect (all values declared here).
    #[must_use]
    pub fn servo28() -> Self {
        Self {
            motor: MotorParams {
                pole_pairs: 7.0,
                r_s: 0.6,
                l_s: 1.2e-3,
                k: 0.050,
                i_max: 6.0,
                v_dc: 28.0,
                j: 2.0e-5,
                c: 1.0e-5,
            },
            transmission: TransmissionParams {
                gear_ratio: 150.0,
                efficiency_opposing: 0.80,
                efficiency_aiding: 0.70,
                friction_dynamic: 0.010,
                friction_static: 0.020,
                backlash: 2e-4,
            },
            controller: ControllerParams {
                period: 100e-6,
                g_p: 3000.0,
                k_p: 0.006,
                k_i: 0.1,
                k_d: 0.0,
                omega_max: 250.0,
                hysteresis: 0.05,
            },
            sensors: SensorParams::standard(),
        }
    }

    /// A 270 V actuator with a vector drive, between the other two in size (all values declared here).
    ///
    /// 270 V is the DC supply of aircraft. Torque (2.5 Nm), inertia, L/R and the share of friction are near the geometric mean of
    /// `bench` and `servo28`; the controller's bandwidths lie between theirs: G_p / n = 22.5 rad/s, K_p / J = 357 rad/s,
    /// K_i / K_p = 16 1/s. At ω_max and I_max the phase voltage is 92 V of the 156 V that the link allows (V_dc / √3). The
    /// simulated drive is [`Drive::of_built_in`](crate::reference::Drive::of_built_in); the half band stands for its ripple.
    ///
    /// ```
    /// let m = ema_models::ActuatorParams::servo270().motor;
    /// assert!((m.torque_gain() * m.i_max - 2.5).abs() < 0.05);
    /// ```
    #[must_use]
    pub fn servo270() -> Self {
        Self {
            motor: MotorParams {
                pole_pairs: 5.0,
                r_s: 1.3,
                l_s: 6.0e-3,
                k: 0.300,
                i_max: 5.6,
                v_dc: 270.0,
                j: 1.4e-4,
                c: 1.0e-4,
            },
            transmission: TransmissionParams {
                gear_ratio: 120.0,
                efficiency_opposing: 0.72,
                efficiency_aiding: 0.60,
                friction_dynamic: 0.040,
                friction_static: 0.080,
                backlash: 1.5e-4,
            },
            controller: ControllerParams {
                period: 100e-6,
                g_p: 2700.0,
                k_p: 0.05,
                k_i: 0.8,
                k_d: 0.0,
                omega_max: 250.0,
                hysteresis: 0.05,
            },
            sensors: SensorParams::standard(),
        }
    }

    /// The built-in type of this name.
    #[must_use]
    pub fn built_in(name: &str) -> Option<Self> {
        match name {
            "bench" => Some(Self::bench()),
            "servo28" => Some(Self::servo28()),
            "servo270" => Some(Self::servo270()),
            _ => None,
        }
    }

    /// Electrical turn in a control period at the largest speed reference, rad.
    #[must_use]
    pub fn turn_per_control(&self) -> f64 {
        self.motor.pole_pairs * self.controller.omega_max * self.controller.period
    }

    /// The same parameters, if every one is finite and physically possible.
    ///
    /// # Errors
    /// The first parameter that is not, with the value found and what was expected.
    pub fn checked(self) -> Result<Self, ParamsError> {
        let m = &self.motor;
        let t = &self.transmission;
        let c = &self.controller;
        let s = &self.sensors;
        for (field, got, min, max) in [
            ("motor.pole_pairs", m.pole_pairs, 1.0, 100.0),
            ("motor.r_s", m.r_s, 1e-4, 1e4),
            ("motor.l_s", m.l_s, 1e-7, 10.0),
            ("motor.k", m.k, 1e-5, 1e3),
            ("motor.i_max", m.i_max, 1e-3, 1e4),
            ("motor.v_dc", m.v_dc, 1.0, 1e4),
            ("motor.j", m.j, 1e-9, 1e3),
            ("motor.c", m.c, 0.0, 1e3),
            ("transmission.gear_ratio", t.gear_ratio, 1.0, 1e5),
            ("transmission.efficiency_opposing", t.efficiency_opposing, 0.01, 1.0),
            ("transmission.efficiency_aiding", t.efficiency_aiding, 0.01, 1.0),
            ("transmission.friction_dynamic", t.friction_dynamic, 0.0, 1e4),
            ("transmission.friction_static", t.friction_static, 0.0, 1e4),
            ("transmission.backlash", t.backlash, 0.0, 0.01),
            ("controller.period", c.period, PERIOD_MIN, 10e-3),
            ("controller.g_p", c.g_p, 1e-3, 1e7),
            ("controller.k_p", c.k_p, 0.0, 1e5),
            ("controller.k_i", c.k_i, 0.0, 1e7),
            ("controller.k_d", c.k_d, 0.0, 1e3),
            ("controller.omega_max", c.omega_max, 1e-2, 1e5),
            ("controller.hysteresis", c.hysteresis, 1e-4, 1e3),
            (
                "sensors.output_counts_per_rev",
                s.output_counts_per_rev,
                16.0,
                16_777_216.0,
            ),
            (
                "sensors.motor_counts_per_rev",
                s.motor_counts_per_rev,
                16.0,
                16_777_216.0,
            ),
            ("sensors.current_full_scale", s.current_full_scale, 1e-3, 1e4),
            ("sensors.current_bits", f64::from(s.current_bits), 4.0, 24.0),
            ("sensors.sample_rate", s.sample_rate, 50.0, 20_000.0),
        ] {
            if !(min..=max).contains(&got) {
                return Err(ParamsError {
                    field,
                    got,
                    expected: Expected::Within(min, max),
                });
            }
        }
        // No control period is short enough.
        let omega_max = CONTROL_TURN_MAX / (m.pole_pairs * PERIOD_MIN);
        if c.omega_max > omega_max {
            return Err(ParamsError {
                field: "controller.omega_max",
                got: c.omega_max,
                expected: Expected::Within(1e-2, omega_max),
            });
        }
        let period_max = CONTROL_TURN_MAX / (m.pole_pairs * c.omega_max);
        if c.period > period_max {
            return Err(ParamsError {
                field: "controller.period",
                got: c.period,
                expected: Expected::Within(PERIOD_MIN, period_max),
            });
        }
        if t.friction_static < t.friction_dynamic {
            return Err(ParamsError {
                field: "transmission.friction_static",
                got: t.friction_static,
                expected: Expected::AtLeast("transmission.friction_dynamic", t.friction_dynamic),
            });
        }
        for (field, got, unit) in [
            ("motor.pole_pairs", m.pole_pairs, 1.0),
            ("controller.period", c.period, REFERENCE_STEP),
            ("sensors.output_counts_per_rev", s.output_counts_per_rev, 1.0),
            ("sensors.motor_counts_per_rev", s.motor_counts_per_rev, 1.0),
            ("1 / sensors.sample_rate", 1.0 / s.sample_rate, c.period),
        ] {
            let ratio = got / unit;
            if libm::fabs(ratio - libm::round(ratio)) > 1e-6 * ratio {
                return Err(ParamsError {
                    field,
                    got,
                    expected: Expected::MultipleOf(unit),
                });
            }
        }
        Ok(self)
    }
}

impl SensorParams {
    /// The sensors all shipped actuators carry: 5000-line output encoder ×4, 16-bit resolver, 12-bit ±16 A
    /// converters, 2 kHz.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            output_counts_per_rev: 20_000.0,
            motor_counts_per_rev: 65_536.0,
            current_full_scale: 16.0,
            current_bits: 12,
            sample_rate: 2000.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_actuators_pass_their_own_check() {
        for name in ActuatorParams::BUILT_IN {
            assert!(ActuatorParams::built_in(name).unwrap().checked().is_ok(), "{name}");
        }
    }

    #[test]
    fn absurd_parameters_are_refused_by_name() {
        let mut p = ActuatorParams::bench();
        p.motor.r_s = f64::NAN;
        assert_eq!(p.checked().map_err(|e| e.field), Err("motor.r_s"));
        let mut p = ActuatorParams::bench();
        p.sensors.sample_rate = 3000.0; // 333.3 µs is no whole number of 100 µs control periods
        assert_eq!(p.checked().map_err(|e| e.field), Err("1 / sensors.sample_rate"));
        let mut p = ActuatorParams::bench();
        p.transmission.friction_static = 0.1;
        assert_eq!(p.checked().map_err(|e| e.field), Err("transmission.friction_static"));
    }
}
