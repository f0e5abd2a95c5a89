use super::*;
use crate::mcap_writer::{METADATA_NAME, McapWriter, ROUND_FRAMES};
use crate::recover::recover;
use crate::schema_copy::LIBRARY_START;
use ::mcap::records::op;
use ema_models::FaultId;
use hmd_core::frame::FrameFlags;
use hmd_core::record::{
    ActuatorStatus, Dropped, Estimate, Health, InterfaceStatus, Log, LogLevel, Rul, Status, Window,
};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::io::Cursor;

fn two_buses() -> BusNames {
    let mut names = BusNames::new();
    for name in ["vcan0", "vcan1"] {
        names.intern(name).unwrap();
    }
    names
}

/// `count` frames on two buses, with a step back of the clock and every kind of frame.
fn frames(count: u64) -> Vec<RawFrame> {
    let mut stamp_ns = 1_700_000_000_000_000_000;
    (0..count)
        .map(|i| {
            stamp_ns = if i == 17 {
                stamp_ns - 5_000_000
            } else {
                stamp_ns + 1000 * (1 + i % 7)
            };
            let data = i.wrapping_mul(0x9E37_79B9_7F4A_7C15).to_le_bytes();
            let (id, flags, data) = match i % 11 {
                3 => (0x1234_5678, FrameFlags::EXTENDED, &data[..5]),
                5 => (0x80, FrameFlags::ERROR, &data[..]),
                7 => (0x321, FrameFlags::REMOTE, &data[..4]),
                9 => (
                    0x108,
                    FrameFlags::FD.union(FrameFlags::BIT_RATE_SWITCH),
                    &[data, [7; 8]].concat()[..12],
                ),
                _ => (0x100 + (i % 4) as u32, FrameFlags::NONE, &data[..]),
            };
            RawFrame::new(stamp_ns, u16::from(i > 0 && (i / 3) % 3 == 0), id, flags, data).unwrap()
        })
        .collect()
}

/// A recording with a chunk per `per_window` frames, each ended by a health record; the first of those is in a chunk of
/// its own, the second one, because it begins with a definition.
fn record(frames: &[RawFrame], per_window: usize, finish: bool) -> Vec<u8> {
    let metadata = BTreeMap::from([("seed".to_owned(), "1".to_owned())]);
    let mut out = Cursor::new(Vec::new());
    let mut writer = McapWriter::new(&mut out, &metadata).unwrap();
    for (window, part) in frames.chunks(per_window).enumerate() {
        for frame in part {
            writer.write_frame(frame, &two_buses()).unwrap();
        }
        let last = part[part.len() - 1].stamp_ns;
        let health = Health {
            actuator: "ema0".to_owned(),
            window: window as u64,
            ..Health::default()
        };
        writer.write(last, &health).unwrap();
        writer.flush_window().unwrap();
    }
    writer
        .write(
            0,
            &Status {
                frames_received: frames.len() as u64,
                ..Status::default()
            },
        )
        .unwrap();
    if finish {
        writer.write(0, &Log::new(0, LogLevel::Info, "hmd", "done")).unwrap();
        writer.finish().unwrap();
        return out.into_inner();
    }
    // A killed process: what was flushed is there, nothing else.
    writer.flush_window().unwrap();
    let (written, counts) = writer.finish().unwrap();
    assert_eq!(counts.frames, frames.len() as u64);
    let length = chunks(written.get_ref()).last().map_or(0, |chunk| chunk.1);
    written.get_ref()[..length].to_vec()
}

/// Start and end of every chunk.
fn chunks(file: &[u8]) -> Vec<(usize, usize)> {
    let mut at = ::mcap::MAGIC.len();
    let mut chunks = Vec::new();
    while let Some(head) = file.get(at..at + 9) {
        let end = at + 9 + u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
        if head[0] == ::mcap::records::op::CHUNK {
            chunks.push((at, end));
        }
        if head[0] == ::mcap::records::op::DATA_END {
            break;
        }
        at = end;
    }
    chunks
}

