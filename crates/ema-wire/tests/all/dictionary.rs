//! `fixtures/ema.dbc` equals the generator's output and describes the bytes that the crate emits.

#[path = "../../examples/dbc/mod.rs"]
mod dbc;
#[path = "../../examples/signals/mod.rs"]
mod signals;

use std::collections::BTreeMap;

use ema_wire::can::FD_LEN;
use ema_wire::{Frame, SampleFd};
use proptest::prelude::*;

use crate::common;

#[test]
fn the_shipped_file_is_the_generated_one() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/ema.dbc");
    let shipped = std::fs::read_to_string(path).expect("fixtures/ema.dbc");
    assert!(
        shipped == dbc::dbc(),
        "regenerate: cargo run -p ema-wire --example make_dbc > fixtures/ema.dbc"
    );
}

/// Reads one signal as the DBC describes it.
fn physical(signal: &dbc::Signal, data: &[u8]) -> f64 {
    let bit = |at: usize| i64::from(data[at / 8] >> (at % 8) & 1);
    let raw: i64 = (0..signal.bits as usize).map(|k| bit(signal.start_bit + k) << k).sum();
    let sign = if signal.signed {
        bit(signal.start_bit + signal.bits as usize - 1) << signal.bits
    } else {
        0
    };
    (raw - sign) as f64 / 10_f64.powi(signal.decimals.cast_signed())
}

fn matches_dbc(frame: &Frame) -> Result<(), TestCaseError> {
    let mut buffer = [0; FD_LEN];
    let data = frame.emit(&mut buffer);
    let mut ours: BTreeMap<_, _> = signals::signals(frame).into_iter().collect();
    let described = dbc::signals(frame.message());
    let end = described
        .iter()
        .map(|signal| signal.start_bit + signal.bits as usize)
        .max();
    prop_assert_eq!(end, Some(8 * data.len()));
    for signal in described {
        let value = physical(&signal, data);
        match ours.remove(&signal.name) {
            Some(Some(mine)) => prop_assert!((mine - value).abs() < 1e-9, "{}: {mine} {value}", signal.name),
            Some(None) => prop_assert!((value + 3276.8).abs() < 1e-9, "{}: {value}", signal.name),
            None => prop_assert!(
                matches!(frame, Frame::SampleFd(_)) && value.abs() < 1e-9,
                "{}",
                signal.name
            ),
        }
    }
    prop_assert!(ours.is_empty(), "not in the DBC: {:?}", ours);
    Ok(())
}

proptest! {
    #[test]
    fn every_signal_has_the_value_that_the_dbc_describes(
        samples in common::run(), status in common::status(),
    ) {
        for frame in samples[0].to_frames() {
            matches_dbc(&frame)?;
        }
        matches_dbc(&Frame::Status(status))?;
        matches_dbc(&Frame::SampleFd(SampleFd::from_samples(&samples)?))?;
    }
}
