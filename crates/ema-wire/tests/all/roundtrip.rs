//! `parse(emit(x)) == x` for every frame, and `emit(parse(bytes)) == bytes` for every message whose bytes are all parsed.

use ema_wire::can::{CLASSIC_LEN, FD_LEN};
use ema_wire::{ActuatorId, BatchError, Frame, Message, Mode, ParseError, Position, Sample, SampleFd, Status};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::common;

fn parse_inverts_emit(actuator: ActuatorId, frame: Frame) -> Result<(), TestCaseError> {
    let mut buffer = [0xaa; FD_LEN];
    let data = frame.emit(&mut buffer);
    prop_assert_eq!(
        Frame::parse(frame.message().id(actuator), data),
        Ok(Some((actuator, frame)))
    );
    Ok(())
}

/// 64 bytes with small numbers in the bytes that decide whether the frame is valid.
fn fd_like() -> impl Strategy<Value = Vec<u8>> {
    (vec(any::<u8>(), FD_LEN), vec(0_u8..5, 5)).prop_map(|(mut data, small)| {
        for (at, value) in [2, 3, 17, 37, 57].into_iter().zip(small) {
            data[at] = value;
        }
        data
    })
}

proptest! {
    #[test]
    fn parse_inverts_emit_of_classic_frames(
        actuator in common::actuator(), currents in common::currents(), position in common::position(),
        command in common::command(), status in common::status(),
    ) {
        parse_inverts_emit(actuator, Frame::Currents(currents))?;
        parse_inverts_emit(actuator, Frame::Position(position))?;
        parse_inverts_emit(actuator, Frame::Command(command))?;
        parse_inverts_emit(actuator, Frame::Status(status))?;
    }

    #[test]
    fn parse_inverts_emit_of_fd_frames(samples in common::run()) {
        let packed = SampleFd::from_samples(&samples)?;
        parse_inverts_emit(samples[0].actuator, Frame::SampleFd(packed))?;
        prop_assert_eq!(packed.samples(samples[0].actuator).collect::<Vec<_>>(), samples);
    }

    #[test]
    fn a_sample_equals_its_joined_frames(sample in common::sample()) {
        let frames = sample.to_frames();
        let [Frame::Currents(currents), Frame::Position(position), Frame::Command(command)] = frames else {
            return Err(TestCaseError::fail("order on the bus"));
        };
        prop_assert_eq!(Sample::from_parts(sample.actuator, &currents, &position, &command), Some(sample));
        let other = Position { seq8: position.seq8 ^ 1, ..position };
        prop_assert_eq!(Sample::from_parts(sample.actuator, &currents, &other, &command), None);
    }

    #[test]
    fn any_bytes_fail_with_their_reason_or_are_emitted_again(
        id in 0x0f0_u16..0x210, data in prop_oneof![vec(any::<u8>(), CLASSIC_LEN), fd_like(), vec(any::<u8>(), 0..=FD_LEN)],
    ) {
        let parsed = Frame::parse(id, &data);
        match parsed {
            Ok(None) => prop_assert_eq!(Message::from_id(id), None),
            Ok(Some((actuator, frame))) => {
                let mut buffer = [0; FD_LEN];
                prop_assert_eq!(frame.message().id(actuator), id);
                let emitted = frame.emit(&mut buffer);
                if !matches!(frame, Frame::SampleFd(_)) { // its unused slots are not parsed
                    prop_assert_eq!(emitted, &data[..]);
                }
            }
            Err(ParseError::Length { expected, got }) => prop_assert!(got == data.len() && got != expected),
            Err(ParseError::Mode { at, got }) => prop_assert!(data[at] == got && got > 2),
            Err(ParseError::Count { got, .. }) => prop_assert!(got == data[2] && !(1..=3).contains(&got)),
            Err(ParseError::Layout { got, .. }) => prop_assert!(got == data[3] && got != SampleFd::LAYOUT),
        }
    }
}

#[test]
fn errors_name_the_invalid_field_and_its_offset() {
    let frame = |id, data: &[u8]| Frame::parse(id, data).expect_err("invalid");
    assert_eq!(
        frame(0x102, &[0, 0, 0, 0, 3, 0, 0, 0]),
        ParseError::Mode { at: 4, got: 3 }
    );
    assert_eq!(
        frame(0x103, &[0; 9]),
        ParseError::Length {
            expected: CLASSIC_LEN,
            got: 9
        }
    );
    assert_eq!(
        frame(0x108, &[0; 8]),
        ParseError::Length {
            expected: FD_LEN,
            got: 8
        }
    );
    let mut data = [0; FD_LEN];
    assert_eq!(frame(0x108, &data), ParseError::Layout { expected: 1, got: 0 });
    data[3] = 1;
    assert_eq!(frame(0x108, &data), ParseError::Count { max: 3, got: 0 });
    data[2] = 2;
    data[4 + 20 + 13] = 9;
    assert_eq!(frame(0x108, &data), ParseError::Mode { at: 37, got: 9 });
    data[2] = 1; // now the bad mode is in an unused slot, which is not parsed
    assert!(Frame::parse(0x108, &data).is_ok());
}

#[test]
fn emit_saturates_the_torque_and_wraps_the_counter() {
    let status = Status {
        dc_link_dv: 0,
        winding_temp_dc: 0,
        load_torque_dnm: Some(i16::MIN),
        fault_flags: 0,
        seq8: 0,
    };
    assert_eq!(Status::parse(&status.emit()).load_torque_dnm, Some(-i16::MAX));
    let position = Position {
        motor_counts: -1,
        output_counts: 1 << 23,
        seq8: 0,
    };
    assert_eq!(Position::parse(&position.emit()).output_counts, -(1 << 23));
}

#[test]
fn only_consecutive_samples_of_one_actuator_share_a_frame() {
    let [a, b, c] = [65_535, 65_536, 65_538].map(common::nth_sample);
    assert!(SampleFd::from_samples(&[a, b]).is_ok()); // the counter may wrap inside
    assert_eq!(
        SampleFd::from_samples(&[b, c]),
        Err(BatchError::Seq { expected: 1, got: 2 })
    );
    assert_eq!(SampleFd::from_samples(&[]), Err(BatchError::Count { max: 3, got: 0 }));
    assert_eq!(
        SampleFd::from_samples(&[a; 4]),
        Err(BatchError::Count { max: 3, got: 4 })
    );
    let ema0 = ActuatorId::new(0).expect("below 16");
    let foreign = Sample {
        actuator: ema0,
        mode: Mode::Idle,
        ..b
    };
    assert_eq!(
        SampleFd::from_samples(&[a, foreign]),
        Err(BatchError::Actuator {
            expected: a.actuator,
            got: ema0
        })
    );
}
