//! Decoding and windowing from memory, on one core: sixteen actuators at 400 Hz on three interfaces.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::config::Config;
use hmd::frame::{BusNames, RawFrame};
use hmd::pipeline::Pipeline;
use hmd::simulate::{EPOCH_NS, traffic};

fn frames() -> Vec<RawFrame> {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let mut frames: Vec<RawFrame> = ActuatorId::all()
        .flat_map(|id| {
            let scenario = Scenario {
                actuations: Actuations {
                    count: 5,
                    ..Actuations::one(Profile::Mixed)
                },
                ..Scenario::new(params, FaultVector::NOMINAL, u64::from(id.index()))
            };
            let bus = u16::from(id.index()) / 6;
            traffic(&scenario, id, EPOCH_NS).map(move |frame| frame.with_bus(bus))
        })
        .collect();
    frames.sort_by_key(|frame| frame.stamp_ns);
    frames
}

fn decode_and_cut(c: &mut Criterion) {
    let mut names = BusNames::new();
    for name in ["can0", "can1", "can2"] {
        names.intern(name).expect("a good name");
    }
    let text = "[type.bench.sensors]\nsample_rate_hz = 400";
    let config = Arc::new(Config::from_toml_str(text, "bench").expect("a good configuration"));
    let frames = frames();
    let mut group = c.benchmark_group("front");
    group.throughput(Throughput::Elements(frames.len() as u64));
    group.bench_function("16_actuators_400_hz", |b| {
        b.iter_batched(
            || (Pipeline::new(config.clone()), Vec::with_capacity(256)),
            |(mut pipeline, mut ended)| {
                for frame in &frames {
                    pipeline.push(black_box(frame), &names, &mut ended);
                }
                assert!(ended.len() >= 64, "windows are cut");
                (pipeline, ended)
            },
            BatchSize::LargeInput,
        );
    });
    group.finish();
}

criterion_group!(benches, decode_and_cut);
criterion_main!(benches);