/// Place of the record that ends the data section.
fn data_end(file: &[u8]) -> usize {
    let mut at = ::mcap::MAGIC.len();
    while file[at] != ::mcap::records::op::DATA_END {
        at += 9 + u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    at
}

fn read(file: &[u8]) -> (Vec<RawFrame>, Vec<McapLoss>) {
    let (mut frames, mut losses) = (Vec::new(), Vec::new());
    for item in McapFrames::new(Cursor::new(file), "a.mcap", BusNames::new()).unwrap() {
        match item {
            Ok(frame) => frames.push(frame),
            Err(loss) => losses.push(loss),
        }
    }
    (frames, losses)
}

fn is_part_of(part: &[RawFrame], whole: &[RawFrame]) -> bool {
    let mut rest = whole.iter();
    part.iter().all(|frame| rest.any(|other| other == frame))
}

#[test]
fn frames_of_all_buses_come_back_in_their_order() {
    // More than two rounds in one window.
    let frames = frames(3 * ROUND_FRAMES as u64 / 2 * 3);
    assert_eq!(read(&record(&frames, frames.len(), true)), (frames, Vec::new()));
}

/// A record of the format.
fn bytes_of_record(opcode: u8, content: &[u8]) -> Vec<u8> {
    [&[opcode], &(content.len() as u64).to_le_bytes()[..], content].concat()
}

/// 193 bytes that ended every reader, and the daemon at each start: the crate expanded the chunk and subtracted with overflow.
#[test]
fn a_chunk_in_the_summary_is_not_expanded() {
    let inner = [5];
    let chunk = [
        &[0; 16][..],
        &1_u64.to_le_bytes(),
        &5_u32.to_le_bytes(),
        &0_u32.to_le_bytes(),
        &1_u64.to_le_bytes(),
        &inner,
    ]
    .concat();
    let header = [&0_u32.to_le_bytes()[..], &9_u32.to_le_bytes(), b"hmd/0.1.0"].concat();
    let data = [
        ::mcap::MAGIC,
        &bytes_of_record(op::HEADER, &header),
        &bytes_of_record(op::DATA_END, &[0; 4]),
    ]
    .concat();
    let footer = [
        &(data.len() as u64).to_le_bytes()[..],
        &[0; 8],
        &0x1234_u32.to_le_bytes(),
    ]
    .concat();
    let file = [
        data.as_slice(),
        &bytes_of_record(op::CHUNK, &chunk),
        &bytes_of_record(op::STATISTICS, &[]),
        &bytes_of_record(op::STATISTICS, &[0; 30]),
        &bytes_of_record(op::FOOTER, &footer),
        ::mcap::MAGIC,
    ]
    .concat();
    let (frames, _) = read(&file);
    assert!(frames.is_empty());
}

/// The copy has one channel of them, and the first header, so that its numbers must go on rising. Found by fuzzing.
#[test]
fn of_two_channels_of_one_topic_a_number_is_kept_once_whatever_a_second_header_says() {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let channel = |id: u16| {
        let ids = [id.to_le_bytes(), [0; 2]].concat();
        let content = [ids, text("/a"), text(""), 0_u32.to_le_bytes().to_vec()].concat();
        bytes_of_record(op::CHANNEL, &content)
    };
    let message = |id: u16| {
        let content = [&id.to_le_bytes()[..], &5_u32.to_le_bytes(), &[0; 16]].concat();
        bytes_of_record(op::MESSAGE, &content)
    };
    let inner = [channel(1), channel(2), message(1), message(2)].concat();
    let length = (inner.len() as u64).to_le_bytes();
    let checksum = crc32fast::hash(&inner).to_le_bytes();
    let chunk = [&[0; 16][..], &length, &checksum, &text(""), &length, &inner].concat();
    let header = [text(""), text(&format!("{LIBRARY_START}0.1.0"))].concat();
    let file = [
        ::mcap::MAGIC,
        &bytes_of_record(op::HEADER, &header),
        &bytes_of_record(op::HEADER, &[text(""), text("another")].concat()),
        &bytes_of_record(op::CHUNK, &chunk),
    ]
    .concat();
    let (copy, report) = recover(Cursor::new(file), "a.mcap", Cursor::new(Vec::new()), "").unwrap();
    assert_eq!(report.messages, 1);
    let copy = McapMessages::new(Cursor::new(copy.into_inner()), "copy").unwrap();
    let numbers: Result<Vec<u32>, McapLoss> = copy.map(|item| item.map(|message| message.sequence)).collect();
    assert_eq!(numbers, Ok(vec![5]));
}

/// A file of another program may count as it likes.
#[test]
fn the_sum_of_missing_frames_does_not_overflow() {
    let mut writer = ::mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema(RawBatch::SCHEMA_NAME, "protobuf", &[]).unwrap();
    let channel_id = writer
        .add_channel(schema, "/bus/can0/raw", "protobuf", &BTreeMap::new())
        .unwrap();
    let frame = RawFrame::new(0, 0, 1, FrameFlags::NONE, &[]).unwrap();
    for n in 0..131_300_u64 {
        let mut batch = RawBatch::pack("can0", n + 1, &[((n % 2) << 48, &frame)]);
        batch.first_stamp_ns = n + 1;
        let header = ::mcap::records::MessageHeader {
            channel_id,
            sequence: n as u32,
            log_time: n,
            publish_time: n,
        };
        writer.write_to_known_channel(&header, &batch.encode_to_vec()).unwrap();
    }
    writer.finish().unwrap();
    let file = writer.into_inner();
    let counted = crate::recover::count_frames(file, "a.mcap").unwrap();
    assert_eq!(counted, (131_300, u64::MAX));
}

#[test]
fn damage_in_the_middle_of_a_round_costs_no_frame_behind_it() {
    let mut writer = ::mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema(RawBatch::SCHEMA_NAME, "protobuf", &[]).unwrap();
    let frames: Vec<RawFrame> = (1..5)
        .map(|n| RawFrame::new(n, 0, n as u32, FrameFlags::NONE, &[]).unwrap())
        .collect();
    for (sequence, interface) in (0..).zip(["can0", "can1"]) {
        let topic = format!("/bus/{interface}/raw");
        let channel_id = writer
            .add_channel(schema, &topic, "protobuf", &BTreeMap::new())
            .unwrap();
        let [first, second] = [0, 2].map(|n| n + sequence as usize);
        let frames = [(first as u64, &frames[first]), (second as u64, &frames[second])];
        let batch = RawBatch::pack(interface, 1, &frames);
        let header = ::mcap::records::MessageHeader {
            channel_id,
            sequence,
            log_time: 1,
            publish_time: 1,
        };
        writer.write_to_known_channel(&header, &batch.encode_to_vec()).unwrap();
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
    let file = writer.into_inner().into_inner();
    let at = chunks(&file)[0].1;
    let bad = [&file[..at], &bytes_of_record(op::METADATA, &[9; 9]), &file[at..]].concat();
    let (read, losses) = read(&bad);
    let ids: Vec<u32> = read.iter().map(RawFrame::id).collect();
    assert_eq!(ids, [1, 2, 3, 4], "{losses:?}");
    assert!(matches!(losses[0].fault, McapFault::Metadata { .. }), "{losses:?}");
}

/// A later record of the same name, as damage may leave one, does not hide the one with a checksum.
#[test]
fn the_serial_number_is_that_of_the_newest_metadata_with_a_checksum() {
    let metadata = BTreeMap::from([("ema0.serial_number".to_owned(), "S1".to_owned())]);
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), &metadata).unwrap();
    writer.write(0, &Log::new(0, LogLevel::Info, "hmd", "done")).unwrap();
    let file = writer.finish().unwrap().0.into_inner();
    let name = METADATA_NAME.as_bytes();
    let other = [&(name.len() as u32).to_le_bytes()[..], name, &0_u32.to_le_bytes()].concat();
    let at = data_end(&file);
    let file = [&file[..at], &bytes_of_record(op::METADATA, &other), &file[at..]].concat();
    let mut messages = McapMessages::new(Cursor::new(file), "a.mcap").unwrap();
    assert_eq!(messages.by_ref().filter(Result::is_ok).count(), 1);
    assert_eq!(messages.metadata(METADATA_NAME), Some(&BTreeMap::new()));
    assert_eq!(messages.serial_number("ema0"), Some("S1"));
}

