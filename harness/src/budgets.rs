//! What bounds work, memory and what others are given to read.

use crate::{FEW, MANY, for_any};
use hmd_storage::recover::recover;
use hmd_storage::retry_delay::RetryDelay;
use hmd_storage::segment_store::is_segment_name;
use hmd_storage::{no_formula, printable, quoted};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::time::Duration;

/// No file is expanded beyond its budget, and what is beyond is reported.
///
/// Up to 40 chunks of up to 60 MiB of zeros.
#[test]
fn expansion_is_bounded_by_the_size_of_the_file() {
    let zeros = vec![0; 60 << 20];
    for_any!(2, |input: (u8, u8)| {
        let (chunks, mib) = (1 + input.0 % 40, 1 + usize::from(input.1 % 60));
        let options = mcap::WriteOptions::new().chunk_size(Some(1));
        let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
        let schema = writer.add_schema("a", "protobuf", &[]).unwrap();
        let channel_id = writer.add_channel(schema, "/a", "protobuf", &BTreeMap::new()).unwrap();
        for sequence in 0..u32::from(chunks) {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence,
                log_time: 1,
                publish_time: 1,
            };
            writer.write_to_known_channel(&header, &zeros[..mib << 20]).unwrap();
            writer.flush().unwrap();
        }
        writer.finish().unwrap();
        let file = writer.into_inner().into_inner();
        let (_, report) = recover(Cursor::new(&file), "a.mcap", std::io::empty(), "").unwrap();
        let limit = 2500 * file.len() as u64 + (128 << 20);
        assert!(report.expanded_bytes <= limit, "{} of {limit}", report.expanded_bytes);
        assert!(report.is_given_up || report.messages == u64::from(chunks), "{report:?}");
    });
}

/// Pauses between attempts never fall and stay within their bounds.
///
/// 2^17 attempts, where the number of attempts saturates long before; exhaustive.
#[test]
fn pauses_stay_within_their_bounds() {
    let longest = Duration::from_millis(250);
    let (mut pause, mut before) = (RetryDelay::up_to(longest), RetryDelay::SHORTEST);
    for _ in 0..1 << 17 {
        let next = pause.next_delay();
        assert!(before <= next && next <= longest);
        before = next;
    }
}

/// No text that is printed is obeyed by a terminal, and harmless text stays.
///
/// All characters; exhaustive.
#[test]
fn printed_characters_are_not_obeyed() {
    for character in char::MIN..=char::MAX {
        let text = character.to_string();
        let printed = printable(&text);
        assert!(!printed.chars().any(char::is_control), "{character:?}");
        assert!(
            character.is_control() || !character.is_alphanumeric() || printed == text,
            "{character:?}"
        );
    }
}

/// Bytes that are quoted in a message are few and printable.
///
/// Any 80 bytes.
#[test]
fn quoted_bytes_are_printable() {
    for_any!(MANY, |input: ([u8; 32], [u8; 32], [u8; 16], u8)| {
        let bytes = [&input.0[..], &input.1, &input.2].concat();
        let text = quoted(&bytes[..usize::from(input.3) % 81]);
        assert!(
            text.chars().all(|c| c == '…' || c.is_ascii_graphic() || c == ' '),
            "{text:?}"
        );
        assert!(text.len() <= 4 * 32 + '…'.len_utf8());
    });
}

/// No cell of a table is a formula.
///
/// All first characters; exhaustive.
#[test]
fn no_cell_is_a_formula() {
    for character in char::MIN..=char::MAX {
        let cell = format!("{character}1+1");
        assert!(
            !no_formula(&cell).starts_with(['=', '+', '-', '@', '\t', '\r']),
            "{character:?}"
        );
    }
}

/// A name of a segment has its form; any other text has not.
///
/// Any change of one character of a segment's name.
#[test]
fn names_of_segments() {
    const NAME: &str = "hmd-00000012-records.mcap.part";
    assert!(is_segment_name(NAME));
    for_any!(FEW * 10, |input: (u8, char)| {
        let at = usize::from(input.0) % NAME.len();
        let name: String = NAME
            .chars()
            .enumerate()
            .map(|(n, c)| if n == at { input.1 } else { c })
            .collect();
        let is_digit = (4..12).contains(&at) && input.1.is_ascii_digit();
        assert_eq!(is_segment_name(&name), is_digit || name == NAME, "{name}");
    });
}
