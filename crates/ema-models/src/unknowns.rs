//! Unknowns of one window: the fault vector, load torque, initial integral of the speed loop, and the motor's deviation.
//!
//! [`Scale`] converts [`Unknowns`] to [`Coordinates`], in which the problem is smooth, and back.

use crate::fault::{FAULT_COUNT, FaultVector};
use crate::params::ActuatorParams;
use crate::temperature::{BACK_EMF_PER_KELVIN, RESISTANCE_PER_KELVIN, temperature_factors};

/// Number of unknowns of one window.
pub const UNKNOWN_COUNT: usize = FAULT_COUNT + 4;

/// Deviation of a motor from its type, each relative to the type's value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorDeviation {
    /// Deviation of the phase resistance R.
    pub resistance: f64,
    /// Deviation of the back-EMF coefficient k, which is also the torque coefficient.
    pub back_emf: f64,
}

impl MotorDeviation {
    /// Deviation at a winding temperature, °C; `self` is the deviation at 20 °C.
    #[must_use]
    pub fn at_temperature(&self, temperature_deg_c: f64) -> Self {
        let [resistance, back_emf] = temperature_factors(temperature_deg_c);
        Self {
            resistance: (1.0 + self.resistance) * resistance - 1.0,
            back_emf: (1.0 + self.back_emf) * back_emf - 1.0,
        }
    }
}

/// Prior knowledge of a motor's deviation: mean and covariance, in the order of the fields of [`MotorDeviation`].
///
/// It follows from tolerances, from healthy windows of the unit, and from the temperature. With variances of zero the
/// deviation is known exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorKnowledge {
    /// Expected deviation.
    pub mean: MotorDeviation,
    /// Its covariance.
    pub covariance: [[f64; 2]; 2],
}

impl MotorKnowledge {
    /// The prior of a motor without a temperature sensor: 20 °C with a standard deviation of `sigma_k`, K.
    ///
    /// The temperature changes resistance and back-EMF together, so it adds a correlated covariance.
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
    ///
    /// Where only one of the two is known exactly, or both move together (exact tolerances at an unknown temperature), the covariance has no
    /// inverse: each is then taken to be known to 1e-4 at best.
    #[must_use]
    pub fn information(&self) -> Option<[[f64; 2]; 2]> {
        let [[a, b], [c, d]] = self.covariance;
        if a <= 0.0 && d <= 0.0 {
            return None;
        }
        let floor = if a * d - b * c > SINGULAR * a * d {
            0.0
        } else {
            NEARLY_EXACT * NEARLY_EXACT
        };
        let (a, d) = (a + floor, d + floor);
        let determinant = a * d - b * c;
        (determinant > 0.0 && determinant.is_finite()).then(|| {
            let scale = 1.0 / determinant;
            [[d * scale, -b * scale], [-c * scale, a * scale]]
        })
    }
}

/// Standard deviation of what is known exactly beside something that is not, relative.
const NEARLY_EXACT: f64 = 1e-4;

/// Determinant of a covariance, relative to the product of its variances, below which it has no inverse worth the name.
const SINGULAR: f64 = 1e-9;

/// All unknowns of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknowns {
    /// The fault vector.
    pub fault: FaultVector,
    /// Load torque at the output, Nm; positive opposes positive motion.
    pub load_torque: f64,
    /// Integral part of the speed loop at the start of the window, minus its value from the measured currents, Nm.
    pub integral: f64,
    /// Deviation of the motor from its type.
    pub motor: MotorDeviation,
}

/// Index of the load torque among the coordinates.
pub const LOAD_COORDINATE: usize = 8;

/// Indices of the motor's deviation among the coordinates.
pub const MOTOR_COORDINATES: [usize; 2] = [UNKNOWN_COUNT - 2, UNKNOWN_COUNT - 1];

/// The unknowns as coordinates of a smooth problem: `[k1…k5, ζ cos φ_e, ζ sin φ_e, k8, load, integral,
/// δR/R, δk/k]`.
///
/// The eccentricity is in Cartesian coordinates, which are smooth at k6 = 0 and across φ_e = ±π, unlike amplitude and
/// direction. Load (at the motor shaft) and integral are relative to the motor's largest torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates(pub [f64; UNKNOWN_COUNT]);

