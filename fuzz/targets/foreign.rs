//! Any bytes as an ASC, BLF or MF4 log: frames and losses, by the beginning of the bytes as `hmd` chooses the reader.
#![no_main]

use std::io::Cursor;

use hmd_core::frame::BusNames;
use hmd_ingest::asc::AscReader;
use hmd_ingest::blf::{self, BlfReader};
use hmd_ingest::mdf::{self, MdfReader};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let names = BusNames::new();
    if bytes.starts_with(blf::MAGIC) {
        BlfReader::new(bytes, "a.blf", names).count();
    } else if mdf::MAGICS.iter().any(|magic| bytes.starts_with(magic)) {
        let _ = MdfReader::new(Cursor::new(bytes), "a.mf4", names).map_or(0, Iterator::count);
    } else {
        AscReader::new(bytes, "a.asc", names).count();
    }
});
