//! Packets on a serial line: COBS, checksum, frames between zeros.

use crate::can::{AnySample, sample};
use crate::{MANY, SOME, bytes, for_any};
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{ActuatorId, Deframer, SerialPacket, Splitter, Status};

fn emitted(packet: SerialPacket) -> Vec<u8> {
    packet.emit(&mut [0; MAX_FRAME_LEN]).unwrap().to_vec()
}

/// A sample is emitted without a zero but the last, in at most 39 bytes, and parsed to itself.
///
/// Any sample.
#[test]
fn samples_come_back() {
    for_any!(MANY, |input: AnySample| {
        let packet = SerialPacket::Sample(sample(input));
        let frame = emitted(packet);
        let (end, content) = frame.split_last().unwrap();
        assert!(*end == 0 && !content.contains(&0), "{frame:?}");
        assert_eq!(SerialPacket::parse(content), Ok(packet));
    });
}

/// A status is parsed to what CAN would deliver.
///
/// Any status.
#[test]
fn statuses_come_back() {
    for_any!(MANY, |input: (u8, [u8; 8])| {
        let packet = SerialPacket::Status {
            actuator: ActuatorId::new(input.0 % 16).unwrap(),
            status: Status::parse(&input.1),
        };
        let frame = emitted(packet);
        assert_eq!(SerialPacket::parse(&frame[..frame.len() - 1]), Ok(packet));
    });
}

/// Any bytes between two zeros are parsed or refused.
///
/// Up to 64 bytes.
#[test]
fn any_frame_is_parsed_or_refused() {
    for_any!(MANY, bytes(64), |frame: Vec<u8>| {
        let _ = SerialPacket::parse(&frame);
    });
}

/// A wrong bit costs the packet and yields no other.
///
/// Any sample, all single bits of its frame.
#[test]
fn every_wrong_bit_is_noticed() {
    for_any!(SOME, |input: AnySample| {
        let frame = emitted(SerialPacket::Sample(sample(input)));
        for bit in 0..8 * (frame.len() - 1) {
            let mut wrong = frame.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            let mut deframer = Deframer::new();
            assert_eq!(deframer.push_slice(&wrong).count(), 0, "bit {bit}");
        }
    });
}

/// Two wrong bits cost the packet, too.
///
/// Any sample, all pairs of bits of its frame.
#[test]
fn every_two_wrong_bits_are_noticed() {
    for_any!(10, |input: AnySample| {
        let frame = emitted(SerialPacket::Sample(sample(input)));
        let bits = 8 * (frame.len() - 1);
        for (one, two) in (0..bits).flat_map(|one| (0..one).map(move |two| (one, two))) {
            let mut wrong = frame.clone();
            wrong[one / 8] ^= 1 << (one % 8);
            wrong[two / 8] ^= 1 << (two % 8);
            let mut deframer = Deframer::new();
            assert_eq!(deframer.push_slice(&wrong).count(), 0, "bits {one}, {two}");
        }
    });
}

/// Packets do not depend on how the stream was cut, and each frame is delivered or counted.
///
/// Up to 200 bytes, cut anywhere.
#[test]
fn cuts_of_the_stream_change_nothing() {
    for_any!(MANY / 4, bytes(200), |stream: Vec<u8>| {
        let mut whole = Deframer::new();
        let packets: Vec<_> = whole.push_slice(&stream).collect();
        let mut pieces = Deframer::new();
        let (one, two) = stream.split_at(stream.len() / 3);
        let mut again: Vec<_> = pieces.push_slice(one).collect();
        again.extend(pieces.push_slice(two));
        whole.finish();
        pieces.finish();
        assert_eq!((packets.len(), whole.stats()), (again.len(), pieces.stats()));
        let frames = stream
            .split(|byte| *byte == 0)
            .filter(|frame| !frame.is_empty())
            .count() as u64;
        assert_eq!(whole.stats().packets + whole.stats().dropped(), frames);
    });
}

/// What lies between zeros comes out as it was, cut after the buffer's length.
///
/// Up to 300 bytes.
#[test]
fn frames_lie_between_zeros() {
    for_any!(MANY / 4, bytes(300), |stream: Vec<u8>| {
        let mut splitter = Splitter::<64>::new();
        let mut frames: Vec<Vec<u8>> = Vec::new();
        for byte in &stream {
            frames.extend(splitter.push(*byte).map(<[u8]>::to_vec));
        }
        frames.extend(splitter.finish().map(<[u8]>::to_vec));
        let expected = stream.split(|byte| *byte == 0).filter(|frame| !frame.is_empty());
        let expected: Vec<_> = expected.map(|frame| frame[..frame.len().min(64)].to_vec()).collect();
        assert_eq!(frames, expected);
    });
}
