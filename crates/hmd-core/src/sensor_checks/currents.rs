//! Errors of the current sensors and of the resolver's zero, from what a drive holds at zero.
//!
//! The three currents sum to zero, and the drive holds the direct current at zero, whatever is worn:
//! `i_a + i_b + i_c = o + e i_j` shows offset and gain of one phase, `i_d = (δ + τ ω_e) i_q + o_α cos θ_e + o_β sin θ_e` the zero δ of
//! the resolver, the age τ of the currents and the two other components of the offsets. An eccentric rotor induces a direct voltage
//! ∝ ω_m in each phase; where the current control lets a current through, its components grow with ω_m and ω_m², whereas those of an
//! offset are constant: the better explanation wins, and where both explain a window alike, the estimate decides. Derived here.

use std::ops::Range;

use ema_models::Tolerances;

use super::current_equations::{RIPPLE_ROWS, direct_current, sums_of_currents};
use super::least_squares::{Fit, fit};
use super::signals::{Row, Signals};

/// What is off in the currents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CurrentError {
    /// Offsets of the phases.
    Offsets {
        /// Of each, A.
        offset: [f64; 3],
        /// Whether the direct voltage of an eccentric rotor explains them alike.
        or_rotor: bool,
    },
    /// Offset of the sum of the phases, A, of which the direct current shows nothing: a drive that has these sensors holds what they read
    /// at zero.
    Sum(f64),
    /// This phase reads so many times its current.
    Gain(usize, f64),
    /// The resolver is ahead of the rotor by this angle, rad electrical, or, where both explain the window alike, the currents
    /// are older than the angles by this time, s.
    Zero {
        /// Angle.
        ahead: f64,
        /// Its standard deviation.
        sigma: f64,
        /// Time.
        or_late: Option<f64>,
    },
    /// The currents are older than the angles by this time, s.
    Late(f64),
}

/// Offset in tolerances, and in standard deviations of the fit, from which on it is no tolerance.
const OFFSET_TOLERANCES: f64 = 3.3;
const SIGMAS: f64 = 6.0;

/// Share of that limit from which on a sum is worth a question where nothing else explains a window.
const SUM_SHARE: f64 = 0.5;

/// Usual tolerance of an offset as a share of I_max: 30 mA on `bench`. Smaller motors have sensors of a smaller range.
pub(crate) const OFFSET_SHARE: f64 = 2.8e-3;

/// Error of one gain from which on it is none of a sensor within its tolerance, in tolerances, and least.
const GAIN_TOLERANCES: f64 = 4.0;

/// Zero of a resolver that is none of an adjusted one, rad electrical: 3.5°. A vector drive without decoupling leaves a direct current with the
/// speed that looks like up to 2.8° (suite `robust`).
pub(super) const ZERO_MIN: f64 = 0.0611;

/// Share of a sample period that two signals of one sample may be apart.
const LATE_PERIODS: f64 = 0.5;

/// Time that two signals of one sample may be apart in any case, s.
const LATE_MIN_S: f64 = 200e-6;

/// Prior of the gain and offsets of a fit: none.
const FREE: (f64, f64) = (0.0, f64::INFINITY);

/// Where the sum of squares of one explanation exceeds that of another by so many times its noise, it explains the window worse.
const WORSE: f64 = 12.0;

/// The errors of a window's currents. Those of a device with two sensors show no sum.
pub(super) fn current_errors(signals: &Signals, tolerances: &Tolerances) -> Vec<CurrentError> {
    let mut found = Vec::new();
    let sum = sum_of_currents(signals, tolerances, &mut found);
    let along = along_direct(signals, tolerances, &mut found);
    let Some(([alpha, beta], or_rotor)) = along else {
        return found;
    };
    // A gain error makes no offset, and its sum none either.
    if found.iter().any(|error| matches!(error, CurrentError::Gain(..))) {
        return found;
    }
    let limit = offset_limit(signals, tolerances);
    if let Some(sum) = sum.filter(|_| alpha.abs() + beta.abs() <= 0.0) {
        found.extend((limit > 0.0 && sum.abs() > SUM_SHARE * limit).then_some(CurrentError::Sum(sum)));
        return found;
    }
    let common = sum.unwrap_or(0.0) / 3.0;
    let offsets = [
        alpha + common,
        -0.5 * alpha + 0.75_f64.sqrt() * beta + common,
        -0.5 * alpha - 0.75_f64.sqrt() * beta + common,
    ];
    let beyond = offsets.iter().filter(|offset| offset.abs() > limit).count();
    if limit > 0.0 && beyond > 0 {
        // A rotor makes no sum of the currents, and that its components complete the sum to an offset of one phase is no chance.
        let is_of_one = beyond == 1 && sum.is_some_and(|sum| sum.abs() > limit);
        found.push(CurrentError::Offsets {
            offset: offsets,
            or_rotor: or_rotor && !is_of_one,
        });
    }
    found
}

