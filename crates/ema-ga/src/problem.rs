//! The problem of a search: a cost and the box of genes over which it is minimised.

use core::fmt;

/// A cost to be minimised over a box of `D` genes.
///
/// The cost of an individual depends on its own genes only. It may be non-finite: such an individual ranks behind every one
/// with a finite cost.
pub trait Objective<const D: usize>: Sync {
    /// The box of admissible genes.
    fn bounds(&self) -> &Bounds<D>;

    /// Cost of one individual, smaller is better.
    fn cost(&self, genes: &[f64; D]) -> f64;

    /// Writes the cost of `genes[i]` to `costs[i]`.
    ///
    /// Override it to evaluate several individuals in SIMD lanes. It receives at most [`batch_size`](Self::batch_size)
    /// individuals, and fewer in the last batch of a generation. A cost must not depend on the other individuals.
    fn cost_batch(&self, genes: &[[f64; D]], costs: &mut [f64]) {
        for (slot, individual) in costs.iter_mut().zip(genes) {
            *slot = self.cost(individual);
        }
    }

    /// Individuals per call of [`cost_batch`](Self::cost_batch), at least 1.
    fn batch_size(&self) -> usize {
        1
    }
}

/// A box of finite width: `lower[i] < upper[i]` for every gene `i`.
///
/// ```
/// use ema_ga::{Bounds, BoundsError};
///
/// let bounds = Bounds::new([0.0, -1.0], [1.0, 1.0])?;
/// assert_eq!(bounds.clamp([0.5, 7.0]), [0.5, 1.0]);
/// assert_eq!(Bounds::new([2.0], [1.0]), Err(BoundsError::NotAscending { gene: 0, lower: 2.0, upper: 1.0 }));
/// # Ok::<(), BoundsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds<const D: usize> {
    lower: [f64; D],
    upper: [f64; D],
}

impl<const D: usize> Bounds<D> {
    /// The box between two corners, checked.
    ///
    /// # Errors
    ///
    /// [`BoundsError`] when a bound or a width is not finite, or when a lower bound is not below its upper bound.
    pub fn new(lower: [f64; D], upper: [f64; D]) -> Result<Self, BoundsError> {
        for gene in 0..D {
            let (lower, upper) = (lower[gene], upper[gene]);
            if !(lower.is_finite() && upper.is_finite() && (upper - lower).is_finite()) {
                return Err(BoundsError::NotFinite { gene, lower, upper });
            }
            if lower >= upper {
                return Err(BoundsError::NotAscending { gene, lower, upper });
            }
        }
        Ok(Self { lower, upper })
    }

    /// Lower bounds, one per gene.
    #[must_use]
    pub fn lower(&self) -> &[f64; D] {
        &self.lower
    }

    /// Upper bounds, one per gene.
    #[must_use]
    pub fn upper(&self) -> &[f64; D] {
        &self.upper
    }

    /// Upper minus lower bound of one gene, above zero.
    #[must_use]
    pub fn width(&self, gene: usize) -> f64 {
        self.upper[gene] - self.lower[gene]
    }

    /// Whether every gene lies within its bounds, bounds included; false for NaN.
    #[must_use]
    pub fn contains(&self, genes: &[f64; D]) -> bool {
        (0..D).all(|i| (self.lower[i]..=self.upper[i]).contains(&genes[i]))
    }

    /// Nearest point of the box; NaN stays NaN.
    #[must_use]
    pub fn clamp(&self, genes: [f64; D]) -> [f64; D] {
        core::array::from_fn(|i| genes[i].clamp(self.lower[i], self.upper[i]))
    }
}

/// Why two corners do not form a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BoundsError {
    /// A bound, or the width between the two, is infinite or NaN.
    NotFinite {
        /// Index of the gene.
        gene: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// The lower bound is not below the upper bound.
    NotAscending {
        /// Index of the gene.
        gene: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
}

impl fmt::Display for BoundsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { gene, lower, upper } => write!(f, "bounds of gene {gene} not finite: {lower}, {upper}"),
            Self::NotAscending { gene, lower, upper } => {
                write!(f, "bounds of gene {gene} not ascending: {lower}, {upper}")
            }
        }
    }
}

impl core::error::Error for BoundsError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_reject_nan_infinity_overflowing_width_and_zero_width() {
        for (lower, upper) in [(f64::NAN, 1.0), (0.0, f64::INFINITY), (-f64::MAX, f64::MAX)] {
            assert!(matches!(
                Bounds::new([0.0, lower], [1.0, upper]),
                Err(BoundsError::NotFinite { gene: 1, .. })
            ));
        }
        assert!(matches!(
            Bounds::new([1.0], [1.0]),
            Err(BoundsError::NotAscending { gene: 0, .. })
        ));
    }

    #[test]
    fn a_box_contains_no_nan() {
        let bounds = Bounds::new([0.0; 2], [1.0; 2]).unwrap();
        assert!(bounds.contains(&[0.0, 1.0]));
        assert!(!bounds.contains(&[0.5, f64::NAN]));
    }
}
