//! Changes of an MCAP file that keep it one: records are changed, repeated, removed and exchanged, at the top and within chunks; lengths
//! and checksums follow, and the footer tells where the summary begins, so that a change gets behind what they guard.

use rand::rngs::SmallRng;
use rand::{Rng, RngExt, SeedableRng};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const FOOTER: u8 = 2;
const CHUNK: u8 = 6;
const DATA_END: u8 = 15;
/// Start and end, length and checksum of a chunk's content, before the name of its compression.
const CHUNK_TIMES: usize = 16;
const CHUNK_HEAD: usize = 28;
/// Most bytes that a chunk expands to here.
const EXPANDED_MAX: usize = 1 << 20;
/// Bytes by which a content may grow.
const GROWTH: usize = 64;

struct Record {
    opcode: u8,
    content: Vec<u8>,
}

/// Changes the file in `data[..size]`; how many bytes it has then.
pub fn mutate(data: &mut [u8], size: usize, max_size: usize, seed: u32) -> usize {
    let mut rng = SmallRng::seed_from_u64(seed.into());
    let records = data[..size].strip_prefix(MAGIC).map(read);
    let Some(mut records) = records.filter(|records| !records.is_empty() && rng.random_ratio(7, 8)) else {
        return libfuzzer_sys::fuzzer_mutate(data, size, max_size);
    };
    let at = rng.random_range(0..records.len());
    match opened(&records[at]) {
        Some(mut inner) if !inner.is_empty() => {
            change(&mut inner, &mut rng);
            close(&mut records[at], &inner);
        }
        _ => change(&mut records, &mut rng),
    }
    if rng.random_ratio(7, 8) {
        // Behind the last record of data, or before any other: a summary of whatever stands there.
        let data = records.iter().position(|record| record.opcode == DATA_END);
        let any = rng.random_range(0..records.len().max(1));
        let first = data.map(|end| end + 1).filter(|_| rng.random_ratio(7, 8)).unwrap_or(any);
        begin_summary(&mut records, first);
    }
    let mut file = MAGIC.to_vec();
    write(&mut file, &records);
    if rng.random_ratio(7, 8) {
        file.extend(MAGIC);
    }
    let size = file.len().min(max_size);
    data[..size].copy_from_slice(&file[..size]);
    size
}

fn change(records: &mut Vec<Record>, rng: &mut impl Rng) {
    let at = rng.random_range(0..records.len());
    let other = rng.random_range(0..records.len());
    match rng.random_range(0..10) {
        0 => drop(records.remove(at)),
        1 => records.swap(at, other),
        2 => {
            let (opcode, content) = (records[at].opcode, records[at].content.clone());
            records.insert(other, Record { opcode, content });
        }
        3 => records[at].opcode = rng.random_range(0..=16),
        _ => {
            let content = &mut records[at].content;
            let size = content.len();
            content.resize(size + GROWTH, 0);
            let size = libfuzzer_sys::fuzzer_mutate(content, size, size + GROWTH);
            content.truncate(size);
        }
    }
}

/// Lets the last footer say that the summary begins with this record; it gives no checksum.
fn begin_summary(records: &mut [Record], first: usize) {
    let bytes = |record: &Record| 9 + record.content.len() as u64;
    let start = MAGIC.len() as u64 + records.iter().take(first).map(bytes).sum::<u64>();
    if let Some(footer) = records.iter_mut().rev().find(|record| record.opcode == FOOTER) {
        // Start of the summary, start of its offsets, checksum.
        footer.content = start.to_le_bytes().to_vec();
        footer.content.resize(20, 0);
    }
}

/// Records, as far as they go.
fn read(mut bytes: &[u8]) -> Vec<Record> {
    let mut records = Vec::new();
    while let Some((head, rest)) = bytes.split_first_chunk::<9>() {
        let [_, length @ ..] = *head;
        let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
        let Some((content, rest)) = rest.split_at_checked(length) else {
            break;
        };
        records.push(Record {
            opcode: head[0],
            content: content.to_vec(),
        });
        bytes = rest;
    }
    records
}

fn write(file: &mut Vec<u8>, records: &[Record]) {
    for record in records {
        file.push(record.opcode);
        file.extend((record.content.len() as u64).to_le_bytes());
        file.extend(&record.content);
    }
}

/// The records in a chunk that is whole.
fn opened(chunk: &Record) -> Option<Vec<Record>> {
    let content = (chunk.opcode == CHUNK).then_some(&chunk.content)?;
    let name_bytes = u32::from_le_bytes(content.get(CHUNK_HEAD..CHUNK_HEAD + 4)?.try_into().ok()?) as usize;
    let name = content.get(CHUNK_HEAD + 4..)?.get(..name_bytes)?;
    let inside = content.get(CHUNK_HEAD + 4 + name_bytes + 8..)?;
    match name {
        b"" => Some(read(inside)),
        b"zstd" => Some(read(&zstd::bulk::decompress(inside, EXPANDED_MAX).ok()?)),
        _ => None,
    }
}

/// Puts records into a chunk, uncompressed: that is read fastest, and a change stays where it is.
fn close(chunk: &mut Record, records: &[Record]) {
    let mut inside = Vec::new();
    write(&mut inside, records);
    let content = &mut chunk.content;
    content.truncate(CHUNK_TIMES);
    content.extend((inside.len() as u64).to_le_bytes());
    content.extend(crc32fast::hash(&inside).to_le_bytes());
    content.extend(0_u32.to_le_bytes());
    content.extend((inside.len() as u64).to_le_bytes());
    content.extend(inside);
}
