//! What the logs of other programs have in common: channels instead of interfaces, length codes, error frames without a class.

use hmd_core::frame::{BusError, BusNames, FrameError, FrameFlags, RawFrame};

/// What an error frame becomes, for messages.
pub(crate) const BUS_ERROR: &str = "an error frame";

/// What a text that begins so is called, if it has frames in a format that is not read: it may look like a table.
pub(crate) fn unread_format(start: &[u8]) -> Option<&'static str> {
    const PEAK: [&[u8]; 2] = [b";$FILEVERSION", b";##"];
    const PYTHON_CAN: &[u8] = b"timestamp,arbitration_id,";
    if PEAK.iter().any(|first| start.starts_with(first)) {
        return Some("a trace of PEAK (.trc)");
    }
    start
        .starts_with(PYTHON_CAN)
        .then_some("a table of frames by python-can")
}

/// Class of an error frame whose log names none: an error on the bus (`CAN_ERR_BUSERROR` of Linux).
const BUS_ERROR_CLASS: u32 = 0x80;

/// An error frame of unknown class, as a controller of Linux reports it.
pub(crate) fn bus_error(stamp_ns: u64, bus: u16) -> Result<RawFrame, FrameError> {
    RawFrame::new(stamp_ns, bus, BUS_ERROR_CLASS, FrameFlags::ERROR, &[0; 8])
}

/// The interface `can<n>` of a channel counted from 0.
pub(crate) fn intern_channel(names: &mut BusNames, channel: Option<u32>) -> Result<u16, String> {
    let Some(channel) = channel else {
        return Err("0, where they count from 1".to_owned());
    };
    let refused = |cause: BusError| format!("can{channel}: {cause}");
    names.intern(&format!("can{channel}")).map_err(refused)
}

/// Data bytes of a length code.
pub(crate) fn fd_length(code: u32) -> Option<usize> {
    const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
    LENGTHS.get(usize::try_from(code).ok()?).copied()
}

/// Stamps on whole microseconds, which is what a log of `candump -L` has and what a bit takes at 1 Mbit/s. Python's tools keep seconds
/// since 1970 in a float, whose steps are 0.24 µs: without this, the same frames would have other stamps in each format.
pub(crate) fn whole_us(ns: u64) -> u64 {
    ns.saturating_add(500) / 1000 * 1000
}
