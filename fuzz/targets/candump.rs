//! Any bytes as a candump log: what is read is written and read again as the same frame.
#![no_main]

use hmd_core::frame::BusNames;
use hmd_ingest::candump::{CandumpReader, Decimals, emit};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut reader = CandumpReader::new(bytes, "a.log", BusNames::new());
    let mut again = Vec::new();
    let mut frames = Vec::new();
    while let Some(item) = reader.next() {
        if let Ok(frame) = item {
            let name = reader
                .bus_names()
                .name(frame.bus)
                .expect("a frame's interface is known");
            emit(&frame, name, Decimals::Nine, &mut again);
            frames.push(frame);
        }
    }
    let second = CandumpReader::new(again.as_slice(), "b.log", BusNames::new());
    let second: Vec<_> = second.map(|item| item.expect("what was written can be read")).collect();
    assert_eq!(second, frames);
});
