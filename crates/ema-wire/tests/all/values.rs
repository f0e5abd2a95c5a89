//! Quantities, counts and texts by their definitions, with numbers worked out by hand.

use core::f64::consts::TAU;

use ema_wire::bus_load::{bus_load, fd_bus_load, fd_frame_seconds, serial_load};
use ema_wire::quantity::{motor_angle_rad, motor_counts, output_angle_rad, output_counts};
use ema_wire::serial::{BufferTooSmall, DeframerStats, MAX_FRAME_LEN, SerialPacket};
use ema_wire::{ActuatorId, Assembler, BatchError, Currents, Deframer, Frame, FrameError, Mode, ParseError, Sample};

use crate::common::nth_sample;

fn actuator() -> ActuatorId {
    ActuatorId::new(5).expect("below 16")
}

fn is_near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-12 * expected.abs()
}

#[test]
fn quantities_are_those_of_their_units() {
    assert!(is_near(output_angle_rad(-5_000), -TAU / 4.0));
    assert!(is_near(motor_angle_rad(-16_384), -TAU / 4.0));
    // The lower edge of a count.
    assert_eq!((motor_counts(0.25), motor_counts(-1e-9)), (2_607, -1));
    assert_eq!((output_counts(0.25), output_counts(-1e-9)), (795, -1));
    let sample = Sample {
        i_a_ma: 1_500,
        i_b_ma: -250,
        i_c_ma: 7,
        mode: Mode::Speed,
        setpoint: -2_500,
        ..nth_sample(0)
    };
    assert_eq!(
        sample.currents_a().map(f64::to_bits),
        [1.5, -0.25, 0.007].map(f64::to_bits)
    );
    assert_eq!((sample.setpoint_rad_s(), sample.setpoint_rad()), (Some(-2.5), None));
    let of_position = Sample {
        mode: Mode::Position,
        ..sample
    };
    assert_eq!(
        (of_position.setpoint_rad_s(), of_position.setpoint_rad()),
        (None, Some(-0.0025))
    );
}

/// 64 bytes: slow 17 + 1 + 13 bits, fast 5 + 512 + 51 + 32.
#[test]
fn an_fd_frame_lasts_as_long_as_its_bits() {
    assert!(is_near(fd_frame_seconds(64, 1e6, 5e6), 31e-6 + 120e-6));
    let status = 10.0 * 120e-6;
    assert!(is_near(
        fd_bus_load(300.0, 2, 1e6, 5e6),
        2.0 * (100.0 * 151e-6 + status)
    ));
    assert!(is_near(bus_load(100.0, 3, 1e6), 3.0 * 310.0 * 120e-6));
    let per_frame = MAX_FRAME_LEN as f64 * 10.0 / 921_600.0;
    assert!(is_near(serial_load(90.0, 2, 921_600.0), 200.0 * per_frame));
}

#[test]
fn every_repeated_and_late_frame_counts_once() {
    let sent = |k: u64, j: usize| (nth_sample(k).to_frames()[j], k * 500_000);
    let mut assembler = Assembler::new(actuator());
    let mut feed = |frames: &[(Frame, u64)]| {
        for (frame, at) in frames {
            assembler.push(frame, *at).for_each(drop);
        }
        assembler.stats()
    };
    feed(&[sent(0, 0), sent(0, 1), sent(0, 2), sent(1, 0), sent(1, 1), sent(1, 2)]);
    let stats = feed(&[sent(1, 0), sent(1, 1), sent(0, 0), sent(0, 1), sent(0, 2)]);
    assert_eq!((stats.samples, stats.duplicates, stats.late), (2, 2, 3));
    let stats = feed(&[sent(2, 0), sent(2, 0), sent(2, 0)]);
    assert_eq!((stats.samples, stats.duplicates), (2, 4));
}

