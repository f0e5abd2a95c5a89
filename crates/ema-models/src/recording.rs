//! Preparation of a window for the comparison with the monitor: from [`SensedSample`]s to [`ComparedSample`]s and the
//! [`InitialState`].

use crate::control::Setpoint;
use crate::frames::dq_from_abc;
use crate::output_angle::estimate_output_angles;
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::samples::{ComparedSample, InitialState, Origin, SensedSample};

/// Samples of a window and its initial state.
#[derive(Clone, Copy, Debug)]
pub struct Recording<'a> {
    /// Samples one sample period apart, with which the monitor is compared.
    pub samples: &'a [ComparedSample],
    /// Input of the monitor: setpoints, and the measured angles of [`Feedback::Measured`](crate::Feedback). These are the same
    /// samples, except for synthetic data that follow from the inputs of another window; the number is always the same.
    pub drive: &'a [ComparedSample],
    /// State at the first sample.
    pub initial: InitialState,
}

/// Converts the samples of a window: relative angles, currents in the rotor frame, speed, initial state.
///
/// The samples of `sensed` are written to `into`, up to the length of the shorter one. The initial state follows from the
/// first `rest` samples, which precede the trigger: the speed is their mean, the currents are the values of their regression
/// lines at the first sample (at rest, the integrator of the speed loop rises linearly against the static friction).
/// `filled` are the indices of samples that were not measured completely.
///
/// ```
/// use ema_models::{prepare_window, ActuatorParams, SensedSample, Setpoint};
/// let at_rest = SensedSample {
///     seq: 0, currents: [0.0; 3], motor_counts: 16_384, output_counts: 50, setpoint: Setpoint::Position(0.0157),
/// };
/// let sensed = [at_rest; 4];
/// let mut ready = Vec::new();
/// ready.resize(4, Default::default());
/// let initial = prepare_window(&ActuatorParams::bench(), &sensed, &[], 4, 0.0, &mut ready);
/// // A quarter turn of the motor is one electrical turn for four pole pairs.
/// assert!((initial.origin.theta_e - core::f64::consts::TAU).abs() < 1e-12 && initial.omega_m == 0.0);
/// ```
pub fn prepare_window(
    params: &ActuatorParams,
    sensed: &[SensedSample],
    filled: &[usize],
    rest: usize,
    output_zero: f64,
    into: &mut [ComparedSample],
) -> InitialState {
    let Some(first) = sensed.first() else {
        return InitialState::default();
    };
    let frame = WindowFrame::new(params, first).with_output_zero(output_zero);
    let last = sensed.len().saturating_sub(1);
    for (n, (s, ready)) in sensed.iter().zip(into.iter_mut()).enumerate() {
        *ready = frame.compared(&sensed[n.saturating_sub(1)], s, &sensed[(n + 1).min(last)]);
    }
    for &n in filled {
        if let Some(ready) = into.get_mut(n) {
            ready.measured = false;
        }
    }

    let rest = rest.max(1).min(sensed.len()).min(into.len());
    if rest == 0 {
        return InitialState::default();
    }
    let ready = sensed.len().min(into.len());
    let backlash = estimate_output_angles(params, &frame.origin, &mut into[..ready]);
    let at_rest = into[..rest].iter().map(|s| [s.i_d, s.i_q]);
    frame.initial_state(&sensed[rest - 1], at_rest, backlash)
}

/// A count as a number, the same bits as by `as`: a controller has an instruction for 32 bits only.
#[must_use]
#[inline(always)]
pub fn number_of_counts(counts: i64) -> f64 {
    i32::try_from(counts).map_or_else(|_| counts as f64, f64::from)
}

/// Converts the samples of one window, one at a time.
#[derive(Clone, Copy, Debug)]
pub struct WindowFrame {
    origin: Origin,
    motor_lsb: f64,
    output_lsb: f64,
    pole_pairs: f64,
    sample_rate: f64,
    first_motor_counts: i64,
    first_output_counts: i64,
}

