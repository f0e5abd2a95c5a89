//! What is known of a window's unknowns beforehand, and the normal equations that it enters.

use crate::fault::FaultVector;
use crate::monitor::Conditions;
use crate::unknowns::{
    Coordinates, LOAD_COORDINATE, MOTOR_COORDINATES, MotorKnowledge, Scale, UNKNOWN_COUNT, Unknowns,
};

/// Prior knowledge of the unknowns beside the fault vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Standard deviation of the load torque about [`Conditions::load_torque`] (about 0 where it is not measured), Nm at the
    /// output; infinite without prior knowledge.
    pub load_torque: f64,
    /// Standard deviation of the speed loop's integral about its value from the first currents, Nm.
    pub integral: f64,
    /// Deviation of the motor. If it is known exactly, it adds no term, and its coordinates are fixed.
    pub motor: MotorKnowledge,
}

/// Coordinates with prior knowledge: load, integral, motor.
const KNOWN: [usize; 4] = [LOAD_COORDINATE, 9, MOTOR_COORDINATES[0], MOTOR_COORDINATES[1]];

impl Prior {
    /// Adds the terms of the prior to the normal equations at a point.
    pub fn add_to(&self, sums: &mut NormalEquations, scale: &Scale, conditions: &Conditions, at: &Coordinates) {
        let (distance, information) = self.terms(scale, conditions, at);
        for (r, &p) in KNOWN.iter().enumerate() {
            for (c, &q) in KNOWN.iter().enumerate() {
                sums.jtj[p][q] += information[r][c];
                sums.jtr[p] += information[r][c] * distance[c];
                sums.cost += 0.5 * distance[r] * information[r][c] * distance[c];
            }
        }
    }

    /// Cost of a point's distance from the prior's mean.
    #[must_use]
    pub fn cost(&self, scale: &Scale, conditions: &Conditions, at: &Coordinates) -> f64 {
        let (distance, information) = self.terms(scale, conditions, at);
        let mut known = 0.0;
        for (row, d) in information.iter().zip(distance) {
            for (weight, other) in row.iter().zip(distance) {
                known += 0.5 * d * weight * other;
            }
        }
        known
    }

    /// Distance from the mean, and information matrix, in the order of [`KNOWN`].
    fn terms(&self, scale: &Scale, conditions: &Conditions, at: &Coordinates) -> ([f64; 4], [[f64; 4]; 4]) {
        let unit = Unknowns {
            fault: FaultVector::NOMINAL,
            load_torque: self.load_torque,
            integral: self.integral,
            motor: self.motor.mean,
        };
        let sigma = scale.coordinates(&unit).0;
        let expected = scale
            .coordinates(&Unknowns {
                load_torque: conditions.load_torque.unwrap_or(0.0),
                integral: 0.0,
                ..unit
            })
            .0;
        let mut information = [[0.0; 4]; 4];
        information[0][0] = 1.0 / (sigma[LOAD_COORDINATE] * sigma[LOAD_COORDINATE]);
        information[1][1] = 1.0 / (sigma[9] * sigma[9]);
        if let Some(motor) = self.motor.information() {
            for (r, row) in motor.into_iter().enumerate() {
                information[2 + r][2..].copy_from_slice(&row);
            }
        }
        (KNOWN.map(|p| at.0[p] - expected[p]), information)
    }
}

/// Normal equations of a least-squares problem in [`Coordinates`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NormalEquations {
    /// `JᵀJ`.
    pub jtj: [[f64; UNKNOWN_COUNT]; UNKNOWN_COUNT],
    /// `Jᵀr`.
    pub jtr: [f64; UNKNOWN_COUNT],
    /// `½ Σ r²`.
    pub cost: f64,
}

impl NormalEquations {
    /// Fixes the motor's coordinates if the deviation is known exactly: they do not change and add no uncertainty.
    pub fn fix_known_motor(&mut self, motor: &MotorKnowledge) {
        if motor.information().is_none() {
            for p in MOTOR_COORDINATES {
                for q in 0..UNKNOWN_COUNT {
                    self.jtj[p][q] = 0.0;
                    self.jtj[q][p] = 0.0;
                }
                self.jtj[p][p] = 1.0;
                self.jtr[p] = 0.0;
            }
        }
    }
}
