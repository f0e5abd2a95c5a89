//! Test functions of optimisation, each with its minimum of 0.

use ema_ga::{Bounds, Objective};

/// A cost function over a box, in batches of three, so that the last batch of a generation is shorter.
pub(crate) struct Function<const D: usize> {
    bounds: Bounds<D>,
    cost: fn(&[f64; D]) -> f64,
}

impl<const D: usize> Function<D> {
    pub(crate) fn new(lower: f64, upper: f64, cost: fn(&[f64; D]) -> f64) -> Self {
        Self {
            bounds: Bounds::new([lower; D], [upper; D]).expect("ascending"),
            cost,
        }
    }
}

impl<const D: usize> Objective<D> for Function<D> {
    fn bounds(&self) -> &Bounds<D> {
        &self.bounds
    }
    fn cost(&self, genes: &[f64; D]) -> f64 {
        (self.cost)(genes)
    }
    fn batch_size(&self) -> usize {
        3
    }
}

/// Minimum at 0.3 in every gene, away from the centre of the box.
pub(crate) fn sphere() -> Function<8> {
    Function::new(0.0, 1.0, |x| x.iter().map(|x| (x - 0.3) * (x - 0.3)).sum())
}

/// Minimum in the lower corner of the box, where every gene is at its bound.
#[allow(dead_code, reason = "each test file uses its own selection")]
pub(crate) fn corner() -> Function<8> {
    Function::new(0.0, 1.0, |x| x.iter().sum())
}

/// Curved valley, minimum at 1 in every gene.
#[allow(dead_code, reason = "each test file uses its own selection")]
pub(crate) fn rosenbrock() -> Function<8> {
    Function::new(-2.0, 2.0, |x| {
        x.windows(2)
            .map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2))
            .sum()
    })
}

/// About 11^8 local minima, the global one at 0.
#[allow(dead_code, reason = "each test file uses its own selection")]
pub(crate) fn rastrigin() -> Function<8> {
    Function::new(-5.12, 5.12, |x| {
        x.iter()
            .map(|x| x * x - 10.0 * (core::f64::consts::TAU * x).cos() + 10.0)
            .sum()
    })
}
