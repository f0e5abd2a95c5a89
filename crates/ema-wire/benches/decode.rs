//! Frames per second: classic decode and assembly, CAN FD, serial.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ema_wire::can::FD_LEN;
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{ActuatorId, Assembler, Deframer, Frame, Mode, Sample, SampleFd, SerialPacket};

const SAMPLES: u32 = 3_000;

fn samples() -> Vec<Sample> {
    let actuator = ActuatorId::new(0).expect("below 16");
    (0..SAMPLES)
        .map(|k| Sample {
            actuator,
            seq: k as u16,
            time_us: (k * 500) as u16,
            i_a_ma: (k * 7) as i16,
            i_b_ma: (k * 11) as i16,
            i_c_ma: (k * 13) as i16,
            motor_counts: (k * 655) as i32,
            output_counts: (k * 2) as i32,
            setpoint: 250_000,
            mode: Mode::Position,
        })
        .collect()
}

fn on_bus(frames: impl Iterator<Item = Frame>, actuator: ActuatorId) -> Vec<(u16, Vec<u8>)> {
    frames
        .map(|frame| (frame.message().id(actuator), frame.emit(&mut [0; FD_LEN]).to_vec()))
        .collect()
}

/// Parses and assembles; the sum prevents the compiler from removing the samples.
fn assemble(bus: &[(u16, Vec<u8>)], actuator: ActuatorId) -> (u64, i64) {
    let mut assembler = Assembler::new(actuator);
    let mut sum = 0;
    for (k, (id, data)) in bus.iter().enumerate() {
        if let Ok(Some((_, frame))) = Frame::parse(*id, data) {
            sum += assembler
                .push(&frame, k as u64 * 160_000)
                .map(|sample| i64::from(sample.motor_counts))
                .sum::<i64>();
        }
    }
    (assembler.stats().samples, sum)
}

fn decode(criterion: &mut Criterion) {
    let samples = samples();
    let actuator = samples[0].actuator;
    let mut group = criterion.benchmark_group("decode");

    let classic = on_bus(samples.iter().flat_map(Sample::to_frames), actuator);
    assert_eq!(assemble(&classic, actuator).0, u64::from(SAMPLES));
    group.throughput(Throughput::Elements(classic.len() as u64));
    group.bench_function("classic_frames", |bencher| {
        bencher.iter(|| assemble(&classic, actuator))
    });

    let packed = samples
        .chunks(3)
        .map(|chunk| Frame::SampleFd(SampleFd::from_samples(chunk).expect("consecutive")));
    let fd = on_bus(packed, actuator);
    assert_eq!(assemble(&fd, actuator).0, u64::from(SAMPLES));
    group.throughput(Throughput::Elements(fd.len() as u64));
    group.bench_function("fd_frames", |bencher| bencher.iter(|| assemble(&fd, actuator)));

    let emit = |sample: &Sample| {
        SerialPacket::Sample(*sample)
            .emit(&mut [0; MAX_FRAME_LEN])
            .expect("fits")
            .to_vec()
    };
    let line: Vec<u8> = samples.iter().flat_map(emit).collect();
    group.throughput(Throughput::Elements(samples.len() as u64));
    group.bench_function("serial_packets", |bencher| {
        bencher.iter(|| {
            let mut deframer: Deframer = Deframer::new();
            deframer.push_slice(&line).count()
        });
    });
    group.finish();
}

criterion_group!(benches, decode);
criterion_main!(benches);
