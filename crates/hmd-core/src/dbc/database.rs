//! [`Database`]: the messages and signals of a DBC file.

use std::collections::BTreeMap;

use can_dbc::{ByteOrder, Dbc, MessageId, MultiplexIndicator, SignalExtendedValueType, ValueType};
use thiserror::Error;

use super::signal::{Layout, Selector, Signal, SignalKind};

/// Messages and signals of a DBC file.
#[derive(Clone, Debug, PartialEq)]
pub struct Database {
    /// Messages in the order of the file.
    pub messages: Vec<DbcMessage>,
}

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub struct DbcMessage {
    /// Its name.
    pub name: String,
    /// Identifier, without the flag for 29 bits.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// Data bytes.
    pub length: usize,
    /// Its signals by name.
    pub signals: BTreeMap<String, DbcSignal>,
}

/// One signal.
#[derive(Clone, Debug, PartialEq)]
pub struct DbcSignal {
    /// Unit of its physical value, as it stands in the file.
    pub unit: String,
    /// Where it is and what it means, or what is wrong: an error in a signal that is not mapped does no harm.
    pub signal: Result<Signal, DbcError>,
}

/// What is wrong with a file or a signal.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DbcError {
    /// The text is no DBC; the line at which it is none, from 1. What stands there is not repeated: it may be any file.
    #[error("no valid DBC: line {line}")]
    Syntax {
        /// The line.
        line: usize,
    },
    /// The text has the form of a DBC, but a number in it cannot be.
    #[error("no valid DBC: a number or a name in it cannot be")]
    Content,
    /// A message has several signals of this name.
    #[error("its message has it twice")]
    Twice,
    /// The signal has no bits, more than 64, or some outside its message.
    #[error("{size} bits from bit {start} on do not fit into {length} bytes")]
    Layout {
        /// First bit.
        start: u64,
        /// Number of bits.
        size: u64,
        /// Data bytes of the message.
        length: u64,
    },
    /// A float of another size.
    #[error("a float of {expected} bits is declared, with {found} bits")]
    FloatSize {
        /// Bits of its type.
        expected: u16,
        /// Bits of its layout.
        found: u16,
    },
    /// Factor zero, or a factor or offset that is no finite number.
    #[error("factor or offset is no use")]
    Scale,
    /// A multiplexed signal whose multiplexor is not given, or is multiplexed by itself.
    #[error("its multiplexor is ambiguous")]
    Multiplexor,
}

/// Depth of multiplexors within multiplexors.
const DEPTH_MAX: usize = 8;

impl Database {
    /// Reads the text of a DBC file.
    ///
    /// # Errors
    /// [`DbcError::Syntax`], [`DbcError::Content`].
    pub fn parse(text: &str) -> Result<Self, DbcError> {
        // The parser tries each of its rules at an empty line.
        let kept: Vec<(usize, &str)> = kept_lines(text).collect();
        let squeezed: String = kept.iter().flat_map(|(_, line)| [*line, "\n"]).collect();
        let dbc = Dbc::try_from(squeezed.as_str()).map_err(|error| match error {
            can_dbc::DbcError::Pest(error) => {
                let line = line_of(&error.to_string()).and_then(|line| kept.get(line.saturating_sub(1)));
                let line = line.or(kept.last()).map_or(1, |(number, _)| *number);
                DbcError::Syntax { line }
            }
            _ => DbcError::Content,
        })?;
        let identifiers = identifiers(text);
        let messages = dbc
            .messages
            .iter()
            .map(|message| read_message(&dbc, message, &identifiers))
            .collect();
        Ok(Self { messages })
    }

    /// The message of this name.
    #[must_use]
    pub fn message(&self, name: &str) -> Option<&DbcMessage> {
        self.messages.iter().find(|message| message.name == name)
    }
}

/// Lines with their numbers from 1; of several empty ones in a row, the first.
fn kept_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut was_empty = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let is_empty = line.trim().is_empty();
        !(std::mem::replace(&mut was_empty, is_empty) && is_empty)
    })
}

/// The line in a message of the parser, which begins with `--> LINE:COLUMN`.
fn line_of(message: &str) -> Option<usize> {
    let (_, place) = message.split_once("--> ")?;
    place.split_once(':')?.0.parse().ok()
}

