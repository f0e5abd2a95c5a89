//! The summary at the end of an MCAP file: a second copy of the channels.

use super::channels::ChannelTable;
use super::chunk::read_some;
use super::limits::{DEFINITION_BYTES_MAX, DEFINITIONS_MAX, RECORD_BYTES_MAX};
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::{self, Read, Seek, SeekFrom};

/// Reads the definitions of the summary, from the end of the file; `None` when it is not there, not intact, or
/// defines more than is held.
pub(super) fn read_summary<R: Read + Seek>(input: &mut R) -> io::Result<Option<ChannelTable>> {
    // Data end (13 bytes) precedes the summary; footer (9 + 20) and magic (8) end the file.
    const DATA_END: u64 = 13;
    const FOOTER: u64 = 37;
    let length = input.seek(SeekFrom::End(0))?;
    if length < FOOTER + DATA_END {
        return Ok(None);
    }
    input.seek(SeekFrom::Start(length - FOOTER))?;
    let mut footer = [0; FOOTER as usize];
    input.read_exact(&mut footer)?;
    let mut field = [0; 8];
    field.copy_from_slice(&footer[9..17]);
    let start = u64::from_le_bytes(field);
    let has_crc = footer[25..29] != [0; 4];
    let size = length.saturating_sub(start);
    if footer[0] != op::FOOTER || !has_crc || start < DATA_END || size < FOOTER || size > RECORD_BYTES_MAX as u64 {
        return Ok(None);
    }
    input.seek(SeekFrom::Start(start - DATA_END))?;
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        // A chunk there is not expanded: it has no limit, and nothing in it is wanted.
        .with_emit_chunks(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    let mut reader = LinearReader::new_with_options(options);
    // Nothing is parsed before the whole summary has passed its checksum.
    let mut kept = Vec::new();
    let mut kept_bytes = 0;
    while let Some(event) = reader.next_event() {
        match event {
            Err(_) => return Ok(None),
            Ok(LinearReadEvent::ReadRequest(need)) => read_some(input, &mut reader, need)?,
            Ok(LinearReadEvent::Record {
                opcode: opcode @ (op::SCHEMA | op::CHANNEL),
                data,
            }) => {
                kept_bytes += data.len();
                if kept.len() == DEFINITIONS_MAX || kept_bytes > DEFINITION_BYTES_MAX {
                    return Ok(None);
                }
                kept.push((opcode, data.to_vec()));
            }
            Ok(LinearReadEvent::Record { .. }) => {}
        }
    }
    let mut definitions = ChannelTable::default();
    for (opcode, data) in kept {
        if definitions.add(opcode, &data).is_err() {
            return Ok(None);
        }
    }
    Ok(Some(definitions))
}
