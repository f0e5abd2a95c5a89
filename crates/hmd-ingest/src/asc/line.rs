//! One line of an ASC log that begins with a stamp.

use std::fmt::Display;

use hmd_core::frame::{BusNames, FrameFlags, MAX_CLASSIC_DATA, MAX_DATA, RawFrame};
use hmd_storage::quoted;

use super::State;
use crate::foreign::{BUS_ERROR, bus_error, fd_length, intern_channel};

/// What is wrong with a line.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) expected: &'static str,
    pub(super) found: String,
}

impl Fault {
    pub(super) fn new(expected: &'static str, found: impl Display) -> Self {
        Self {
            expected,
            found: found.to_string(),
        }
    }

    fn at(expected: &'static str, word: &[u8]) -> Self {
        Self::new(expected, format_args!("\"{}\"", quoted(word)))
    }
}

/// The frame of a line; `None` for another event.
pub(super) fn parse(line: &[u8], state: &mut State, names: &mut BusNames) -> Result<Option<RawFrame>, Fault> {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let mut word = || words.next().unwrap_or_default();
    let stamp = word();
    let from_start = stamp_ns(stamp).ok_or_else(|| Fault::at("a stamp in seconds", stamp))?;
    let before_ns = if state.relative { state.last_ns } else { 0 };
    let from_start = before_ns.saturating_add(from_start);
    state.last_ns = from_start;
    let stamp_ns = state
        .start_ns
        .checked_add(from_start)
        .ok_or_else(|| Fault::at("a stamp before the year 2554", stamp))?;

    let kind = word();
    let is_fd = kind.eq_ignore_ascii_case(b"CANFD");
    let channel = if is_fd { word() } else { kind };
    let Some(channel) = number(channel, 10) else {
        return Ok(None);
    };
    let (id, direction) = if is_fd {
        let direction = word();
        (word(), direction)
    } else {
        (word(), b"".as_slice())
    };
    if id.eq_ignore_ascii_case(b"ErrorFrame") {
        let bus = intern_channel(names, channel.checked_sub(1)).map_err(|found| Fault::new("a channel", found))?;
        return bus_error(stamp_ns, bus)
            .map(Some)
            .map_err(|found| Fault::new(BUS_ERROR, found));
    }
    let direction = if is_fd { direction } else { word() };
    let sent = match direction {
        [b'R' | b'r', b'x' | b'X'] => false,
        [b'T' | b't', b'x' | b'X'] => true,
        _ => return Ok(None),
    };
    let (digits, extended) = match id {
        [digits @ .., b'x' | b'X'] => (digits, true),
        digits => (digits, false),
    };
    let can_id = number(digits, state.radix).ok_or_else(|| Fault::at("an identifier", id))?;
    let flags = FrameFlags::NONE
        .with(FrameFlags::EXTENDED, extended)
        .with(FrameFlags::SENT, sent);
    let mut data = [0; MAX_DATA];
    let body: Vec<&[u8]> = words.take(MAX_DATA + 16).collect();
    let (flags, length) = if is_fd {
        fd_body(&body, flags, state.radix, &mut data)?
    } else {
        classic_body(&body, flags, state.radix, &mut data)?
    };
    let mut frame = RawFrame::new(stamp_ns, 0, can_id, flags, &data[..length])
        .map_err(|found| Fault::new("a frame that can be", found))?;
    frame.bus = intern_channel(names, channel.checked_sub(1)).map_err(|found| Fault::new("a channel", found))?;
    Ok(Some(frame))
}

/// `d 8 …`, or `r` and perhaps a length.
fn classic_body(
    body: &[&[u8]],
    flags: FrameFlags,
    radix: u32,
    data: &mut [u8; MAX_DATA],
) -> Result<(FrameFlags, usize), Fault> {
    let length = |word: &[u8]| {
        let length = number(word, radix).filter(|length| *length < 16);
        length.map(|length| (length as usize).min(MAX_CLASSIC_DATA))
    };
    match body {
        [[b'r' | b'R'], rest @ ..] => {
            let length = rest.first().and_then(|word| length(word)).unwrap_or(0);
            Ok((flags.union(FrameFlags::REMOTE), length))
        }
        [_, word, bytes @ ..] => {
            let length = length(word).ok_or_else(|| Fault::at("a length", word))?;
            fill(bytes, length, radix, data)?;
            Ok((flags, length))
        }
        _ => Err(Fault::new("a length and data", "none")),
    }
}

/// `[NAME] brs esi dlc length data… duration bits flags …`.
fn fd_body(
    body: &[&[u8]],
    flags: FrameFlags,
    radix: u32,
    data: &mut [u8; MAX_DATA],
) -> Result<(FrameFlags, usize), Fault> {
    let rest = match body {
        [[b'0' | b'1'], ..] => body,
        [_, rest @ ..] => rest,
        [] => body,
    };
    let [brs, esi, dlc, length, rest @ ..] = rest else {
        return Err(Fault::new("flags, length and data", "none"));
    };
    let code = number(dlc, radix).ok_or_else(|| Fault::at("a length code", dlc))?;
    let length = number(length, 10)
        .map(|length| length as usize)
        .filter(|length| *length <= MAX_DATA)
        .ok_or_else(|| Fault::at("a length", length))?;
    if length == 0 && code > 0 {
        let length = fd_length(code).unwrap_or(0).min(MAX_CLASSIC_DATA);
        return Ok((flags.union(FrameFlags::REMOTE), length));
    }
    fill(rest, length, radix, data)?;
    // Classic frames of an FD channel stand in such lines, too: the third word behind the data tells.
    const EDL: u32 = 1 << 12;
    let is_classic = rest
        .get(length + 2)
        .and_then(|word| number(word, 16))
        .is_some_and(|bits| bits & EDL == 0);
    if is_classic && length <= MAX_CLASSIC_DATA {
        return Ok((flags, length));
    }
    let flags = flags
        .union(FrameFlags::FD)
        .with(FrameFlags::BIT_RATE_SWITCH, *brs == b"1")
        .with(FrameFlags::ERROR_STATE, *esi == b"1");
    Ok((flags, length))
}

fn fill(words: &[&[u8]], length: usize, radix: u32, data: &mut [u8; MAX_DATA]) -> Result<(), Fault> {
    for at in 0..length {
        let word = words.get(at).copied().unwrap_or_default();
        data[at] = number(word, radix)
            .and_then(|value| u8::try_from(value).ok())
            .ok_or_else(|| Fault::at("a data byte", word))?;
    }
    Ok(())
}

/// `12.000120` in ns; further digits are cut off.
fn stamp_ns(word: &[u8]) -> Option<u64> {
    let text = std::str::from_utf8(word).ok()?;
    let (seconds, fraction) = text.split_once('.')?;
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if !is_digits(seconds) || !is_digits(fraction) {
        return None;
    }
    let digits = &fraction[..fraction.len().min(9)];
    let ns = digits.parse::<u64>().ok()? * 10_u64.pow(9 - digits.len() as u32);
    seconds.parse::<u64>().ok()?.checked_mul(1_000_000_000)?.checked_add(ns)
}

fn number(word: &[u8], radix: u32) -> Option<u32> {
    let text = std::str::from_utf8(word)
        .ok()
        .filter(|text| !text.starts_with(['+', '-']))?;
    u32::from_str_radix(text, radix).ok()
}
