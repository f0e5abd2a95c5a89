//! Counters that wrap on the wire, continued as `i64`.
//!
//! Each function takes the previous continued value and the new raw value, and returns the new continued value. Each states
//! the largest change for which the result is unique. After a longer silence the caller starts from a new origin.

use crate::quantity::wrap_s24;

/// Continues the s32 motor counts: the value congruent to `raw` that is nearest to `previous` (within ±2^31 counts, which
/// is 32 768 turns).
///
/// ```
/// use ema_wire::unwrap_motor_counts;
/// let before = i64::from(i32::MAX) - 1;
/// assert_eq!(unwrap_motor_counts(before, i32::MIN), before + 2);
/// assert_eq!(unwrap_motor_counts(before + 2, i32::MAX), before + 1);
/// ```
#[inline]
#[must_use]
pub const fn unwrap_motor_counts(previous: i64, raw: i32) -> i64 {
    previous.wrapping_add(raw.wrapping_sub(previous as i32) as i64)
}

/// Continues the s24 output counts: nearest to `previous`, within ±2^23 counts (419 turns). Bits of `raw` above the 24th
/// are ignored.
///
/// ```
/// use ema_wire::unwrap_output_counts;
/// assert_eq!(unwrap_output_counts((1 << 23) - 1, -(1 << 23)), 1 << 23);
/// ```
#[inline]
#[must_use]
pub const fn unwrap_output_counts(previous: i64, raw: i32) -> i64 {
    previous.wrapping_add(wrap_s24((raw as i64).wrapping_sub(previous)) as i64)
}

/// Continues the u16 sample counter: the first value at or after `previous` that is congruent to `raw`.
///
/// The counter never goes back. At most 65 535 samples (33 s at 2 kHz) may lie between the two values.
///
/// ```
/// use ema_wire::unwrap_seq;
/// assert_eq!(unwrap_seq(65_535, 0), 65_536);
/// assert_eq!(unwrap_seq(65_536, 0), 65_536);
/// assert_eq!(unwrap_seq(65_536, 65_535), 131_071); // 65 535 forward, not one back
/// ```
#[inline]
#[must_use]
pub const fn unwrap_seq(previous: i64, raw: u16) -> i64 {
    previous.wrapping_add(raw.wrapping_sub(previous as u16) as i64)
}

/// Continues the u16 device time: the value congruent to `raw` that is nearest to `expected_us`.
///
/// The raw field wraps every 65.536 ms, so the number of wraps in a gap follows from the sample counter:
/// `expected_us = previous_us + change of seq × nominal period`. The result is right if `expected_us` is wrong by less
/// than 32.768 ms.
///
/// ```
/// use ema_wire::unwrap_time_us;
/// // 2 kHz, 400 samples lost: 200 ms later, three wraps; the device clock is 20 µs fast.
/// assert_eq!(unwrap_time_us(1_000 + 200_000, (1_000_u32 + 200_020) as u16), 201_020);
/// ```
#[inline]
#[must_use]
pub const fn unwrap_time_us(expected_us: i64, raw: u16) -> i64 {
    expected_us.wrapping_add(raw.wrapping_sub(expected_us as u16) as i16 as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_continue_across_every_wrap_in_both_directions() {
        for centre in [
            0_i64,
            1 << 23,
            1 << 24,
            1 << 31,
            1 << 32,
            -(1 << 23),
            -(1 << 31),
            1 << 40,
        ] {
            for (from, to) in [(-5, 7), (7, -5), (0, 0), (-1, 0)] {
                let (from, to) = (centre + from, centre + to);
                assert_eq!(unwrap_motor_counts(from, to as i32), to);
                assert_eq!(unwrap_output_counts(from, wrap_s24(to)), to);
                assert_eq!(unwrap_time_us(from, to as u16), to);
                if to >= from {
                    assert_eq!(unwrap_seq(from, to as u16), to);
                }
            }
        }
    }
}
