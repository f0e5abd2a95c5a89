//! One frame as it came from a CAN bus or a serial line, before anything is known about its meaning.
//!
//! A frame is 80 bytes, `Copy` and without heap, so that queues of frames have a known size. Interfaces are an index
//! into a small table of names; the table is bounded because a garbled log may invent a new name on every line.

use std::fmt;
use thiserror::Error;

/// Longest payload of any frame (CAN FD), bytes.
pub const MAX_DATA: usize = 64;
/// Longest payload of a classic frame, bytes.
pub const MAX_CLASSIC_DATA: usize = 8;
/// Largest 11-bit identifier.
pub const MAX_STANDARD_ID: u32 = 0x7FF;
/// Largest 29-bit identifier; also the mask of the error class of an error frame.
pub const MAX_EXTENDED_ID: u32 = 0x1FFF_FFFF;

/// Flags of a frame, one bit each.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct FrameFlags(u8);

impl FrameFlags {
    /// A classic data frame with an 11-bit identifier.
    pub const NONE: Self = Self(0);
    /// 29-bit identifier.
    pub const EXTENDED: Self = Self(1);
    /// Remote request: a data length, but no data.
    pub const REMOTE: Self = Self(1 << 1);
    /// Error frame of the controller; the identifier is the error class.
    pub const ERROR: Self = Self(1 << 2);
    /// CAN FD frame.
    pub const FD: Self = Self(1 << 3);
    /// FD: the data were sent at the higher bit rate (BRS).
    pub const BIT_RATE_SWITCH: Self = Self(1 << 4);
    /// FD: the sender is error passive (ESI).
    pub const ERROR_STATE: Self = Self(1 << 5);
    /// Sent by this host (the `T` suffix of candump), not received.
    pub const SENT: Self = Self(1 << 6);
    /// Not of a CAN bus: what stood between two zeros on a serial line. Excludes every other flag.
    pub const SERIAL: Self = Self(1 << 7);

    /// The flags as stored in a record.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The flags with the stored form `bits`.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// Whether every flag of `other` is set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets together.
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// This set, with `other` added when `on`.
    pub const fn with(self, other: Self, on: bool) -> Self {
        if on { self.union(other) } else { self }
    }
}

impl fmt::Debug for FrameFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: [&str; 8] = ["EXT", "RTR", "ERR", "FD", "BRS", "ESI", "TX", "SERIAL"];
        let set = NAMES
            .iter()
            .enumerate()
            .filter(|(bit, _)| self.0 & (1 << bit) != 0)
            .map(|(_, name)| *name);
        f.write_str(&set.collect::<Vec<_>>().join("|"))
    }
}

/// Why a set of values is not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum FrameError {
    /// The identifier does not fit its form.
    #[error("identifier {got:#x} is above {max:#x}")]
    Id {
        /// Identifier received.
        got: u32,
        /// Largest one allowed with these flags.
        max: u32,
    },
    /// No such data length exists.
    #[error("a {} frame cannot carry {got} data bytes", if *fd { "CAN FD" } else { "classic CAN" })]
    Length {
        /// Length received.
        got: usize,
        /// Whether the frame is CAN FD.
        fd: bool,
    },
    /// Flags that exclude each other, e.g. remote and FD.
    #[error("flags {flags:?} exclude each other")]
    Flags {
        /// The flags received.
        flags: FrameFlags,
    },
}

/// One frame of a bus, as received.
///
/// Unused data bytes are zero, so that equality of values is equality of frames.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct RawFrame {
    /// UTC time stamp of the reception, ns.
    pub stamp_ns: u64,
    id: u32,
    /// Interface, an index into [`BusNames`].
    pub bus: u16,
    flags: FrameFlags,
    len: u8,
    data: [u8; MAX_DATA],
}

impl RawFrame {
    /// A data or error frame with `data`, or a remote request for `data.len()` bytes (whose content is ignored).
    ///
    /// # Errors
    /// [`FrameError`] when identifier, length and flags do not fit together.
    pub fn new(stamp_ns: u64, bus: u16, id: u32, flags: FrameFlags, data: &[u8]) -> Result<Self, FrameError> {
        let has = |flag| flags.contains(flag);
        let (fd, serial) = (has(FrameFlags::FD), has(FrameFlags::SERIAL));
        let kinds = u8::from(has(FrameFlags::REMOTE)) + u8::from(has(FrameFlags::ERROR)) + u8::from(fd);
        let fd_bits = has(FrameFlags::BIT_RATE_SWITCH) || has(FrameFlags::ERROR_STATE);
        let mixed = serial && flags != FrameFlags::SERIAL;
        if mixed || kinds > 1 || (fd_bits && !fd) || (has(FrameFlags::ERROR) && has(FrameFlags::EXTENDED)) {
            return Err(FrameError::Flags { flags });
        }
        let wide = has(FrameFlags::EXTENDED) || has(FrameFlags::ERROR);
        let max = match (serial, wide) {
            (true, _) => 0,
            (false, true) => MAX_EXTENDED_ID,
            (false, false) => MAX_STANDARD_ID,
        };
        if id > max {
            return Err(FrameError::Id { got: id, max });
        }
        let fits = match (serial, fd) {
            (true, _) => data.len() <= MAX_DATA,
            (false, true) => is_fd_length(data.len()),
            (false, false) => data.len() <= MAX_CLASSIC_DATA,
        };
        if !fits {
            return Err(FrameError::Length { got: data.len(), fd });
        }
        let mut frame = Self {
            stamp_ns,
            bus,
            id,
            flags,
            len: data.len() as u8,
            data: [0; MAX_DATA],
        };
        if !has(FrameFlags::REMOTE) {
            frame.data[..data.len()].copy_from_slice(data);
        }
        Ok(frame)
    }

