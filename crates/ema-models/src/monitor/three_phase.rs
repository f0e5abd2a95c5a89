//! Current loop of the monitor, averaged over the switching: three unequal phases in star connection.
//!
//! The hysteresis comparators hold each phase at its reference while the inverter has voltage to spare. Where it has
//! not, the two phases that need most sit at opposite rails, and the third is held at its reference if it can be
//! (derived here: the sliding modes of three comparators on a star whose errors sum to zero).

use super::Derived;
use crate::real::Real;

/// Phase currents one step later, A.
///
/// `target` are the references at the step's end (zero sum), `emf` the back-EMFs at mid-step, V. Trapezoidal in the
/// resistance: `v_j − v_n = A_j x_j + B_j` with the increments x_j, `A_j = L_j/dt + R_j/2`, `B_j = R_j i_j + e_j`.
#[inline(always)]
pub(super) fn step<R: Real>(m: &Derived<R>, i: [R; 3], target: [R; 3], emf: [R; 3]) -> [R; 3] {
    let b: [R; 3] = core::array::from_fn(|j| m.r[j] * i[j] + emf[j]);
    let wanted: [R; 3] = core::array::from_fn(|j| target[j] - i[j]);
    let needed: [R; 3] = core::array::from_fn(|j| m.ohms[j] * wanted[j] + b[j]);

    let [a_, b_, c_] = needed;
    let a_high = b_.le(a_) & c_.le(a_);
    let b_high = !a_high & c_.le(b_);
    let c_high = !a_high & !b_high;
    let c_low = c_.le(a_) & c_.le(b_) & !c_high;
    let b_low = !c_low & !b_high & b_.le(a_);
    let a_low = !c_low & !b_low & !a_high;
    let high = [a_high, b_high, c_high];
    let low = [a_low, b_low, c_low];

    // Rails for the extreme phases; the middle one gets what holds its current, within the rails.
    let rail = m.half_v_dc;
    let mut extremes = R::zero();
    let mut middle_wanted = R::zero();
    let mut middle_needed = R::zero();
    let mut middle_weight = R::zero();
    let mut v: [R; 3] = [R::zero(); 3];
    for j in 0..3 {
        let at_rail = high[j] | low[j];
        v[j] = R::select(high[j], rail, -rail);
        extremes = extremes + R::select(at_rail, (v[j] - b[j]) * m.siemens[j], R::zero());
        middle_wanted = middle_wanted + R::select(at_rail, R::zero(), wanted[j]);
        middle_needed = middle_needed + R::select(at_rail, R::zero(), needed[j]);
        middle_weight = middle_weight + R::select(at_rail, R::zero(), m.star_ohms_without[j]);
    }
    let star = (extremes + middle_wanted) * middle_weight;
    let middle = (middle_needed + star).clamp_abs(rail);
    let mut sum = R::zero();
    for j in 0..3 {
        v[j] = R::select(high[j] | low[j], v[j], middle);
        sum = sum + (v[j] - b[j]) * m.siemens[j];
    }
    let star = sum * m.star_ohms;

    let highest = a_.max(b_).max(c_);
    let lowest = a_.min(b_).min(c_);
    let enough = (highest - lowest).le(rail + rail);
    core::array::from_fn(|j| i[j] + R::select(enough, wanted[j], (v[j] - star - b[j]) * m.siemens[j]))
}
