//! Damaged recordings: whatever is cut or flipped, every intact chunk comes back and nothing else does.
//!
//! Requirements S-6 and S-7 of `docs/safety.md`. The short forms run always; `cargo xtask survive` runs the long ones.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeMap;
use std::io::Cursor;
use std::process::Command;

use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::record::{Health, Log, LogLevel};
use hmd_core::seed::mix;
use hmd_storage::mcap::McapMessages;
use hmd_storage::mcap_writer::{METADATA_NAME, McapWriter};
use hmd_storage::recover::{Recovered, count_frames, recover};

/// Frames of each chunk; with payloads that do not compress, a chunk is some 25 kB.
const FRAMES: u64 = 2000;
const CHUNKS: u64 = 4;

/// Topic, time and content of a message.
type Plain = (String, u64, Vec<u8>);

/// One chunk: where it lies in the file, and what is in it.
struct Chunk {
    start: usize,
    end: usize,
    messages: Vec<Plain>,
}

/// A finished recording of [`CHUNKS`] windows.
fn recording() -> Vec<u8> {
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let metadata = BTreeMap::from([("seed".to_owned(), "1".to_owned())]);
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), &metadata).unwrap();
    for window in 0..CHUNKS {
        for n in 0..FRAMES {
            let stamp_ns = 1_700_000_000_000_000_000 + (window * FRAMES + n) * 100_000;
            let data = mix(7, &[window, n]).to_le_bytes();
            let frame = RawFrame::new(stamp_ns, 0, 0x100, FrameFlags::NONE, &data).unwrap();
            writer.write_frame(&frame, &names).unwrap();
        }
        let health = Health {
            actuator: "ema0".to_owned(),
            window,
            ..Health::default()
        };
        writer.write(window, &health).unwrap();
        writer.flush_window().unwrap();
    }
    writer.write(9, &Log::new(9, LogLevel::Info, "hmd", "done")).unwrap();
    writer.finish().unwrap().0.into_inner()
}

fn messages(file: &[u8]) -> Vec<(usize, Plain)> {
    let messages = McapMessages::new(Cursor::new(file), "a.mcap").unwrap();
    let messages = messages.map(Result::unwrap);
    let plain = messages.map(|m| (m.at_byte as usize, (m.topic.to_string(), m.log_time_ns, m.data)));
    plain.collect()
}

fn chunks(file: &[u8]) -> Vec<Chunk> {
    let mut chunks: Vec<Chunk> = Vec::new();
    for (start, message) in messages(file) {
        if chunks.last().is_none_or(|chunk| chunk.start != start) {
            let length = u64::from_le_bytes(file[start + 1..start + 9].try_into().unwrap());
            let end = start + 9 + length as usize;
            chunks.push(Chunk {
                start,
                end,
                messages: Vec::new(),
            });
        }
        chunks.last_mut().unwrap().messages.push(message);
    }
    chunks
}

fn recovered(file: &[u8]) -> (Vec<u8>, Recovered) {
    let (out, report) = recover(Cursor::new(file), "a.mcap", Cursor::new(Vec::new()), "").unwrap();
    (out.into_inner(), report)
}

/// Recovers a damaged file; `whole` says which chunks must come back. The others come back whole or not at all.
fn check(damaged: &[u8], chunks: &[Chunk], whole: impl Fn(&Chunk) -> bool, what: &str) -> Recovered {
    let (copy, report) = recovered(damaged);
    let mut found = messages(&copy).into_iter().map(|(_, message)| message).peekable();
    for chunk in chunks {
        if found.peek() == chunk.messages.first() {
            let all = found.by_ref().take(chunk.messages.len());
            assert!(all.eq(chunk.messages.iter().cloned()), "{what}: a part of a chunk");
        } else {
            assert!(!whole(chunk), "{what}: the chunk at {} is lost", chunk.start);
        }
    }
    assert_eq!(found.next(), None, "{what}: something that was not recorded");
    let metadata = McapMessages::new(Cursor::new(&copy), "copy").unwrap();
    let (mut metadata, mut any) = (metadata, false);
    while metadata.next().is_some() {
        any = true;
    }
    if let Some(found) = metadata.metadata(METADATA_NAME) {
        assert_eq!(found["seed"], "1", "{what}: metadata");
    }
    assert_eq!(any, report.messages > 0);
    report
}

