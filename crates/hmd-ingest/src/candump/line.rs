//! One line of a candump log and one frame, in both directions.

use hmd_core::frame::{BusError, BusNames, FrameError, FrameFlags, MAX_DATA, RawFrame};
use hmd_storage::quoted;
use std::io;
use thiserror::Error;

/// Longest line that is looked at, bytes; a line of a 64-byte frame has about 190.
pub const MAX_LINE: usize = 400;

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum LineFault {
    /// One part of the line is not what it should be.
    #[error("expected {expected}, found \"{found}\"")]
    Part {
        /// The part.
        expected: Part,
        /// The text there, escaped and shortened.
        found: String,
    },
    /// The parts do not make a frame.
    #[error("expected a frame, found one that cannot exist: {0}")]
    Frame(#[from] FrameError),
    /// The interface name cannot be taken.
    #[error("expected an interface, found \"{found}\": {cause}")]
    Bus {
        /// The text there, escaped and shortened.
        found: String,
        /// Why it is refused.
        cause: BusError,
    },
    /// The line is longer than any frame's line.
    #[error("expected at most {MAX_LINE} bytes in a line, found {got}")]
    TooLong {
        /// Length of the line, bytes.
        got: u64,
    },
    /// The file ends within the line, so that data bytes may be missing.
    #[error("expected a line end, found the end of the file; the last frame may be cut and is not used")]
    Unfinished,
    /// The file cannot be read further.
    #[error("expected to read on, found an input error: {0}")]
    Io(io::ErrorKind),
}

/// The parts of a line, for error messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// `(seconds.fraction)`.
    Stamp,
    /// The interface name.
    Interface,
    /// 3 or 8 hexadecimal digits and `#`.
    Identifier,
    /// The digit of flags of an FD frame.
    FdFlags,
    /// Pairs of hexadecimal digits.
    Data,
    /// Length of a remote request.
    RemoteLength,
    /// ` R` or ` T`, or nothing.
    Direction,
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Stamp => "a stamp \"(seconds.fraction)\" with 6 or 9 decimals",
            Self::Interface => "an interface name",
            Self::Identifier => "an identifier of 3 or 8 hexadecimal digits before \"#\"",
            Self::FdFlags => "one digit of FD flags, 0 to 7, after \"##\"",
            Self::Data => "data bytes as pairs of hexadecimal digits",
            Self::RemoteLength => "a length of 0 to 8 after \"#R\"",
            Self::Direction => "\"R\", \"T\" or the end of the line",
        })
    }
}

