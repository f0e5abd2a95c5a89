//! What one window leaves open: the fault vector, and what is no fault but not exactly known either.

use crate::fault::{FAULT_COUNT, FaultVector};
use crate::params::ActuatorParams;

/// Number of unknowns of one window.
pub const UNKNOWN_COUNT: usize = FAULT_COUNT + 2;

/// The fault vector with its companions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknowns {
    /// What is worn.
    pub fault: FaultVector,
    /// Load torque at the output, Nm; positive opposes positive motion.
    pub load_torque: f64,
    /// Integral part of the speed loop at the window's start beyond what the measured currents say, Nm.
    pub integral: f64,
}

/// The unknowns as coordinates of a smooth problem: `[k1…k5, ζ cos φ_e, ζ sin φ_e, k8, load, integral]`.
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
        }
    }
}

impl Coordinates {
    /// Lower corner of the box: the Cartesian eccentricity goes from −1, load and integral by half the largest torque.
    pub const LOWER: [f64; UNKNOWN_COUNT] = [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, -0.5, -0.5];
    /// Upper corner of the box.
    pub const UPPER: [f64; UNKNOWN_COUNT] = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5];
}

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
        };
        let back = scale.unknowns(&scale.coordinates(&unknowns));
        for (a, b) in back.fault.to_array().into_iter().zip(unknowns.fault.to_array()) {
            assert!((a - b).abs() < 1e-12, "{back:?}");
        }
        assert!((back.load_torque - 12.0).abs() < 1e-9 && (back.integral + 0.2).abs() < 1e-12);
    }
}