#[test]
fn a_silent_first_bus_does_not_change_the_indices() {
    let frame = frames(1)[0].with_bus(1);
    let file = record(&[frame], 1, true);
    let mut reader = McapFrames::new(Cursor::new(file), "a.mcap", BusNames::new()).unwrap();
    assert_eq!(reader.next(), Some(Ok(frame.with_bus(0))));
    assert_eq!(reader.bus_names().name(0), Some("vcan1"));
    assert_eq!(reader.messages().metadata(METADATA_NAME).unwrap()["seed"], "1");
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let frames = frames(300);
    assert_eq!(record(&frames, 40, true), record(&frames, 40, true));
}

#[test]
fn a_killed_writer_leaves_all_flushed_windows() {
    let frames = frames(120);
    let (read, losses) = read(&record(&frames, 30, false));
    assert_eq!(read, frames);
    assert_eq!(losses.len(), 1);
    assert_eq!(losses[0].fault, McapFault::Truncated);
}

#[test]
fn a_file_cut_anywhere_gives_the_frames_of_its_whole_chunks() {
    let frames = frames(90);
    let file = record(&frames, 30, true);
    let chunks = chunks(&file);
    for end in 0..file.len() {
        let (read, losses) = read(&file[..end]);
        let whole = chunks.iter().filter(|chunk| chunk.1 <= end).count();
        let with_frames = whole - usize::from(whole > 1);
        assert_eq!(read, frames[..(30 * with_frames).min(90)], "cut at {end}");
        assert!(!losses.is_empty(), "cut at {end}");
    }
}

