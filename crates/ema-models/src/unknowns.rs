//! What one window leaves open: the fault vector, and what is no fault but not exactly known either.

use crate::fault::{FAULT_COUNT, FaultVector};
use crate::params::ActuatorParams;
use crate::temperature::{BACK_EMF_PER_KELVIN, RESISTANCE_PER_KELVIN, temperature_factors};

/// Number of unknowns of one window.
pub const UNKNOWN_COUNT: usize = FAULT_COUNT + 4;

/// How far a motor is off its type, each as a share of the type's value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorDeviation {
    /// Of the phase resistance R.
    pub resistance: f64,
    /// Of the back-EMF coefficient k, which is the torque coefficient too.
    pub back_emf: f64,
}

impl MotorDeviation {
    /// Deviation at a winding temperature, °C, of a motor that deviates by this at 20 °C.
    #[must_use]
    pub fn at_temperature(&self, temperature_deg_c: f64) -> Self {
        let [resistance, back_emf] = temperature_factors(temperature_deg_c);
        Self {
            resistance: (1.0 + self.resistance) * resistance - 1.0,
            back_emf: (1.0 + self.back_emf) * back_emf - 1.0,
        }
    }
}

/// What is known of a motor's deviation beforehand: mean and covariance, in the order of the fields.
///
/// A covariance of zero says that the deviation is exactly the mean. It comes from tolerances, from healthy windows of the
/// very motor, and from the temperature.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorKnowledge {
    /// Expected deviation.
    pub mean: MotorDeviation,
    /// Its covariance.
    pub covariance: [[f64; 2]; 2],
}

impl MotorKnowledge {
    /// The same of a motor whose temperature nobody measures: 20 °C give or take `sigma_k`. A warm motor is one of more
    /// resistance and less back-EMF, both together.
    #[must_use]
    pub fn at_unknown_temperature(mut self, sigma_k: f64) -> Self {
        let rise = [RESISTANCE_PER_KELVIN * sigma_k, BACK_EMF_PER_KELVIN * sigma_k];
        for (row, a) in self.covariance.iter_mut().zip(rise) {
            for (covariance, b) in row.iter_mut().zip(rise) {
                *covariance += a * b;
            }
        }
        self
    }

    /// Inverse of the covariance; `None` where the deviation is known exactly.
    #[must_use]
    pub fn information(&self) -> Option<[[f64; 2]; 2]> {
        let [[a, b], [c, d]] = self.covariance;
        let determinant = a * d - b * c;
        (determinant > 0.0 && determinant.is_finite()).then(|| {
            let scale = 1.0 / determinant;
            [[d * scale, -b * scale], [-c * scale, a * scale]]
        })
    }
}

/// The fault vector with its companions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknowns {
    /// What is worn.
    pub fault: FaultVector,
    /// Load torque at the output, Nm; positive opposes positive motion.
    pub load_torque: f64,
    /// Integral part of the speed loop at the window's start beyond what the measured currents say, Nm.
    pub integral: f64,
    /// The motor itself.
    pub motor: MotorDeviation,
}

/// Place of the load among the coordinates.
pub const LOAD_COORDINATE: usize = 8;

/// Places of the motor's deviation among the coordinates.
pub const MOTOR_COORDINATES: [usize; 2] = [UNKNOWN_COUNT - 2, UNKNOWN_COUNT - 1];

/// The unknowns as coordinates of a smooth problem: `[k1…k5, ζ cos φ_e, ζ sin φ_e, k8, load, integral,
/// δR/R, δk/k]`.
///
/// The eccentricity is Cartesian, smooth where amplitude and direction are not: at k6 = 0 and across φ_e = ±π. Load and
/// integral are in units of the motor's largest torque, the load as seen at the motor shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates(pub [f64; UNKNOWN_COUNT]);

/// Turns unknowns into coordinates and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    load: f64,
    integral: f64,
}

impl Scale {
    /// For one type of actuator.
    #[must_use]
    pub fn new(params: &ActuatorParams) -> Self {
        let torque = params.motor.torque_gain() * params.motor.i_max;
        Self {
            load: torque * params.transmission.gear_ratio,
            integral: torque,
        }
    }

