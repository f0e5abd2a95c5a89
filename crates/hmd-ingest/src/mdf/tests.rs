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
fn a_cut_file_is_read_up_to_the_cut() {
    let whole = fixture("frames.mf4");
    for cut in (0..whole.len()).step_by(97) {
        let (frames, losses) = read(&whole[..cut]);
        assert!(!losses.is_empty() || !frames.is_empty(), "{cut}");
    }
}
