//! [`ObjectDictionary`]: what an EDS or DCF file of CiA 306 says of the objects that a layout needs, with the SDO writes overheard.
//!
//! Such a file is text of sections `[1A00sub1]` with lines `Key=Value`. Of each object `ParameterValue` (of a DCF) holds over
//! `DefaultValue`. Read by hand: the crates for this kind of text (`configparser`, `rust-ini`) forget the line of a value, which an
//! error must name.

use std::collections::BTreeMap;

use thiserror::Error;

/// Largest file, bytes: those of drives have some 0.3 MB.
pub const EDS_BYTES_MAX: usize = 4 << 20;

/// Longest line, bytes.
const LINE_MAX: usize = 1024;

/// Objects that a layout needs: PDO, and scales of CiA 402 (rated current, resolutions of the encoders).
const PDO_FIRST: u16 = 0x1400;
const PDO_LAST: u16 = 0x1BFF;
const SCALES: [u16; 4] = [0x6075, 0x608F, 0x60E6, 0x60EB];

/// Most objects with those that were written: a bus may write anything.
const WRITTEN_MAX: usize = 1 << 16;

/// Whether a layout may need an object.
fn is_needed(index: u16) -> bool {
    (PDO_FIRST..=PDO_LAST).contains(&index) || SCALES.contains(&index)
}

/// Why a file is no EDS. Displays as line, what is expected and found.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum EdsError {
    /// More bytes than [`EDS_BYTES_MAX`].
    #[error("expected at most {EDS_BYTES_MAX} bytes, found {got}")]
    TooLarge {
        /// Bytes.
        got: usize,
    },
    /// A line that is none of the format.
    #[error("line {line}: expected {expected}, found {found:?}")]
    Line {
        /// Its number, from 1.
        line: usize,
        /// What is expected.
        expected: &'static str,
        /// What is there, its beginning.
        found: String,
    },
    /// No section of an object.
    #[error("expected objects as sections [1A00sub1], found none")]
    NoObject,
}

/// Values of objects by index and sub-index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectDictionary {
    values: BTreeMap<(u16, u8), u64>,
}

/// What a section is of.
#[derive(Clone, Copy)]
enum Section {
    Object(u16, u8),
    Other,
}

impl ObjectDictionary {
    /// The dictionary of a file, for a node of this number.
    ///
    /// # Errors
    /// [`EdsError`] for the first line that is wrong.
    pub fn parse(bytes: &[u8], node: u8) -> Result<Self, EdsError> {
        if bytes.len() > EDS_BYTES_MAX {
            return Err(EdsError::TooLarge { got: bytes.len() });
        }
        let mut found = Self::default();
        let (mut section, mut objects, mut of_parameter) = (Section::Other, 0_usize, false);
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        for (n, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
            let line = line.trim_ascii();
            let wrong = |expected| EdsError::Line {
                line: n + 1,
                expected,
                found: String::from_utf8_lossy(&line[..line.len().min(40)]).into_owned(),
            };
            match line {
                [] | [b';' | b'#', ..] => continue,
                _ if line.len() > LINE_MAX => return Err(wrong("a line of at most 1024 bytes")),
                [b'[', name @ .., b']'] => {
                    section = self::section(name);
                    objects += usize::from(matches!(section, Section::Object(..)));
                    of_parameter = false;
                    continue;
                }
                [b'[', ..] => return Err(wrong("a section that ends in ]")),
                _ => {}
            }
            let Some(equals) = line.iter().position(|&byte| byte == b'=') else {
                return Err(wrong("[section], Key=Value or ; comment"));
            };
            let (key, value) = (line[..equals].trim_ascii(), line[equals + 1..].trim_ascii());
            let Section::Object(index, sub) = section else { continue };
            let is_parameter = key.eq_ignore_ascii_case(b"ParameterValue");
            if !is_needed(index) || value.is_empty() || !(is_parameter || key.eq_ignore_ascii_case(b"DefaultValue")) {
                continue;
            }
            let is_pdo = (PDO_FIRST..=PDO_LAST).contains(&index);
            match number(value, node) {
                // A value of the configured device holds over the default, wherever it stands.
                Some(value) if is_parameter || !of_parameter => {
                    found.values.insert((index, sub), value);
                }
                None if is_pdo => return Err(wrong("a whole number, or $NODEID + a whole number")),
                Some(_) | None => {}
            }
            of_parameter |= is_parameter;
        }
        if objects == 0 {
            Err(EdsError::NoObject)
        } else {
            Ok(found)
        }
    }

