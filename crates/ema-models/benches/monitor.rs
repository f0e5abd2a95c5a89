//! Times of the monitor: one sample period of ten steps, a batch of windows of 0.5 s, and one linearisation.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ema_models::reference::Scenario;
use ema_models::{
    ActuatorParams, Calibration, ComparedSample, Comparison, Conditions, FaultVector, Feedback, Prior, RANK_LANES,
    Recording, Scale, SensedSample, Weights, prepare_window,
};

fn monitor(c: &mut Criterion) {
    let params = ActuatorParams::bench();
    let fault = FaultVector {
        friction: 0.25,
        short_b: 0.45,
        ..FaultVector::NOMINAL
    };
    // The window starts 20 ms before the trigger, which is at 40 ms.
    let sensed: Vec<SensedSample> = Scenario::new(params, fault, 1).run().skip(40).take(1000).collect();
    let mut samples = vec![ComparedSample::default(); sensed.len()];
    let initial = prepare_window(&params, &sensed, &[], 40, 0.0, &mut samples);
    let calibration = Calibration::default();
    let comparison = Comparison {
        recording: Recording {
            samples: &samples,
            drive: &samples,
            initial,
        },
        params: &params,
        calibration: &calibration,
        conditions: Conditions {
            load_torque: Some(0.0),
            v_dc: params.motor.v_dc,
            winding_temp_deg_c: None,
        },
        weights: Weights {
            i_d: 0.5,
            i_q: 2.0,
            theta_m: 30.0,
            omega_m: 0.2,
            theta_out: 400.0,
        },
        feedback: Feedback::Measured,
        prior: Prior {
            load_torque: 0.1,
            integral: 0.1,
            motor: ema_models::MotorKnowledge::default(),
        },
    };
    let unknowns = comparison.unknowns_with_fault(fault);

    let monitor = comparison.monitor(&unknowns);
    c.bench_function("ten_steps_scalar_f64", |b| {
        let mut state = monitor.start(&initial, &samples[0]);
        b.iter(|| monitor.run_sample_period(black_box(&mut state), &initial, &samples[500], &samples[501]));
    });
    // Different fault vectors, because lanes take a shortcut only if all of them can.
    let batch = core::array::from_fn(|n| {
        let share = n as f64 / RANK_LANES as f64;
        comparison.unknowns_with_fault(FaultVector {
            friction: share,
            short_a: 1.0 - share,
            ..fault
        })
    });
    c.bench_function("window_in_a_batch", |b| b.iter(|| comparison.rank(black_box(&batch))));
    let at = Scale::new(&params).coordinates(&unknowns);
    c.bench_function("linearisation", |b| {
        b.iter(|| comparison.normal_equations(black_box(&at), 2e-3))
    });
}

criterion_group!(benches, monitor);
criterion_main!(benches);
