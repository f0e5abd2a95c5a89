//! Any text as a DBC file, and bytes as the data of its messages: refused in one line, or signals that stay inside
//! their bits.
#![no_main]

#[path = "../mutators/lines.rs"]
mod mutator;

use hmd_core::dbc::{Database, SignalKind};
use libfuzzer_sys::{fuzz_mutator, fuzz_target};

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutator::mutate(data, size, max_size, seed)
});

/// The data of a message: the bits of the file, anything.
fn data_of(text: &str) -> [u8; 64] {
    let mut data = [0; 64];
    for (n, byte) in text.bytes().rev().enumerate().take(4096) {
        data[n % 64] ^= byte.rotate_left((n / 64) as u32);
    }
    data
}

fuzz_target!(|text: &str| {
    let data = data_of(text);
    let database = match Database::parse(text) {
        Ok(database) => database,
        Err(error) => return assert!(!error.to_string().contains('\n'), "{error}"),
    };
    for message in &database.messages {
        assert!(database.message(&message.name).is_some());
        for signal in message.signals.values() {
            let Ok(signal) = &signal.signal else { continue };
            assert!(signal.layout.fits(message.length));
            for length in [0, message.length.min(64), 64] {
                let Some(value) = signal.value(&data[..length]) else {
                    continue;
                };
                assert!(signal.layout.fits(length) && signal.is_in(&data[..length]));
                if let (SignalKind::Unsigned | SignalKind::Signed, Some(range)) = (signal.kind, signal.range()) {
                    assert!(!value.is_nan() && range >= 0.0);
                }
            }
        }
    }
});
