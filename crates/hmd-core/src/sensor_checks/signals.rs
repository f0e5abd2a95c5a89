//! A window as the checks read it: measured quantities of each sample in SI units.

use ema_models::{ActuatorParams, MotorParams, Real, SensedSample, Setpoint, dq_from_abc};

/// Quantities of one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// Phase currents, A.
    pub(super) currents: [f64; 3],
    /// Motor angle as counted, rad.
    pub(super) theta_m: f64,
    /// Motor speed, rad/s: central difference of the angle.
    pub(super) omega_m: f64,
    /// Output angle as counted, rad.
    pub(super) theta_out: f64,
    /// Set point.
    pub(super) setpoint: Setpoint,
    /// Whether any of it was filled in: its currents are no evidence.
    pub(super) is_filled: bool,
}

/// A window in SI units.
#[derive(Clone, Debug)]
pub(super) struct Signals {
    pub(super) rows: Vec<Row>,
    pub(super) pole_pairs: f64,
    pub(super) rate_hz: f64,
    motor: MotorParams,
}

impl Signals {
    /// Of the samples of a window; `filled` are the indices of those that were filled in, rising.
    pub(super) fn new(params: &ActuatorParams, samples: &[SensedSample], filled: &[usize]) -> Self {
        let (motor_lsb, output_lsb) = (params.sensors.motor_lsb(), params.sensors.output_lsb());
        let rate_hz = params.sensors.sample_rate;
        let angle = |n: usize| (samples[n].motor_counts as f64 + 0.5) * motor_lsb;
        let last = samples.len().saturating_sub(1);
        let rows = samples.iter().enumerate().map(|(n, sample)| {
            let (before, after) = (n.saturating_sub(1), (n + 1).min(last));
            let turned = samples[after].motor_counts.saturating_sub(samples[before].motor_counts) as f64;
            Row {
                currents: sample.currents,
                theta_m: angle(n),
                omega_m: turned * motor_lsb * rate_hz / (after - before).max(1) as f64,
                theta_out: sample.output_counts as f64 * output_lsb,
                setpoint: sample.setpoint,
                is_filled: filled.binary_search(&n).is_ok(),
            }
        });
        Self {
            rows: rows.collect(),
            pole_pairs: params.motor.pole_pairs,
            rate_hz,
            motor: params.motor,
        }
    }

    /// The same with the resolver turned back by an electrical angle, rad.
    pub(super) fn turned_back(&self, ahead: f64) -> Self {
        let mut turned = self.clone();
        for row in &mut turned.rows {
            row.theta_m -= ahead / self.pole_pairs;
        }
        turned
    }

    /// Largest current of the motor, A.
    pub(super) fn i_max(&self) -> f64 {
        self.motor.i_max
    }

    /// Whether the drive has voltage to spare at a sample, so that it holds the direct current: the phase voltage of a motor at this
    /// speed with this current, `|R i_q + k ω, ω_e L i_q|`, is below [`VOLTAGE_SHARE`] of the nominal link voltage.
    pub(super) fn is_controlled(&self, row: &Row) -> bool {
        let motor = &self.motor;
        let i = row.currents.iter().fold(0.0, |max: f64, i| max.max(i.abs()));
        let along = motor.r_s * i + (motor.k * row.omega_m).abs();
        let across = self.pole_pairs * row.omega_m * motor.l_s * i;
        along.hypot(across) < VOLTAGE_SHARE * motor.v_dc
    }

    /// Direct and quadrature current of a sample.
    pub(super) fn i_dq(&self, row: &Row) -> [f64; 2] {
        dq_from_abc(row.currents, (self.pole_pairs * row.theta_m).sin_cos_poly())
    }

    /// Largest minus smallest value of a quantity; 0 of an empty window.
    pub(super) fn span(&self, of: impl Fn(&Row) -> f64) -> f64 {
        let (min, max) = range(self.rows.iter().map(of));
        (max - min).max(0.0)
    }
}

/// Smallest and largest of some values.
pub(super) fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    values.into_iter().fold(none, |(min, max), x| (min.min(x), max.max(x)))
}

/// Share of the link voltage: three quarters of V_dc / √3, for supplies that sag by a quarter.
const VOLTAGE_SHARE: f64 = 0.43;

/// The angle of a set point in position mode, rad.
pub(super) fn commanded_angle(setpoint: Setpoint) -> Option<f64> {
    match setpoint {
        Setpoint::Position(angle) => Some(angle),
        Setpoint::Idle | Setpoint::Speed(_) => None,
    }
}
