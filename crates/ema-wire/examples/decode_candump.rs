//! Decodes a candump log: reads it on stdin and prints one JSON line per frame of an actuator.
//!
//! A line has the signal names and physical units of the DBC file,
//! `{"id":256,"message":"EMA0_Currents","signals":{"i_a":0.3,…}}`, or `"error":"…"` instead of the signals.
//! `fixtures/check_dbc.py` compares the lines with what `cantools` decodes from the same log.

mod signals;

use std::io::{self, BufRead, Write};

use ema_wire::{Frame, Message};

fn main() -> io::Result<()> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    for line in io::stdin().lock().lines() {
        let line = line?;
        let Some((id, data)) = candump_frame(&line) else {
            continue;
        };
        let Some((actuator, message)) = Message::from_id(id) else {
            continue;
        };
        write!(
            out,
            "{{\"id\":{id},\"message\":\"EMA{}_{}\",",
            actuator.index(),
            message.name()
        )?;
        match Frame::parse(id, &data) {
            Ok(Some((_, frame))) => {
                let fields: Vec<String> = signals::signals(&frame)
                    .into_iter()
                    .map(|(name, value)| {
                        format!("\"{name}\":{}", value.map_or("null".into(), |value| value.to_string()))
                    })
                    .collect();
                writeln!(out, "\"signals\":{{{}}}}}", fields.join(","))?;
            }
            Ok(None) => unreachable!("the identifier is in the dictionary"),
            Err(error) => writeln!(out, "\"error\":\"{error}\"}}")?,
        }
    }
    out.flush()
}

/// Identifier and data of a data frame with an 11-bit identifier: `(stamp) bus 100#0011… [R|T]`, FD `100##f0011…`.
fn candump_frame(line: &str) -> Option<(u16, Vec<u8>)> {
    let (id, rest) = line.split_whitespace().nth(2)?.split_once('#')?;
    let hex = match rest.strip_prefix('#') {
        Some(fd) => fd.get(1..)?,
        None if rest.starts_with('R') => return None,
        None => rest,
    };
    if id.len() != 3 || !hex.is_ascii() {
        return None;
    }
    let bytes = hex
        .as_bytes()
        .chunks_exact(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok());
    Some((u16::from_str_radix(id, 16).ok()?, bytes.collect::<Option<_>>()?))
}
