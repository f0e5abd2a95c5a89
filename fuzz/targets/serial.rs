//! Any bytes on a serial line: the packets do not depend on how the bytes were cut.
#![no_main]

use ema_wire::serial::Deframer;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut whole: Deframer = Deframer::new();
    let mut single: Deframer = Deframer::new();
    let at_once: Vec<_> = whole.push_slice(bytes).collect();
    let one_by_one: Vec<_> = bytes.iter().filter_map(|&byte| single.push(byte)).collect();
    assert_eq!(at_once, one_by_one);
    whole.finish();
});
