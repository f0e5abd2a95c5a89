//! Known minima in 8-D are found, to values that a broken operator misses.

use crate::common::{Function, corner, rastrigin, rosenbrock, sphere};
use ema_ga::{
    CmaConfig, Control, DeConfig, GaConfig, Mutation, Outcome, Parallel, Search, Selection, StopReason, StopRule,
    cma_es_owned, differential_evolution_owned, evolve_owned,
};

/// A patient stop rule: MATLAB's tolerance of 1e-6 is absolute for costs below 1 and would end the descent early.
fn patient() -> StopRule {
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
        ..patient()
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
            ..patient()
        },
        ..CmaConfig::for_dimension(8)
    };
    cma_es_owned(&search, &config, |_| Control::Continue).expect("valid settings")
}

/// Largest cost over five seeds must lie between the two limits: the lower one tells when a limit has become too loose.
fn assert_worst(name: &str, expected: core::ops::RangeInclusive<f64>, run: impl Fn(u64) -> Outcome<8>) {
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
        stop: patient(),
        ..GaConfig::for_dimension(8)
    };
    assert_worst("GA sphere", 1e-13..=1e-10, |seed| ga(&sphere(), seed, config));
    assert_worst("GA corner", 0.0..=0.0, |seed| ga(&corner(), seed, config));
    assert_worst("GA rastrigin", 1e-13..=1e-9, |seed| ga(&rastrigin(), seed, config));
    // A genetic algorithm finds the valley and creeps along it; 8-D starts are at about 3000.
    assert_worst("GA rosenbrock", 0.5..=5.0, |seed| ga(&rosenbrock(), seed, config));
}

#[test]
fn covariance_matrix_adaptation_converges() {
    assert_worst("CMA-ES sphere", 1e-15..=1e-13, |seed| cma(&sphere(), seed));
    assert_worst("CMA-ES corner", 1e-15..=1e-13, |seed| cma(&corner(), seed));
    assert_worst("CMA-ES rosenbrock", 1e-15..=1e-13, |seed| cma(&rosenbrock(), seed));
}

#[test]
fn the_other_operators_converge() {
    let base = GaConfig {
        stop: patient(),
        ..GaConfig::for_dimension(8)
    };
    let gaussian = GaConfig {
        mutation: Mutation::Gaussian {
            scale: 0.5,
            shrink: 1.0,
        },
        ..base
    };
    assert_worst("GA gaussian sphere", 1e-7..=1e-3, |seed| ga(&sphere(), seed, gaussian));
    let tournament = GaConfig {
        selection: Selection::Tournament { size: 4 },
        ..base
    };
    assert_worst("GA tournament sphere", 1e-13..=1e-10, |seed| {
        ga(&sphere(), seed, tournament)
    });
}

#[test]
fn differential_evolution_converges() {
    assert_worst("DE sphere", 1e-15..=1e-11, |seed| de(&sphere(), seed));
    assert_worst("DE corner", 0.0..=0.0, |seed| de(&corner(), seed));
    assert_worst("DE rastrigin", 1e-15..=1e-11, |seed| de(&rastrigin(), seed));
    assert_worst("DE rosenbrock", 1e-14..=1e-10, |seed| de(&rosenbrock(), seed));
}

#[test]
fn the_budget_is_honoured_exactly() {
    // 1 and 7 end inside the first population, 200 with it, 1001 inside a later generation.
    for limit in [1, 7, 200, 390, 1001] {
        let stop = StopRule {
            max_evaluations: Some(limit),
            ..patient()
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
fn non_finite_regions_are_left_behind() {
    // Half of the box is NaN, a quarter -inf, and the minimum lies right at the edge of the rest.
    let holed = Function::<8>::new(0.0, 1.0, |x| match (x[0] < 0.5, x[1] < 0.5) {
        (true, _) => f64::NAN,
        (false, true) => f64::NEG_INFINITY,
        (false, false) => x.iter().sum::<f64>() - 1.0,
    });
    let config = GaConfig {
        stop: patient(),
        ..GaConfig::for_dimension(8)
    };
    assert_worst("GA holed", 0.0..=1e-4, |seed| ga(&holed, seed, config));
    assert_worst("DE holed", 0.0..=1e-4, |seed| de(&holed, seed));
}

#[test]
fn a_cost_that_is_never_finite_ends_at_the_last_generation() {
    let hopeless = Function::<8>::new(0.0, 1.0, |_| f64::NAN);
    let stop = StopRule {
        max_generations: 70,
        ..patient()
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
