//! One object of a BLF log.

use hmd_core::frame::{BusNames, FrameFlags, MAX_CLASSIC_DATA, MAX_DATA, RawFrame};

use crate::foreign::{bus_error, intern_channel, whole_us};

const EXTENDED: u32 = 0x8000_0000;
const IDENTIFIER: u32 = 0x1fff_ffff;

/// Directions: received is 0; a request to send is no frame on the bus, which follows as sent.
const SENT: u8 = 1;
const REQUESTED: u8 = 2;

/// Bytes of an object, with bounds.
pub(super) struct Object<'a> {
    body: &'a [u8],
}

impl<'a> Object<'a> {
    /// The frame of a whole object, its header included; `None` for one of another type. An error is what was found.
    pub(super) fn parse(object: &'a [u8], start_ns: u64, names: &mut BusNames) -> Result<Option<RawFrame>, String> {
        const HEADER: usize = 32;
        const TEN_US: u32 = 1;
        let whole = Self { body: object };
        let kind = whole.u32(12)?;
        if !matches!(kind, 1 | 2 | 73 | 86 | 100 | 101) {
            return Ok(None);
        }
        let header = usize::from(whole.u16(4)?);
        if header < HEADER {
            return Err(format!("a header of {header} bytes"));
        }
        let unit_ns = if whole.u32(16)? == TEN_US { 10_000 } else { 1 };
        let stamp_ns = whole
            .u64(24)?
            .checked_mul(unit_ns)
            .and_then(|from_start| start_ns.checked_add(from_start))
            .map(whole_us)
            .ok_or("a stamp after the year 2554")?;
        let body = Self {
            body: object.get(header..).ok_or("a header beyond its end")?,
        };
        let direction = match kind {
            1 | 86 | 100 => body.u8(2)? & 0xf,
            101 => body.u8(34)?,
            _ => 0,
        };
        if direction == REQUESTED {
            return Ok(None);
        }
        let frame = match kind {
            1 | 86 => body.classic(stamp_ns)?,
            100 => body.fd(stamp_ns)?,
            101 => body.fd_64(stamp_ns)?,
            _ => bus_error(stamp_ns, 0).map_err(|error| error.to_string())?,
        };
        let channel = if kind == 101 {
            u32::from(body.u8(0)?)
        } else {
            u32::from(body.u16(0)?)
        };
        let bus = intern_channel(names, channel.checked_sub(1))?;
        Ok(Some(frame.with_bus(bus)))
    }

    fn classic(&self, stamp_ns: u64) -> Result<RawFrame, String> {
        let (flags, length) = (self.u8(2)?, usize::from(self.u8(3)?).min(MAX_CLASSIC_DATA));
        let flags = sent(flags).with(FrameFlags::REMOTE, flags & 0x80 != 0);
        frame(stamp_ns, self.u32(4)?, flags, self.bytes(8, length)?)
    }

    fn fd(&self, stamp_ns: u64) -> Result<RawFrame, String> {
        let (direction, bits) = (self.u8(2)?, self.u8(13)?);
        let length = usize::from(self.u8(14)?);
        let flags = sent(direction).with(FrameFlags::REMOTE, direction & 0x80 != 0);
        let flags = fd_flags(flags, bits & 1 != 0, bits & 2 != 0, bits & 4 != 0);
        frame(stamp_ns, self.u32(4)?, flags, self.bytes(20, length)?)
    }

    fn fd_64(&self, stamp_ns: u64) -> Result<RawFrame, String> {
        const DATA: usize = 40;
        let bits = self.u32(12)?;
        let length = usize::from(self.u8(2)?).min(MAX_DATA);
        let flags = sent(self.u8(34)?).with(FrameFlags::REMOTE, bits & 0x10 != 0);
        let flags = fd_flags(flags, bits & 0x1000 != 0, bits & 0x2000 != 0, bits & 0x4000 != 0);
        // Fewer bytes may be stored than are valid: the others are zero. What follows the data begins at `extra`, if anything does.
        let extra = usize::from(self.u8(35)?);
        let end = if extra == 0 {
            self.body.len()
        } else {
            extra.min(self.body.len())
        };
        let stored = self.body.get(DATA..end.max(DATA)).unwrap_or_default();
        let mut data = [0; MAX_DATA];
        let there = stored.len().min(length);
        data[..there].copy_from_slice(&stored[..there]);
        frame(stamp_ns, self.u32(4)?, flags, &data[..length])
    }

    fn bytes(&self, at: usize, length: usize) -> Result<&[u8], String> {
        let found = self.body.get(at..at + length);
        found.ok_or_else(|| format!("{} bytes, fewer than its length says", self.body.len()))
    }

    fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], String> {
        Ok(self.bytes(at, N)?.try_into().unwrap_or([0; N]))
    }

    fn u8(&self, at: usize) -> Result<u8, String> {
        Ok(u8::from_le_bytes(self.array(at)?))
    }

    fn u16(&self, at: usize) -> Result<u16, String> {
        Ok(u16::from_le_bytes(self.array(at)?))
    }

    fn u32(&self, at: usize) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array(at)?))
    }

    fn u64(&self, at: usize) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.array(at)?))
    }
}

fn sent(direction: u8) -> FrameFlags {
    FrameFlags::NONE.with(FrameFlags::SENT, direction & 0xf == SENT)
}

fn fd_flags(flags: FrameFlags, fd: bool, brs: bool, esi: bool) -> FrameFlags {
    flags
        .with(FrameFlags::FD, fd)
        .with(FrameFlags::BIT_RATE_SWITCH, fd && brs)
        .with(FrameFlags::ERROR_STATE, fd && esi)
}

fn frame(stamp_ns: u64, id: u32, flags: FrameFlags, data: &[u8]) -> Result<RawFrame, String> {
    let flags = flags.with(FrameFlags::EXTENDED, id & EXTENDED != 0);
    RawFrame::new(stamp_ns, 0, id & IDENTIFIER, flags, data).map_err(|error| error.to_string())
}
