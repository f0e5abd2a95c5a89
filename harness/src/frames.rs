//! Raw frames, batches of them, and their way through the demultiplexer.

use crate::{MANY, SOME, for_any};
use hmd_core::config::Config;
use hmd_core::demux::Demux;
use hmd_core::frame::{BusNames, FrameFlags, MAX_DATA, RawFrame};
use hmd_core::record::RawBatch;
use std::sync::Arc;

/// Stamp, bus, identifier, flags, length, data.
pub(crate) type AnyFrame = (u64, u8, u32, u8, u8, [u8; 32]);

/// The frame, if those values make one; identifiers are mostly those of actuators.
pub(crate) fn frame(input: AnyFrame) -> Option<RawFrame> {
    let (stamp_ns, bus, id, flags, length, half) = input;
    let id = if id & 7 == 0 {
        id >> 3
    } else {
        0x100 + (id >> 3) % 0x100
    };
    // Half of the frames are plain ones.
    let flags = if flags & 1 == 0 { 0 } else { flags };
    let data = [half, half].concat();
    let data = &data[..[8, 8, 64, usize::from(length) % (MAX_DATA + 1)][usize::from(length % 4)]];
    let fd = flags == 0 && data.len() > 8;
    let flags = FrameFlags::from_bits_retain(flags).with(FrameFlags::FD, fd || flags & FrameFlags::FD.bits() != 0);
    RawFrame::new(stamp_ns, u16::from(bus % 2), id, flags, data).ok()
}

pub(crate) fn names() -> BusNames {
    let mut names = BusNames::new();
    for name in ["can0", "can1"] {
        names.intern(name).unwrap();
    }
    names
}

fn frames(longest: usize) -> impl bolero::ValueGenerator<Output = Vec<AnyFrame>> {
    bolero::produce::<Vec<AnyFrame>>().with().len(0..=longest)
}

/// A frame is what it was made of, or refused.
///
/// Any identifier, flags and up to 64 bytes.
#[test]
fn frames_are_what_they_are_made_of() {
    for_any!(MANY, |input: AnyFrame| {
        let (stamp_ns, _, id, flags, length, half) = input;
        let data = [half, half].concat();
        let data = &data[..usize::from(length) % (MAX_DATA + 1)];
        let flags = FrameFlags::from_bits_retain(flags);
        if let Ok(frame) = RawFrame::new(stamp_ns, 0, id, flags, data) {
            assert_eq!(
                (frame.id(), frame.flags(), frame.announced_len()),
                (id, flags, data.len())
            );
            assert!(frame.is_remote() || frame.data() == data);
        }
    });
}

/// The identifier of SocketCAN gives the frame back.
///
/// Any valid frame but those of serial lines.
#[test]
fn socketcan_identifiers_come_back() {
    for_any!(MANY, |input: AnyFrame| {
        let Some(frame) = frame(input).filter(|frame| !frame.is_serial()) else {
            return;
        };
        let more = frame
            .flags()
            .with(FrameFlags::EXTENDED | FrameFlags::REMOTE | FrameFlags::ERROR, false);
        let asked = [0; MAX_DATA];
        let data = if frame.is_remote() {
            &asked[..frame.announced_len()]
        } else {
            frame.data()
        };
        let again = RawFrame::from_socketcan(frame.stamp_ns, frame.bus, frame.socketcan_id(), more, data);
        assert_eq!(again, Ok(frame));
    });
}

/// Frames in a batch come back with their places.
///
/// Up to 40 frames with any stamps.
#[test]
fn batches_come_back() {
    for_any!(MANY / 4, frames(40), |input: Vec<AnyFrame>| {
        let frames: Vec<_> = input
            .into_iter()
            .filter_map(frame)
            .map(|frame| frame.with_bus(0))
            .collect();
        let placed: Vec<(u64, &RawFrame)> = (3..).step_by(2).zip(&frames).collect();
        if !placed.is_empty() {
            let unpacked = RawBatch::pack("can0", 1, &placed).unpack(0).unwrap();
            assert!(
                unpacked
                    .iter()
                    .map(|(place, frame)| (*place, frame))
                    .eq(placed.iter().copied())
            );
        }
    });
}

/// Arrays that contradict each other are refused.
///
/// Any arrays of up to 8 entries.
#[test]
fn any_batch_is_unpacked_or_refused() {
    type Arrays = (u64, u64, [u32; 3], [i64; 3], [u8; 3], [u8; 3], u16);
    for_any!(MANY, |input: Arrays| {
        let (first_index, first_stamp_ns, id, stamp_step_ns, flags, length, cut) = input;
        let take = |at: u16| usize::from(cut >> at & 3);
        let batch = RawBatch {
            interface: "can0".to_owned(),
            first_index: first_index >> (cut >> 12 << 2),
            first_stamp_ns,
            id: id[..take(0)].iter().map(|id| id % 0x900).collect(),
            stamp_step_ns: stamp_step_ns[..take(2)].to_vec(),
            flags: flags[..take(4)].iter().map(|flags| u32::from(*flags)).collect(),
            length: length[..take(6)].iter().map(|length| u32::from(*length % 12)).collect(),
            payload: vec![7; take(8) * 4],
            index_step: id[..take(10)].to_vec(),
            ..RawBatch::default()
        };
        if let Ok(frames) = batch.unpack(0) {
            assert_eq!(frames.len(), batch.id.len());
            assert!(frames.windows(2).all(|two| two[0].0 < two[1].0));
        }
    });
}

/// Every frame is counted once, by what became of it.
///
/// Up to 100 frames of two buses.
#[test]
fn each_frame_is_counted_once() {
    let config = Arc::new(Config::default());
    for_any!(SOME, frames(100), |input: Vec<AnyFrame>| {
        let mut demux = Demux::new(config.clone());
        let frames: Vec<_> = input.into_iter().filter_map(frame).collect();
        for frame in &frames {
            demux.push(frame, &names());
        }
        demux.finish();
        let counts = demux.counts();
        let sum = counts.decoded + counts.filtered + counts.error + counts.malformed + counts.unreadable;
        assert_eq!(
            (counts.received, sum),
            (frames.len() as u64, frames.len() as u64),
            "{counts:?}"
        );
    });
}

/// The table of interfaces keeps its names, refuses what is none, and is bounded.
///
/// Up to 100 names of up to 20 characters.
#[test]
fn names_of_interfaces() {
    let texts = bolero::produce::<Vec<(u8, char)>>().with().len(0..=100usize);
    for_any!(SOME, texts, |input: Vec<(u8, char)>| {
        let mut names = BusNames::new();
        for (length, character) in input {
            let name: String = std::iter::repeat_n(character, usize::from(length % 20)).collect();
            if let Ok(bus) = names.intern(&name) {
                assert_eq!(
                    (names.name(bus), names.index_of(&name)),
                    (Some(name.as_str()), Some(bus))
                );
                assert!(name.bytes().all(|byte| byte.is_ascii_graphic() && byte != b'/'));
            }
        }
        assert!(names.len() <= BusNames::CAPACITY);
    });
}
