//! The problem, linear about a point: information, gradient and cost.

use core::ops::Range;
use std::rc::Rc;
use std::vec;
use std::vec::Vec;

use ema_models::{GRAM_COLUMNS, SIGNAL_COUNT};

use super::derivatives::Derivatives;
use super::problem::{Gradient, Information, Point, Problem};

/// Derivatives about a point and the residuals at it.
pub(super) struct Linearised<'a> {
    pub(super) derivatives: Rc<Derivatives<'a>>,
    /// Residual times squared weight and confidence, signal by signal.
    scaled: Vec<f64>,
    /// `JᵀJ` with the prior.
    pub(super) information: Information,
    /// `Jᵀr` with the prior.
    pub(super) gradient: Gradient,
    /// Half the sum of the squares, the prior included.
    pub(super) cost: f64,
}

impl<'a> Linearised<'a> {
    /// The problem about a point, by derivatives of it or of one nearby.
    pub(super) fn new(problem: &Problem<'_>, derivatives: Rc<Derivatives<'a>>, at: &Point) -> Self {
        let samples = problem.comparison().recording.samples.len();
        let squared = problem.comparison().weights.to_array().map(|weight| weight * weight);
        let confidence = &problem.basis().confidence;
        let mut scaled = vec![0.0; SIGNAL_COUNT * samples];
        problem.residuals(at, |n, residuals| {
            for signal in 0..SIGNAL_COUNT {
                scaled[signal * samples + n] = squared[signal] * confidence[n][signal] * residuals[signal];
            }
        });
        let mut sums = [[0.0; GRAM_COLUMNS]; GRAM_COLUMNS];
        for (products, squared) in derivatives.products().iter().zip(squared) {
            for (line, products) in sums.iter_mut().zip(products) {
                for (sum, product) in line.iter_mut().zip(products) {
                    *sum += squared * product;
                }
            }
        }
        let columns = *derivatives.columns();
        let information = Information::from_fn(|p, q| {
            let (p, q) = (columns[p], columns[q]);
            sums[p.max(q)][p.min(q)]
        });
        let mut found = Self {
            derivatives,
            scaled,
            information,
            gradient: Gradient::zeros(),
            cost: problem.cost(at),
        };
        found.gradient = found.score(0..samples);
        problem.add_prior(at, &mut found.information, &mut found.gradient);
        found
    }

    /// Number of samples.
    pub(super) fn samples(&self) -> usize {
        self.scaled.len() / SIGNAL_COUNT
    }

    /// What some samples contribute to the gradient.
    pub(super) fn score(&self, samples: Range<usize>) -> Gradient {
        let mut sums = [0.0; GRAM_COLUMNS];
        for (signal, scaled) in self.scaled.chunks(self.samples().max(1)).enumerate() {
            let rows = &self.derivatives.of_signal(signal)[samples.clone()];
            for (row, residual) in rows.iter().zip(&scaled[samples.clone()]) {
                for (sum, slope) in sums.iter_mut().zip(row) {
                    *sum += f64::from(*slope) * residual;
                }
            }
        }
        let columns = self.derivatives.columns();
        Gradient::from_fn(|p, _| sums[columns[p]])
    }
}