/// The frame of one line (without its line end); its interface goes into `names`.
///
/// # Errors
/// [`LineFault`]; then `names` is unchanged.
pub fn parse(line: &[u8], names: &mut BusNames) -> Result<RawFrame, LineFault> {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let mut word = || words.next().unwrap_or_default();
    let bad = |expected, found: &[u8]| LineFault::Part {
        expected,
        found: quoted(found),
    };

    let stamp = word();
    let stamp_ns = parse_stamp(stamp).ok_or_else(|| bad(Part::Stamp, stamp))?;
    let interface = word();
    // A name that is not UTF-8 is refused by the table below, as one that has no printable characters.
    let name = std::str::from_utf8(interface).unwrap_or_default();
    if interface.is_empty() || interface.contains(&b'#') {
        return Err(bad(Part::Interface, interface));
    }
    let frame = word();
    let (digits, body) = split_at_hash(frame).ok_or_else(|| bad(Part::Identifier, frame))?;
    let can_id = parse_id(digits).ok_or_else(|| bad(Part::Identifier, digits))?;
    let direction = word();
    let sent = match direction {
        b"" | b"R" => false,
        b"T" => true,
        _ => return Err(bad(Part::Direction, direction)),
    };
    let end = word();
    if !end.is_empty() {
        return Err(bad(Part::Direction, end));
    }

    let mut data = [0; MAX_DATA];
    let (flags, len, can_id) = match body {
        [b'R' | b'r', length @ ..] => {
            let len = parse_remote_length(length).ok_or_else(|| bad(Part::RemoteLength, length))?;
            (FrameFlags::NONE, len, can_id | hmd_core::frame::socketcan::RTR)
        }
        [b'#', body @ ..] => {
            let (&digit, bytes) = body.split_first().ok_or_else(|| bad(Part::FdFlags, body))?;
            let bits = nibble(digit)
                .filter(|bits| *bits < 8)
                .ok_or_else(|| bad(Part::FdFlags, &[digit]))?;
            let flags = FrameFlags::FD
                .with(FrameFlags::BIT_RATE_SWITCH, bits & 1 != 0)
                .with(FrameFlags::ERROR_STATE, bits & 2 != 0);
            (
                flags,
                parse_data(bytes, &mut data).ok_or_else(|| bad(Part::Data, bytes))?,
                can_id,
            )
        }
        bytes => {
            let hex = without_raw_length(bytes);
            (
                FrameFlags::NONE,
                parse_data(hex, &mut data).ok_or_else(|| bad(Part::Data, bytes))?,
                can_id,
            )
        }
    };
    // Remote requests and FD frames are never error frames; `from_socketcan` would drop the remote flag silently.
    if can_id & hmd_core::frame::socketcan::ERR != 0 && can_id & hmd_core::frame::socketcan::RTR != 0 {
        return Err(LineFault::Frame(FrameError::Flags {
            flags: FrameFlags::ERROR.union(FrameFlags::REMOTE),
        }));
    }
    let flags = flags.with(FrameFlags::SENT, sent);
    let mut frame = RawFrame::from_socketcan(stamp_ns, 0, can_id, flags, &data[..len])?;
    frame.bus = names.intern(name).map_err(|cause| LineFault::Bus {
        found: quoted(interface),
        cause,
    })?;
    Ok(frame)
}

/// `(1436509052.249713)` in ns.
fn parse_stamp(word: &[u8]) -> Option<u64> {
    let inner = word.strip_prefix(b"(")?.strip_suffix(b")")?;
    let dot = inner.iter().position(|&byte| byte == b'.')?;
    let unit = match inner.len() - dot - 1 {
        6 => 1_000,
        9 => 1,
        _ => return None,
    };
    let seconds = parse_decimal(&inner[..dot])?;
    let fraction = parse_decimal(&inner[dot + 1..])? * unit;
    seconds.checked_mul(1_000_000_000)?.checked_add(fraction)
}

fn parse_decimal(digits: &[u8]) -> Option<u64> {
    if digits.is_empty() || digits.len() > 18 {
        return None;
    }
    digits.iter().try_fold(0, |sum, byte| {
        byte.is_ascii_digit().then(|| sum * 10 + u64::from(byte - b'0'))
    })
}

fn split_at_hash(word: &[u8]) -> Option<(&[u8], &[u8])> {
    let at = word.iter().position(|&byte| byte == b'#')?;
    Some((&word[..at], &word[at + 1..]))
}

/// The identifier with SocketCAN's flags: 8 digits are 29 bits, unless the error flag is set.
fn parse_id(digits: &[u8]) -> Option<u32> {
    let id = digits
        .iter()
        .try_fold(0_u32, |sum, &byte| Some(sum << 4 | u32::from(nibble(byte)?)));
    match (digits.len(), id?) {
        (3, id) if id <= hmd_core::frame::MAX_STANDARD_ID => Some(id),
        (8, id) if id >> 29 == 1 => Some(id),
        (8, id) if id >> 29 == 0 => Some(id | hmd_core::frame::socketcan::EFF),
        _ => None,
    }
}

/// `8` or `8_C`: the length, and a raw length code that is dropped.
fn parse_remote_length(text: &[u8]) -> Option<usize> {
    match text {
        [] => Some(0),
        [b'8', b'_', raw] => nibble(*raw).filter(|raw| *raw > 8).map(|_| 8),
        [digit @ b'0'..=b'8'] => Some(usize::from(digit - b'0')),
        _ => None,
    }
}

