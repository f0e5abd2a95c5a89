//! One seed gives one log, bit for bit, serially and on any number of threads.

use crate::common::{Function, rastrigin, sphere};
use ema_ga::{
    CmaConfig, ConfigError, Control, DeConfig, Evaluate, FixedStorage, GaConfig, GenerationLog, Parallel, Search,
    Serial, StopReason, StopRule, cma_es_owned, differential_evolution_owned, evolve, evolve_owned,
};

fn bits(line: &GenerationLog<8>) -> Vec<u64> {
    [u64::from(line.generation), line.evaluations]
        .into_iter()
        .chain([line.best_cost, line.mean_cost, line.spread].map(f64::to_bits))
        .chain(line.best_genes.map(f64::to_bits))
        .collect()
}

fn ga_log(objective: &Function<8>, evaluate: impl Evaluate, seed: u64) -> Vec<Vec<u64>> {
    let mut log = Vec::new();
    let search = Search {
        objective,
        evaluate,
        seed,
        initial: &[],
    };
    evolve_owned(&search, &GaConfig::for_dimension(8), |line| {
        log.push(bits(line));
        Control::Continue
    })
    .expect("valid settings");
    log
}

fn de_log(objective: &Function<8>, evaluate: impl Evaluate, seed: u64) -> Vec<Vec<u64>> {
    let mut log = Vec::new();
    let search = Search {
        objective,
        evaluate,
        seed,
        initial: &[],
    };
    differential_evolution_owned(&search, &DeConfig::for_dimension(8), |line| {
        log.push(bits(line));
        Control::Continue
    })
    .expect("valid settings");
    log
}

fn cma_log(objective: &Function<8>, evaluate: impl Evaluate, seed: u64) -> Vec<Vec<u64>> {
    let mut log = Vec::new();
    let search = Search {
        objective,
        evaluate,
        seed,
        initial: &[],
    };
    cma_es_owned(&search, &CmaConfig::for_dimension(8), |line| {
        log.push(bits(line));
        Control::Continue
    })
    .expect("valid settings");
    log
}

fn on_threads<T: Send>(threads: usize, run: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("valid settings")
        .install(run)
}

#[test]
fn log_does_not_depend_on_threads() {
    let objective = rastrigin();
    for seed in [0, u64::MAX] {
        let (ga, de) = (ga_log(&objective, Serial, seed), de_log(&objective, Serial, seed));
        let cma = cma_log(&objective, Serial, seed);
        assert!(ga.len() > 50 && de.len() > 50 && cma.len() > 50);
        for threads in [1, 4] {
            assert_eq!(
                on_threads(threads, || ga_log(&objective, Parallel, seed)),
                ga,
                "seed {seed}"
            );
            assert_eq!(
                on_threads(threads, || cma_log(&objective, Parallel, seed)),
                cma,
                "seed {seed}"
            );
            assert_eq!(
                on_threads(threads, || de_log(&objective, Parallel, seed)),
                de,
                "seed {seed}"
            );
        }
    }
    assert_ne!(ga_log(&objective, Serial, 0), ga_log(&objective, Serial, 1));
}

#[test]
fn storage_does_not_change_the_result() {
    let objective = sphere();
    let search = Search {
        objective: &objective,
        evaluate: Serial,
        seed: 3,
        initial: &[],
    };
    let config = GaConfig::for_dimension(8);
    let owned = evolve_owned(&search, &config, |_| Control::Continue);
    let mut fixed = Box::new(FixedStorage::<8, 201, 60>::new());
    assert_eq!(
        evolve(&search, &config, fixed.workspace(), |_| Control::Continue),
        owned
    );
    // The content left by the first search does not matter.
    assert_eq!(
        evolve(&search, &config, fixed.workspace(), |_| Control::Continue),
        owned
    );
    let mut small = FixedStorage::<8, 199, 60>::new();
    let rejected = evolve(&search, &config, small.workspace(), |_| Control::Continue);
    assert_eq!(
        rejected,
        Err(ConfigError::Storage {
            expected: 200,
            got: 199
        })
    );
}

#[test]
fn a_warm_start_is_in_the_first_population() {
    let objective = sphere();
    let search = |initial| Search {
        objective: &objective,
        evaluate: Serial,
        seed: 3,
        initial,
    };
    let config = GaConfig::for_dimension(8);
    let mut first = None;
    let outcome = evolve_owned(&search(&[[0.3; 8]]), &config, |line| {
        first.get_or_insert(line.best_genes);
        Control::Continue
    });
    assert_eq!((first, outcome.unwrap().cost), (Some([0.3; 8]), 0.0));

    let outside = evolve_owned(&search(&[[0.3; 8], [1.1; 8]]), &config, |_| Control::Continue);
    assert_eq!(outside, Err(ConfigError::InitialOutside { individual: 1 }));
    let too_many = evolve_owned(&search(&[[0.3; 8]; 201]), &config, |_| Control::Continue);
    assert_eq!(
        too_many,
        Err(ConfigError::TooManyInitial {
            got: 201,
            population: 200
        })
    );
}

#[test]
fn the_callback_and_the_cost_limit_end_the_search() {
    let objective = sphere();
    let search = Search {
        objective: &objective,
        evaluate: Serial,
        seed: 3,
        initial: &[],
    };
    let config = GaConfig::for_dimension(8);
    let stop_at_4 = |line: &GenerationLog<8>| {
        if line.generation == 4 {
            Control::Stop
        } else {
            Control::Continue
        }
    };
    let outcome = evolve_owned(&search, &config, stop_at_4).unwrap();
    // The elite of 10 is evaluated only once.
    assert_eq!(
        (outcome.generations, outcome.evaluations, outcome.stop),
        (4, 200 + 4 * 190, StopReason::Stopped)
    );

    let stop = StopRule {
        cost_limit: Some(1e-2),
        ..config.stop
    };
    let outcome = evolve_owned(&search, &GaConfig { stop, ..config }, |_| Control::Continue).unwrap();
    assert_eq!(outcome.stop, StopReason::CostLimit);
    assert!(outcome.cost <= 1e-2 && outcome.cost > 0.0);

    // A window longer than the search needs no more memory than the search, and never ends it.
    let stop = StopRule {
        max_stall_generations: u32::MAX,
        max_generations: 150,
        ..config.stop
    };
    let outcome = evolve_owned(&search, &GaConfig { stop, ..config }, |_| Control::Continue).unwrap();
    assert_eq!((outcome.generations, outcome.stop), (150, StopReason::MaxGenerations));
}
