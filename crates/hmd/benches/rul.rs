//! One update and forecast of the prognosis late in a life with all faults growing: the most expensive case. And one trial of a
//! specification on 32 fault vectors, of which a window takes one or two where something is required, and as many again
//! where a stall load is.

use criterion::{Criterion, criterion_group, criterion_main};
use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_models::{ActuatorParams, FaultId, FaultVector};
use hmd_core::config::Specification;
use hmd_core::functional_check::{CHECK_LANES, unmet_requirements};
use hmd_core::rul::{Odometer, Prognosis};

fn update(c: &mut Criterion) {
    let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
    let mut hours = 0.0;
    let mut window = |prognosis: &mut Prognosis| {
        hours += 1.0;
        let at = Odometer {
            hours,
            cycles: hours,
            work_j: hours,
        };
        let damage = 0.5 * (hours / 1e3).min(1.0);
        prognosis.update(
            at,
            &[Some((damage + 0.003 * (hours * 0.618).fract(), 0.005)); FaultId::COUNT],
        );
    };
    for _ in 0..500 {
        window(&mut prognosis);
    }
    c.bench_function("rul/update", |b| {
        b.iter_batched_ref(|| prognosis.clone(), &mut window, criterion::BatchSize::SmallInput);
    });
    c.bench_function("rul/forecast", |b| b.iter(|| prognosis.forecast(100.0)));
}

fn trial(c: &mut Criterion) {
    let calibration = TypeCalibration::built_in("bench", MonitorForm::ThreePhase)
        .expect("it is shipped")
        .coefficients();
    let specification = Specification {
        slew_rate_min_rad_s: 0.1,
        ..Specification::default()
    };
    let params = ActuatorParams::bench();
    c.bench_function("rul/specification_trial", |b| {
        b.iter(|| {
            unmet_requirements(
                &params,
                &calibration,
                &specification,
                &[FaultVector::NOMINAL; CHECK_LANES],
            )
        });
    });
}

criterion_group!(benches, update, trial);
criterion_main!(benches);
