//! Places of the free coefficients of a torque balance, and how errors of the torque and of what a unit's windows share reach them.

use nalgebra::{SMatrix, SVector};

use super::normal_equations::Solution;
use super::shared::{SHARED_COUNT, Shared, free_of_shared, is_free, is_worn};

/// Free coefficients of a window: N_A, N_B, N_C, ζ cos φ_e, ζ sin φ_e, scale of friction, load, spring.
pub(super) const FREE_COUNT: usize = 8;

/// Places of the eccentricity, of friction, and of load and spring among the free coefficients.
pub(super) const ECCENTRICITY: usize = 3;
pub(super) const FRICTION: usize = 5;
pub(super) const LOAD: usize = 6;

/// Largest bias of the free coefficients by errors of the sampled torque: as much as if the whole residual, but the noise that was
/// subtracted, were the quadrature current's, whose error stands in the columns of the turns too and draws them towards zero.
///
/// An error ε of `1.5 k i_q` is `ε s_j²/1.5` in the column of phase j; the mean of `s_i² s_j²` is 3/8 or 3/16. Derived here.
pub(super) fn attenuation(
    solution: &Solution<FREE_COUNT>,
    rows: usize,
    loop_phase: Option<usize>,
) -> SVector<f64, FREE_COUNT> {
    let squares = solution.quiet_rms * solution.quiet_rms * rows as f64 / 2.25;
    let mut turns = solution.x.fixed_rows::<3>(0).into_owned();
    if let Some(phase) = loop_phase {
        turns[phase] = 0.0;
    }
    let mut products = SVector::<f64, FREE_COUNT>::zeros();
    for j in 0..3 {
        products[j] = squares * 0.1875 * (turns.sum() + turns[j]);
    }
    if let Some(phase) = loop_phase {
        products[phase] = 0.0;
    }
    solution.inverse * products
}

/// How an error of the shared unknowns changes the *change* of the free coefficients since commissioning.
///
/// With the columns a of the free coefficients and s of the shared ones, `x̂ = N⁻¹ Σ a (… + s c)`; turns and eccentricity are
/// free and compared with the learnt ones. Derived here.
#[inline(never)]
pub(super) fn error_of_shared(
    solution: &Solution<FREE_COUNT>,
    with_shared: &SMatrix<f64, FREE_COUNT, SHARED_COUNT>,
    loop_phase: Option<usize>,
) -> SMatrix<f64, FREE_COUNT, SHARED_COUNT> {
    let mut error = solution.inverse * with_shared;
    for unknown in 0..SHARED_COUNT {
        if is_free(unknown) {
            error.column_mut(unknown).fill(0.0);
        } else if is_worn(unknown) {
            error.column_mut(unknown).scale_mut(solution.x[FRICTION]);
        }
    }
    for (row, of_shared) in free_of_shared().row_iter().enumerate() {
        if loop_phase == Some(row) {
            continue;
        }
        for unknown in 0..SHARED_COUNT {
            error[(row, unknown)] -= of_shared[unknown];
        }
    }
    error
}

/// `E (P + D) Eᵀ` with the covariance P of the shared unknowns and a diagonal D, row by row: the controller has no room for a
/// second matrix of their size.
#[inline(never)]
pub(super) fn covariance_by_shared(
    error: &SMatrix<f64, FREE_COUNT, SHARED_COUNT>,
    learnt: &[[f64; SHARED_COUNT]; SHARED_COUNT],
    spread: &Shared,
) -> SMatrix<f64, FREE_COUNT, FREE_COUNT> {
    let mut covariance = SMatrix::zeros();
    for unknown in 0..SHARED_COUNT {
        for place in 0..FREE_COUNT {
            let along: f64 = (0..SHARED_COUNT)
                .map(|other| error[(place, other)] * learnt[other][unknown])
                .sum();
            let weighted = along + error[(place, unknown)] * spread[unknown];
            for other in 0..FREE_COUNT {
                covariance[(place, other)] += weighted * error[(other, unknown)];
            }
        }
    }
    covariance
}