/// Offset of one phase beyond which it is no tolerance, A; 0 where the tolerances have none.
pub(super) fn offset_limit(signals: &Signals, tolerances: &Tolerances) -> f64 {
    OFFSET_TOLERANCES * tolerances.current_offset.min(OFFSET_SHARE * signals.i_max())
}

/// The phase whose gain explains the sum of the currents.
pub(super) fn gain_of_a_phase(signals: &Signals, tolerances: &Tolerances) -> Option<CurrentError> {
    let mut found = Vec::new();
    sum_of_currents(signals, tolerances, &mut found);
    found.pop()
}

/// Offset of the sum, A, where it is clear; a phase whose gain explains the sum goes to `found`.
fn sum_of_currents(signals: &Signals, tolerances: &Tolerances, found: &mut Vec<CurrentError>) -> Option<f64> {
    let sum = |row: &Row| row.currents.iter().sum::<f64>();
    let of_phase = |phase: usize| {
        let rows = sums_of_currents(signals).map(|(currents, sum)| ([1.0, currents[phase]], sum));
        fit(rows, [FREE; 2], 1.0)
    };
    let measured = signals.rows.iter().filter(|row| !row.is_filled);
    let alone = fit(measured.map(|row| ([1.0], sum(row))), [FREE], 1.0)?;
    let best = (0..3)
        .filter_map(|phase| Some((phase, of_phase(phase)?)))
        .reduce(|best, other| {
            if other.1.mean_square < best.1.mean_square {
                other
            } else {
                best
            }
        });
    if let Some((phase, fit)) = best {
        let [offset, error] = fit.value;
        let limit = GAIN_TOLERANCES * tolerances.current_gain;
        if limit > 0.0 && error.abs() > limit && error.abs() > SIGMAS * fit.sigma[1] {
            found.push(CurrentError::Gain(phase, 1.0 + error));
            return Some(offset);
        }
    }
    clear(&alone, 0)
}

/// A coefficient that is clear of its standard deviation.
fn clear<const P: usize>(fit: &Fit<P>, place: usize) -> Option<f64> {
    (fit.value[place].abs() > SIGMAS * fit.sigma[place]).then_some(fit.value[place])
}

/// Columns of the fit of the direct current, and which of them are used.
const COLUMNS: usize = 8;
type Uses = [bool; COLUMNS];

/// Columns of the zero of the resolver, of the age of the currents, of offsets and of an eccentric rotor.
const ZERO: Range<usize> = 0..1;
const AGE: Range<usize> = 1..2;
const OFFSETS: Range<usize> = 2..4;
const ROTOR: Range<usize> = 4..8;

fn uses(one: Range<usize>, other: Range<usize>) -> Uses {
    core::array::from_fn(|n| one.contains(&n) || other.contains(&n))
}