/// Identifiers as the file writes them, by the messages' names: the parser cuts them to 11 or 29 bits, and one that does not
/// fit would become another message's.
fn identifiers(text: &str) -> BTreeMap<&str, u64> {
    let mut found = BTreeMap::new();
    for line in text.lines().filter_map(|line| line.trim_start().strip_prefix("BO_ ")) {
        let mut words = line.split([' ', '\t', ':']).filter(|word| !word.is_empty());
        if let (Some(Ok(id)), Some(name)) = (words.next().map(str::parse), words.next()) {
            found.entry(name).or_insert(id);
        }
    }
    found
}

fn read_message(dbc: &Dbc, message: &can_dbc::Message, identifiers: &BTreeMap<&str, u64>) -> DbcMessage {
    const EXTENDED: u64 = 0x8000_0000;
    let (id, extended) = match (identifiers.get(message.name.as_str()), message.id) {
        (Some(&id), _) => (u32::try_from(id & !EXTENDED).unwrap_or(u32::MAX), id & EXTENDED != 0),
        (None, MessageId::Standard(id)) => (u32::from(id), false),
        (None, MessageId::Extended(id)) => (id, true),
    };
    let read = |signal: &can_dbc::Signal| {
        let unit = signal.unit.clone();
        let named = message.signals.iter().filter(|other| other.name == signal.name);
        let read = match named.count() {
            1 => read_signal(dbc, message, signal),
            _ => Err(DbcError::Twice),
        };
        (signal.name.clone(), DbcSignal { unit, signal: read })
    };
    DbcMessage {
        name: message.name.clone(),
        id,
        extended,
        length: usize::try_from(message.size).unwrap_or(usize::MAX),
        signals: message.signals.iter().map(read).collect(),
    }
}

fn read_signal(dbc: &Dbc, message: &can_dbc::Message, signal: &can_dbc::Signal) -> Result<Signal, DbcError> {
    let layout = layout(message, signal)?;
    let kind = kind(dbc, message, signal);
    let float = match kind {
        SignalKind::F32 => Some(32),
        SignalKind::F64 => Some(64),
        SignalKind::Unsigned | SignalKind::Signed => None,
    };
    if let Some(expected) = float.filter(|&bits| bits != layout.size) {
        let found = layout.size;
        return Err(DbcError::FloatSize { expected, found });
    }
    let (factor, offset) = (signal.factor, signal.offset);
    if !(factor.is_normal() && offset.is_finite()) {
        return Err(DbcError::Scale);
    }
    let mut selectors = Vec::new();
    select(dbc, message, signal, &mut selectors)?;
    Ok(Signal {
        layout,
        kind,
        factor,
        offset,
        selectors,
    })
}

fn layout(message: &can_dbc::Message, signal: &can_dbc::Signal) -> Result<Layout, DbcError> {
    let (start, size, length) = (signal.start_bit, signal.size, message.size);
    let found = Layout {
        start: u16::try_from(start).unwrap_or(u16::MAX),
        size: u16::try_from(size).unwrap_or(0),
        big_endian: signal.byte_order == ByteOrder::BigEndian,
    };
    if found.fits(usize::try_from(length).unwrap_or(0)) {
        Ok(found)
    } else {
        Err(DbcError::Layout { start, size, length })
    }
}

fn kind(dbc: &Dbc, message: &can_dbc::Message, signal: &can_dbc::Signal) -> SignalKind {
    let mut declared = dbc.signal_extended_value_type_list.iter();
    let declared = declared.find(|of| of.message_id == message.id && of.signal_name == signal.name);
    match declared.map(|declared| declared.signal_extended_value_type) {
        Some(SignalExtendedValueType::IEEEfloat32Bit) => SignalKind::F32,
        Some(SignalExtendedValueType::IEEEdouble64bit) => SignalKind::F64,
        _ if signal.value_type == ValueType::Signed => SignalKind::Signed,
        _ => SignalKind::Unsigned,
    }
}

