//! One typed line per generation, for the callback of a search.

use crate::problem::Bounds;

/// Summary of one generation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GenerationLog<const D: usize> {
    /// Number of the generation; 0 is the initial population.
    pub generation: u32,
    /// Costs computed since the start of the search.
    pub evaluations: u64,
    /// Smallest cost of the population; infinite when none is finite.
    pub best_cost: f64,
    /// Mean of the finite costs of the population; infinite when none is finite.
    pub mean_cost: f64,
    /// Diversity of the population: root mean square over the genes of (standard deviation over the population / width of
    /// the box). 0 when all individuals are equal, 0.29 when they are uniform in the box, at most 0.5.
    pub spread: f64,
    /// Genes of the individual with the smallest cost; of equal costs, the lowest index.
    pub best_genes: [f64; D],
}

/// Answer of the callback to a line: whether the search continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Continue the search.
    Continue,
    /// End the search with this generation.
    Stop,
}

impl<const D: usize> GenerationLog<D> {
    /// Summarises a population that is not empty. Sums run in the order of the index, so that the line is reproducible.
    pub(crate) fn new(
        generation: u32,
        evaluations: u64,
        bounds: &Bounds<D>,
        genes: &[[f64; D]],
        costs: &[f64],
    ) -> Self {
        let mut best = 0;
        let (mut sum, mut finite) = (0.0, 0u32);
        for (i, cost) in costs.iter().enumerate() {
            if cost.total_cmp(&costs[best]).is_lt() {
                best = i;
            }
            if cost.is_finite() {
                sum += cost;
                finite += 1;
            }
        }
        Self {
            generation,
            evaluations,
            best_cost: costs[best],
            mean_cost: if finite == 0 {
                f64::INFINITY
            } else {
                sum / f64::from(finite)
            },
            spread: spread(bounds, genes),
            best_genes: genes[best],
        }
    }
}

/// [`GenerationLog::spread`] of a population.
fn spread<const D: usize>(bounds: &Bounds<D>, genes: &[[f64; D]]) -> f64 {
    let count = genes.len() as f64;
    let mut total = 0.0;
    for gene in 0..D {
        let scaled = |individual: &[f64; D]| (individual[gene] - bounds.lower()[gene]) / bounds.width(gene);
        let mean = genes.iter().map(scaled).sum::<f64>() / count;
        total += genes
            .iter()
            .map(|g| (scaled(g) - mean) * (scaled(g) - mean))
            .sum::<f64>()
            / count;
    }
    libm::sqrt(total / D as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_omits_infinite_costs_and_the_spread_is_relative_to_the_box() {
        let bounds = Bounds::new([0.0, -100.0], [1.0, 100.0]).unwrap();
        let corners = [[0.0, -100.0], [1.0, 100.0]];
        let line = GenerationLog::new(3, 7, &bounds, &corners, &[f64::INFINITY, 2.0]);
        assert_eq!(
            (line.best_genes, line.best_cost.to_bits()),
            (corners[1], 2f64.to_bits())
        );
        assert!((line.mean_cost - 2.0).abs() < 1e-15);
        assert!((line.spread - 0.5).abs() < 1e-15);
    }
}
