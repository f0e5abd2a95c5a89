use std::io::Cursor;

use super::*;
use crate::candump::{Decimals, emit};

/// A file of asammdf or python-can, and the same frames as text (`fixtures/foreign/make.py`).
fn fixture(name: &str) -> Vec<u8> {
    let path = format!("{}/../../fixtures/foreign/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read(&path).expect(&path)
}

fn read(bytes: &[u8]) -> (String, Vec<String>) {
    let mut reader = match MdfReader::new(Cursor::new(bytes), "a.mf4", BusNames::new()) {
        Ok(reader) => reader,
        Err(damage) => return (String::new(), vec![damage.to_string()]),
    };
    let (mut out, mut losses) = (Vec::new(), Vec::new());
    while let Some(item) = reader.next() {
        match item {
            Ok(frame) => emit(
                &frame,
                reader.bus_names().name(frame.bus).unwrap(),
                Decimals::Six,
                &mut out,
            ),
            Err(damage) => losses.push(damage.to_string()),
        }
    }
    (String::from_utf8(out).unwrap(), losses)
}

#[test]
fn every_arrangement_of_records_is_read() {
    let expected = String::from_utf8(fixture("frames.log")).unwrap();
    for name in ["frames.mf4", "deflated.mf4", "transposed.mf4", "unfinalised.mf4"] {
        let (frames, losses) = read(&fixture(name));
        assert_eq!(losses, [""; 0], "{name}");
        assert_eq!(frames, expected, "{name}");
    }
}

#[test]
fn only_the_last_block_of_an_unfinalised_file_is_open() {
    // Its records lie in three data groups; the structure lies behind them, so that every length is known.
    let mut bytes = fixture("frames.mf4");
    bytes[..8].copy_from_slice(super::MAGICS[1]);
    bytes[60] |= 4;
    let (frames, losses) = read(&bytes);
    assert_eq!(losses, [""; 0]);
    assert_eq!(frames, String::from_utf8(fixture("frames.log")).unwrap());
    // Those of the third group at the end, in a block whose length was not written.
    let (from, to, group) = (0x2d0 + 24, 0x2d0 + 41, 0x470 + 24 + 16);
    let at = bytes.len() as u64;
    bytes.extend(b"##DT\0\0\0\0");
    bytes.extend([24_u64, 0].map(u64::to_le_bytes).concat());
    bytes.extend(fixture("frames.mf4").get(from..to).unwrap());
    bytes[group..group + 8].copy_from_slice(&at.to_le_bytes());
    let (again, losses) = read(&bytes);
    assert_eq!((again, losses), (frames, Vec::new()));
}

#[test]
fn the_records_before_a_cut_are_read() {
    let whole = fixture("frames.mf4");
    let (frames, _) = read(&whole);
    // The records of the first data group, copied to the end of the file, which is cut within the last of them.
    let (from, to, group) = (0xf8, 0xf8 + 360, 0x3f0 + 24 + 16);
    let mut bytes = whole.clone();
    let at = bytes.len() as u64;
    bytes.extend_from_slice(&whole[from..to - 5]);
    bytes[group..group + 8].copy_from_slice(&at.to_le_bytes());
    let (found, losses) = read(&bytes);
    let missing = frames.lines().filter(|line| !found.contains(line)).count();
    assert_eq!((missing, losses.len()), (1, 1), "{losses:?}");
    assert!(losses[0].contains("it was cut"), "{losses:?}");
}

#[test]
fn a_cut_file_is_read_up_to_the_cut() {
    let whole = fixture("frames.mf4");
    for cut in (0..whole.len()).step_by(97) {
        let (frames, losses) = read(&whole[..cut]);
        assert!(!losses.is_empty() || !frames.is_empty(), "{cut}");
    }
}