impl WindowFrame {
    /// The conversion for the window with this first sample.
    #[must_use]
    pub fn new(params: &ActuatorParams, first: &SensedSample) -> Self {
        let sensors = &params.sensors;
        let (motor_lsb, output_lsb) = (sensors.motor_lsb(), sensors.output_lsb());
        // The angle within one turn gives the same theta_e with more precision.
        let within_turn = first.motor_counts.rem_euclid(sensors.motor_counts_per_rev as i64) as f64;
        Self {
            origin: Origin {
                theta_e: params.motor.pole_pairs * within_turn * motor_lsb,
                play_centre: first.motor_counts as f64 * motor_lsb / params.transmission.gear_ratio
                    - first.output_counts as f64 * output_lsb,
            },
            motor_lsb,
            output_lsb,
            pole_pairs: params.motor.pole_pairs,
            sample_rate: sensors.sample_rate,
            first_motor_counts: first.motor_counts,
            first_output_counts: first.output_counts,
        }
    }

    /// The same with the zero of the output at this angle, rad, against the zero of the motor behind the gear; a part of a count.
    #[must_use]
    pub fn with_output_zero(mut self, output_zero: f64) -> Self {
        self.origin.play_centre -= output_zero;
        self
    }

    /// Origin of the window's relative angles.
    #[must_use]
    pub fn origin(&self) -> Origin {
        self.origin
    }

    /// Relative angles of motor and output, rad, each at the middle of its count.
    #[must_use]
    pub fn angles(&self, s: &SensedSample) -> [f64; 2] {
        [
            (number_of_counts(s.motor_counts - self.first_motor_counts) + 0.5) * self.motor_lsb,
            (number_of_counts(s.output_counts - self.first_output_counts) + 0.5) * self.output_lsb,
        ]
    }

    /// A measured sample, from itself and its neighbours (itself at either end); [`ComparedSample::theta_out_estimate`] is 0.
    #[must_use]
    pub fn compared(&self, before: &SensedSample, s: &SensedSample, after: &SensedSample) -> ComparedSample {
        let [theta_m, theta_out] = self.angles(s);
        let theta_e = self.origin.theta_e + self.pole_pairs * theta_m;
        let [i_d, i_q] = dq_from_abc(s.currents, theta_e.sin_cos_poly());
        let span = after.seq.saturating_sub(before.seq).max(1) as f64 / self.sample_rate;
        // At either end the sample has one neighbour only.
        let neighbours = f64::from(u8::from(before.seq < s.seq) + u8::from(s.seq < after.seq)).max(1.0);
        ComparedSample {
            i_d,
            i_q,
            theta_m,
            omega_m: number_of_counts(after.motor_counts - before.motor_counts) * self.motor_lsb / span,
            theta_out,
            theta_m_change: number_of_counts(after.motor_counts - before.motor_counts) * self.motor_lsb / neighbours,
            theta_out_estimate: 0.0,
            setpoint: match s.setpoint {
                Setpoint::Position(angle) => {
                    Setpoint::Position(angle - self.first_output_counts as f64 * self.output_lsb)
                }
                other => other,
            },
            measured: true,
        }
    }

    /// State at the first sample, from the last sample at rest and the direct and quadrature currents of all samples at rest; `backlash` is
    /// that of the [output angles](crate::OutputAngleEstimator::backlash).
    #[must_use]
    pub fn initial_state(
        &self,
        last_at_rest: &SensedSample,
        currents: impl ExactSizeIterator<Item = [f64; 2]> + Clone,
        backlash: f64,
    ) -> InitialState {
        let rest = currents.len();
        let turned = last_at_rest.motor_counts - self.first_motor_counts;
        // A change of one count may be dither at rest.
        let omega_m = if turned.abs() > 1 {
            turned as f64 * self.motor_lsb * self.sample_rate / (rest.max(2) - 1) as f64
        } else {
            0.0
        };
        InitialState {
            origin: self.origin,
            theta_m: 0.5 * self.motor_lsb,
            omega_m,
            i_dq: [
                value_at_start(currents.clone().map(|i| i[0])),
                value_at_start(currents.map(|i| i[1])),
            ],
            backlash,
        }
    }
}

/// Value of the regression line through equally spaced numbers at the first of them; 0 without numbers.
fn value_at_start(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    let (mut sum, mut moment) = (0.0, 0.0);
    for (x, y) in values.enumerate() {
        sum += y;
        moment += x as f64 * y;
    }
    if n > 1.0 {
        (2.0 * (2.0 * n - 1.0) * sum - 6.0 * moment) / (n * (n + 1.0))
    } else {
        sum
    }
}
