//! Files made to fill the memory of whoever reads them: requirement S-8 of `docs/safety.md`.
//!
//! What reading one may take is a small multiple of its longest record, however much of the same it holds.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeMap;
use std::io::Cursor;

use hmd_core::frame::BusNames;
use hmd_core::record::{RawBatch, Record};
use hmd_storage::mcap::McapFrames;
use hmd_storage::recover::{Recovered, recover};
use mcap::records::{MessageHeader, Metadata};
use mcap::{WriteOptions, Writer};
use prost::Message;

use crate::ALONE;
use crate::counting_allocator::most_held_bytes;

const MIB: usize = 1 << 20;
/// Length of the longest record or chunk of each file.
const RECORD: usize = 8 * MIB;
/// The record, its content twice (as expanded, and for reading), a copy of the definition or message in hand, and all
/// that is bounded by itself.
const MOST_HELD: usize = 4 * RECORD + 8 * MIB;

fn writer() -> Writer<Cursor<Vec<u8>>> {
    let zstd = Some(mcap::Compression::Zstd);
    let options = WriteOptions::new()
        .chunk_size(None)
        .compression(zstd)
        .compression_threads(0);
    options.create(Cursor::new(Vec::new())).unwrap()
}

fn finished(mut writer: Writer<Cursor<Vec<u8>>>) -> Vec<u8> {
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn put(writer: &mut Writer<Cursor<Vec<u8>>>, channel_id: u16, data: &[u8]) {
    let header = MessageHeader {
        channel_id,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer.write_to_known_channel(&header, data).unwrap();
}

/// Chunk after chunk defines another schema, each as long as a record may well be, and uses it.
fn many_large_schemas() -> Vec<u8> {
    let mut writer = writer();
    for n in 0..6 {
        let schema = writer.add_schema("a", "protobuf", &vec![n; RECORD]).unwrap();
        let topic = format!("/{n}");
        let channel = writer
            .add_channel(schema, &topic, "protobuf", &BTreeMap::new())
            .unwrap();
        put(&mut writer, channel, b"");
        writer.flush().unwrap();
    }
    finished(writer)
}

/// A map of as many and as small entries as fit.
fn small_entries(bytes: usize) -> BTreeMap<String, String> {
    (0..bytes / 14).map(|n| (format!("{n:06x}"), String::new())).collect()
}

fn a_channel_with_many_entries() -> Vec<u8> {
    let mut writer = writer();
    let entries = small_entries(RECORD);
    let channel = writer.add_channel(0, "/a", "protobuf", &entries).unwrap();
    put(&mut writer, channel, b"");
    finished(writer)
}

fn metadata(count: usize, bytes: usize) -> Vec<u8> {
    let mut writer = writer();
    let mut metadata = Metadata {
        name: "a".to_owned(),
        metadata: small_entries(bytes),
    };
    hmd_core::metadata_checksum::seal("a", &mut metadata.metadata);
    for _ in 0..count {
        writer.write_metadata(&metadata).unwrap();
    }
    finished(writer)
}

fn a_chunk_of_tiny_messages() -> Vec<u8> {
    let mut writer = writer();
    let channel = writer.add_channel(0, "/a", "protobuf", &BTreeMap::new()).unwrap();
    for _ in 0..RECORD / 31 {
        put(&mut writer, channel, b"");
    }
    finished(writer)
}

/// A raw batch whose arrays take eight times as much decoded, and its frames far more.
fn a_huge_batch() -> Vec<u8> {
    let mut writer = writer();
    let schema = RawBatch::descriptor().encode_to_vec();
    let schema = writer.add_schema(RawBatch::SCHEMA_NAME, "protobuf", &schema).unwrap();
    let channel = writer.add_channel(schema, "/bus/can0/raw", "protobuf", &BTreeMap::new());
    let count = RECORD / 4;
    let batch = RawBatch {
        interface: "can0".to_owned(),
        stamp_step_ns: vec![1; count - 1],
        id: vec![1; count],
        flags: vec![1; count],
        length: vec![0; count],
        ..RawBatch::default()
    };
    put(&mut writer, channel.unwrap(), &batch.encode_to_vec());
    finished(writer)
}

#[test]
fn no_file_takes_more_memory_than_some_records() {
    let _alone = ALONE.lock();
    let files = [
        ("large schemas", many_large_schemas()),
        ("a channel with many entries", a_channel_with_many_entries()),
        ("many metadata records", metadata(100, MIB / 2)),
        ("a large metadata record", metadata(1, RECORD)),
        ("tiny messages", a_chunk_of_tiny_messages()),
        ("a huge batch", a_huge_batch()),
    ];
    for (name, file) in &files {
        // The copy is written to nowhere: it is no part of what is read.
        let (most, (_, report)) = most_held_bytes(|| recover(Cursor::new(file), name, std::io::empty(), "").unwrap());
        println!("{name}: {} MiB of file, recover {} MiB", file.len() / MIB, most / MIB);
        assert!(most < MOST_HELD, "{name}: {} MiB", most / MIB);
        let (most, _) = most_held_bytes(|| {
            McapFrames::new(Cursor::new(file), name, BusNames::new())
                .unwrap()
                .count()
        });
        println!("{name}: frames {} MiB", most / MIB);
        assert!(most < MOST_HELD, "{name}: {} MiB", most / MIB);
        check(name, &report);
    }
}

/// Nothing is left out untold.
fn check(name: &str, report: &Recovered) {
    let said: Vec<_> = report.losses.iter().map(|loss| loss.fault.to_string()).collect();
    let (lost, kept) = match name {
        "large schemas" => (6, 6),
        "a channel with many entries" => (1, 0),
        "many metadata records" => (99, 0),
        "a large metadata record" => (1, 0),
        "tiny messages" => (0, (RECORD / 31) as u64),
        _ => (0, 1),
    };
    assert_eq!((report.losses_total, report.messages), (lost, kept), "{name}: {said:?}");
}
