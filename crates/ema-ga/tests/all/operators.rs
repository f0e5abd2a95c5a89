//! Properties of the genetic operators.

use ema_ga::Bounds;
use ema_ga::operators::{
    adapt_step, adaptive_feasible_mutation, gaussian_deviation, gaussian_mutation, rank_expectation,
    scattered_crossover, stochastic_uniform, tournament, uniform_point,
};
use ema_ga::stream::stream;
use proptest::prelude::*;

fn bounds() -> impl Strategy<Value = Bounds<4>> {
    (prop::array::uniform4(-1e6..1e6), prop::array::uniform4(1e-6..1e6)).prop_map(|(lower, width)| {
        Bounds::new(lower, core::array::from_fn(|i| lower[i] + width[i])).expect("ascending")
    })
}

proptest! {
    #[test]
    fn every_operator_keeps_the_bounds(bounds in bounds(), seed: u64, deviation in 1e-9..10.0) {
        let rng = &mut stream(seed, 0, 0);
        let (a, b) = (uniform_point(rng, &bounds), uniform_point(rng, &bounds));
        prop_assert!(bounds.contains(&a) && bounds.contains(&b));
        prop_assert!(bounds.contains(&gaussian_mutation(rng, &a, &bounds, deviation)));
        prop_assert!(bounds.contains(&adaptive_feasible_mutation(rng, &a, &bounds, deviation)));
        let child = scattered_crossover(rng, &a, &b);
        for i in 0..4 {
            prop_assert!(child[i].to_bits() == a[i].to_bits() || child[i].to_bits() == b[i].to_bits());
        }
    }

    #[test]
    fn expectations_sum_to_the_parents_and_fall_with_rank(individuals in 1usize..500, parents in 1usize..1000) {
        let mut expectation = vec![0.0; individuals];
        rank_expectation(parents, &mut expectation);
        let sum: f64 = expectation.iter().sum();
        prop_assert!((sum / parents as f64 - 1.0).abs() < 1e-12);
        prop_assert!(expectation.windows(2).all(|pair| pair[0] > pair[1]));
    }

    #[test]
    fn universal_sampling_selects_each_rank_floor_or_ceil_of_its_expectation(
        individuals in 1usize..300,
        parents in 1usize..600,
        seed: u64,
    ) {
        let mut expectation = vec![0.0; individuals];
        rank_expectation(parents, &mut expectation);
        let mut chosen = vec![0; parents];
        stochastic_uniform(&mut stream(seed, 0, 0), &expectation, &mut chosen);
        for (rank, expected) in expectation.iter().enumerate() {
            let count = chosen.iter().filter(|&&r| r == rank).count() as f64;
            // The ends of an interval carry the rounding of the running sum.
            prop_assert!((expected - 1e-9).floor() <= count && count <= (expected + 1e-9).ceil());
        }
    }

    #[test]
    fn tournaments_choose_existing_ranks(individuals in 1usize..300, size in 1usize..10, seed: u64) {
        let mut chosen = [0; 50];
        tournament(&mut stream(seed, 0, 0), individuals, size, &mut chosen);
        prop_assert!(chosen.iter().all(|&rank| rank < individuals));
    }

    #[test]
    fn the_adaptive_step_stays_in_its_range(outcomes in prop::collection::vec(any::<bool>(), 0..200)) {
        let step = outcomes.into_iter().fold(0.5, adapt_step);
        prop_assert!((1e-8..=1.0).contains(&step));
    }
}

#[test]
fn tournament_of_four_has_the_mean_rank_of_the_smallest_of_four() {
    // E[min of s uniform on 0..n] = n / (s + 1) - 0.5 to first order; here 100 / 5 - 0.5.
    let mut chosen = vec![0; 20_000];
    tournament(&mut stream(1, 0, 0), 100, 4, &mut chosen);
    let mean = chosen.iter().sum::<usize>() as f64 / chosen.len() as f64;
    assert!((mean - 19.5).abs() < 0.5, "mean rank {mean}");
}

#[test]
fn gaussian_mutation_has_the_stated_deviation() {
    let bounds = Bounds::new([-50.0], [50.0]).unwrap();
    let rng = &mut stream(2, 0, 0);
    let steps: Vec<f64> = (0..20_000)
        .map(|_| gaussian_mutation(rng, &[1.0], &bounds, 0.05)[0] - 1.0)
        .collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let deviation = (steps.iter().map(|s| s * s).sum::<f64>() / steps.len() as f64).sqrt();
    assert!(
        mean.abs() < 0.1 && (deviation - 5.0).abs() < 0.1,
        "mean {mean}, deviation {deviation}"
    );
}

#[test]
fn gaussian_deviation_shrinks_linearly_to_nothing() {
    let at = |generation| gaussian_deviation(0.5, 1.0, generation, 100);
    // Halves and quarters are exact.
    assert_eq!(
        [at(0), at(50), at(100)].map(f64::to_bits),
        [0.5, 0.25, 0.0].map(f64::to_bits)
    );
}
