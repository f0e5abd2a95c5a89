//! Decoding and windowing from memory, on one core: sixteen actuators at 400 Hz on three interfaces.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd_core::config::Config;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::pipeline::Pipeline;
use hmd_lab::simulate::{EPOCH_NS, traffic};

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

/// The built-in dictionary by its DBC file.
fn mapped() -> String {
    let mut text = String::new();
    for n in 0..16 {
        text += &format!(
            "[[actuator]]\nid = {n}\nbus = \"can{}\"\ndbc = \"ema.dbc\"\n[actuator.signals]\n\
             currents = {{ a = \"EMA{n}_Currents.i_a\", b = \"EMA{n}_Currents.i_b\", c = \"EMA{n}_Currents.i_c\" }}\n\
             position = {{ motor = \"EMA{n}_Position.motor_counts\", output = \"EMA{n}_Position.output_counts\" }}\n\
             command.position = {{ signal = \"EMA{n}_Command.setpoint\", unit = \"urad\" }}\n\
             command.mode = \"EMA{n}_Command.mode\"\nsample.time = \"EMA{n}_Command.time_us\"\n\
             sample.counter = [\"EMA{n}_Currents.seq\", \"EMA{n}_Position.seq8\", \"EMA{n}_Command.seq8\"]\n",
            n / 6
        );
    }
    text
}

fn decode_and_cut(c: &mut Criterion) {
    let mut names = BusNames::new();
    for name in ["can0", "can1", "can2"] {
        names.intern(name).expect("a good name");
    }
    let rate = "[type.bench.sensors]\nsample_rate_hz = 400\n";
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/hmd.toml");
    let config = |text: &str| Arc::new(Config::from_toml_str(text, file).expect("a good configuration"));
    let frames = frames();
    let mut group = c.benchmark_group("front");
    group.throughput(Throughput::Elements(frames.len() as u64));
    let cases = [
        ("16_actuators_400_hz", config(rate)),
        ("16_mapped_actuators_400_hz", config(&(mapped() + rate))),
    ];
    for (name, config) in cases {
        group.bench_function(name, |b| {
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
    }
    group.finish();
}

criterion_group!(benches, decode_and_cut);
criterion_main!(benches);