    /// Takes over a value that was written; whether a layout may need it.
    pub(super) fn write(&mut self, index: u16, sub: u8, value: u64) -> bool {
        let is_known = self.values.contains_key(&(index, sub));
        let fits = is_needed(index) && (is_known || self.values.len() < WRITTEN_MAX);
        fits && self.values.insert((index, sub), value) != Some(value)
    }

    /// The value of an object; `None` where there is none.
    #[must_use]
    pub fn number(&self, index: u16, sub: u8) -> Option<u64> {
        self.values.get(&(index, sub)).copied()
    }
}

/// What a section's name is: `6064`, `1A00sub1`.
fn section(name: &[u8]) -> Section {
    let text = core::str::from_utf8(name)
        .unwrap_or_default()
        .trim()
        .to_ascii_lowercase();
    let (index, sub) = text.split_once("sub").unwrap_or((&text, "0"));
    let is_hex =
        |text: &str, most: usize| (1..=most).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    if index.len() != 4 || !is_hex(index, 4) || !is_hex(sub, 2) {
        return Section::Other;
    }
    match (u16::from_str_radix(index, 16), u8::from_str_radix(sub, 16)) {
        (Ok(index), Ok(sub)) => Section::Object(index, sub),
        _ => Section::Other,
    }
}

/// A value: decimal, hexadecimal or octal as in C, with `$NODEID +` before or behind it; negative ones in two's complement.
fn number(text: &[u8], node: u8) -> Option<u64> {
    let text = core::str::from_utf8(text).ok()?.to_ascii_uppercase();
    let mut sum = 0_u64;
    for term in text.split('+') {
        let term = term.trim();
        let value = if term == "$NODEID" {
            u64::from(node)
        } else if let Some(hex) = term.strip_prefix("0X") {
            u64::from_str_radix(hex, 16).ok()?
        } else if let Some(octal) = term.strip_prefix('0').filter(|rest| !rest.is_empty()) {
            u64::from_str_radix(octal, 8).ok()?
        } else if term.starts_with('-') {
            term.parse::<i64>().ok()?.cast_unsigned()
        } else {
            term.parse().ok()?
        };
        sum = sum.wrapping_add(value);
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[FileInfo]\r\nFileName=a\\b.eds\r\n; a comment\r\n[1A00]\r\nSubNumber=3\r\n[1A00sub0]\r\nDefaultValue=2\r\n\
        [1A00Sub1]\r\nDefaultValue=0x60410010\r\nParameterValue=0x60640020\r\n[1a00sub2]\r\nParameterValue=0x60780010\r\nDefaultValue=0\r\n\
        [1800sub1]\r\ndefaultvalue=$NODEID+0x180\r\n[1801sub1]\nDefaultValue=0x280+$NODEID\n[6075]\nDefaultValue=2500\n[2000]\nDefaultValue=?\n";

    #[test]
    fn values_of_the_device_hold_over_defaults() {
        let found = ObjectDictionary::parse(TEXT.as_bytes(), 5).expect("an EDS");
        let cases = [
            ((0x1A00, 0), 2),
            ((0x1A00, 1), 0x6064_0020),
            ((0x1A00, 2), 0x6078_0010),
            ((0x1800, 1), 0x185),
            ((0x1801, 1), 0x285),
            ((0x6075, 0), 2500),
        ];
        for ((index, sub), expected) in cases {
            assert_eq!(found.number(index, sub), Some(expected), "{index:04X}sub{sub}");
        }
        assert_eq!(found.number(0x2000, 0), None);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let refused = |text: &str| ObjectDictionary::parse(text.as_bytes(), 1).unwrap_err().to_string();
        assert_eq!(
            refused("[FileInfo]\n"),
            "expected objects as sections [1A00sub1], found none"
        );
        assert_eq!(
            refused("[1A00sub1]\nDefaultValue=many\n"),
            "line 2: expected a whole number, or $NODEID + a whole number, found \"DefaultValue=many\""
        );
        assert_eq!(
            refused("[1A00sub1]\nhello\n"),
            "line 2: expected [section], Key=Value or ; comment, found \"hello\""
        );
        assert_eq!(
            refused("[1A00"),
            "line 1: expected a section that ends in ], found \"[1A00\""
        );
        assert!(refused(&"x".repeat(2000)).starts_with("line 1: expected a line of at most 1024 bytes"));
        let large = ObjectDictionary::parse(&vec![b'\n'; EDS_BYTES_MAX + 1], 1);
        assert_eq!(large, Err(EdsError::TooLarge { got: EDS_BYTES_MAX + 1 }));
    }
}
