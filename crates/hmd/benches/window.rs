//! One window from its samples to its estimate, on one thread.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, Method};
use ema_models::{ActuatorParams, FaultVector, Profile};
use hmd_lab::evaluate::TABLE_III;
use hmd_lab::simulated::SimulatedWindow;

fn window(c: &mut Criterion) {
    let params = ActuatorParams::bench();
    let identifier = Identifier {
        params,
        calibration: TypeCalibration::built_in("bench", MonitorForm::ThreePhase).expect("shipped with the program"),
        method: Method::hybrid(),
        motor: ema_models::MotorKnowledge::default(),
        tolerances: ema_models::Tolerances::NONE,
    };
    let window = SimulatedWindow::new(&params, FaultVector::from_array(TABLE_III), Profile::Mixed, 1);
    let one = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("one thread");
    c.bench_function("identification", |b| {
        b.iter(|| one.install(|| identifier.identify(black_box(&window.prepared), window.conditions, 1)))
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30);
    targets = window
}
criterion_main!(benches);
