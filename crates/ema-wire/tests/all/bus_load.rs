//! Nominal stuffing compared with frames whose bits are counted one by one.

use ema_wire::bus_load::{Stuffing, classic_frame_bits};
use ema_wire::{ActuatorId, Mode, Sample, quantity};

/// Bits of one classic frame as sent, ISO 11898-1: header, data, CRC-15, stuffing, tail and pause.
fn counted_bits(id: u16, data: &[u8]) -> u32 {
    let bits_of = |value: u32, n: u32| (0..n).rev().map(move |k| value >> k & 1 == 1);
    let mut bits: Vec<bool> = [false]
        .into_iter()
        .chain(bits_of(id.into(), 11))
        .chain([false; 3])
        .collect();
    bits.extend(bits_of(data.len() as u32, 4));
    bits.extend(data.iter().flat_map(|byte| bits_of((*byte).into(), 8)));
    let mut crc = 0_u32;
    for bit in &bits {
        let feedback = *bit != (crc >> 14 & 1 == 1);
        crc = (crc << 1 & 0x7fff) ^ if feedback { 0x4599 } else { 0 };
    }
    bits.extend(bits_of(crc, 15));
    let (mut run, mut last, mut stuffed) = (0, None, 0);
    for bit in &bits {
        run = if last == Some(*bit) { run + 1 } else { 1 };
        last = Some(*bit);
        if run == 5 {
            (stuffed, last, run) = (stuffed + 1, Some(!bit), 1);
        }
    }
    bits.len() as u32 + stuffed + 13
}

/// Sample of an actuator under roughly the mixed profile; only the magnitudes matter.
fn sample(actuator: ActuatorId, k: u32) -> Sample {
    let t = f64::from(k) / 2_000.0;
    let (theta_out, i) = (0.25 + 0.01 * (6.0 * t).sin(), 4.0 * (23.0 * t).sin());
    let angle = 400.0 * theta_out;
    let third = std::f64::consts::TAU / 3.0;
    Sample {
        actuator,
        seq: k as u16,
        time_us: (k * 500) as u16,
        i_a_ma: quantity::current_ma(-i * angle.sin()),
        i_b_ma: quantity::current_ma(-i * (angle - third).sin()),
        i_c_ma: quantity::current_ma(-i * (angle + third).sin()),
        motor_counts: quantity::motor_counts(100.0 * theta_out),
        output_counts: quantity::output_counts(theta_out),
        setpoint: quantity::position_setpoint_urad(theta_out),
        mode: Mode::Position,
    }
}

#[test]
fn counted_lengths_lie_between_the_bounds_and_near_nominal() {
    let ([none, nominal, worst], mut sum, mut frames) = (
        [Stuffing::None, Stuffing::Nominal, Stuffing::Worst].map(|s| classic_frame_bits(8, s)),
        0,
        0,
    );
    for actuator in ActuatorId::all() {
        for frame in (0..4_000).flat_map(|k| sample(actuator, k).to_frames()) {
            let mut buffer = [0; 64];
            let bits = counted_bits(frame.message().id(actuator), frame.emit(&mut buffer));
            assert!((none..=worst).contains(&bits), "{frame:?}: {bits}");
            (sum, frames) = (sum + u64::from(bits), frames + 1);
        }
    }
    let mean = sum as f64 / f64::from(frames);
    println!("mean {mean:.2} bits, nominal {nominal}");
    assert!(
        (mean - f64::from(nominal)).abs() < 4.0,
        "mean {mean}, nominal {nominal}"
    );
}
