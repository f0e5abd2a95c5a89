//! Wiring and angles: does the current lie across the rotor?
//!
//! A drive holds the direct current at zero: nearly all of the current is on the torque axis, whatever is worn. Phases in each
//! other's place, a reversed resolver or wrong pole pairs turn the current against the rotor. The share of the current's square
//! that lies on the torque axis, `Q = Σ i_q² / Σ 2/3 (i_a² + i_b² + i_c²)`, is 1 less the noise for the right wiring and about ½ for a
//! wrong one. Derived here.

use std::f64::consts::PI;

use ema_models::{ActuatorParams, Real, dq_from_abc};

use super::currents::ZERO_MIN;
use super::signals::{Row, Signals};
use super::torque::balance;

/// What may be wrong between sensors and program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wiring {
    /// Nothing.
    Right,
    /// These two phase currents in each other's place.
    Swapped(usize, usize),
    /// One phase current with the wrong sign.
    Reversed(usize),
    /// The resolver counts backwards.
    ResolverReversed,
    /// The resolver counts this many times too much.
    ResolverTimes(f64),
    /// The motor has this many pole pairs.
    PolePairs(f64),
    /// The currents are older than the angles by so many samples.
    CurrentsLate(isize),
}

/// A wiring with the share of the current that it puts on the torque axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct OnTorqueAxis {
    pub(super) wiring: Wiring,
    pub(super) share: f64,
}

/// Share of the current off the torque axis, with the best zero, that asks for another wiring. An actuator that holds its load most of
/// the time hides a wrong number of pole pairs.
const OFF_AXIS: f64 = 0.12;

/// The same for currents of another instant.
pub(super) const OFF_AXIS_LATE: f64 = 0.03;

/// Part of it that the right wiring may leave.
pub(super) const LEFT: f64 = 0.4;

/// Most pole pairs that are tried.
const POLE_PAIRS_MAX: u32 = 30;

/// Turn of the motor that a check needs, rad electrical: a shorter one shows no rotation against the rotor.
const TURN_RAD: f64 = 3.0;

/// The wiring that puts the current on the torque axis where the configured one does not; the share of the configured one, too.
/// `ratio` is what the output turns for each turn of the motor, times the gear ratio.
pub(super) fn other_wiring(
    signals: &Signals,
    params: &ActuatorParams,
    ratio: Option<f64>,
) -> Option<(OnTorqueAxis, f64)> {
    if signals.pole_pairs * signals.span(|row| row.theta_m) < TURN_RAD {
        return None;
    }
    let late = || latenesses(signals.rate_hz).map(Wiring::CurrentsLate);
    // A wrong zero is not a matter of wires.
    let configured = share_on_torque_axis(signals, Wiring::PolePairs(signals.pole_pairs), |_| true)?;
    if 1.0 - configured < OFF_AXIS {
        // Where the drive lacks voltage, the current leaves the torque axis a little by itself.
        let counts = |row: &Row| signals.is_controlled(row);
        let configured = share_on_torque_axis(signals, Wiring::Right, counts)?;
        if 1.0 - configured < OFF_AXIS_LATE {
            return None;
        }
        // A zero that explains as much is told by `far_zero`, or beside the age of the currents by `currents`.
        let by_zero = share_on_torque_axis(signals, Wiring::PolePairs(signals.pole_pairs), counts)?;
        return best_of(signals, late(), configured, counts).filter(|(best, _)| best.share > by_zero);
    }
    let mut candidates: Vec<Wiring> = late().collect();
    match ratio {
        Some(ratio) if ratio < 0.0 => candidates.push(Wiring::ResolverReversed),
        Some(ratio) if (ratio - 1.0).abs() > 0.1 => candidates.push(Wiring::ResolverTimes(1.0 / ratio)),
        _ => {
            candidates.extend([Wiring::Swapped(1, 2), Wiring::Swapped(2, 0), Wiring::Swapped(0, 1)]);
            candidates.extend((0..3).map(Wiring::Reversed));
            candidates.extend(other_pole_pairs(params.motor.pole_pairs));
        }
    }
    best_of(signals, candidates, configured, |_| true)
}

/// Longest time, s, by which currents and angles of one sample may be apart: loggers that join several buses.
pub(super) const LATE_MAX_S: f64 = 6e-3;

/// Samples by which currents may be older than the angles; negative where they are newer.
pub(super) fn latenesses(rate_hz: f64) -> impl Iterator<Item = isize> {
    let most = ((LATE_MAX_S * rate_hz).round() as isize).max(1);
    (1..=most).flat_map(|late| [late, -late])
}

/// The age of the currents against the angles, samples, that puts most of the current on the torque axis, and that share.
pub(super) fn best_lateness(signals: &Signals) -> Option<(isize, f64)> {
    let counts = |row: &Row| signals.is_controlled(row);
    let shares = latenesses(signals.rate_hz).filter_map(|late| {
        let share = share_on_torque_axis(signals, Wiring::CurrentsLate(late), counts)?;
        Some((late, share))
    });
    shares.reduce(|best, other| if other.1 > best.1 { other } else { best })
}

/// Pole pairs other than those configured.
fn other_pole_pairs(configured: f64) -> impl Iterator<Item = Wiring> {
    let all = (1..=POLE_PAIRS_MAX).map(f64::from);
    all.filter(move |p| (p - configured).abs() > 0.5).map(Wiring::PolePairs)
}

/// A resolver far from the zero of its rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FarZero {
    /// The resolver is ahead of the rotor by this angle, rad electrical, within half a turn.
    pub(super) ahead: f64,
    /// Share of the current on the torque axis with it.
    pub(super) share: f64,
    /// Samples by which the currents may be late instead.
    pub(super) or_late: Option<isize>,
}

