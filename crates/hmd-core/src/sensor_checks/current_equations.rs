//! The two equations that hold for the currents of every motion, as rows of a least squares.
//!
//! A star connection: `i_a + i_b + i_c = o + Σ e_j i_q s_j`. A drive that holds the direct current at zero:
//! `i_d = δ i_q + τ ω_e i_q + o_α cos θ_e + o_β sin θ_e`. Offsets o, gain errors e_j, zero δ of the resolver, age τ of the currents.

use ema_models::{Real, phase_shapes};

use super::signals::{Row, Signals};

/// Neighbouring samples whose direct currents are alike: the ripple of a drive.
pub(super) const RIPPLE_ROWS: f64 = 3.0;

/// For each sample the currents `i_q s_j` of phase A, B, C, and the sum of the measured ones, A. The torque-producing current is that of
/// the two neighbouring samples, whose noise is not in the sum.
pub(super) fn sums_of_currents(signals: &Signals) -> impl Iterator<Item = ([f64; 3], f64)> + '_ {
    let all = signals.rows.windows(3);
    all.filter(|near| !near[1].is_filled).map(|near| {
        let i_q = 0.5 * (signals.i_dq(&near[0])[1] + signals.i_dq(&near[2])[1]);
        let shapes = phase_shapes((signals.pole_pairs * near[1].theta_m).sin_cos_poly());
        (shapes.map(|shape| i_q * shape), near[1].currents.iter().sum())
    })
}

/// For each sample at which the drive holds the direct current its row, the columns of δ, τ, o_α and o_β, and the direct current, A.
pub(super) fn direct_current(signals: &Signals) -> impl Iterator<Item = (&Row, [f64; 4], f64)> + '_ {
    let is_evidence = |row: &&Row| !row.is_filled && signals.is_controlled(row);
    signals.rows.iter().filter(is_evidence).map(|row| {
        let (sin, cos) = (signals.pole_pairs * row.theta_m).sin_cos_poly();
        let [direct, i_q] = signals.i_dq(row);
        let columns = [i_q, signals.pole_pairs * row.omega_m * i_q, cos, sin];
        (row, columns, direct)
    })
}
