//! Any text as a DBC file, and any bytes as the data of its messages: refused in one line, or signals that stay inside
//! their bits.
#![no_main]

use hmd_core::dbc::{Database, SignalKind};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (&str, [u8; 64])| {
    let (text, data) = input;
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
                let Some(value) = signal.value(&data[..length]) else { continue };
                assert!(signal.layout.fits(length) && signal.is_in(&data[..length]));
                if let (SignalKind::Unsigned | SignalKind::Signed, Some(range)) = (signal.kind, signal.range()) {
                    assert!(!value.is_nan() && range >= 0.0);
                }
            }
        }
    }
});
