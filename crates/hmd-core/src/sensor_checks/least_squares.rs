//! Small linear least squares with priors, for checks of a few unknowns.

use nalgebra::{SMatrix, SVector};

/// Solution of a least squares.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit<const P: usize> {
    /// The coefficients.
    pub(super) value: [f64; P],
    /// One standard deviation of each, the residual taken as noise whose neighbours are alike.
    pub(super) sigma: [f64; P],
    /// Mean square of the residual.
    pub(super) mean_square: f64,
    /// Rows.
    pub(super) rows: f64,
}

/// Fits `y = Σ column · coefficient`. `prior` are expected value and standard deviation of each coefficient, infinite where
/// nothing is known; `alike` is the number of neighbouring rows whose residuals are alike. `None` without enough rows.
pub(super) fn fit<const P: usize>(
    rows: impl Iterator<Item = ([f64; P], f64)>,
    prior: [(f64, f64); P],
    alike: f64,
) -> Option<Fit<P>> {
    let (mut normal, mut right) = (SMatrix::<f64, P, P>::zeros(), SVector::<f64, P>::zeros());
    let (mut squares, mut count) = (0.0, 0.0);
    for (columns, y) in rows {
        let columns = SVector::from(columns);
        normal += columns * columns.transpose();
        right += columns * y;
        squares += y * y;
        count += 1.0;
    }
    if count < 4.0 * P as f64 * alike.max(1.0) {
        return None;
    }
    // The prior counts in units of the noise, which the first round overestimates.
    let mut noise = squares / count;
    let mut found = None;
    for _ in 0..3 {
        let mut information = normal / (noise * alike).max(f64::MIN_POSITIVE);
        let mut weighted = right / (noise * alike).max(f64::MIN_POSITIVE);
        for (p, (expected, sigma)) in prior.into_iter().enumerate() {
            information[(p, p)] += 1.0 / (sigma * sigma);
            weighted[p] += expected / (sigma * sigma);
        }
        let covariance = information.try_inverse()?;
        let value = covariance * weighted;
        let of_residual = squares - 2.0 * value.dot(&right) + value.dot(&(normal * value));
        noise = (of_residual / count).max(0.0);
        let sigma = core::array::from_fn(|p| covariance[(p, p)].max(0.0).sqrt());
        found = Some(Fit {
            value: value.into(),
            sigma,
            mean_square: noise,
            rows: count,
        });
    }
    found.filter(|fit| fit.value.iter().chain(&fit.sigma).all(|x| x.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_a_prior_holds_what_no_row_shows() {
        let noise = |n: i32| if n % 2 == 0 { 0.01 } else { -0.01 };
        let rows = (0..200).map(|n| ([1.0, f64::from(n), 0.0], 3.0 + 0.5 * f64::from(n) + noise(n)));
        let free = (0.0, f64::INFINITY);
        let found = fit(rows, [free, free, (7.0, 2.0)], 1.0).unwrap();
        assert!((found.value[0] - 3.0).abs() < 0.01 && (found.value[1] - 0.5).abs() < 1e-4);
        assert!((found.value[2] - 7.0).abs() < 1e-9 && (found.sigma[2] - 2.0).abs() < 1e-9);
        assert!((found.mean_square - 1e-4).abs() < 1e-5);
        assert!(fit([([1.0], 2.0)].into_iter(), [free], 1.0).is_none());
    }
}