#[test]
fn a_flipped_byte_costs_its_chunk_and_nothing_else() {
    let frames = frames(120);
    let file = record(&frames, 30, true);
    let chunks = chunks(&file);
    let data_end = data_end(&file);
    for at in 0..file.len() {
        // A bit, another, or all of them.
        let flip = [1_u8, 0x80, 0xFF][at % 3];
        let mut bad = file.clone();
        bad[at] ^= flip;
        let (read, losses) = read(&bad);
        assert!(is_part_of(&read, &frames), "byte {at} flipped by {flip:#x}");
        assert!(
            read.len() == frames.len() || !losses.is_empty(),
            "byte {at} by {flip:#x}: silent loss"
        );
        let lost: u64 = losses.iter().map(McapLoss::frames).sum();
        assert!(
            lost + read.len() as u64 <= frames.len() as u64,
            "byte {at} by {flip:#x}: {losses:?}"
        );
        let in_chunk = chunks.iter().any(|chunk| (chunk.0..chunk.1).contains(&at));
        let least = frames.len() - if in_chunk { 30 } else { 0 };
        assert!(
            read.len() >= least,
            "byte {at} by {flip:#x}: {} frames, {losses:?}",
            read.len()
        );
        // Behind the data stands only what this reader does not need while the data are whole.
        assert!(
            at >= data_end || !losses.is_empty(),
            "byte {at} by {flip:#x}: not noticed"
        );
    }
}

#[test]
fn missing_frames_are_counted() {
    let frames = frames(120);
    let file = record(&frames, 30, true);
    let mut chunks = chunks(&file);
    chunks.remove(1);
    for (window, &(start, end)) in chunks.iter().take(4).enumerate() {
        let mut bad = file.clone();
        bad[(start + end) / 2] ^= 0x10;
        let (read, losses) = read(&bad);
        assert_eq!(read.len(), 90);
        let counted: Vec<_> = losses
            .iter()
            .filter(|loss| loss.frames() > 0)
            .map(|loss| &loss.fault)
            .collect();
        let expected = McapFault::MissingFrames {
            first_index: 30 * window as u64,
            count: 30,
        };
        // After the last frame their number is unknown.
        let expected = if window < 3 { vec![&expected] } else { vec![] };
        assert_eq!(counted, expected);
    }
}

