//! What one window shows of its sensors: offsets and gains of the currents, their age, errors of the resolver, link voltage.
//!
//! Three least squares, none of which needs a commissioned unit. Derived here:
//! - the currents of a star connection sum to zero: `i_a + i_b + i_c = o + Σ e_j i_q s_j`, with Σ e_j = 0;
//! - the drive holds the direct current at zero: `i_d = δ i_q + τ ω_e i_q + a cos θ_e + b sin θ_e`;
//! - the balance of the shaft, smoothed by a kernel f as the relations are (`docs/design/relations.md`):
//!   `Σ Δ²f θ_m / Δt² = Σ f g (i_q + o_α sin θ_e − o_β cos θ_e + …) + Σ Δ²f ε(θ_e) / (p Δt²)`, ε the resolver's error of first and second
//!   electrical harmonic. What wears (turns, eccentricity, friction) has columns of its own there.
//!
//! Sigmas are those of white errors. Model errors scatter from window to window; who compares windows takes the scatter from them.

use ema_identify::relations::Kernel;
use ema_models::{ActuatorParams, DriveKind, Real};

use super::current_equations::{RIPPLE_ROWS, direct_current, sums_of_currents};
use super::least_squares::fit;
use super::signals::Signals;
use crate::outbox::WindowJob;

/// Value and standard deviation of one quantity in one window.
pub type Reading = (f64, f64);

/// What a window shows; `None` where it does not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorReadings {
    /// Sum of the three phase currents without current, A; of three sensors.
    pub current_sum: Option<Reading>,
    /// Error of the gain of each phase against the mean of the three; of three sensors.
    pub phase_gain: Option<[Reading; 3]>,
    /// Offsets of the currents along α and β, A.
    pub current_offset: Option<[Reading; 2]>,
    /// Time by which the currents are older than the angles, s.
    pub current_latency: Option<Reading>,
    /// Error of the resolver, rad electrical: cos θ_e, sin θ_e, cos 2θ_e, sin 2θ_e.
    pub resolver: Option<[Reading; 4]>,
    /// Link voltage, V.
    pub dc_link: Option<Reading>,
}

/// What a window shows of its sensors, by its samples as they were received.
#[must_use]
pub fn sensor_readings(job: &WindowJob) -> SensorReadings {
    let params = &job.params;
    let signals = Signals::new(params, &job.window.samples, &job.window.filled);
    let mut readings = SensorReadings {
        current_latency: latency(&signals),
        dc_link: job.conditions.dc_link_v.map(|volts| (volts, DC_LINK_LSB_V)),
        ..SensorReadings::default()
    };
    if let Some((sum, gains)) = sum_and_gains(&signals, params.sensors.current_lsb()) {
        readings.current_sum = Some(sum);
        readings.phase_gain = gains;
    }
    if let Some((offset, resolver)) = by_balance(&signals, params) {
        let ripple = match job.actuator.drive.kind {
            DriveKind::Hysteresis => RIPPLE_SHARE * params.controller.hysteresis,
            DriveKind::Vector => 0.0,
        };
        readings.current_offset = Some(offset.map(|(value, sigma)| (value, sigma.hypot(ripple))));
        readings.resolver = Some(resolver);
    }
    readings
}

/// Step of the link voltage in status frames, V.
const DC_LINK_LSB_V: f64 = 0.1;

/// Standard deviation of a gain beyond which a window does not show it.
const GAIN_SIGMA_MAX: f64 = 0.05;

/// Standard deviation of an offset by the ripple that comparators make between the samples, share of their half band. Windows of one
/// motion hide it; those of several scatter by 10 to 24 mA of 50 mA (`bench`, 2 kHz), by 3 mA of 50 mA (`servo28`).
const RIPPLE_SHARE: f64 = 0.2;

const FREE: (f64, f64) = (0.0, f64::INFINITY);

/// Whether the third current of a window follows from the other two, so that no sum of the phases checks the sensors.
#[must_use]
pub fn has_no_sum(job: &WindowJob) -> bool {
    let params = &job.params;
    let signals = Signals::new(params, &job.window.samples, &job.window.filled);
    has_two_sensors(&signals, params.sensors.current_lsb())
}

fn has_two_sensors(signals: &Signals, lsb: f64) -> bool {
    let mut sums = signals.rows.iter().map(|row| row.currents.iter().sum::<f64>());
    sums.all(|sum| sum.abs() < lsb)
}

/// Offset of the sum and gains of the phases; `None` where the third current follows from the other two.
fn sum_and_gains(signals: &Signals, lsb: f64) -> Option<(Reading, Option<[Reading; 3]>)> {
    if has_two_sensors(signals, lsb) {
        return None;
    }
    let rows = sums_of_currents(signals).map(|([a, b, c], sum)| ([1.0, a - c, b - c], sum));
    let found = fit(rows, [FREE, (0.0, 1.0), (0.0, 1.0)], 1.0)?;
    let ([sum, a, b], [sum_sigma, a_sigma, b_sigma]) = (found.value, found.sigma);
    let shows_gains = a_sigma.max(b_sigma) < GAIN_SIGMA_MAX;
    let gains = [(a, a_sigma), (b, b_sigma), (-a - b, a_sigma.hypot(b_sigma))];
    Some(((sum, sum_sigma), shows_gains.then_some(gains)))
}

