//! One update and forecast of the prognosis late in a life with all faults growing: the dearest case.

use criterion::{Criterion, criterion_group, criterion_main};
use hmd::health::FAULTS;
use hmd::rul::{Odometer, Prognosis};

fn update(c: &mut Criterion) {
    let mut prognosis = Prognosis::new([0.8; FAULTS]);
    let mut hours = 0.0;
    let mut window = |prognosis: &mut Prognosis| {
        hours += 1.0;
        let at = Odometer {
            hours,
            cycles: hours,
            work_j: hours,
        };
        let damage = 0.5 * (hours / 1e3).min(1.0);
        prognosis.update(at, &[Some((damage + 0.003 * (hours * 0.618).fract(), 0.005)); FAULTS]);
    };
    for _ in 0..500 {
        window(&mut prognosis);
    }
    c.bench_function("rul/update", |b| {
        b.iter_batched_ref(|| prognosis.clone(), &mut window, criterion::BatchSize::SmallInput);
    });
    c.bench_function("rul/forecast", |b| b.iter(|| prognosis.forecast(100.0)));
}

criterion_group!(benches, update);
criterion_main!(benches);