#[test]
#[ignore = "writes the file named by HMD_SAMPLE with every field filled, for fixtures/check_mcap.py"]
fn write_a_sample() {
    let path = std::env::var("HMD_SAMPLE").expect("HMD_SAMPLE names the file to write");
    let metadata = BTreeMap::from([
        ("seed".to_owned(), "1".to_owned()),
        ("config_hash".to_owned(), "00".to_owned()),
    ]);
    let mut writer = McapWriter::new(std::io::BufWriter::new(std::fs::File::create(path).unwrap()), &metadata).unwrap();
    let frames = frames(20_000);
    for (number, part) in frames.chunks(5000).enumerate() {
        for frame in part {
            writer.write_frame(frame, &two_buses()).unwrap();
        }
        let (t_start_ns, t_end_ns, window) = (part[0].stamp_ns, part[part.len() - 1].stamp_ns, number as u64);
        let actuator = || "ema0".to_owned();
        let curve: Vec<f32> = (1..=100_u8).map(|i| f32::from(i) * 0.01).collect();
        let (some, text) = (Some(0.25), || "ok".to_owned());
        let record = Window {
            actuator: actuator(),
            window,
            t_start_ns,
            duration_s: 0.5,
            status: text(),
            reason: "all fields".to_owned(),
            samples: 100,
            samples_expected: 101,
            samples_lost: 1,
            sample_rate_hz: 200.0,
            mode: "position".to_owned(),
            setpoint_start: some,
            setpoint_end: some,
            setpoint_min: some,
            setpoint_max: some,
            travel_rad: some,
            peak_speed_rad_s: some,
            peak_i_q_a: some,
            dc_link_v: some,
            winding_temp_c: some,
            load_torque_nm: some,
            time_s: curve.clone(),
            setpoint: curve.clone(),
            measured_i_q_a: curve.clone(),
            fitted_i_q_a: curve.clone(),
            measured_speed_rad_s: curve.clone(),
            fitted_speed_rad_s: curve.clone(),
            measured_position_rad: curve.clone(),
            fitted_position_rad: curve,
        };
        writer.write(t_end_ns, &record).unwrap();
        let mut health = Health {
            actuator: actuator(),
            window,
            t_start_ns,
            ..Health::default()
        };
        (health.status, health.health, health.reason) = (text(), "watch".to_owned(), "all fields".to_owned());
        (health.cost, health.residual_rms_a, health.evaluations) = (some, some, 1500);
        health.set_estimate(Some(&Estimate {
            k: [0.25; 8],
            sigma: [Some(0.01); 8],
            observable: [true; 8],
        }));
        health.set_damage([some; 7]);
        health.set_faults(&[FaultId::Friction, FaultId::Gain]);
        writer.write(t_end_ns, &health).unwrap();
        let mut rul = Rul {
            actuator: actuator(),
            window,
            t_start_ns,
            operating_h: some,
            operating_cycles: some,
            rul_p10_h: Some(1.0),
            rul_p50_h: Some(2.0),
            rul_p90_h: Some(3.0),
            rul_p10_cycles: Some(10.0),
            rul_p50_cycles: Some(20.0),
            rul_p90_cycles: Some(30.0),
            dominant_fault: "friction".to_owned(),
            reason: "all fields".to_owned(),
            operating_work_j: some,
            failure_probability: some,
            horizon_h: some,
            governed_by: "damage".to_owned(),
            ..Rul::default()
        };
        rul.set_faults([Some(([1.0, 2.0, 3.0], 0.5)); 7]);
        writer.write(t_end_ns, &rul).unwrap();
        writer.flush_window().unwrap();
    }
    let mut log = Log::new(frames[0].stamp_ns, LogLevel::Info, "hmd", "started");
    (log.file, log.line) = ("main.rs".to_owned(), 7);
    writer.write(frames[0].stamp_ns, &log).unwrap();
    let status = Status {
        frames_received: 1,
        frames_decoded: 2,
        frames_filtered: 3,
        frames_error: 4,
        samples: 5,
        lost_unreadable: 6,
        lost_damaged: 7,
        lost_socket_queue: 8,
        lost_samples: 10,
        lost_malformed: 11,
        lost_late: 17,
        device_restarts: 18,
        rate_changes: 19,
        lost_windows: 12,
        windows_ok: 13,
        windows_degraded: 14,
        windows_invalid: 15,
        windows_unmodelled: 16,
        interfaces: vec![InterfaceStatus {
            interface: "can0".to_owned(),
            bus_state: "error-passive".to_owned(),
            link: "down".to_owned(),
            passive: true,
        }],
        unreadable_too_long: 18,
        unreadable_cobs: 19,
        unreadable_crc: 20,
        unreadable_version: 21,
        unreadable_decode: 22,
        lost_storage_frames: 18,
        lost_storage_records: 19,
        lost_captures: 20,
        storage: "failing".to_owned(),
        storage_used_bytes: 20,
        storage_free_bytes: 21,
        storage_segments: 22,
        storage_deleted: 23,
        queued_inputs: 24,
        queued_windows: 25,
        identification_s: 2.5,
        identification_max_s: 0.5,
        record_age_s: Some(1.5),
        actuators: vec![ActuatorStatus {
            actuator: "ema1".to_owned(),
            data_age_s: 0.5,
            data_state: "fresh".to_owned(),
            health: "watch".to_owned(),
            persistence: 2,
            changed_ns: frames[0].stamp_ns,
            changed_from: "nominal".to_owned(),
            changed_faults: "friction".to_owned(),
            changed_damage: 0.25,
            passive: true,
            sensors: "warning".to_owned(),
        }],
    };
    writer.write(frames[0].stamp_ns, &status).unwrap();
    let dropped = Dropped {
        actuator: "ema1".to_owned(),
        window: 3,
        t_start_ns: frames[0].stamp_ns,
    };
    writer.write(frames[0].stamp_ns, &dropped).unwrap();
    writer.finish().unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_frames_on_any_bus_come_back(
        frames in prop::collection::vec((crate::any_frame::any_frame(), 0..2u16), 1..200),
        per_window in 1..60usize,
    ) {
        let mut frames: Vec<_> = frames.into_iter().map(|(frame, bus)| frame.with_bus(bus)).collect();
        frames[0].bus = 0;
        let (again, losses) = read(&record(&frames, per_window, true));
        prop_assert_eq!(again, frames);
        prop_assert_eq!(losses, vec![]);
    }
}