fn check_cut(file: &[u8], chunks: &[Chunk], end: usize) {
    let what = format!("cut at {end}");
    let report = check(&file[..end], chunks, |chunk| chunk.end <= end, &what);
    assert!(!report.is_intact(), "{what}: not noticed");
}

/// Flips `bits` at `at` of a finished file.
fn check_flip(file: &[u8], chunks: &[Chunk], data_end: usize, at: usize, bits: u8) {
    let what = format!("byte {at} flipped by {bits:#04x}");
    let mut damaged = file.to_vec();
    damaged[at] ^= bits;
    let report = check(&damaged, chunks, |chunk| !(chunk.start..chunk.end).contains(&at), &what);
    // Behind the data stands nothing that is needed while they are whole.
    assert!(at >= data_end || !report.is_intact(), "{what}: not noticed");
}

/// The same in a file that was cut at `end`, so that it has no summary: `at` is before the cut.
fn check_flip_of_cut(file: &[u8], chunks: &[Chunk], end: usize, at: usize, bits: u8) {
    let what = format!("cut at {end}, and byte {at} flipped by {bits:#04x}");
    let mut damaged = file[..end].to_vec();
    damaged[at] ^= bits;
    let is_hit = |chunk: &Chunk| (chunk.start..chunk.end).contains(&at);
    let report = check(&damaged, chunks, |chunk| chunk.end <= end && !is_hit(chunk), &what);
    let mut there = chunks.iter().filter(|chunk| chunk.end <= end);
    let lost = there.clone().map(|chunk| chunk.messages.len() as u64).sum::<u64>() > report.messages;
    // The last one, hit in its length, looks like a torn one.
    let is_inner = there.clone().any(is_hit) && !there.next_back().is_some_and(is_hit);
    let least = 1 + u64::from(lost && is_inner);
    assert!(
        report.losses_total >= least,
        "{what}: not reported, {:?}",
        report.losses
    );
}