/// Adds the multiplexors that must select a signal: its own, and those that select that.
fn select(
    dbc: &Dbc,
    message: &can_dbc::Message,
    signal: &can_dbc::Signal,
    selectors: &mut Vec<Selector>,
) -> Result<(), DbcError> {
    let value = match signal.multiplexer_indicator {
        MultiplexIndicator::Plain | MultiplexIndicator::Multiplexor => return Ok(()),
        MultiplexIndicator::MultiplexedSignal(value) | MultiplexIndicator::MultiplexorAndMultiplexedSignal(value) => {
            value
        }
    };
    if selectors.len() >= DEPTH_MAX {
        return Err(DbcError::Multiplexor);
    }
    let mut extended = dbc.extended_multiplex.iter();
    let extended = extended.find(|of| of.message_id == message.id && of.signal_name == signal.name);
    let multiplexor = message.signals.iter().find(|other| match extended {
        Some(extended) => other.name == extended.multiplexor_signal_name,
        None => other.multiplexer_indicator == MultiplexIndicator::Multiplexor,
    });
    let multiplexor = multiplexor.ok_or(DbcError::Multiplexor)?;
    let ranges = match extended {
        Some(extended) => extended
            .mappings
            .iter()
            .map(|of| (of.min_value, of.max_value))
            .collect(),
        None => vec![(value, value)],
    };
    selectors.push(Selector {
        multiplexor: layout(message, multiplexor)?,
        ranges,
    });
    select(dbc, message, multiplexor, selectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A\n\n\
        BO_ 2147483653 Wide: 8 A\n SG_ M M : 0|4@1+ (1,0) [0|15] \"\" A\n SG_ x m2 : 15|16@0- (0.5,3) [0|0] \"deg\" A\n\
        \u{20}SG_ f m3M : 32|32@1- (1,0) [0|0] \"A\" A\n SG_ y m0 : 8|8@1+ (1,0) [0|0] \"\" A\n\
        \u{20}SG_ out : 60|8@1+ (1,0) [0|0] \"\" A\n\n\
        SIG_VALTYPE_ 2147483653 f : 1;\n\nSG_MUL_VAL_ 2147483653 y f 1-2, 7-7;\n";

    #[test]
    fn identifiers_are_those_of_the_file() {
        // 29 bits without the flag, more than 29 bits with it, more than 32.
        for (written, id, extended) in [
            (419_299_584_u64, 0x18fe_0100, false),
            (3_758_096_389, 0x6000_0005, true),
            (291, 0x123, false),
        ] {
            let text = TEXT.replace("BO_ 2147483653", &format!("BO_ {written}"));
            let text = text.split("SIG_VALTYPE_").next().expect("before it");
            let database = Database::parse(text).expect("valid");
            let message = database.message("Wide").expect("there");
            assert_eq!((message.id, message.extended), (id, extended), "{written}");
        }
    }

    #[test]
    fn orders_signs_floats_and_multiplexors_are_understood() {
        let database = Database::parse(TEXT).expect("valid");
        let message = database.message("Wide").expect("there");
        assert_eq!((message.id, message.extended, message.length), (5, true, 8));
        let signal = |name: &str| message.signals[name].signal.clone().expect("valid");
        let data = [0x02, 0xff, 0xfe, 0, 0, 0, 0, 0];
        assert_eq!(signal("x").value(&data), Some(-2.0 * 0.5 + 3.0));
        assert_eq!(signal("x").value(&[0x03, 0xff, 0xfe, 0, 0, 0, 0, 0]), None);
        let mut data = [3, 9, 0, 0, 0, 0, 0, 0];
        data[4..].copy_from_slice(&f32::to_le_bytes(-1.5));
        assert_eq!(signal("f").value(&data), Some(-1.5));
        // Multiplexed by a multiplexed multiplexor: both must select it.
        data[4] = 2;
        data[5..].fill(0);
        assert_eq!(signal("y").value(&data), Some(9.0));
        data[4] = 3;
        assert_eq!(signal("y").value(&data), None);
        data[4] = 7;
        assert_eq!(signal("y").value(&data), Some(9.0));
        data[0] = 2;
        assert_eq!(signal("y").value(&data), None);
        let error = message.signals["out"].signal.clone().expect_err("beyond the end");
        assert_eq!(error.to_string(), "8 bits from bit 60 on do not fit into 8 bytes");
    }

    #[test]
    fn nonsense_is_refused_without_a_panic() {
        assert!(matches!(
            Database::parse("BO_ hello"),
            Err(DbcError::Syntax { line: 1 })
        ));
        let after = format!("{TEXT}\n\n\n\nroot:x:0:0\n");
        let line = after.lines().count();
        assert_eq!(Database::parse(&after), Err(DbcError::Syntax { line }));
        let twice = TEXT
            .replace(" y m0 ", " x m0 ")
            .replace("SG_MUL_VAL_ 2147483653 y", "SG_MUL_VAL_ 2147483653 x");
        let database = Database::parse(&twice).expect("valid but for its signal");
        let message = database.message("Wide").expect("there");
        assert_eq!(message.signals["x"].signal, Err(DbcError::Twice));
        assert!(message.signals["f"].signal.is_ok());
        for cut in 0..TEXT.len() {
            // Whatever it says.
            let _ = Database::parse(&TEXT[..cut]);
            let _ = Database::parse(&TEXT[cut..]);
        }
    }
}