/// How far our own recordings expand, 869 times here and 1709 times in five minutes (2026-11-25, zstd 1.5): what [`limits::EXPANSION_MAX`] must leave room for. Frames that never change, at the pace of a
/// clock, are the most regular that a bus can send; a tick syncs each second, or a file is written in chunks of full size.
#[test]
fn an_idle_bus_expands_less_than_a_file_may() {
    let constant = |flags, data: &'static [u8]| move |at, _| RawFrame::new(at, 0, 0x108, flags, data).unwrap();
    let of_serial = |at, _| RawFrame::of_serial(at, 0, &[0x55; 64]);
    let in_turn = |at, n: u64| RawFrame::new(at, 0, 0x100 + (n % 16) as u32, FrameFlags::NONE, &[0; 8]).unwrap();
    type Make<'a> = &'a dyn Fn(u64, u64) -> RawFrame;
    let classic = constant(FrameFlags::NONE, &[0; 8]);
    let fd = constant(FrameFlags::FD, &[0; 64]);
    // Frames a second: an actuator, a full bus at 1 Mbit/s and at 5 Mbit/s, a line at 3 Mbaud.
    let cases: [(&str, Make<'_>, u64); 5] = [
        ("one identifier, 8 bytes", &classic, 400),
        ("one identifier, 8 bytes, full bus", &classic, 8000),
        ("sixteen identifiers, full bus", &in_turn, 8000),
        ("one identifier, 64 bytes, full bus", &fd, 5000),
        ("serial, 64 bytes", &of_serial, 4600),
    ];
    for (name, make, rate) in cases {
        for synced in [true, false] {
            let mut out = Cursor::new(Vec::new());
            let mut writer = McapWriter::new(&mut out, &BTreeMap::new()).unwrap();
            for n in 0..rate * 10 {
                let stamp_ns = 1_700_000_000_000_000_000 + n * (1_000_000_000 / rate);
                writer.write_frame(&make(stamp_ns, n), &two_buses()).unwrap();
                if synced && n % rate == 0 {
                    writer.flush_window().unwrap();
                }
            }
            writer.finish().unwrap();
            let file = out.into_inner();
            let mut messages = McapMessages::new(Cursor::new(&file), "a.mcap").unwrap();
            assert!(messages.by_ref().all(|message| message.is_ok()), "{name}");
            let factor = messages.expanded_bytes() as f64 / file.len() as f64;
            println!(
                "{name}, synced {synced}: {} bytes, expand {factor:.0} times",
                file.len()
            );
            // Twice for longer recordings, a third for what a new compressor may gain.
            assert!(
                factor * 2.0 * 1.33 < limits::EXPANSION_MAX as f64,
                "{name}, synced {synced}: {factor}"
            );
        }
    }
}
