//! What the records of a file mean: its groups and channels.

use std::io::{Read, Seek};

use hmd_core::frame::{BusNames, FrameFlags, MAX_CLASSIC_DATA, MAX_DATA, RawFrame};

use super::block::{Blocks, u32_at, u64_at};
use super::channel::{Channel, Field, channels};
use crate::damage::Damage;
use crate::foreign::{bus_error, fd_length, intern_channel, whole_us};

/// Records of one data group.
#[derive(Debug)]
pub(super) struct Layout {
    /// Bytes of the number before each record that tells its format.
    pub(super) id_bytes: usize,
    pub(super) formats: Vec<Format>,
    /// UTC.
    pub(super) start_ns: u64,
}

/// Where the records of a data group are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Data {
    pub(super) first: Option<u64>,
    /// Its last block goes on to the end of the file, whatever its length says.
    pub(super) is_open: bool,
}

/// Records of one channel group.
#[derive(Debug)]
#[cfg_attr(
    not(feature = "signals"),
    allow(dead_code, reason = "only measured signals ask for all channels")
)]
pub(super) struct Format {
    pub(super) id: u64,
    /// Bytes of a record; `None`: it tells its own length.
    pub(super) length: Option<usize>,
    /// Where it makes a frame.
    frame: Option<FrameFields>,
    pub(super) channels: Vec<Channel>,
    /// Bytes of a record before its bits of invalid values.
    pub(super) values: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Data,
    Remote,
    Error,
}

/// Fields of a frame by the last part of their names.
#[derive(Debug)]
struct FrameFields {
    kind: Kind,
    time: Field,
    fields: Vec<(Name, Field)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Name {
    BusChannel,
    Id,
    Ide,
    Dlc,
    DataLength,
    DataBytes,
    Dir,
    Edl,
    Brs,
    Esi,
}

const NAMES: [(&str, Name); 10] = [
    ("BusChannel", Name::BusChannel),
    ("ID", Name::Id),
    ("IDE", Name::Ide),
    ("DLC", Name::Dlc),
    ("DataLength", Name::DataLength),
    ("DataBytes", Name::DataBytes),
    ("Dir", Name::Dir),
    ("EDL", Name::Edl),
    ("BRS", Name::Brs),
    ("ESI", Name::Esi),
];

const KINDS: [(&str, Kind); 3] = [
    ("CAN_DataFrame.", Kind::Data),
    ("CAN_RemoteFrame.", Kind::Remote),
    ("CAN_ErrorFrame.", Kind::Error),
];

/// A frame whose interface is still a number.
#[derive(Debug)]
pub(super) struct Stamped {
    frame: RawFrame,
    channel: u32,
}

impl Stamped {
    pub(super) fn stamp_ns(&self) -> u64 {
        self.frame.stamp_ns
    }

