//! PDO of CiA 301: which objects of a dictionary a frame has.

use super::eds::ObjectDictionary;

/// Most PDO of one direction.
const PDO_COUNT: u16 = 512;

/// Most objects that one PDO maps; numbers of them that say that it is a multiplex PDO, which carries any object.
const MAPPED_MAX: u32 = 64;
const MULTIPLEX: [u64; 2] = [0xFE, 0xFF];

/// Bytes of a PDO.
const LENGTH_MAX: u32 = 8;

/// First object of each kind; the n-th PDO has the n-th from there.
const RECEIVE_COMMUNICATION: u16 = 0x1400;
const RECEIVE_MAPPING: u16 = 0x1600;
const TRANSMIT_COMMUNICATION: u16 = 0x1800;
const TRANSMIT_MAPPING: u16 = 0x1A00;

/// Bits of a COB-ID: the PDO is not in use; its identifier has 29 bits.
const NOT_VALID: u32 = 1 << 31;
const EXTENDED: u32 = 1 << 29;

/// Largest transmission type that waits for the SYNC.
const SYNCHRONOUS_MAX: u64 = 240;

/// One PDO in use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pdo {
    pub(super) name: String,
    pub(super) id: u32,
    pub(super) extended: bool,
    /// Whether the drive takes what it is told only at the next SYNC. What it sends with a SYNC it has sampled at that one.
    pub(super) synchronous: bool,
    pub(super) objects: Vec<Mapped>,
}

/// An object in a PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mapped {
    pub(super) index: u16,
    pub(super) sub: u8,
    /// First bit, and their number.
    pub(super) start: u16,
    pub(super) size: u16,
}

/// Why the mapping of a PDO cannot be. Displays as what is expected and found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PdoError {
    /// More objects or bits than fit.
    #[error("at most {MAPPED_MAX} objects of {LENGTH_MAX} bytes together in a PDO, where {index:04X} has more")]
    TooLong {
        /// Its mapping.
        index: u16,
    },
    /// No PDO at all.
    #[error("a PDO in use (1400 to 1BFF), from the EDS file or overheard, where there is none")]
    None,
}

/// The PDO in use: those that the drive sends, then those that it receives.
///
/// # Errors
/// [`PdoError`].
pub(super) fn pdos(dictionary: &ObjectDictionary) -> Result<Vec<Pdo>, PdoError> {
    let mut found = Vec::new();
    for (first, mapping, name, is_received) in [
        (TRANSMIT_COMMUNICATION, TRANSMIT_MAPPING, "TPDO", false),
        (RECEIVE_COMMUNICATION, RECEIVE_MAPPING, "RPDO", true),
    ] {
        for n in 0..PDO_COUNT {
            let name = || format!("{name}{}", n + 1);
            let pdo = pdo(dictionary, first + n, mapping + n, name)?;
            found.extend(pdo.map(|pdo| Pdo {
                synchronous: pdo.synchronous && is_received,
                ..pdo
            }));
        }
    }
    if found.is_empty() {
        Err(PdoError::None)
    } else {
        Ok(found)
    }
}

fn pdo(
    dictionary: &ObjectDictionary,
    communication: u16,
    mapping: u16,
    name: impl Fn() -> String,
) -> Result<Option<Pdo>, PdoError> {
    let Some(cob) = dictionary.number(communication, 1).map(|cob| cob as u32) else {
        return Ok(None);
    };
    let count = dictionary.number(mapping, 0).unwrap_or(0);
    if cob & NOT_VALID != 0 || count == 0 || MULTIPLEX.contains(&count) {
        return Ok(None);
    }
    let too_long = PdoError::TooLong { index: mapping };
    if count > u64::from(MAPPED_MAX) {
        return Err(too_long);
    }
    let (mut objects, mut start) = (Vec::new(), 0);
    for sub in 1..=count as u8 {
        let entry = dictionary.number(mapping, sub).unwrap_or(0) as u32;
        let size = entry & 0xff;
        if start + size > 8 * LENGTH_MAX {
            return Err(too_long);
        }
        objects.push(Mapped {
            index: (entry >> 16) as u16,
            sub: (entry >> 8) as u8,
            start: start as u16,
            size: size as u16,
        });
        start += size;
    }
    let extended = cob & EXTENDED != 0;
    Ok(Some(Pdo {
        name: name(),
        id: cob & if extended { 0x1fff_ffff } else { 0x7ff },
        extended,
        synchronous: dictionary
            .number(communication, 2)
            .is_some_and(|of| of <= SYNCHRONOUS_MAX),
        objects,
    }))
}
