//! Readers of files and lines: anything is read or refused, and what was written comes back.

use crate::frames::{AnyFrame, frame, names};
use crate::{FEW, MANY, SOME, bytes, for_any};
use hmd_core::config::Config;
use hmd_core::dbc::{Database, Layout};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_ingest::candump as line;
use hmd_storage::mcap::{McapFrames, McapMessages};
use hmd_storage::mcap_writer::McapWriter;
use hmd_storage::recover::recover;
use std::collections::BTreeMap;
use std::io::Cursor;

/// Lines of `candump` that are written are read as the same frame.
///
/// Any valid frame with whole microseconds.
#[test]
fn candump_lines_come_back() {
    for_any!(MANY, |input: AnyFrame| {
        let stamp_ns = input.0 / 1_000_000 * 1000;
        let Some(frame) = frame((stamp_ns, 0, input.2, input.3, input.4, input.5)) else {
            return;
        };
        let mut text = Vec::new();
        line::emit(&frame, "can0", line::Decimals::Six, &mut text);
        if frame.is_serial() {
            assert!(text.is_empty());
        } else {
            assert_eq!(line::parse(&text, &mut names()), Ok(frame), "{}", text.escape_ascii());
        }
    });
}

/// Any line is read or refused, and a refused one adds no interface.
///
/// Up to 80 bytes behind a valid stamp.
#[test]
fn any_candump_line_is_read_or_refused() {
    for_any!(MANY, bytes(80), |end: Vec<u8>| {
        for text in [end.clone(), [b"(1.000000) can0 123#".as_slice(), &end].concat()] {
            let mut names = BusNames::new();
            let refused = line::parse(&text, &mut names).is_err();
            assert!(!refused || names.is_empty());
        }
    });
}

/// A recording cut anywhere yields the first frames and nothing else.
///
/// Up to 60 frames with syncs between, cut at any byte.
#[test]
fn a_cut_recording_yields_its_first_frames() {
    let input = (
        bolero::produce::<Vec<AnyFrame>>().with().len(0..=60usize),
        bolero::produce::<(u8, u16)>(),
    );
    for_any!(FEW, input, |input: (Vec<AnyFrame>, (u8, u16))| {
        let (input, (every, cut)) = input;
        let frames: Vec<RawFrame> = input.into_iter().filter_map(frame).collect();
        let mut file = Cursor::new(Vec::new());
        let mut writer = McapWriter::new(&mut file, &BTreeMap::new()).unwrap();
        for (n, frame) in frames.iter().enumerate() {
            writer.write_frame(frame, &names()).unwrap();
            if n % (1 + usize::from(every % 8)) == 0 {
                writer.flush_window().unwrap();
            }
        }
        writer.finish().unwrap();
        let file = file.into_inner();
        let read = |file: &[u8]| -> Vec<RawFrame> {
            McapFrames::new(Cursor::new(file), "a.mcap", names())
                .unwrap()
                .flatten()
                .collect()
        };
        assert_eq!(read(&file), frames);
        let cut = read(&file[..usize::from(cut) % (file.len() + 1)]);
        assert_eq!(cut, frames[..cut.len()]);
    });
}

/// Any bytes behind the head of a recording are read or refused.
///
/// Up to 400 bytes.
#[test]
fn any_recording_is_read_or_refused() {
    for_any!(SOME, bytes(400), |end: Vec<u8>| {
        let file = [mcap::MAGIC, end.as_slice()].concat();
        let _ = McapMessages::new(Cursor::new(&file), "a.mcap").unwrap().count();
        recover(Cursor::new(&file), "a.mcap", Cursor::new(Vec::new()), "").unwrap();
    });
}

/// Any text is a configuration or refused.
///
/// Up to 200 bytes behind a valid section.
#[test]
fn any_configuration_is_read_or_refused() {
    for_any!(SOME, bytes(200), |end: Vec<u8>| {
        let end = String::from_utf8_lossy(&end);
        for text in [
            end.to_string(),
            format!("[[actuator]]\nid = 1\n{end}"),
            format!("[health]\nwatch = {end}"),
        ] {
            let _ = Config::from_toml_str(&text, "a.toml");
        }
    });
}

/// Any text is a DBC or refused.
///
/// Up to 200 bytes behind a valid message.
#[test]
fn any_dbc_is_read_or_refused() {
    for_any!(SOME, bytes(200), |end: Vec<u8>| {
        let end = String::from_utf8_lossy(&end);
        for text in [end.to_string(), format!("BU_: A\n\nBO_ 1 M: 8 A\n SG_ S : {end}\n")] {
            let _ = Database::parse(&text);
        }
    });
}

/// The bits of a signal are those that a count bit by bit finds.
///
/// All places, sizes and orders within 8 bytes, exhaustive, of any 8 bytes.
#[test]
fn bits_of_signals() {
    for_any!(5, |data: [u8; 8]| {
        for (start, size, big_endian) in
            (0..64).flat_map(|start| (1..=64).flat_map(move |size| [false, true].map(|big| (start, size, big))))
        {
            let layout = Layout {
                start,
                size,
                big_endian,
            };
            let bit = |at: u16| u64::from(data[usize::from(at / 8)] >> (at % 8) & 1);
            let mut expected = Some(0u64);
            let mut at = start;
            for n in 0..size {
                expected = expected.filter(|_| at < 64).map(|sum| match big_endian {
                    true => sum << 1 | bit(at),
                    false => sum | bit(at) << n,
                });
                at = match (big_endian, at % 8) {
                    (false, _) => at + 1,
                    (true, 0) => at + 15,
                    (true, _) => at - 1,
                };
            }
            assert_eq!(layout.raw(&data), expected, "{layout:?}");
        }
    });
}
