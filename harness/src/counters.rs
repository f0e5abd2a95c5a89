//! Counters that wrap on the wire.

use crate::{MANY, for_any};
use ema_wire::quantity::wrap_s24;
use ema_wire::{unwrap_motor_counts, unwrap_output_counts, unwrap_seq, unwrap_time_us};

/// A sample counter is continued forwards, by less than 65 536, to the value congruent to the raw one.
///
/// All pairs of 16-bit counters; exhaustive.
#[test]
fn sample_counter() {
    for previous in 0..=u16::MAX {
        let mut wrong = 0;
        for raw in 0..=u16::MAX {
            let step = unwrap_seq(previous.into(), raw) - i64::from(previous);
            wrong |= (step as u64 > 0xffff) as u32;
            wrong |= u32::from(previous.wrapping_add(step as u16) != raw);
        }
        assert_eq!(wrong, 0, "{previous}");
    }
}

/// A device time is continued to the nearest value congruent to the raw one.
///
/// All pairs of 16-bit times; exhaustive.
#[test]
fn device_time() {
    for expected in 0..=u16::MAX {
        let mut wrong = 0;
        for raw in 0..=u16::MAX {
            let step = unwrap_time_us(expected.into(), raw) - i64::from(expected);
            wrong |= u32::from(step != i64::from(step as i16));
            wrong |= u32::from(expected.wrapping_add(step as u16) != raw);
        }
        assert_eq!(wrong, 0, "{expected}");
    }
}

/// The same from any value, however large.
///
/// Any 64-bit previous value within 2^62.
#[test]
fn continued_counters_are_congruent() {
    for_any!(MANY, |input: (i64, u16)| {
        let (previous, raw) = (input.0 >> 1, input.1);
        let (seq, time) = (unwrap_seq(previous, raw), unwrap_time_us(previous, raw));
        assert_eq!([seq as u16, time as u16], [raw; 2]);
        assert!((0..=0xffff).contains(&(seq - previous)), "{seq}");
        assert!((-0x8000..0x8000).contains(&(time - previous)), "{time}");
    });
}

/// Resolver counts are continued to the nearest value congruent to the raw one.
///
/// Any previous value within 2^62, any raw one.
#[test]
fn resolver_counts() {
    for_any!(MANY, |input: (i64, i32)| {
        let (previous, raw) = (input.0 >> 1, input.1);
        let counts = unwrap_motor_counts(previous, raw);
        assert_eq!(counts as i32, raw);
        assert!((-(1 << 31)..1 << 31).contains(&(counts - previous)), "{counts}");
    });
}

/// Encoder counts are continued to the nearest value congruent to the raw one in 24 bits.
///
/// Any previous value within 2^62, any raw one.
#[test]
fn encoder_counts() {
    for_any!(MANY, |input: (i64, i32)| {
        let (previous, raw) = (input.0 >> 1, input.1);
        let counts = unwrap_output_counts(previous, raw);
        assert_eq!(counts & 0xff_ffff, i64::from(raw) & 0xff_ffff);
        assert!((-(1 << 23)..1 << 23).contains(&(counts - previous)), "{counts}");
    });
}

/// 24 bits are extended by their sign.
///
/// All 24-bit values; exhaustive.
#[test]
fn sign_of_24_bits() {
    for bits in 0..1i64 << 24 {
        let signed = if bits < 1 << 23 { bits } else { bits - (1 << 24) };
        assert_eq!(i64::from(wrap_s24(bits)), signed);
    }
}
