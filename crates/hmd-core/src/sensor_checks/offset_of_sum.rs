//! Which phase has the offset of the sum of the currents, where the direct current does not show it.
//!
//! A drive that controls its currents by the same sensors holds the *read* direct current at zero: the offset stands in the real currents, and
//! in their torque. An offset o of one phase j lies along `2/3 o (cos 2πj/3, sin 2πj/3)` of α and β, one that all share along neither. Derived here.

use std::f64::consts::TAU;

use ema_models::ActuatorParams;

use super::readings::by_balance;
use super::signals::Signals;

/// Whose offset it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SumOffset {
    /// Of this phase alone.
    OfPhase(usize),
    /// Of all three alike.
    OfAll,
}

/// Share of the limit by which the offsets that are no fault blur the torque.
const BLUR: f64 = 0.25;

/// Squared deviation up to which an explanation holds, and by which the next one is worse.
const HOLDS: f64 = 16.0;
const WORSE: f64 = 9.0;

/// Whose the offset of a sum, A, is by the torque; `limit` is what one phase may have, A, up to which the likeliest suffices: the estimate then
/// tells whether it is. `None` where the torque does not tell.
pub(super) fn offset_of_sum(signals: &Signals, params: &ActuatorParams, sum: f64, limit: f64) -> Option<SumOffset> {
    let ([alpha, beta], _) = by_balance(signals, params)?;
    let off = |expected: [f64; 2]| -> f64 {
        let read = [alpha, beta].into_iter().zip(expected);
        read.map(|((value, sigma), expected)| ((value - expected) / sigma.hypot(BLUR * limit)).powi(2))
            .sum()
    };
    let of_phase = |phase: usize| {
        let (sin, cos) = (TAU / 3.0 * phase as f64).sin_cos();
        let expected = [cos, sin].map(|share| 2.0 / 3.0 * sum * share);
        (off(expected), SumOffset::OfPhase(phase))
    };
    let mut all = [of_phase(0), of_phase(1), of_phase(2), (off([0.0; 2]), SumOffset::OfAll)];
    all.sort_by(|one, other| one.0.total_cmp(&other.0));
    let [(least, whose), (next, _), ..] = all;
    let is_told = sum.abs() <= limit || next > least + WORSE;
    (least < HOLDS && is_told).then_some(whose)
}
