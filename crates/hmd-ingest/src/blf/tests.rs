use super::*;
use crate::candump::{Decimals, emit};

fn object(kind: u32, stamp_ns: u64, body: &[u8]) -> Vec<u8> {
    let mut bytes = SIGNATURE.to_vec();
    for (half, size) in [(32_u16, 2), (1, 2)] {
        bytes.extend(&half.to_le_bytes()[..size]);
    }
    for word in [32 + body.len() as u32, kind, 2, 0] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(stamp_ns.to_le_bytes());
    bytes.extend(body);
    bytes.extend(vec![0; body.len() % 4]);
    bytes
}

fn container(contents: &[u8]) -> Vec<u8> {
    let data = miniz_oxide::deflate::compress_to_vec_zlib(contents, 6);
    let mut bytes = SIGNATURE.to_vec();
    bytes.extend([16, 0, 1, 0]);
    bytes.extend((32 + data.len() as u32).to_le_bytes());
    bytes.extend(CONTAINER.to_le_bytes());
    bytes.extend([2, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend((contents.len() as u32).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(&data);
    bytes.extend(vec![0; data.len() % 4]);
    bytes
}

/// Frames, two requests to send, which are none, and an error frame, in containers that split an object.
pub(crate) fn log() -> Vec<u8> {
    let classic = |channel: u8, id: u32, flags: u8, data: &[u8]| {
        let mut body = vec![channel, 0, flags, data.len() as u8];
        body.extend(id.to_le_bytes());
        body.extend(data);
        body.resize(16, 0);
        body
    };
    let mut fd = vec![1, 0, 0, 9, 0x23, 1, 0, 0, 0, 0, 0, 0, 0, 3, 12, 0, 0, 0, 0, 0];
    fd.extend(0..12);
    fd.resize(84, 0);
    let mut fd_64 = vec![2, 9, 12, 0, 0x24, 1, 0, 0, 0, 0, 0, 0];
    fd_64.extend(0x1000_u32.to_le_bytes());
    fd_64.resize(40, 0);
    fd_64.extend(0..10);
    let mut requested = fd_64.clone();
    requested[34] = 2;
    let objects = [
        object(86, 999_999, &classic(1, 0x1a0, 0, &[1, 10, 255])),
        object(86, 1_500_000, &classic(2, 0x8000_0123, 2, &[])),
        object(1, 2_000_000, &classic(2, 0x8000_0123, 1, &[])),
        object(1, 3_000_000, &classic(1, 0x7ff, 0x80, &[0; 4])),
        object(73, 4_000_000, &[1, 0, 0, 0]),
        object(100, 5_000_000, &fd),
        object(101, 6_000_000, &fd_64),
        object(101, 6_500_000, &requested),
        object(65, 7_000_000, b"a text that is none of ours"),
    ]
    .concat();
    let mut file = MAGIC.to_vec();
    file.extend(144_u32.to_le_bytes());
    file.resize(40, 0);
    for word in [2023_u16, 11, 2, 14, 22, 13, 20, 0] {
        file.extend(word.to_le_bytes());
    }
    file.resize(144, 0);
    file.extend(container(&objects[..100]));
    file.extend(container(&objects[100..]));
    file
}

fn read(bytes: &[u8]) -> (String, Vec<String>) {
    let mut reader = BlfReader::new(bytes, "a.blf", BusNames::new());
    let (mut out, mut losses) = (Vec::new(), Vec::new());
    while let Some(item) = reader.next() {
        match item {
            Ok(frame) => emit(
                &frame,
                reader.bus_names().name(frame.bus).unwrap(),
                Decimals::Six,
                &mut out,
            ),
            Err(damage) => losses.push(damage.to_string()),
        }
    }
    (String::from_utf8(out).unwrap(), losses)
}

const EXPECTED: &str = "(1700000000.001000) can0 1A0#010AFF\n(1700000000.002000) can1 00000123# T\n(1700000000.003000) can0 7FF#R4\n\
    (1700000000.004000) can0 20000080#0000000000000000\n(1700000000.005000) can0 123##1000102030405060708090A0B\n\
    (1700000000.006000) can1 124##0000102030405060708090000\n";

#[test]
fn every_form_is_read() {
    assert_eq!(read(&log()), (EXPECTED.to_owned(), Vec::new()));
}

#[test]
fn a_damaged_container_costs_its_own_frames() {
    let mut bytes = log();
    bytes[144 + 60] ^= 1;
    let (frames, losses) = read(&bytes);
    assert!(EXPECTED.ends_with(&frames) && !frames.is_empty(), "{frames}");
    assert!(
        losses[0].contains("expected a container with a right checksum"),
        "{losses:?}"
    );
    let cut = &log()[..log().len() - 20];
    let (_, losses) = read(cut);
    assert!(losses[0].contains("it was cut"), "{losses:?}");
}