/// Zero from which on the linear equations of `currents` do not hold, rad electrical: 30°.
pub(super) const FAR: f64 = 0.52;

/// Standard deviations of the gain by the torque balance that tell the half turns apart.
const GAIN_SIGMAS: f64 = 5.0;

/// The zero that puts the current on the torque axis, where it is far from the configured one and no wiring does so better. The half turn
/// by which the axis is open is that in which the currents accelerate the motor.
pub(super) fn far_zero(signals: &Signals, params: &ActuatorParams) -> Option<FarZero> {
    if signals.pole_pairs * signals.span(|row| row.theta_m) < TURN_RAD {
        return None;
    }
    let counts = |row: &Row| signals.is_controlled(row);
    let share = share_on_torque_axis(signals, Wiring::PolePairs(signals.pole_pairs), counts)?;
    if 1.0 - share > OFF_AXIS {
        return None;
    }
    let axis = zero_of_torque_axis(signals, counts);
    let (gain, sigma) = balance(&signals.turned_back(axis), params)?.gain;
    if gain.abs() < GAIN_SIGMAS * sigma {
        return None;
    }
    let ahead = if gain > 0.0 { axis } else { axis - PI.copysign(axis) };
    let is_half_turn = PI - ahead.abs() < ZERO_MIN;
    if ahead.abs() <= FAR || is_half_turn {
        return None;
    }
    let (late, of_late) = best_lateness(signals)?;
    if of_late > share {
        return None;
    }
    // With wrong pole pairs a short motion has a best zero, too.
    let of_others =
        other_pole_pairs(signals.pole_pairs).filter_map(|wiring| share_on_torque_axis(signals, wiring, counts));
    let best = of_others.fold(0.0, f64::max);
    (1.0 - best >= LEFT * (1.0 - share)).then_some(FarZero {
        ahead,
        share,
        or_late: (1.0 - of_late < ALIKE * (1.0 - share)).then_some(late),
    })
}

/// Factor on what lies off the torque axis up to which two explanations are alike.
const ALIKE: f64 = 2.0;

/// Angle by which the resolver is ahead of the torque axis, rad electrical, within a quarter turn, over the rows that count.
fn zero_of_torque_axis(signals: &Signals, counts: impl Fn(&Row) -> bool) -> f64 {
    let rows = signals.rows.iter().filter(|row| counts(row));
    let (real, imaginary) = rows.fold((0.0, 0.0), |(real, imaginary), row| {
        let [d, q] = signals.i_dq(row);
        (real + d * d - q * q, imaginary + 2.0 * d * q)
    });
    0.5 * f64::atan2(imaginary, -real)
}

/// The candidate that puts most of the current on the torque axis, over the rows that count, and the share of the configured wiring;
/// `None` where it leaves too much.
fn best_of(
    signals: &Signals,
    candidates: impl IntoIterator<Item = Wiring>,
    configured: f64,
    counts: impl Fn(&Row) -> bool + Copy,
) -> Option<(OnTorqueAxis, f64)> {
    let scored = candidates.into_iter().filter_map(|wiring| {
        let share = share_on_torque_axis(signals, wiring, counts)?;
        Some(OnTorqueAxis { wiring, share })
    });
    let best = scored.reduce(|best, other| if other.share > best.share { other } else { best })?;
    (1.0 - best.share < LEFT * (1.0 - configured)).then_some((best, configured))
}

/// Share of the current's square on the torque axis with a wiring; where the wiring leaves the zero of the angle open, with the
/// best zero; over the rows that count. `None` without current.
pub(super) fn share_on_torque_axis(signals: &Signals, wiring: Wiring, counts: impl Fn(&Row) -> bool) -> Option<f64> {
    let pole_pairs = match wiring {
        Wiring::PolePairs(pole_pairs) => pole_pairs,
        _ => signals.pole_pairs,
    };
    let late = match wiring {
        Wiring::CurrentsLate(late) => late,
        _ => 0,
    };
    // Σ of the squares, and of the square of i_d + j i_q as a complex number.
    let (mut all, mut on_axis, mut real, mut imaginary) = (0.0, 0.0, 0.0, 0.0);
    for (n, row) in signals.rows.iter().enumerate() {
        if !counts(row) {
            continue;
        }
        let Some(of_currents) = n.checked_add_signed(late).and_then(|n| signals.rows.get(n)) else {
            continue;
        };
        let mut currents = of_currents.currents;
        let mut theta_m = row.theta_m;
        match wiring {
            Wiring::Swapped(one, other) => currents.swap(one, other),
            Wiring::Reversed(phase) => currents[phase] = -currents[phase],
            Wiring::ResolverReversed => theta_m = -theta_m,
            Wiring::ResolverTimes(times) => theta_m /= times,
            Wiring::Right | Wiring::PolePairs(_) | Wiring::CurrentsLate(_) => {}
        }
        let [d, q] = dq_from_abc(currents, (pole_pairs * theta_m).sin_cos_poly());
        all += 2.0 / 3.0 * currents.iter().map(|i| i * i).sum::<f64>();
        on_axis += q * q;
        real += d * d - q * q;
        imaginary += 2.0 * d * q;
    }
    let with_best_zero = 0.5 * (1.0 + real.hypot(imaginary) / all);
    let share = match wiring {
        Wiring::ResolverReversed | Wiring::ResolverTimes(_) | Wiring::PolePairs(_) => with_best_zero,
        _ => on_axis / all,
    };
    share.is_finite().then_some(share)
}
