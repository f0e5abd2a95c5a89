//! Variances of a least-squares problem by its curvature.

use ema_models::UNKNOWN_COUNT;
use nalgebra::SMatrix;

/// Diagonal of `(JᵀJ)⁻¹`; infinite where the data say nothing.
#[inline(never)]
pub(super) fn variance(information: &SMatrix<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>) -> [f64; UNKNOWN_COUNT] {
    let mut matrix = *information;
    for p in 0..UNKNOWN_COUNT {
        // A coordinate without influence gets a vanishing information, so that the others can be inverted.
        matrix[(p, p)] += 1e-9;
    }
    match matrix.cholesky() {
        Some(factor) => {
            let inverse = factor.inverse();
            core::array::from_fn(|p| inverse[(p, p)])
        }
        None => [f64::INFINITY; UNKNOWN_COUNT],
    }
}
