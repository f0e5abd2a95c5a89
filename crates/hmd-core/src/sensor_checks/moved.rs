//! Whether samples show a motion of an actuator: the travel of its output, and the current that moves it.

use ema_models::{ActuatorParams, SensedSample};

/// Travel of the output that is a motion, in thresholds of the trigger.
const TRAVEL_THRESHOLDS: f64 = 10.0;

/// Current that moves the actuator, share of I_max: nothing else turns it.
const CURRENT_SHARE: f64 = 0.05;

/// Travel and current beyond which an actuator moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionLimits {
    travel_rad: f64,
    current_a: f64,
    rad_per_motor_count: f64,
}

impl MotionLimits {
    /// Of an actuator whose windows a motion by `trigger_rad` begins.
    pub(super) fn new(params: &ActuatorParams, trigger_rad: f64) -> Self {
        Self {
            travel_rad: TRAVEL_THRESHOLDS * trigger_rad,
            current_a: CURRENT_SHARE * params.motor.i_max,
            rad_per_motor_count: params.sensors.motor_lsb() / params.transmission.gear_ratio,
        }
    }

    /// Travel of the output by one count of the motor, rad.
    pub(super) fn rad_per_motor_count(&self) -> f64 {
        self.rad_per_motor_count
    }
}

/// Range of the motor's counts over samples, and their largest current.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    limits: MotionLimits,
    least: i64,
    most: i64,
    current_max_a: f64,
}

impl Moved {
    /// Since the motor stood at these counts.
    pub(super) fn since(motor_counts: i64, limits: MotionLimits) -> Self {
        Self {
            limits,
            least: motor_counts,
            most: motor_counts,
            current_max_a: 0.0,
        }
    }

    /// Takes a sample.
    pub(super) fn push(&mut self, sample: &SensedSample) {
        self.least = self.least.min(sample.motor_counts);
        self.most = self.most.max(sample.motor_counts);
        let currents = sample.currents.iter();
        self.current_max_a = currents.fold(self.current_max_a, |max, i| max.max(i.abs()));
    }

    /// Travel of the output, rad.
    pub(super) fn travel_rad(&self) -> f64 {
        self.most.abs_diff(self.least) as f64 * self.limits.rad_per_motor_count
    }

    /// Largest current of a phase, A.
    pub(super) fn current_max_a(&self) -> f64 {
        self.current_max_a
    }

    /// Whether the actuator moved its output.
    pub(super) fn is_motion(&self) -> bool {
        self.travel_rad() > self.limits.travel_rad && self.current_max_a > self.limits.current_a
    }
}