#[test]
fn a_repeated_and_a_late_whole_sample_count_once() {
    let mut assembler = Assembler::new(actuator());
    let samples: Vec<Sample> = (0..2).map(nth_sample).collect();
    for sample in samples
        .iter()
        .chain([&samples[1], &samples[1], &samples[0], &samples[0]])
    {
        assembler.push_sample(sample, 0);
    }
    let stats = assembler.stats();
    assert_eq!((stats.samples, stats.duplicates, stats.late), (2, 2, 2));
}

#[test]
fn a_whole_sample_after_frames_that_contradict_each_other_is_late() {
    let mut assembler = Assembler::new(actuator());
    let [first, ..] = nth_sample(0).to_frames();
    let Frame::Currents(currents) = first else {
        panic!("the first frame has the currents: {first:?}");
    };
    let other = Frame::Currents(Currents {
        i_a_ma: currents.i_a_ma.wrapping_add(1),
        ..currents
    });
    assert_eq!(assembler.push(&first, 0).count() + assembler.push(&other, 1).count(), 0);
    assert_eq!(assembler.push_sample(&nth_sample(0), 2), None);
    let stats = assembler.stats();
    assert_eq!((stats.conflicting, stats.late, stats.samples), (1, 1, 0));
}

#[test]
fn a_span_that_is_set_counts() {
    let mut assembler = Assembler::new(actuator());
    assembler.set_max_span_ns(10);
    let frames = nth_sample(0).to_frames();
    assert_eq!(assembler.push(&frames[0], 0).count(), 0);
    // Beyond the span it is the frame of another sample.
    assert_eq!(assembler.push(&frames[1], 11).count(), 0);
    assert_eq!(assembler.push(&frames[2], 11).count(), 0);
    assert_eq!(assembler.stats().incomplete, 1);
}

#[test]
fn the_longest_frame_is_read_and_one_byte_more_is_too_long() {
    assert_eq!(SerialPacket::parse(&[1; MAX_FRAME_LEN]), Err(FrameError::TooLong));
    assert_ne!(SerialPacket::parse(&[1; MAX_FRAME_LEN - 1]), Err(FrameError::TooLong));
}

#[test]
fn output_counts_beyond_the_wire_wrap() {
    let sample = Sample {
        output_counts: (1 << 23) + 5,
        ..nth_sample(0)
    };
    let mut buffer = [0; MAX_FRAME_LEN];
    let line = SerialPacket::Sample(sample)
        .emit(&mut buffer)
        .expect("it suffices")
        .to_vec();
    let mut deframer = Deframer::new();
    let packets: Vec<SerialPacket> = deframer.push_slice(&line).collect();
    let [SerialPacket::Sample(found)] = packets.as_slice() else {
        panic!("one sample: {packets:?}");
    };
    assert_eq!(found.output_counts, 5 - (1 << 23));
}

#[test]
fn dropped_frames_are_counted_by_cause_and_together() {
    let stats = DeframerStats {
        packets: 1_000_000,
        crc: 2,
        cobs: 30,
        too_long: 400,
        version: 5_000,
        decode: 60_000,
        truncated: 700_000,
    };
    assert_eq!(stats.dropped(), 765_432);
    let by_cause = FrameError::ALL.map(|error| stats.dropped_for(error));
    assert_eq!(by_cause, [400, 30, 2, 5_000, 60_000]);
}

#[test]
fn errors_say_what_was_expected() {
    assert_eq!(actuator().to_string(), "ema5");
    let refused = ActuatorId::try_from(16).expect_err("there are sixteen");
    assert_eq!(refused.to_string(), "actuator number: expected 0 to 15, got 16");
    let short = BufferTooSmall { sufficient: 40, got: 3 };
    assert_eq!(short.to_string(), "serial buffer: 40 bytes suffice, got 3");
    assert_eq!(FrameError::Crc.to_string(), "wrong CRC");
    let length = ParseError::Length { expected: 8, got: 7 };
    assert_eq!(length.to_string(), "data length: expected 8 bytes, got 7");
    let gap = BatchError::Seq { expected: 3, got: 4 };
    assert_eq!(gap.to_string(), "sample counter: expected 3, got 4");
}