/// Eight data bytes may carry a raw length code of 9 to 15 behind them, which says nothing about the data.
fn without_raw_length(bytes: &[u8]) -> &[u8] {
    match bytes {
        [hex @ .., b'_', raw] if hex.len() >= 16 && nibble(*raw).is_some_and(|raw| raw > 8) => hex,
        _ => bytes,
    }
}

/// Number of bytes read; a dot may separate them.
fn parse_data(mut text: &[u8], data: &mut [u8; MAX_DATA]) -> Option<usize> {
    let mut len = 0;
    while let [high, low, rest @ ..] = text {
        *data.get_mut(len)? = nibble(*high)? << 4 | nibble(*low)?;
        len += 1;
        text = match rest {
            [b'.', more @ ..] if !more.is_empty() => more,
            _ => rest,
        };
    }
    text.is_empty().then_some(len)
}

fn nibble(digit: u8) -> Option<u8> {
    match digit {
        b'0'..=b'9' => Some(digit - b'0'),
        b'a'..=b'f' => Some(digit - b'a' + 10),
        b'A'..=b'F' => Some(digit - b'A' + 10),
        _ => None,
    }
}

/// Decimals of a stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Decimals {
    /// Microseconds, as `candump -l` writes and every `canplayer` reads; the rest of a stamp is cut off.
    #[default]
    Six,
    /// Nanoseconds; an older `canplayer` takes them for microseconds and waits wrongly.
    Nine,
}

/// Appends the line of `frame` on `interface`, with its line end.
///
/// `parse` gives the same frame back, provided that the stamp has no more decimals than `decimals`. A frame of a serial
/// line has no form here: nothing is appended.
pub fn emit(frame: &RawFrame, interface: &str, decimals: Decimals, line: &mut Vec<u8>) {
    if frame.is_serial() {
        return;
    }
    let (seconds, ns) = (frame.stamp_ns / 1_000_000_000, frame.stamp_ns % 1_000_000_000);
    line.push(b'(');
    push_decimal(line, seconds, 10);
    line.push(b'.');
    match decimals {
        Decimals::Six => push_decimal(line, ns / 1000, 6),
        Decimals::Nine => push_decimal(line, ns, 9),
    }
    line.extend_from_slice(b") ");
    line.extend_from_slice(interface.as_bytes());
    line.push(b' ');
    let digits = if frame.is_extended() || frame.is_error() { 8 } else { 3 };
    let id = frame.id()
        | if frame.is_error() {
            hmd_core::frame::socketcan::ERR
        } else {
            0
        };
    for at in (0..digits).rev() {
        line.push(HEX[(id >> (4 * at) & 0xF) as usize]);
    }
    line.push(b'#');
    if frame.is_remote() {
        line.push(b'R');
        if frame.announced_len() > 0 {
            line.push(HEX[frame.announced_len()]);
        }
    }
    if frame.is_fd() {
        let bit = |flag, bit| if frame.flags().contains(flag) { bit } else { 0 };
        let bits = bit(FrameFlags::BIT_RATE_SWITCH, 1) | bit(FrameFlags::ERROR_STATE, 2);
        line.extend_from_slice(&[b'#', HEX[bits]]);
    }
    for byte in frame.data() {
        line.extend_from_slice(&[HEX[usize::from(byte >> 4)], HEX[usize::from(byte & 0xF)]]);
    }
    if frame.flags().contains(FrameFlags::SENT) {
        line.extend_from_slice(b" T");
    }
    line.push(b'\n');
}

/// `value` with leading zeros up to `width` digits.
fn push_decimal(line: &mut Vec<u8>, value: u64, width: u32) {
    let start = line.len();
    let mut rest = value;
    while rest > 0 || line.len() - start < width as usize {
        line.push(b'0' + (rest % 10) as u8);
        rest /= 10;
    }
    line[start..].reverse();
}

const HEX: &[u8; 16] = b"0123456789ABCDEF";
