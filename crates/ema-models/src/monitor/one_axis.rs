//! Current loop of the one-axis monitor: one equivalent phase in the q axis (\[P\] section 5.2).

use super::Derived;
use crate::frames::phase_shapes;
use crate::real::Real;
use crate::winding::DerivedShape;

/// Quadrature current one step later, A.
///
/// `v_q = R(θ_e) i + L(θ_e) di/dt + ½ ω_e (dL/dθ_e) i + k φ ω_m`, with the voltage limited to the inverter's along the
/// current, `V_dc/3 · Σ|s_j|`. The current reaches its reference within the step if the voltage suffices.
#[inline(always)]
pub(super) fn step<R: Real>(m: &Derived<R>, i: R, i_ref: R, shape: &DerivedShape<R>, omega: R, sin_cos: (R, R)) -> R {
    let [a, b, c] = phase_shapes(sin_cos);
    let limit = m.half_v_dc * R::splat(2.0 / 3.0) * (a.abs() + b.abs() + c.abs());
    let half = R::splat(0.5);
    let r = m.phase_r * shape.resistance + half * m.pole_pairs * omega * m.phase_l * shape.inductance_slope;
    let ohms = m.phase_l * shape.inductance * m.per_dt + half * r;
    let back = r * i + m.back_emf * shape.emf * omega;
    let v = (ohms * (i_ref - i) + back).clamp_abs(limit);
    i + (v - back) / ohms
}
