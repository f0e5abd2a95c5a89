//! Frames for property tests, of this crate and, by its path, of those that use it.

use hmd_core::frame::{FrameFlags, MAX_EXTENDED_ID, MAX_STANDARD_ID, RawFrame};

/// Any valid CAN frame on bus 0 with a stamp of whole microseconds, for property tests.
pub(crate) fn any_frame() -> impl proptest::strategy::Strategy<Value = RawFrame> {
    use proptest::prelude::*;
    const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
    let lengths = (0..=8usize, proptest::sample::select(&FD_LENGTHS[..]));
    let bits = (any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>());
    (
        0..u64::MAX / 1000,
        0..4u8,
        any::<u32>(),
        lengths,
        bits,
        any::<[u8; 64]>(),
    )
        .prop_map(
            |(stamp_us, kind, id, (short, long), (extended, brs, esi, sent), data)| {
                let extended = extended && kind != 2;
                let flags = match kind {
                    0 => FrameFlags::NONE,
                    1 => FrameFlags::REMOTE,
                    2 => FrameFlags::ERROR,
                    _ => FrameFlags::FD
                        .with(FrameFlags::BIT_RATE_SWITCH, brs)
                        .with(FrameFlags::ERROR_STATE, esi),
                };
                let flags = flags.with(FrameFlags::EXTENDED, extended).with(FrameFlags::SENT, sent);
                let id = id
                    & if extended || kind == 2 {
                        MAX_EXTENDED_ID
                    } else {
                        MAX_STANDARD_ID
                    };
                let len = if kind == 3 { long } else { short };
                RawFrame::new(stamp_us * 1000, 0, id, flags, &data[..len]).expect("the strategy builds valid frames")
            },
        )
}
