//! The serial line under any chunking, garbage, single flipped bits and limits.

use ema_wire::serial::{BufferTooSmall, MAX_FRAME_LEN, VERSION};
use ema_wire::{ActuatorId, Deframer, FrameError, Mode, Sample, SerialPacket, Splitter};
use proptest::prelude::*;

use crate::common;

fn frame(packet: &SerialPacket) -> Vec<u8> {
    packet
        .emit(&mut [0; MAX_FRAME_LEN])
        .expect("MAX_FRAME_LEN suffices")
        .to_vec()
}

/// Packets in these bytes, and the number of dropped frames.
fn deframe_all(bytes: &[u8]) -> (Vec<SerialPacket>, u64) {
    let mut deframer = Deframer::new();
    let packets = deframer.push_slice(bytes).collect();
    deframer.finish();
    (packets, deframer.stats().dropped())
}

/// A frame of any content, built without the crate's encoder: COBS by its definition, bitwise CRC-32.
fn foreign_frame(content: &[u8]) -> Vec<u8> {
    let mut crc = u32::MAX;
    for byte in content {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
        }
    }
    let data = [content, &(!crc).to_le_bytes()].concat();
    assert!(
        data.len() < 254,
        "longer data need code byte 0xFF, which this encoder lacks"
    );
    let mut out: Vec<u8> = data
        .split(|byte| *byte == 0)
        .flat_map(|run| [&[run.len() as u8 + 1], run].concat())
        .collect();
    out.push(0);
    out
}

proptest! {
    #[test]
    fn packets_survive_any_chunking(
        packets in proptest::collection::vec(common::packet(), 0..20), cuts in proptest::collection::vec(0_usize..900, 0..30),
    ) {
        let line: Vec<u8> = packets.iter().flat_map(frame).collect();
        let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(line.len())).chain([0, line.len()]).collect();
        cuts.sort_unstable();
        let mut deframer = Deframer::new();
        let mut got = Vec::new();
        for chunk in cuts.windows(2) {
            got.extend(deframer.push_slice(&line[chunk[0]..chunk[1]]));
        }
        prop_assert_eq!(got, packets);
        prop_assert_eq!(deframer.stats().dropped(), 0);
    }

    #[test]
    fn garbage_costs_at_most_the_packet_it_touches(
        garbage in proptest::collection::vec(any::<u8>(), 0..200), before in common::packet(), after in common::packet(),
    ) {
        let line = [&frame(&before), &garbage[..], b"\0", &frame(&after)].concat();
        let (packets, dropped) = deframe_all(&line);
        prop_assert_eq!(packets, [before, after]);
        prop_assert_eq!(dropped, garbage.split(|byte| *byte == 0).filter(|run| !run.is_empty()).count() as u64);
    }

    /// Flips each bit of the line in turn. Every packet still delivered was sent, in this order, and the last one is
    /// delivered unless its own bytes or the zero before it are hit.
    #[test]
    fn no_flipped_bit_produces_a_wrong_packet(packets in proptest::collection::vec(common::packet(), 3)) {
        let line: Vec<u8> = packets.iter().flat_map(frame).collect();
        let last_starts = line.len() - frame(&packets[2]).len();
        for bit in 0..line.len() * 8 {
            let mut flipped = line.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let (got, dropped) = deframe_all(&flipped);
            let mut sent = packets.iter();
            prop_assert!(got.iter().all(|packet| sent.any(|other| other == packet)), "bit {}", bit);
            prop_assert!(got.len() < packets.len() && dropped > 0, "bit {}", bit);
            if bit / 8 < last_starts - 1 {
                prop_assert_eq!(got.last(), packets.last(), "bit {}", bit);
            }
        }
    }

    #[test]
    fn an_independent_encoder_emits_the_same_bytes(sample in common::sample()) {
        let mut content = vec![VERSION, 0, sample.actuator.index()];
        let mut varint = |mut value: u64| loop {
            let low = (value & 0x7f) as u8;
            value >>= 7;
            content.push(if value == 0 { low } else { low | 0x80 });
            if value == 0 { break }
        };
        let zigzag = |value: i64| ((value << 1) ^ (value >> 63)).cast_unsigned();
        varint(sample.seq.into());
        varint(sample.time_us.into());
        for value in [sample.i_a_ma, sample.i_b_ma, sample.i_c_ma].map(i64::from) {
            varint(zigzag(value));
        }
        for value in [sample.motor_counts, sample.output_counts, sample.setpoint].map(i64::from) {
            varint(zigzag(value));
        }
        varint(sample.mode as u64);
        prop_assert_eq!(foreign_frame(&content), frame(&SerialPacket::Sample(sample)));
    }
}

