//! One generation of the genetic algorithm, population 200 in 8-D, with a cost that takes almost no time: the bench measures
//! ranking, selection, breeding and the log, the serial share of a search.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ema_ga::{
    Bounds, Control, DeConfig, Evaluate, GaConfig, Objective, OwnedStorage, Parallel, Search, Serial, StopRule,
    differential_evolution, evolve,
};

const GENERATIONS: u32 = 100;

struct Sphere(Bounds<8>);

impl Objective<8> for Sphere {
    fn bounds(&self) -> &Bounds<8> {
        &self.0
    }
    fn cost(&self, genes: &[f64; 8]) -> f64 {
        genes.iter().map(|x| x * x).sum()
    }
    fn batch_size(&self) -> usize {
        8
    }
}

/// Times are those of [`GENERATIONS`] generations, including the first population.
fn generation(c: &mut Criterion) {
    let sphere = Sphere(Bounds::new([-1.0; 8], [2.0; 8]).expect("constant bounds"));
    let stop = StopRule {
        max_generations: GENERATIONS,
        max_stall_generations: 1000,
        ..StopRule::for_dimension(8)
    };
    let mut storage = OwnedStorage::new(200, stop.history());

    fn run<E: Evaluate>(sphere: &Sphere, evaluate: E, stop: StopRule, storage: &mut OwnedStorage<8>) {
        let search = Search {
            objective: sphere,
            evaluate,
            seed: 1,
            initial: &[],
        };
        let config = GaConfig {
            stop,
            ..GaConfig::for_dimension(8)
        };
        black_box(evolve(&search, &config, storage.workspace(), |_| Control::Continue)).expect("valid settings");
    }
    c.bench_function("ga_100_generations_serial", |b| {
        b.iter(|| run(&sphere, Serial, stop, &mut storage))
    });
    c.bench_function("ga_100_generations_parallel", |b| {
        b.iter(|| run(&sphere, Parallel, stop, &mut storage))
    });

    let search = Search {
        objective: &sphere,
        evaluate: Serial,
        seed: 1,
        initial: &[],
    };
    let config = DeConfig { population: 200, stop };
    c.bench_function("de_100_generations_serial", |b| {
        b.iter(|| {
            black_box(differential_evolution(&search, &config, storage.workspace(), |_| {
                Control::Continue
            }))
        })
    });
}

criterion_group!(benches, generation);
criterion_main!(benches);