    /// The frame of a SocketCAN identifier, which carries the extended, remote and error flags in its top bits.
    ///
    /// `more` adds what the identifier cannot say (FD, BRS, ESI, sent by this host).
    ///
    /// # Errors
    /// As [`RawFrame::new`].
    pub fn from_socketcan(
        stamp_ns: u64,
        bus: u16,
        can_id: u32,
        more: FrameFlags,
        data: &[u8],
    ) -> Result<Self, FrameError> {
        let error = can_id & socketcan::ERR != 0;
        let flags = more
            .with(FrameFlags::ERROR, error)
            .with(FrameFlags::EXTENDED, !error && can_id & socketcan::EFF != 0)
            .with(FrameFlags::REMOTE, !error && can_id & socketcan::RTR != 0);
        Self::new(stamp_ns, bus, can_id & MAX_EXTENDED_ID, flags, data)
    }

    /// What stood between two zeros on a serial line. Its first 64 bytes are kept, which is more than any packet has, so
    /// that a longer one stays recognisable as too long.
    #[must_use]
    pub fn of_serial(stamp_ns: u64, bus: u16, bytes: &[u8]) -> Self {
        let len = bytes.len().min(MAX_DATA);
        let mut data = [0; MAX_DATA];
        data[..len].copy_from_slice(&bytes[..len]);
        Self {
            stamp_ns,
            bus,
            id: 0,
            flags: FrameFlags::SERIAL,
            len: len as u8,
            data,
        }
    }

    /// The same frame on another interface.
    #[must_use]
    pub fn with_bus(self, bus: u16) -> Self {
        Self { bus, ..self }
    }

    /// The identifier with SocketCAN's flags in its top bits.
    pub fn socketcan_id(&self) -> u32 {
        let bit = |flag, bit| if self.flags.contains(flag) { bit } else { 0 };
        self.id
            | bit(FrameFlags::EXTENDED, socketcan::EFF)
            | bit(FrameFlags::REMOTE, socketcan::RTR)
            | bit(FrameFlags::ERROR, socketcan::ERR)
    }

    /// Identifier without flags: 11 bits, 29 bits, or the error class.
    pub fn id(&self) -> u32 {
        self.id
    }

    /// The flags.
    pub fn flags(&self) -> FrameFlags {
        self.flags
    }

    /// The data bytes; empty for a remote request.
    pub fn data(&self) -> &[u8] {
        if self.is_remote() {
            &[]
        } else {
            &self.data[..usize::from(self.len)]
        }
    }

    /// The data length the frame announced; for a remote request the length it asks for.
    pub fn announced_len(&self) -> usize {
        usize::from(self.len)
    }

    /// Whether the identifier has 29 bits.
    pub fn is_extended(&self) -> bool {
        self.flags.contains(FrameFlags::EXTENDED)
    }

    /// Whether this is a remote request.
    pub fn is_remote(&self) -> bool {
        self.flags.contains(FrameFlags::REMOTE)
    }

    /// Whether this is an error frame of the controller.
    pub fn is_error(&self) -> bool {
        self.flags.contains(FrameFlags::ERROR)
    }

    /// Whether this came from a serial line.
    pub fn is_serial(&self) -> bool {
        self.flags.contains(FrameFlags::SERIAL)
    }

    /// Whether this is a CAN FD frame.
    pub fn is_fd(&self) -> bool {
        self.flags.contains(FrameFlags::FD)
    }
}

impl fmt::Debug for RawFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            stamp_ns,
            id,
            bus,
            flags,
            len,
            ..
        } = self;
        write!(
            f,
            "RawFrame {{ {stamp_ns} ns, bus {bus}, id {id:#x} {flags:?}, {len} bytes {:02x?} }}",
            self.data()
        )
    }
}

/// Whether `len` is one of the data lengths a CAN FD frame can have.
pub fn is_fd_length(len: usize) -> bool {
    len <= 8 || matches!(len, 12 | 16 | 20 | 24 | 32 | 48 | 64)
}

/// Top bits of a SocketCAN identifier (`linux/can.h`).
pub mod socketcan {
    /// 29-bit identifier.
    pub const EFF: u32 = 0x8000_0000;
    /// Remote request.
    pub const RTR: u32 = 0x4000_0000;
    /// Error frame.
    pub const ERR: u32 = 0x2000_0000;
}

