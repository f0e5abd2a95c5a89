//! Known minima in 8-D are found, to values that a faulty operator does not reach.

use crate::common::{Function, corner, rastrigin, rosenbrock, sphere};
use ema_ga::{
    CmaConfig, Control, DeConfig, GaConfig, Mutation, Outcome, Parallel, Search, Selection, StopReason, StopRule,
    cma_es_owned, differential_evolution_owned, evolve_owned,
};

/// A stop rule with a small tolerance: MATLAB's 1e-6 is absolute for costs below 1 and would end the search early.
fn tight_stop_rule() -> StopRule {
    StopRule {
        function_tolerance: 1e-12,
        ..StopRule::for_dimension(8)
    }
}

fn ga(objective: &Function<8>, seed: u64, config: GaConfig) -> Outcome<8> {
    let search = Search {
        objective,
        evaluate: Parallel,
        seed,
        initial: &[],
    };
    evolve_owned(&search, &config, |_| Control::Continue).expect("valid settings")
}

fn de(objective: &Function<8>, seed: u64) -> Outcome<8> {
    let search = Search {
        objective,
        evaluate: Parallel,
        seed,
        initial: &[],
    };
    let stop = StopRule {
        max_generations: 1600,
        ..tight_stop_rule()
    };
    differential_evolution_owned(
        &search,
        &DeConfig {
            stop,
            ..DeConfig::for_dimension(8)
        },
        |_| Control::Continue,
    )
    .expect("valid settings")
}

fn cma(objective: &Function<8>, seed: u64) -> Outcome<8> {
    let search = Search {
        objective,
        evaluate: Parallel,
        seed,
        initial: &[],
    };
    let config = CmaConfig {
        stop: StopRule {
            max_generations: 1600,
            ..tight_stop_rule()
        },
        ..CmaConfig::for_dimension(8)
    };
    cma_es_owned(&search, &config, |_| Control::Continue).expect("valid settings")
}

/// Asserts that the largest cost over five seeds lies in a range; the lower limit fails when the upper is too loose.
fn assert_worst_cost(name: &str, expected: core::ops::RangeInclusive<f64>, run: impl Fn(u64) -> Outcome<8>) {
    let outcomes: Vec<_> = (0..5).map(run).collect();
    let worst = outcomes.iter().map(|o| o.cost).fold(0.0, f64::max);
    let evaluations: Vec<_> = outcomes.iter().map(|o| o.evaluations).collect();
    println!("{name:22} worst {worst:.2e}, evaluations {evaluations:?}");
    assert!(
        expected.contains(&worst),
        "{name}: worst of seeds 0..5 is {worst:e}, expected {expected:?}"
    );
}

#[test]
fn genetic_algorithm_converges() {
    let config = GaConfig {
        stop: tight_stop_rule(),
        ..GaConfig::for_dimension(8)
    };
    assert_worst_cost("GA sphere", 1e-13..=1e-10, |seed| ga(&sphere(), seed, config));
    assert_worst_cost("GA corner", 0.0..=0.0, |seed| ga(&corner(), seed, config));
    assert_worst_cost("GA rastrigin", 1e-13..=1e-9, |seed| ga(&rastrigin(), seed, config));
    // A genetic algorithm finds the valley but converges slowly along it; the first populations cost about 3000.
    assert_worst_cost("GA rosenbrock", 0.5..=5.0, |seed| ga(&rosenbrock(), seed, config));
}

#[test]
fn covariance_matrix_adaptation_converges() {
    assert_worst_cost("CMA-ES sphere", 1e-15..=1e-13, |seed| cma(&sphere(), seed));
    assert_worst_cost("CMA-ES corner", 1e-15..=1e-13, |seed| cma(&corner(), seed));
    assert_worst_cost("CMA-ES rosenbrock", 1e-15..=1e-13, |seed| cma(&rosenbrock(), seed));
}

#[test]
fn the_other_operators_converge() {
    let base = GaConfig {
        stop: tight_stop_rule(),
        ..GaConfig::for_dimension(8)
    };
    let gaussian = GaConfig {
        mutation: Mutation::Gaussian {
            scale: 0.5,
            shrink: 1.0,
        },
        ..base
    };
    assert_worst_cost("GA gaussian sphere", 1e-7..=1e-3, |seed| ga(&sphere(), seed, gaussian));
    let tournament = GaConfig {
        selection: Selection::Tournament { size: 4 },
        ..base
    };
    assert_worst_cost("GA tournament sphere", 1e-13..=1e-10, |seed| {
        ga(&sphere(), seed, tournament)
    });
}

#[test]
fn differential_evolution_converges() {
    assert_worst_cost("DE sphere", 1e-15..=1e-11, |seed| de(&sphere(), seed));
    assert_worst_cost("DE corner", 0.0..=0.0, |seed| de(&corner(), seed));
    assert_worst_cost("DE rastrigin", 1e-15..=1e-11, |seed| de(&rastrigin(), seed));
    assert_worst_cost("DE rosenbrock", 1e-14..=1e-10, |seed| de(&rosenbrock(), seed));
}

#[test]
fn the_search_uses_exactly_its_evaluation_budget() {
    // 1 and 7 end within the first population, 200 at its end, 1001 within a later generation.
    for limit in [1, 7, 200, 390, 1001] {
        let stop = StopRule {
            max_evaluations: Some(limit),
            ..tight_stop_rule()
        };
        let objective = sphere();
        let search = Search {
            objective: &objective,
            evaluate: Parallel,
            seed: 5,
            initial: &[],
        };
        let ga = evolve_owned(
            &search,
            &GaConfig {
                stop,
                ..GaConfig::for_dimension(8)
            },
            |_| Control::Continue,
        );
        let de = differential_evolution_owned(&search, &DeConfig { population: 80, stop }, |_| Control::Continue);
        for outcome in [ga.unwrap(), de.unwrap()] {
            assert_eq!((outcome.evaluations, outcome.stop), (limit, StopReason::MaxEvaluations));
            assert!(outcome.cost.is_finite());
        }
    }
}

#[test]
fn searches_converge_beside_regions_of_non_finite_cost() {
    // The cost is NaN in half of the box and -inf in a quarter; the minimum lies at the edge of the rest.
    let holed = Function::<8>::new(0.0, 1.0, |x| match (x[0] < 0.5, x[1] < 0.5) {
        (true, _) => f64::NAN,
        (false, true) => f64::NEG_INFINITY,
        (false, false) => x.iter().sum::<f64>() - 1.0,
    });
    let config = GaConfig {
        stop: tight_stop_rule(),
        ..GaConfig::for_dimension(8)
    };
    assert_worst_cost("GA holed", 0.0..=1e-4, |seed| ga(&holed, seed, config));
    assert_worst_cost("DE holed", 0.0..=1e-4, |seed| de(&holed, seed));
}

#[test]
fn a_cost_that_is_never_finite_ends_at_the_last_generation() {
    let hopeless = Function::<8>::new(0.0, 1.0, |_| f64::NAN);
    let stop = StopRule {
        max_generations: 70,
        ..tight_stop_rule()
    };
    let outcome = ga(
        &hopeless,
        1,
        GaConfig {
            stop,
            ..GaConfig::for_dimension(8)
        },
    );
    assert_eq!(
        (outcome.cost, outcome.generations, outcome.stop),
        (f64::INFINITY, 70, StopReason::MaxGenerations)
    );
}
