//! What the fit needs of a window: costs and normal equations of its monitor. The host's implementation is
//! [`Comparison`], which runs monitors in SIMD lanes over prepared samples.

use ema_models::{
    ActuatorParams, COST_LANES, Calibration, Comparison, Conditions, Coordinates, FaultVector, MotorKnowledge,
    NormalEquations, Prior, SIGNAL_COUNT, Scale, Setpoint, UNKNOWN_COUNT, Unknowns, Weights,
};

use super::coarse_time::Time;
use crate::calibration::Mismatch;

/// One window, and the monitor that it is compared with.
///
/// Residuals are measured minus modelled; a cost is half the sum of their weighted squares. Every implementation sums in the
/// same order, so that the same window gives the same bits.
pub trait MonitoredWindow: Copy {
    /// The actuator, as known.
    fn params(&self) -> &ActuatorParams;

    /// Load and supply during the window.
    fn conditions(&self) -> &Conditions;

    /// What each signal weighs.
    fn weights(&self) -> &Weights;

    /// What is known beforehand of load, integral and motor.
    fn prior(&self) -> &Prior;

    /// The same window with other weights.
    #[must_use]
    fn with_weights(self, weights: Weights) -> Self;

    /// The same window with other knowledge of the motor.
    #[must_use]
    fn with_motor(self, motor: MotorKnowledge) -> Self;

    /// Number of samples, filled ones included.
    fn sample_count(&self) -> usize;

    /// Setpoint and motor angle (rad) of each sample, relative to the window's origin.
    fn setpoints_and_angles(&self) -> impl Iterator<Item = (Setpoint, f64)>;

    /// Cost of one set of unknowns as a mean over the samples, without what is known beforehand.
    fn mean_cost(&self, unknowns: &Unknowns) -> f64;

    /// Unweighted squared residuals of one set of unknowns, summed for each signal, and the number of samples summed.
    fn squared_residuals(&self, unknowns: &Unknowns) -> ([f64; SIGNAL_COUNT], usize);

    /// Normal equations at a point by forward differences of length `step` towards the inside of the box, what is known
    /// beforehand included.
    fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations;

    /// Cost that [`MonitoredWindow::normal_equations`] belong to: a sum, what is known beforehand included.
    fn cost(&self, at: &Coordinates) -> f64 {
        let scale = Scale::new(self.params());
        let mean = self.mean_cost(&scale.unknowns(at));
        mean * self.sample_count() as f64 + self.prior().cost(&scale, self.conditions(), at)
    }

    /// Points whose costs [`MonitoredWindow::costs`] finds in about the time of one.
    const SIDE_BY_SIDE: usize = 1;

    /// Costs of at most [`MonitoredWindow::SIDE_BY_SIDE`] points, the same bits as from [`MonitoredWindow::cost`].
    fn costs(&self, points: &[[f64; UNKNOWN_COUNT]], costs: &mut [f64]) {
        for (point, cost) in points.iter().zip(costs) {
            *cost = self.cost(&Coordinates(*point));
        }
    }

    /// A fault vector with its companions at what is measured or expected.
    fn unknowns_with(&self, fault: FaultVector) -> Unknowns {
        Unknowns {
            fault,
            load_torque: self.conditions().load_torque.unwrap_or(0.0),
            integral: 0.0,
            motor: self.prior().motor.mean,
        }
    }

    /// Number of signals that weigh anything.
    fn weighted_signals(&self) -> f64 {
        self.weights().to_array().iter().filter(|w| **w > 0.0).count() as f64
    }
}

impl MonitoredWindow for Comparison<'_> {
    fn params(&self) -> &ActuatorParams {
        self.params
    }

    fn conditions(&self) -> &Conditions {
        &self.conditions
    }

    fn weights(&self) -> &Weights {
        &self.weights
    }

    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn with_weights(self, weights: Weights) -> Self {
        Self { weights, ..self }
    }

    fn with_motor(mut self, motor: MotorKnowledge) -> Self {
        self.prior.motor = motor;
        self
    }

    fn sample_count(&self) -> usize {
        self.recording.samples.len()
    }

    fn setpoints_and_angles(&self) -> impl Iterator<Item = (Setpoint, f64)> {
        let samples = self.recording.samples.iter();
        samples.map(|sample| (sample.setpoint, sample.theta_m))
    }

    fn mean_cost(&self, unknowns: &Unknowns) -> f64 {
        self.least_squares(unknowns)
    }

    fn squared_residuals(&self, unknowns: &Unknowns) -> ([f64; SIGNAL_COUNT], usize) {
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0);
        self.residuals(unknowns, |_, r| {
            for (sum, r) in squares.iter_mut().zip(r.to_array()) {
                *sum += r * r;
            }
            count += 1;
        });
        (squares, count)
    }

    fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations {
        Comparison::normal_equations(self, at, step)
    }

    fn cost(&self, at: &Coordinates) -> f64 {
        Comparison::cost(self, at)
    }

    const SIDE_BY_SIDE: usize = COST_LANES;

    fn costs(&self, points: &[[f64; UNKNOWN_COUNT]], costs: &mut [f64]) {
        // Lanes that few points leave over run the first again.
        let point_of = |lane: usize| {
            let point = points.get(lane).or(points.first()).copied();
            Coordinates(point.unwrap_or([0.0; UNKNOWN_COUNT]))
        };
        let all = Comparison::costs(self, &core::array::from_fn(point_of));
        for (slot, cost) in costs.iter_mut().zip(all) {
            *slot = cost;
        }
    }
}

/// A window whose monitors can run in coarse time.
pub trait InTime: MonitoredWindow {
    /// The same window in another time.
    #[must_use]
    fn in_time(self, time: Time) -> Self;
}

/// What identification knows of one actuator before it sees a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorKnowledge {
    /// The actuator's parameters.
    pub params: ActuatorParams,
    /// The monitor's coefficients for its type.
    pub calibration: Calibration,
    /// How wrong the calibrated monitor still is at about the window's sample rate.
    pub mismatch: Mismatch,
    /// How far the motor is off its type, and how well that is known.
    pub motor: MotorKnowledge,
}

/// What is known of a window's unknowns beside the faults.
pub(crate) fn prior(params: &ActuatorParams, conditions: &Conditions, motor: MotorKnowledge) -> Prior {
    Prior {
        load_torque: match conditions.load_torque {
            Some(_) => LOAD_SIGMA_NM,
            None => LOAD_SIGMA_SHARE * Scale::new(params).load_unit(),
        },
        integral: INTEGRAL_SIGMA_SHARE * params.motor.torque_gain() * params.motor.i_max,
        motor,
    }
}

/// What the status frame's load may be off by, Nm: its last digit is 0.1.
const LOAD_SIGMA_NM: f64 = 0.03;

/// What a load that nobody measures may be, in shares of the largest one the motor could hold without losses.
const LOAD_SIGMA_SHARE: f64 = 0.1;

/// What the first currents leave open of the speed loop's integral, in shares of the largest torque.
const INTEGRAL_SIGMA_SHARE: f64 = 0.01;