/// Why an interface name cannot be taken into the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum BusError {
    /// Empty, too long, or with a character that no interface name has.
    #[error("an interface name has 1 to {max} printable characters without '/' and blanks", max = BusNames::MAX_NAME)]
    Name,
    /// The table is full.
    #[error("more than {max} interfaces", max = BusNames::CAPACITY)]
    Full,
}

/// Interface names in order of their first appearance; `RawFrame::bus` is the index.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BusNames(Vec<Box<str>>);

impl BusNames {
    /// Most interfaces in one table; further names are refused.
    pub const CAPACITY: usize = 64;
    /// Longest name, bytes (Linux `IFNAMSIZ` without its terminator).
    pub const MAX_NAME: usize = 15;

    /// An empty table.
    pub fn new() -> Self {
        Self::default()
    }

    /// The index of `name`, which is added if it is new.
    ///
    /// # Errors
    /// [`BusError`] when the name is not an interface name or the table is full.
    pub fn intern(&mut self, name: &str) -> Result<u16, BusError> {
        if let Some(bus) = self.find(name) {
            return Ok(bus);
        }
        let printable = name.bytes().all(|b| b.is_ascii_graphic() && b != b'/');
        if name.is_empty() || name.len() > Self::MAX_NAME || !printable {
            return Err(BusError::Name);
        }
        if self.0.len() >= Self::CAPACITY {
            return Err(BusError::Full);
        }
        self.0.push(name.into());
        Ok((self.0.len() - 1) as u16)
    }

    /// The index of `name`, if it is in the table.
    pub fn find(&self, name: &str) -> Option<u16> {
        self.0.iter().position(|known| **known == *name).map(|at| at as u16)
    }

    /// The name of interface `bus`.
    pub fn name(&self, bus: u16) -> Option<&str> {
        self.0.get(usize::from(bus)).map(|name| &**name)
    }

    /// All names in index order.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|name| &**name)
    }

    /// How many interfaces are known.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether no interface is known.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod any_frame;
#[cfg(test)]
pub(crate) use any_frame::any_frame;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_frame_is_small() {
        assert_eq!(size_of::<RawFrame>(), 80);
    }

    #[test]
    fn impossible_frames_are_refused() {
        let new = |id, flags, len: usize| RawFrame::new(0, 0, id, flags, &[0; 65][..len]);
        assert_eq!(
            new(0x800, FrameFlags::NONE, 0),
            Err(FrameError::Id { got: 0x800, max: 0x7FF })
        );
        assert_eq!(
            new(1, FrameFlags::NONE, 9),
            Err(FrameError::Length { got: 9, fd: false })
        );
        assert_eq!(new(1, FrameFlags::FD, 9), Err(FrameError::Length { got: 9, fd: true }));
        assert!(new(1, FrameFlags::FD, 12).is_ok());
        assert!(matches!(
            new(1, FrameFlags::FD.union(FrameFlags::REMOTE), 0),
            Err(FrameError::Flags { .. })
        ));
        assert!(matches!(
            new(1, FrameFlags::BIT_RATE_SWITCH, 0),
            Err(FrameError::Flags { .. })
        ));
        assert_eq!(new(1, FrameFlags::SERIAL, 9), Err(FrameError::Id { got: 1, max: 0 }));
        assert!(new(0, FrameFlags::SERIAL, 65).is_err() && new(0, FrameFlags::SERIAL, 37).is_ok());
        assert!(matches!(
            new(0, FrameFlags::SERIAL.union(FrameFlags::ERROR), 0),
            Err(FrameError::Flags { .. })
        ));
    }

    #[test]
    fn a_stretch_of_a_line_is_a_frame_of_its_own_kind() {
        let bytes: Vec<u8> = (1..=100).collect();
        for len in [0, 38, 64] {
            let frame = RawFrame::new(5, 1, 0, FrameFlags::SERIAL, &bytes[..len]);
            assert_eq!(Ok(RawFrame::of_serial(5, 1, &bytes[..len])), frame);
        }
        assert_eq!(
            RawFrame::of_serial(5, 1, &bytes),
            RawFrame::of_serial(5, 1, &bytes[..64])
        );
    }

    #[test]
    fn names_are_bounded() {
        let mut names = BusNames::new();
        for i in 0..BusNames::CAPACITY {
            assert_eq!(names.intern(&format!("vcan{i}")), Ok(i as u16));
        }
        assert_eq!(names.intern("vcan3"), Ok(3));
        assert_eq!(names.intern("vcan64"), Err(BusError::Full));
        for bad in ["", "a b", "a/b", "\u{fc}", "sixteen-letters!"] {
            assert_eq!(names.intern(bad), Err(BusError::Name), "{bad:?}");
        }
    }

    proptest! {
        #[test]
        fn the_socketcan_identifier_keeps_the_frame(frame in any_frame()) {
            let more = FrameFlags::from_bits(frame.flags().bits() & !0b111);
            let data = &[frame.data(), &[0; 8]].concat()[..frame.announced_len()];
            let again = RawFrame::from_socketcan(frame.stamp_ns, frame.bus, frame.socketcan_id(), more, data);
            prop_assert_eq!(again, Ok(frame));
        }
    }
}