    pub(super) fn into_frame(self, names: &mut BusNames) -> Result<RawFrame, String> {
        Ok(self.frame.with_bus(intern_channel(names, Some(self.channel))?))
    }
}

/// The data groups.
pub(super) fn read<R: Read + Seek>(
    blocks: &mut Blocks<R>,
    refused: &mut Vec<Damage>,
) -> Result<Vec<(Layout, Data)>, Damage> {
    const HEAD: u64 = 64;
    const LENGTH_OF_LAST: u64 = 1 << 2;
    let head = blocks.read(0, HEAD as usize)?;
    let version = u64_at(&head, 28) & 0xffff;
    if !(400..500).contains(&version) {
        return Err(blocks.damage(28, "MDF version 4", &format!("version {version}")));
    }
    let is_finalised = head.starts_with(super::MAGICS[0]);
    let is_open = !is_finalised && u64_at(&head, 60) & LENGTH_OF_LAST != 0;
    let header = blocks.once(HEAD)?;
    // In UTC, or in a local time without an offset, which is taken as such.
    let start_ns = u64_at(&blocks.data(&header, 8)?, 0);
    let mut found = Vec::new();
    let mut next = header.link(0);
    while let Some(at) = next {
        let group = blocks.once(at)?;
        next = group.link(0);
        let id_bytes = usize::from(blocks.data(&group, 1)?[0]);
        if !matches!(id_bytes, 0 | 1 | 2 | 4 | 8) {
            return Err(blocks.damage(at, "records numbered by 0, 1, 2, 4 or 8 bytes", &id_bytes.to_string()));
        }
        let mut formats = Vec::new();
        let mut format = group.link(1);
        while let Some(at) = format {
            let block = blocks.once(at)?;
            format = block.link(0);
            formats.push(read_format(blocks, at, block.link(1), refused)?);
        }
        let layout = Layout {
            id_bytes,
            formats,
            start_ns,
        };
        let first = group.link(2);
        found.push((layout, Data { first, is_open: false }));
    }
    if is_open {
        let lasts: Vec<_> = found.iter().map(|(_, data)| last_block(blocks, data.first)).collect();
        // A block that others follow has its length.
        let last = lasts
            .iter()
            .flatten()
            .max()
            .filter(|last| blocks.is_behind_structure(**last));
        for ((_, data), own) in found.iter_mut().zip(&lasts) {
            data.is_open = own.is_some() && own.as_ref() == last;
        }
    }
    Ok(found)
}

/// Address of the last block of the records that begin with a block.
fn last_block<R: Read + Seek>(blocks: &mut Blocks<R>, first: Option<u64>) -> Option<u64> {
    /// A chain of links that is longer is a circle.
    const CHAIN_MAX: usize = 1 << 16;
    let mut at = first?;
    for _ in 0..CHAIN_MAX {
        let Ok(block) = blocks.block(at) else { break };
        let next = match &block.id {
            b"##HL" => block.link(0),
            b"##DL" => {
                let last = || block.links.iter().skip(1).rev().find(|at| **at != 0).copied();
                block.link(0).or_else(last)
            }
            _ => None,
        };
        let Some(next) = next else { break };
        at = next;
    }
    Some(at)
}

fn read_format<R: Read + Seek>(
    blocks: &mut Blocks<R>,
    at: u64,
    first: Option<u64>,
    refused: &mut Vec<Damage>,
) -> Result<Format, Damage> {
    const RECORD_MAX: u64 = 1 << 20;
    const VARIABLE: u64 = 1;
    let block = blocks.block(at)?;
    let data = blocks.data(&block, 32)?;
    let (id, flags) = (u64_at(&data, 0), u64_at(&data, 16));
    let length = u64::from(u32_at(&data, 24)) + u64::from(u32_at(&data, 28));
    if length > RECORD_MAX {
        return Err(blocks.damage(at, "records of at most 1 MiB", &format!("{length} bytes")));
    }
    let length = (flags & VARIABLE == 0).then_some(length as usize);
    let mut kind = None;
    let mut time = None;
    let mut fields = Vec::new();
    let mut is_variable = false;
    let channels = channels(blocks, first)?;
    for channel in &channels {
        if channel.is_time() {
            time = Some(channel.field);
            continue;
        }
        for (prefix, of) in KINDS {
            let Some(last) = channel.name.strip_prefix(prefix) else {
                continue;
            };
            kind = Some(of);
            if let Some((_, name)) = NAMES.iter().find(|(known, _)| *known == last) {
                is_variable |= *name == Name::DataBytes && channel.is_variable();
                fields.push((*name, channel.field));
            }
        }
    }
    let fits = |field: &Field| length.is_some_and(|length| field.fits(length));
    let frame = match (kind, time) {
        (Some(_), _) if is_variable => {
            let expected = "data bytes inside their records";
            refused.push(blocks.damage(at, expected, "data bytes of variable length, which are not read"));
            None
        }
        (Some(kind), Some(time)) if fits(&time) && fields.iter().all(|(_, field)| fits(field)) => {
            Some(FrameFields { kind, time, fields })
        }
        (Some(_), _) => {
            refused.push(blocks.damage(at, "frames with a time, inside their records", "others"));
            None
        }
        (None, _) => None,
    };
    Ok(Format {
        id,
        length,
        frame,
        channels,
        values: u32_at(&data, 24) as usize,
    })
}

impl Layout {
    /// Whether some of its records are frames.
    pub(super) fn has_frames(&self) -> bool {
        self.formats.iter().any(|format| format.frame.is_some())
    }

