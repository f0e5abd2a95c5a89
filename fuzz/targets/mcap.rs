//! Any bytes as an MCAP file: frames, and what recovery makes of it, which must be whole.
#![no_main]

#[path = "../mutators/mcap.rs"]
mod mutator;

use std::io::Cursor;

use hmd_core::frame::BusNames;
use hmd_storage::mcap::{McapFrames, McapMessages};
use hmd_storage::recover::recover;
use libfuzzer_sys::{fuzz_mutator, fuzz_target};

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutator::mutate(data, size, max_size, seed)
});

fuzz_target!(|bytes: &[u8]| {
    if let Ok(frames) = McapFrames::new(Cursor::new(bytes), "a.mcap", BusNames::new()) {
        frames.for_each(drop);
    }
    let Ok((out, report)) = recover(Cursor::new(bytes), "a.mcap", Cursor::new(Vec::new()), "") else {
        return;
    };
    let out = Cursor::new(out.into_inner());
    let copy = McapMessages::new(out, "copy").expect("memory can be read");
    let messages = copy.map(|item| item.expect("a recovered file is whole")).count();
    assert_eq!(messages as u64, report.messages);
});