    /// Load torque at the output that stands for one unit of its coordinate, Nm.
    #[must_use]
    pub fn load(&self) -> f64 {
        self.load
    }

    /// Coordinates of unknowns.
    #[must_use]
    pub fn coordinates(&self, unknowns: &Unknowns) -> Coordinates {
        let k = unknowns.fault.to_array();
        let phi = unknowns.fault.eccentricity_angle();
        Coordinates([
            k[0],
            k[1],
            k[2],
            k[3],
            k[4],
            k[5] * libm::cos(phi),
            k[5] * libm::sin(phi),
            k[7],
            unknowns.load_torque / self.load,
            unknowns.integral / self.integral,
            unknowns.motor.resistance,
            unknowns.motor.back_emf,
        ])
    }

    /// Unknowns at coordinates; every fault component is limited to [0, 1], and without eccentricity its phase is the
    /// nominal ½.
    #[must_use]
    pub fn unknowns(&self, Coordinates(x): &Coordinates) -> Unknowns {
        let amplitude = libm::hypot(x[5], x[6]);
        let phase = if amplitude > 0.0 {
            0.5 * (libm::atan2(x[6], x[5]) / core::f64::consts::PI + 1.0)
        } else {
            0.5
        };
        let k = [x[0], x[1], x[2], x[3], x[4], amplitude, phase, x[7]];
        Unknowns {
            fault: FaultVector::from_array(k.map(|v| v.clamp(0.0, 1.0))),
            load_torque: x[8] * self.load,
            integral: x[9] * self.integral,
            motor: MotorDeviation {
                resistance: x[10],
                back_emf: x[11],
            },
        }
    }
}

impl Coordinates {
    /// Lower corner of the box: the Cartesian eccentricity goes from −1, load and integral by half the largest torque,
    /// R and k by half.
    pub const LOWER: [f64; UNKNOWN_COUNT] = [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, -0.5, -0.5, -0.5, -0.5];
    /// Upper corner of the box.
    pub const UPPER: [f64; UNKNOWN_COUNT] = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5];

    /// The point of the disc ζ ≤ 1 that this one stands for ([`Scale::unknowns`] takes no more than ζ = 1): outside it, nothing
    /// changes with ζ, and a descent that strays there is lost.
    #[must_use]
    pub fn inside_the_disc(mut self) -> Self {
        let amplitude = libm::hypot(self.0[5], self.0[6]);
        if amplitude > 1.0 {
            self.0[5] /= amplitude;
            self.0[6] /= amplitude;
        }
        self
    }

    /// Steps of finite differences of length `step` along each coordinate, towards the inside of the box.
    #[must_use]
    pub fn inward_steps(&self, step: f64) -> [f64; UNKNOWN_COUNT] {
        core::array::from_fn(|p| match p {
            // Beyond this the turns are held, so a short step would see nothing.
            2..=4 if self.0[p] > 1.0 - FULL_SHORT => -step.max(FULL_SHORT),
            // Towards the middle of the disc.
            5 | 6 => -step.copysign(self.0[p]),
            _ if self.0[p] > 0.5 * Self::UPPER[p] => -step,
            _ => step,
        })
    }
}

/// Distance from a full short circuit within which the fraction of intact turns is next to nothing.
const FULL_SHORT: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_invert() {
        let scale = Scale::new(&ActuatorParams::bench());
        let unknowns = Unknowns {
            fault: FaultVector::from_array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.9, 0.3]),
            load_torque: 12.0,
            integral: -0.2,
            motor: MotorDeviation {
                resistance: 0.03,
                back_emf: -0.02,
            },
        };
        let back = scale.unknowns(&scale.coordinates(&unknowns));
        for (a, b) in back.fault.to_array().into_iter().zip(unknowns.fault.to_array()) {
            assert!((a - b).abs() < 1e-12, "{back:?}");
        }
        assert!((back.load_torque - 12.0).abs() < 1e-9 && (back.integral + 0.2).abs() < 1e-12);
        assert_eq!(back.motor, unknowns.motor);
    }
}