    /// The frame of a record; `None` if its format has none. An error is what was found.
    pub(super) fn frame(&self, format: usize, record: &[u8]) -> Result<Option<Stamped>, String> {
        let Some(of) = &self.formats[format].frame else {
            return Ok(None);
        };
        let stamp_ns = stamp_ns(self.start_ns, of.time.number(record)).ok_or("a stamp before 1970 or after 2554")?;
        let field = |name: Name| {
            of.fields
                .iter()
                .find(|(known, _)| *known == name)
                .map(|(_, field)| field)
        };
        let number = |name: Name| field(name).map(|field| field.raw(record));
        let flag = |name: Name| number(name).is_some_and(|value| value != 0);
        let channel = number(Name::BusChannel)
            .and_then(|value| u32::try_from(value).ok())
            .unwrap_or(0);
        let frame = if of.kind == Kind::Error {
            bus_error(stamp_ns, 0).map_err(|error| error.to_string())?
        } else {
            const EXTENDED: u64 = 1 << 31;
            let id = number(Name::Id).ok_or("no identifier")?;
            let flags = FrameFlags::NONE
                .with(FrameFlags::EXTENDED, flag(Name::Ide) || id & EXTENDED != 0)
                .with(FrameFlags::SENT, flag(Name::Dir));
            let id = (id & !EXTENDED) as u32;
            let code = number(Name::Dlc).and_then(|value| u32::try_from(value).ok());
            let is_fd = of.kind == Kind::Data && flag(Name::Edl);
            let of_code = code.and_then(fd_length).unwrap_or(0);
            let of_code = if is_fd { of_code } else { of_code.min(MAX_CLASSIC_DATA) };
            let length = number(Name::DataLength).map_or(of_code, |value| value.min(255) as usize);
            let mut data = [0; MAX_DATA];
            if of.kind == Kind::Remote {
                let flags = flags.union(FrameFlags::REMOTE);
                RawFrame::new(stamp_ns, 0, id, flags, &data[..of_code]).map_err(|error| error.to_string())?
            } else {
                let bytes = field(Name::DataBytes).ok_or("no data bytes")?;
                let stored = &record[bytes.byte..bytes.byte + (bytes.bits / 8) as usize];
                let stored = stored
                    .get(..length)
                    .filter(|_| length <= MAX_DATA)
                    .ok_or("a length beyond its data")?;
                data[..length].copy_from_slice(stored);
                let flags = flags
                    .with(FrameFlags::FD, is_fd)
                    .with(FrameFlags::BIT_RATE_SWITCH, is_fd && flag(Name::Brs))
                    .with(FrameFlags::ERROR_STATE, is_fd && flag(Name::Esi));
                RawFrame::new(stamp_ns, 0, id, flags, &data[..length]).map_err(|error| error.to_string())?
            }
        };
        Ok(Some(Stamped { frame, channel }))
    }
}

/// A stamp `seconds` after the start; before it, too, as python-can writes.
fn stamp_ns(start_ns: u64, seconds: f64) -> Option<u64> {
    // An absurd time, and what is no number, has no stamp.
    if seconds.is_nan() || seconds.abs() >= 1e10 {
        return None;
    }
    let whole = seconds.floor();
    let ns = whole as i64 as i128 * 1_000_000_000 + ((seconds - whole) * 1e9).round() as i128;
    u64::try_from(i128::from(start_ns) + ns).ok().map(whole_us)
}
