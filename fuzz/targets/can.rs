//! Any frames on any bus: decoding, assembly, windows. The books must add up.
#![no_main]

use std::sync::Arc;

use hmd_core::assess::WindowCounts;
use hmd_core::config::Config;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::pipeline::Pipeline;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut names = BusNames::new();
    for name in ["can0", "can1"] {
        names.intern(name).expect("two names fit");
    }
    let mut pipeline = Pipeline::new(Arc::new(Config::default()));
    let (mut rest, mut stamp_ns, mut frames) = (bytes, 0u64, 0);
    // Identifier, kind and bus, length, step of the stamp, data.
    while let Some((&[id, kind, length, step], after)) = rest.split_first_chunk() {
        let (data, after) = after.split_at(after.len().min(usize::from(length % 65)));
        rest = after;
        let flags = [
            FrameFlags::NONE,
            FrameFlags::FD,
            FrameFlags::ERROR,
            FrameFlags::EXTENDED,
        ][usize::from(kind % 4)];
        stamp_ns = stamp_ns.wrapping_add(u64::from(step) << (kind >> 3));
        let id = 0x100 + u32::from(id);
        if let Ok(frame) = RawFrame::new(stamp_ns, u16::from(kind >> 2 & 1), id, flags, data) {
            pipeline.push(&frame, &names);
            frames += 1;
        }
    }
    pipeline.finish();
    let status = pipeline.status(&names, WindowCounts::default());
    let known = status.frames_decoded + status.frames_filtered + status.frames_error + status.lost_malformed;
    assert_eq!((status.frames_received, known), (frames, frames));
});