#[test]
fn the_longest_packet_has_exactly_the_stated_length() {
    let longest = SerialPacket::Sample(Sample {
        actuator: ActuatorId::new(15).expect("below 16"),
        seq: u16::MAX,
        time_us: u16::MAX,
        i_a_ma: i16::MIN,
        i_b_ma: i16::MIN,
        i_c_ma: i16::MIN,
        motor_counts: i32::MIN,
        output_counts: -(1 << 23),
        setpoint: i32::MIN,
        mode: Mode::Speed,
    });
    assert_eq!(frame(&longest).len(), MAX_FRAME_LEN);
    for got in 0..MAX_FRAME_LEN {
        let small = &mut [0; MAX_FRAME_LEN][..got];
        assert_eq!(
            longest.emit(small),
            Err(BufferTooSmall {
                sufficient: MAX_FRAME_LEN,
                got
            })
        );
    }
}

#[test]
fn every_kind_of_bad_frame_is_counted_by_its_reason() {
    let good = frame(&SerialPacket::Sample(common::nth_sample(1)));
    let mut bad_crc = good.clone();
    bad_crc[4] ^= 0x10;
    let mut deframer = Deframer::new();
    let line = [
        &bad_crc[..],
        &[5, 1, 1, 0],                                                  // code byte past the end
        &[1; 65],                                                       // longer than the buffer
        &[0, 0, 0],                                                     // ends it; empty frames do not count
        &foreign_frame(&[VERSION + 1, 0, 0]),                           // another version
        &foreign_frame(&[VERSION, 7]),                                  // no such packet
        &foreign_frame(&[VERSION, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0]),   // actuator 16
        &foreign_frame(&[VERSION, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 3]),    // mode 3
        &foreign_frame(&[VERSION, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1]), // a byte too many
        &foreign_frame(&[]),
        &good,
        &good[..9],
    ]
    .concat();
    assert_eq!(deframer.push_slice(&line).count(), 1);
    deframer.finish();
    let stats = deframer.stats();
    assert_eq!((stats.crc, stats.cobs, stats.too_long, stats.version), (1, 1, 1, 1));
    assert_eq!((stats.decode, stats.truncated, stats.packets), (5, 1, 1));
}

#[test]
fn frames_from_the_splitter_parse_later() {
    let good = frame(&SerialPacket::Sample(common::nth_sample(1)));
    let line = [&[7; 300][..], b"\0", &good, &[9; MAX_FRAME_LEN - 1], b"\0", &good[..9]].concat();
    let mut splitter: Splitter = Splitter::new();
    let mut frames: Vec<Vec<u8>> = Vec::new();
    for byte in line {
        frames.extend(splitter.push(byte).map(<[u8]>::to_vec));
    }
    frames.extend(splitter.finish().map(<[u8]>::to_vec));
    assert_eq!(splitter.finish(), None);
    assert_eq!(
        frames.iter().map(Vec::len).collect::<Vec<_>>(),
        [64, good.len() - 1, MAX_FRAME_LEN - 1, 9]
    );
    let parsed: Vec<_> = frames.iter().map(|frame| SerialPacket::parse(frame)).collect();
    assert_eq!(parsed[0], Err(FrameError::TooLong));
    assert_eq!(parsed[1], Ok(SerialPacket::Sample(common::nth_sample(1))));
    assert!(
        matches!(parsed[2..], [Err(FrameError::Cobs | FrameError::Crc), Err(_)]),
        "{parsed:?}"
    );
}