/// Offsets along α and β, A, each 0 where it is not clear, and whether an eccentric rotor explains them alike; a zero or an age that is off
/// goes to `found`.
fn along_direct(signals: &Signals, tolerances: &Tolerances, found: &mut Vec<CurrentError>) -> Option<([f64; 2], bool)> {
    let turn = signals.pole_pairs * signals.span(|row| row.theta_m);
    let fastest = signals.rows.iter().map(|row| row.omega_m.abs()).fold(1e-9, f64::max);
    // Columns: those of zero, age and offsets; cos θ_e and sin θ_e times ω_m and ω_m², as shares of the largest speed.
    let row = |(row, [zero, age, cos, sin], direct): (&Row, [f64; 4], f64), uses: Uses| {
        let speed = row.omega_m / fastest;
        let [of_cos, of_sin] = [speed * cos, speed * sin];
        let columns = [zero, age, cos, sin, of_cos, of_sin, speed * of_cos, speed * of_sin];
        (core::array::from_fn(|n| if uses[n] { columns[n] } else { 0.0 }), direct)
    };
    let offset = if turn > std::f64::consts::PI {
        FREE
    } else {
        (0.0, tolerances.current_offset.max(1e-6))
    };
    let fitted = |uses: Uses| {
        let prior: [(f64, f64); COLUMNS] = core::array::from_fn(|n| match n {
            _ if !uses[n] => (0.0, 1.0),
            0 | 1 => FREE,
            2 | 3 => offset,
            _ => (0.0, signals.i_max()),
        });
        fit(
            direct_current(signals).map(|equation| row(equation, uses)),
            prior,
            RIPPLE_ROWS,
        )
    };
    let by_zero = fitted(uses(ZERO, OFFSETS))?;
    let by_age = fitted(uses(AGE, OFFSETS))?;
    let worse = |one: &Fit<COLUMNS>, other: &Fit<COLUMNS>| {
        let noise = other.mean_square.max(f64::MIN_POSITIVE);
        one.rows * (one.mean_square - other.mean_square) > WORSE * RIPPLE_ROWS * noise
    };
    let (ahead, sigma) = (by_zero.value[0], by_zero.sigma[0]);
    let late = by_age.value[1];
    let is_off = ahead.abs() > ZERO_MIN && ahead.abs() > SIGMAS * sigma;
    let least_late = (LATE_PERIODS / signals.rate_hz).max(LATE_MIN_S);
    let is_late = late.abs() > least_late && late.abs() > SIGMAS * by_age.sigma[1];
    if is_off && !worse(&by_zero, &by_age) {
        let or_late = (is_late && !worse(&by_age, &by_zero)).then_some(late);
        // The fit is that of the tangent.
        found.push(CurrentError::Zero {
            ahead: ahead.atan(),
            sigma: sigma / (1.0 + ahead * ahead),
            or_late,
        });
    } else if is_late && worse(&by_zero, &by_age) {
        found.push(CurrentError::Late(late));
    }
    let (first, best) = if worse(&by_zero, &by_age) {
        (AGE, by_age)
    } else {
        (ZERO, by_zero)
    };
    let by_rotor = fitted(uses(first, ROTOR))?;
    if worse(&best, &by_rotor) {
        return Some(([0.0; 2], false));
    }
    let offsets = [2, 3].map(|place| clear(&best, place).unwrap_or(0.0));
    Some((offsets, !worse(&by_rotor, &best)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::{ActuatorParams, Real, SensedSample, Setpoint, abc_from_alpha_beta, alpha_beta_from_dq};

    /// The errors of a motion whose speed rises from `slow` to 100 rad/s, with 2 A on the torque axis, these offsets, A, and in
    /// every phase a direct current by an eccentric rotor of `rotor` A at the highest speed.
    fn errors(slow: f64, offsets: [f64; 3], rotor: f64) -> Vec<CurrentError> {
        let (params, samples) = motion(slow, offsets, rotor);
        current_errors(&Signals::new(&params, &samples, &[]), &Tolerances::USUAL)
    }

    fn motion(slow: f64, offsets: [f64; 3], rotor: f64) -> (ActuatorParams, Vec<SensedSample>) {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 2000.0;
        let mut angle = 0.0;
        let samples = (0..1000_u64).map(|seq| {
            let speed = slow + (100.0 - slow) * seq as f64 / 1000.0;
            angle += speed / 2000.0;
            let (sin, cos) = (params.motor.pole_pairs * (angle + 0.5 * params.sensors.motor_lsb())).sin_cos_poly();
            let direct = rotor * speed / 100.0 * cos;
            // 10 mA of noise that no column explains, in the direct current and in the sum.
            let noise = if seq % 2 == 0 { 0.01 } else { -0.01 };
            let common = if seq % 4 < 2 { 0.01 } else { -0.01 };
            let currents = abc_from_alpha_beta(alpha_beta_from_dq([direct + noise, 2.0], (sin, cos)));
            SensedSample {
                seq,
                currents: std::array::from_fn(|phase| currents[phase] + offsets[phase] + common),
                motor_counts: (angle / params.sensors.motor_lsb()) as i64,
                output_counts: 0,
                setpoint: Setpoint::Position(0.0),
            }
        });
        let samples = samples.collect();
        (params, samples)
    }

    fn offsets(found: &[CurrentError]) -> Option<([f64; 3], bool)> {
        match found {
            [CurrentError::Offsets { offset, or_rotor }] => Some((*offset, *or_rotor)),
            _ => None,
        }
    }

    #[test]
    fn at_one_speed_offsets_without_a_sum_may_be_a_rotor_and_that_of_one_phase_is_none() {
        let opposite = [0.25, -0.25, 0.0];
        let (found, or_rotor) = offsets(&errors(100.0, opposite, 0.0)).unwrap();
        assert!(or_rotor && (found[0] - 0.25).abs() < 0.01, "{found:?}");
        let (found, or_rotor) = offsets(&errors(20.0, opposite, 0.0)).unwrap();
        assert!(!or_rotor && (found[1] + 0.25).abs() < 0.01, "{found:?}");
        let (found, or_rotor) = offsets(&errors(100.0, [0.0, 0.25, 0.0], 0.0)).unwrap();
        assert!(
            !or_rotor && (found[1] - 0.25).abs() < 0.01 && found[0].abs() < 0.01,
            "{found:?}"
        );
    }

    #[test]
    fn a_direct_current_that_grows_with_the_speed_is_no_offset() {
        assert_eq!(errors(20.0, [0.0; 3], 0.25), []);
    }

    #[test]
    fn samples_that_were_filled_in_are_no_evidence_against_a_gain() {
        let (params, mut samples) = motion(20.0, [0.0; 3], 0.0);
        // Of the largest currents of the phase that reads too much the sums were refused.
        let mut filled = Vec::new();
        for (n, sample) in samples.iter_mut().enumerate() {
            if sample.currents[0].abs() > 1.0 {
                filled.push(n);
            } else {
                sample.currents[0] *= 1.1;
            }
        }
        let found = |filled: &[usize]| gain_of_a_phase(&Signals::new(&params, &samples, filled), &Tolerances::USUAL);
        let Some(CurrentError::Gain(0, gain)) = found(&filled) else {
            panic!("{:?}", found(&filled));
        };
        assert!((gain - 1.1).abs() < 0.01, "{gain}");
    }
}
