//! Frames on CAN.

use crate::{MANY, for_any};
use ema_wire::can::{Command, Currents, FD_LEN, Position, SampleFd, Status};
use ema_wire::{ActuatorId, Assembler, Frame, Message, Mode, ParseError, Sample};

/// Identifiers and messages of actuators are one to one.
///
/// All 16-bit identifiers; exhaustive.
#[test]
fn identifiers() {
    let known = (0..=u16::MAX).filter(|id| match Message::from_id(*id) {
        Some((actuator, message)) => {
            assert_eq!(message.id(actuator), *id);
            true
        }
        None => false,
    });
    assert_eq!(known.count(), usize::from(ActuatorId::COUNT) * Message::ALL.len());
}

/// A frame of a length that its message does not have is refused, with both lengths.
///
/// All identifiers of 11 bits with all lengths up to 64; exhaustive.
#[test]
fn lengths() {
    for id in 0..1 << 11 {
        for length in 0..=FD_LEN {
            let mut data = [0; FD_LEN];
            data[3] = SampleFd::LAYOUT;
            data[2] = 1;
            let parsed = Frame::parse(id, &data[..length]);
            let expected = match Message::from_id(id) {
                None => {
                    assert_eq!(parsed, Ok(None));
                    continue;
                }
                Some((_, Message::SampleFd)) => FD_LEN,
                Some(_) => 8,
            };
            if length == expected {
                assert!(
                    !matches!(parsed, Err(ParseError::Length { .. })),
                    "{id:#x}, {length} bytes"
                );
            } else {
                assert_eq!(parsed, Err(ParseError::Length { expected, got: length }));
            }
        }
    }
}

/// Only three modes are taken.
///
/// All values of the byte; exhaustive.
#[test]
fn modes() {
    for mode in 0..=u8::MAX {
        let parsed = Command::parse(&[0, 0, 0, 0, mode, 0, 0, 0]);
        assert_eq!(parsed.is_ok(), mode < 3, "{mode}");
    }
}

/// Frames of 8 bytes that are parsed are emitted as the same bytes.
///
/// Any 8 bytes.
#[test]
fn classic_frames_come_back() {
    for_any!(MANY, |data: [u8; 8]| {
        assert_eq!(Currents::parse(&data).emit(), data);
        assert_eq!(Position::parse(&data).emit(), data);
        assert_eq!(Status::parse(&data).emit(), data);
        if let Ok(command) = Command::parse(&data) {
            assert_eq!(command.emit(), data);
        }
    });
}

/// Frames of 64 bytes that are parsed are emitted as a frame that is parsed to the same samples.
///
/// Any 64 bytes behind a valid head.
#[test]
fn fd_frames_come_back() {
    for_any!(MANY, |input: (u16, u8, [u8; 32], [u8; 28])| {
        let (seq, count, first, second) = input;
        let mut data = [0; FD_LEN];
        data[..2].copy_from_slice(&seq.to_le_bytes());
        data[2..4].copy_from_slice(&[count % 5, SampleFd::LAYOUT]);
        data[4..36].copy_from_slice(&first);
        data[36..].copy_from_slice(&second);
        if let Ok(parsed) = SampleFd::parse(&data) {
            assert_eq!(SampleFd::parse(&parsed.emit()), Ok(parsed));
            assert!((1..=SampleFd::MAX_SAMPLES).contains(&parsed.slots().len()));
        }
    });
}

/// Any frame of any bus is parsed or refused.
///
/// Any 16-bit identifier, up to 64 bytes.
#[test]
fn any_frame_is_parsed_or_refused() {
    for_any!(MANY, |input: (u16, u8, [u8; 32])| {
        let (id, length, half) = input;
        let data = [half, half].concat();
        let data = &data[..usize::from(length) % (FD_LEN + 1)];
        if let Ok(Some((actuator, frame))) = Frame::parse(id, data) {
            assert_eq!(frame.message().id(actuator), id);
        }
    });
}

/// A sample of any content.
pub(crate) fn sample(input: (u8, u16, u16, [i16; 3], [i32; 3], u8)) -> Sample {
    let (actuator, seq, time_us, [i_a_ma, i_b_ma, i_c_ma], [motor_counts, output, setpoint], mode) = input;
    Sample {
        actuator: ActuatorId::new(actuator % 16).unwrap(),
        seq,
        time_us,
        i_a_ma,
        i_b_ma,
        i_c_ma,
        motor_counts,
        output_counts: ema_wire::quantity::wrap_s24(output.into()),
        setpoint,
        mode: [Mode::Idle, Mode::Position, Mode::Speed][usize::from(mode % 3)],
    }
}

pub(crate) type AnySample = (u8, u16, u16, [i16; 3], [i32; 3], u8);

/// A sample's three frames give it back in every order of arrival, once.
///
/// Any sample, all six orders.
#[test]
fn every_order_of_three_frames() {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    for_any!(MANY / 10, |input: AnySample| {
        let sample = sample(input);
        let frames = sample.to_frames();
        for order in ORDERS {
            let mut assembler = Assembler::new(sample.actuator);
            let delivered: Vec<_> = order.iter().flat_map(|n| assembler.push(&frames[*n], 5)).collect();
            assert_eq!(delivered, [sample]);
            assert_eq!(assembler.stats().samples, 1);
        }
    });
}

/// Whatever arrives, a sample is delivered at most once, and each frame is in it, late, a duplicate, in conflict or left over.
///
/// Up to 64 frames of any content and stamp, with counters within 8 of each other.
#[test]
fn the_assembler_delivers_no_sample_twice() {
    let frames = bolero::produce::<Vec<(u8, u8, u8, u8)>>().with().len(0..=64usize);
    for_any!(MANY / 10, frames, |frames: Vec<(u8, u8, u8, u8)>| {
        let actuator = ActuatorId::new(3).unwrap();
        let mut assembler = Assembler::new(actuator);
        let (mut delivered, mut stamp_ns) = (Vec::new(), 0);
        for (kind, seq, content, wait) in &frames {
            stamp_ns += u64::from(*wait) * 10_000;
            let one = sample((3, u16::from(seq % 8), 0, [i16::from(content % 2); 3], [0; 3], 1));
            let frame = match kind % 4 {
                3 => Frame::SampleFd(SampleFd::from_samples(&[one]).unwrap()),
                n => one.to_frames()[usize::from(n)],
            };
            delivered.extend(assembler.push(&frame, stamp_ns));
        }
        assembler.close();
        let stats = assembler.stats();
        assert_eq!(stats.samples as usize, delivered.len());
        assert!(delivered.len() <= frames.len());
        let handled = stats.samples + stats.incomplete + stats.conflicting + stats.duplicates + stats.late;
        assert!(handled <= frames.len() as u64, "{stats:?}");
        if stats.restarts == 0 {
            assert!(
                delivered.windows(2).all(|two| two[0].seq != two[1].seq),
                "{delivered:?}"
            );
        }
    });
}
