//! Reads frames as `ID#DATA` lines on stdin, decodes each by a DBC file, and prints one JSON line for each with what every
//! signal says: `{"message":"M3","signals":{"S1":[-12,4.5]}}`, the raw bits as a number with their sign, and the physical
//! value. `fixtures/random_dbc.py` compares the lines with what `cantools` reads.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Write};

use hmd_core::dbc::{Database, Signal, SignalKind};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: decode_dbc FILE.dbc < FRAMES")?;
    let database = Database::parse(&std::fs::read_to_string(path)?)?;
    let mut out = io::BufWriter::new(io::stdout().lock());
    for line in io::stdin().lock().lines() {
        let line = line?;
        let (id, data) = line.split_once('#').ok_or("expected ID#DATA")?;
        let extended = id.len() == 8;
        let id = u32::from_str_radix(id, 16)?;
        let data = (0..data.len() / 2)
            .map(|n| u8::from_str_radix(&data[2 * n..2 * n + 2], 16))
            .collect::<Result<Vec<u8>, _>>()?;
        let mut messages = database.messages.iter();
        let message = messages
            .find(|of| (of.id, of.extended) == (id, extended))
            .ok_or("expected a known identifier")?;
        let mut signals = BTreeMap::new();
        for (name, found) in &message.signals {
            let signal = found.signal.as_ref().map_err(ToString::to_string)?;
            if let (Some(raw), Some(value)) = (signal.layout.raw(&data), signal.value(&data)) {
                signals.insert(name, (shown(signal, raw), value));
            }
        }
        writeln!(
            out,
            "{}",
            serde_json::json!({ "message": message.name, "signals": signals })
        )?;
    }
    Ok(out.flush()?)
}

/// Bits as a number; those of a float as they are.
fn shown(signal: &Signal, raw: u64) -> serde_json::Value {
    match signal.kind {
        SignalKind::Signed => signal.signed(raw).into(),
        SignalKind::Unsigned | SignalKind::F32 | SignalKind::F64 => raw.into(),
    }
}