/// Converts unknowns to coordinates and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    load: f64,
    integral: f64,
}

impl Scale {
    /// The conversion for one actuator type.
    #[must_use]
    pub fn new(params: &ActuatorParams) -> Self {
        let torque = params.motor.torque_gain() * params.motor.i_max;
        Self {
            load: torque * params.transmission.gear_ratio,
            integral: torque,
        }
    }

    /// Load torque at the output that corresponds to a coordinate of 1, Nm.
    #[must_use]
    pub fn load_unit(&self) -> f64 {
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

    /// Unknowns at these coordinates. Every parameter of the fault vector is limited to [0, 1]; without eccentricity its
    /// direction is the nominal ½.
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
    /// Lower bounds: −1 for the Cartesian eccentricity, half of the largest torque for load and integral, half of the type's
    /// value for R and k.
    pub const LOWER: [f64; UNKNOWN_COUNT] = [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, -0.5, -0.5, -0.5, -0.5];
    /// Upper bounds.
    pub const UPPER: [f64; UNKNOWN_COUNT] = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5];

    /// The coordinates with the eccentricity projected to the disc ζ ≤ 1.
    ///
    /// [`Scale::unknowns`] limits ζ to 1, so the cost does not change with ζ outside the disc, and a descent would stop there.
    #[must_use]
    pub fn projected_to_unit_disc(mut self) -> Self {
        let amplitude = libm::hypot(self.0[5], self.0[6]);
        if amplitude > 1.0 {
            self.0[5] /= amplitude;
            self.0[6] /= amplitude;
        }
        self
    }

    /// Signed steps of finite differences, of length `step` along each coordinate, towards the inside of the box.
    #[must_use]
    pub fn inward_steps(&self, step: f64) -> [f64; UNKNOWN_COUNT] {
        core::array::from_fn(|p| match p {
            // Near a full short the turns ratio is limited, so a shorter step would not change it.
            2..=4 if self.0[p] > 1.0 - FULL_SHORT => -step.max(FULL_SHORT),
            // Towards the centre of the disc.
            5 | 6 => -step.copysign(self.0[p]),
            _ if self.0[p] > 0.5 * Self::UPPER[p] => -step,
            _ => step,
        })
    }
}

/// Distance of k3…k5 from 1 within which the turns ratio is almost zero.
const FULL_SHORT: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;

    /// Sigmas of both as the information gives them back.
    fn sigmas(covariance: [[f64; 2]; 2]) -> Option<[f64; 2]> {
        let knowledge = MotorKnowledge {
            mean: MotorDeviation::default(),
            covariance,
        };
        let [[a, b], [c, d]] = knowledge.information()?;
        let determinant = a * d - b * c;
        Some([d, a].map(|minor| libm::sqrt(minor / determinant)))
    }

    #[test]
    fn what_is_known_exactly_leaves_the_other_as_it_is() {
        assert_eq!(sigmas([[0.0; 2]; 2]), None);
        for (covariance, expected) in [
            ([[0.01, 0.0], [0.0, 0.0]], [0.1, 1e-4]),
            ([[0.0, 0.0], [0.0, 9e-4]], [1e-4, 0.03]),
            ([[0.01, 0.001], [0.001, 9e-4]], [0.1, 0.03]),
        ] {
            let found = sigmas(covariance).expect("something is unknown");
            let near = |(a, b): (f64, f64)| (a / b - 1.0).abs() < 1e-3;
            assert!(found.into_iter().zip(expected).all(near), "{found:?}");
        }
    }

    #[test]
    fn exact_tolerances_do_not_make_the_temperature_known() {
        let knowledge = MotorKnowledge::default().at_unknown_temperature(45.0);
        let [resistance, back_emf] = sigmas(knowledge.covariance).expect("the temperature is unknown");
        assert!((resistance - 45.0 * RESISTANCE_PER_KELVIN).abs() < 1e-4, "{resistance}");
        assert!((back_emf - 45.0 * BACK_EMF_PER_KELVIN.abs()).abs() < 1e-4, "{back_emf}");
    }

    #[test]
    fn unknowns_invert_coordinates() {
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