/// Standard deviation of the latency beyond which a window does not show it, s.
const LATENCY_SIGMA_MAX_S: f64 = 2e-4;

fn latency(signals: &Signals) -> Option<Reading> {
    let rows = direct_current(signals).map(|(_, columns, direct)| (columns, direct));
    let offset = (0.0, OFFSET_SHARE_MAX * signals.i_max());
    let found = fit(rows, [(0.0, 0.3), FREE, offset, offset], RIPPLE_ROWS)?;
    let (latency, sigma) = (found.value[1], found.sigma[1]);
    (sigma < LATENCY_SIGMA_MAX_S).then_some((latency, sigma))
}

/// Offset that an unknown one may have, share of I_max.
const OFFSET_SHARE_MAX: f64 = 0.1;

/// Half width of the kernel, s, and least samples.
const HALF_WIDTH_S: f64 = 3e-3;
const HALF_WIDTH_MIN: f64 = 3.0;

/// Speed below which the motor may stick, rad/s.
const SPEED_MIN: f64 = 3.0;

/// Electrical angle from sample to sample beyond which products of samples alias, rad.
const STEP_MAX_RAD: f64 = 0.8;

/// Columns of the balance: torque, turns and eccentricity (4), offsets (2), resolver (4), dry friction, damping, load, spring.
const COLUMNS: usize = 15;

/// Places of offsets and resolver among the columns.
const OFFSETS: usize = 5;
const RESOLVER: usize = 7;

/// Standard deviations beyond which a window does not show offsets, share of I_max, and errors of the resolver, rad electrical.
const OFFSET_SIGMA_MAX: f64 = 0.01;
const RESOLVER_SIGMA_MAX: f64 = 0.02;

/// Offsets along α and β, and the error of the resolver, by the torque balance.
pub(super) fn by_balance(signals: &Signals, params: &ActuatorParams) -> Option<([Reading; 2], [Reading; 4])> {
    let motor = &params.motor;
    let (p, rate) = (motor.pole_pairs, signals.rate_hz);
    let kernel = Kernel::rigid(HALF_WIDTH_S.max(HALF_WIDTH_MIN / rate), rate);
    let half = kernel.half_width();
    // Scales near 1 keep the normal equations well conditioned.
    let (i_max, omega_max) = (motor.i_max, params.controller.omega_max);
    let acceleration_max = motor.torque_gain() * i_max / motor.j;
    let first = signals.rows.first()?.theta_out;
    let rows = (half..signals.rows.len().saturating_sub(half)).filter_map(|n| {
        let around = &signals.rows[n - half..=n + half];
        let speed = around[half].omega_m;
        let is_fit = (p * speed / rate).abs() < STEP_MAX_RAD
            && around
                .iter()
                .all(|row| row.omega_m * speed > 0.0 && row.omega_m.abs() > SPEED_MIN);
        if !is_fit {
            return None;
        }
        let (mut columns, mut y) = ([0.0; COLUMNS], 0.0);
        for ((row, f), second) in around.iter().zip(kernel.average()).zip(kernel.second()) {
            let (sin, cos) = (p * row.theta_m).sin_cos_poly();
            let (sin_2, cos_2) = (2.0 * sin * cos, cos * cos - sin * sin);
            let i_q = signals.i_dq(row)[1] / i_max;
            let plain = [i_q, i_q * cos, i_q * sin, i_q * cos_2, i_q * sin_2, sin, -cos];
            for (column, value) in columns.iter_mut().zip(plain) {
                *column += f * value;
            }
            for (column, value) in columns[RESOLVER..].iter_mut().zip([cos, sin, cos_2, sin_2]) {
                *column += second * value / (p * acceleration_max);
            }
            let against = [
                -speed.signum(),
                -row.omega_m / omega_max,
                -1.0,
                -(row.theta_out - first),
            ];
            for (column, value) in columns[RESOLVER + 4..].iter_mut().zip(against) {
                *column += f * value;
            }
            y += second * (row.theta_m - around[half].theta_m) / acceleration_max;
        }
        Some((columns, y))
    });
    let mut prior = [(0.0, 1.0); COLUMNS];
    prior[0] = (1.0, 0.5);
    prior[OFFSETS..RESOLVER].fill((0.0, OFFSET_SHARE_MAX));
    prior[RESOLVER..RESOLVER + 4].fill((0.0, OFFSET_SHARE_MAX));
    let found = fit(rows, prior, half as f64)?;
    let gain = found.value[0];
    let offset = |n: usize| {
        let [value, sigma] = [found.value[OFFSETS + n], found.sigma[OFFSETS + n]];
        (i_max * value / gain, i_max * sigma / gain)
    };
    let resolver: [Reading; 4] = std::array::from_fn(|n| (found.value[RESOLVER + n], found.sigma[RESOLVER + n]));
    let offsets = [offset(0), offset(1)];
    let shows = gain > 0.1
        && offsets.iter().all(|(_, sigma)| *sigma < OFFSET_SIGMA_MAX * i_max)
        && resolver.iter().all(|(_, sigma)| *sigma < RESOLVER_SIGMA_MAX);
    shows.then_some((offsets, resolver))
}