/// Where the data section ends: behind the last chunk and its message indexes.
fn data_end(file: &[u8], chunks: &[Chunk]) -> usize {
    let mut at = chunks.last().unwrap().end;
    while file[at] != mcap::records::op::DATA_END {
        at += 9 + u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    at
}

fn flips(file: &[u8], count: u64) {
    let chunks = chunks(file);
    let data_end = data_end(file, &chunks);
    for n in 0..count {
        let draw = mix(11, &[n]);
        let bits = 1 << (draw % 8);
        check_flip(file, &chunks, data_end, (draw / 8) as usize % file.len(), bits);
        check_flip_of_cut(file, &chunks, data_end, (draw / 8) as usize % data_end, bits);
        let end = 8 + (mix(13, &[n]) as usize) % (data_end - 8);
        check_flip_of_cut(file, &chunks, end, (draw / 8) as usize % end, bits);
    }
}

#[test]
fn a_whole_file_is_kept_whole() {
    let file = recording();
    let (copy, report) = recovered(&file);
    assert!(report.is_intact(), "{report:?}");
    assert_eq!(
        (report.chunks, report.metadata),
        (CHUNKS + 2, 1),
        "and those of the first health record and of the log line, which begin with a definition"
    );
    let plain = |file| {
        messages(file)
            .into_iter()
            .map(|(_, message)| message)
            .collect::<Vec<_>>()
    };
    assert_eq!(plain(&copy), plain(&file));
    assert_eq!(count_frames(Cursor::new(copy), "copy").unwrap(), (CHUNKS * FRAMES, 0));
}

#[test]
fn a_cut_costs_the_torn_chunk_alone() {
    let file = recording();
    let chunks = chunks(&file);
    assert!(file.len() >= 64 << 10 && chunks.len() >= 3);
    let near = |end: usize| {
        chunks
            .iter()
            .any(|chunk| chunk.end.abs_diff(end) < 16 || chunk.start.abs_diff(end) < 16)
    };
    for end in (8..file.len()).filter(|end| near(*end) || end % 997 == 0 || *end > file.len() - 64) {
        check_cut(&file, &chunks, end);
    }
}

#[test]
fn a_flip_costs_its_chunk_alone() {
    flips(&recording(), 200);
}

/// The lengths, which nothing vouches for, are where a flip leads astray: every byte around the chunks.
#[test]
fn a_flipped_length_costs_its_chunk_alone() {
    let file = recording();
    let chunks = chunks(&file);
    let data_end = data_end(&file, &chunks);
    let between = |at: usize| !chunks.iter().any(|chunk| (chunk.start + 64..chunk.end).contains(&at));
    for at in (8..data_end)
        .filter(|at| between(*at))
        .filter(|at| at % 3 == 0 || *at < 200)
    {
        check_flip(&file, &chunks, data_end, at, 1 << (at % 8));
        check_flip_of_cut(&file, &chunks, data_end, at, 1 << (at % 8));
    }
}

/// The chunk that defines the channels, lost from a file without a summary: the metadata record stands in for it.
#[test]
fn the_definitions_outlive_their_chunk() {
    let file = recording();
    let chunks = chunks(&file);
    let data_end = data_end(&file, &chunks);
    for chunk in &chunks {
        for at in [
            chunk.start,
            chunk.start + 2,
            chunk.start + 30,
            chunk.start + 60,
            chunk.end - 1,
        ] {
            check_flip_of_cut(&file, &chunks, data_end, at, 0x10);
        }
    }
    // Every copy: the later chunks cannot be named, and that is reported.
    let mut damaged = file[..data_end].to_vec();
    let copies: Vec<usize> = (0..data_end - 11)
        .filter(|at| file[*at..].starts_with(b"hmd-channel"))
        .collect();
    for at in copies {
        damaged[at + 30] ^= 1;
    }
    damaged[chunks[0].start + 100] ^= 1;
    let (_, report) = recovered(&damaged);
    let text: Vec<_> = report.losses.iter().map(|loss| loss.fault.to_string()).collect();
    assert!(
        text.iter()
            .any(|text| text.contains("expected metadata with a checksum")),
        "{text:?}"
    );
    assert!(text.iter().any(|text| text.contains("unknown channel 1")), "{text:?}");
}

/// A block of a disk, wherever it lies, in a file without a summary. Where it takes the first two copies of a definition,
/// what comes before the third one is reported as unknown; that is at the first sync when 8 KiB have been written.
#[test]
fn a_lost_block_costs_the_chunks_that_it_touches() {
    const THIRD_COPY: usize = 8192 + 25_000;
    let file = recording();
    let chunks = chunks(&file);
    let data_end = data_end(&file, &chunks);
    for block in [512, 4096] {
        for from in (0..data_end).step_by(block).skip(1) {
            let to = (from + block).min(data_end);
            let mut damaged = file[..data_end].to_vec();
            damaged[from..to].fill(0);
            let (copy, report) = recovered(&damaged);
            assert!(!report.is_intact());
            let found = messages(&copy);
            let apart = |chunk: &&Chunk| chunk.end <= from || chunk.start >= to + THIRD_COPY;
            for chunk in chunks.iter().filter(apart) {
                for message in &chunk.messages {
                    assert!(
                        found.iter().any(|(_, kept)| kept == message),
                        "{block} bytes at {from}: {}",
                        message.0
                    );
                }
            }
        }
    }
}

/// Other programs number the channels anew and keep the metadata: below their header a copy is not believed.
#[test]
fn a_copied_definition_counts_only_below_our_header() {
    let file = recording();
    let chunks = chunks(&file);
    let data_end = data_end(&file, &chunks);
    let mut damaged = file[..data_end].to_vec();
    damaged[chunks[0].start + 100] ^= 1;
    let at = damaged.windows(4).position(|bytes| bytes == b"hmd/").unwrap();
    damaged[at..at + 4].copy_from_slice(b"xmd/");
    let (copy, _) = recovered(&damaged);
    assert!(messages(&copy).iter().all(|(_, (topic, ..))| topic != "/bus/can0/raw"));
}

#[test]
#[ignore = "long form: cargo xtask survive"]
fn a_cut_at_each_byte() {
    let file = recording();
    let chunks = chunks(&file);
    for end in 8..file.len() {
        check_cut(&file, &chunks, end);
    }
    eprintln!("{} cuts of {} chunks", file.len() - 8, chunks.len());
}

#[test]
#[ignore = "long form: cargo xtask survive"]
fn ten_thousand_flips() {
    flips(&recording(), 10_000);
}

/// An index taken for the end of the data by its opcode alone hides that it is damaged: found by the long form.
#[test]
fn an_index_that_looks_like_the_end_is_noticed() {
    let file = recording();
    let chunks = chunks(&file);
    let data_end = data_end(&file, &chunks);
    for chunk in &chunks {
        assert_eq!(file[chunk.end], mcap::records::op::MESSAGE_INDEX);
        check_flip(&file, &chunks, data_end, chunk.end, 0x08);
    }
}

/// Two recordings in one file, and rubbish before, between and behind: the chunks of all come out.
#[test]
fn rubbish_around_the_chunks_is_passed() {
    let file = recording();
    let chunks = chunks(&file);
    let rubbish: Vec<u8> = (0..5000).map(|n| mix(5, &[n]) as u8).collect();
    let mut damaged = file[..chunks[0].end].to_vec();
    for chunk in &chunks[1..] {
        damaged.extend(&rubbish);
        damaged.extend(&file[chunk.start..chunk.end]);
    }
    damaged.extend(&rubbish);
    let report = check(&damaged, &chunks, |_| true, "rubbish between all chunks");
    assert_eq!(report.chunks, chunks.len() as u64);
    assert!(!report.is_intact());
}

/// A file made to keep the search busy: nothing but heads of chunks that promise megabytes.
#[test]
fn a_hostile_file_is_given_up_in_bounded_time() {
    let mut file = mcap::MAGIC.to_vec();
    let total = 4 << 20;
    while file.len() < total {
        let length = (total - file.len()) as u64;
        file.push(mcap::records::op::CHUNK);
        file.extend(length.to_le_bytes());
        file.extend([0; 16]);
        file.extend((1_u64 << 20).to_le_bytes());
        file.extend(1_u32.to_le_bytes());
        file.extend(0_u32.to_le_bytes());
        file.extend((length - 40).to_le_bytes());
    }
    file.resize(2 * total, 0);
    let since = std::time::Instant::now();
    let (_, report) = recovered(&file);
    assert_eq!(report.messages, 0);
    assert!(!report.is_intact());
    assert!(since.elapsed().as_secs() < 60, "{:?}", since.elapsed());
}

#[test]
fn the_verb_says_what_is_lost_and_exits_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let [log, out] = ["cut.mcap", "out.mcap"].map(|name| folder.path().join(name));
    let file = recording();
    let run = |args: &[&std::path::Path]| {
        let output = Command::new(env!("CARGO_BIN_EXE_hmd"))
            .arg("recover")
            .args(args)
            .output()
            .unwrap();
        let text = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        (output.status.code(), text)
    };
    let dash_o = std::path::Path::new("-o");

    std::fs::write(&log, &file).unwrap();
    let (code, [summary, lost]) = run(&[&log, dash_o, &out]);
    assert_eq!((code, lost.as_str()), (Some(0), ""), "{summary}");
    assert!(
        summary.contains("kept 6 chunks with 9 messages and 8000 raw frames, and 1 metadata record"),
        "{summary}"
    );

    let mut damaged = file[..file.len() - 9].to_vec();
    damaged[chunks(&file)[2].start + 500] ^= 1;
    std::fs::write(&log, &damaged).unwrap();
    let (code, [summary, lost]) = run(&[&log, dash_o, &out]);
    assert_eq!(code, Some(3), "{summary}{lost}");
    assert!(summary.contains("kept 5 chunks"), "{summary}");
    assert!(lost.contains("2000 raw frames missing"), "{lost}");
    // The copy is whole; the page of it says that the recording is not.
    let page = folder.path().join("page.html");
    let report = Command::new(env!("CARGO_BIN_EXE_hmd"))
        .arg("report")
        .args([out.as_path(), dash_o, page.as_path()])
        .output()
        .unwrap();
    assert!(report.status.success(), "{}", String::from_utf8_lossy(&report.stderr));
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(page.contains("Parts of a recording are missing or damaged"), "{page}");

    let (code, [_, text]) = run(&[&log, dash_o, &log]);
    assert_eq!(code, Some(2), "{text}");
    std::fs::write(&log, b"rubbish").unwrap();
    let (code, [_, text]) = run(&[&log, dash_o, &out]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("expected an intact chunk, found none"), "{text}");
}
