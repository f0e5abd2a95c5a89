//! Files of other programs as a whole: what python-can and asammdf write (`fixtures/foreign`), and damaged copies of it.

use std::io::Cursor;
use std::path::PathBuf;
use std::time::Instant;

use hmd_core::config::Config;
use hmd_core::drive_bus::{DriveBus, DriveSettings, ObjectDictionary, Preset};
use hmd_core::frame::BusNames;

use crate::asc::AscReader;
use crate::blf::BlfReader;
use crate::mdf::MdfReader;

const FILES: [&str; 6] = [
    "frames.asc",
    "frames.blf",
    "frames.mf4",
    "deflated.mf4",
    "transposed.mf4",
    "unfinalised.mf4",
];

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/foreign")
}

#[test]
fn the_same_frames_come_from_every_format() {
    let read = |name: &str| {
        let source = crate::open(&folder().join(name)).expect(name);
        let (mut frames, mut names) = (Vec::new(), Vec::new());
        let mut source = source;
        while let Some(item) = source.next() {
            let frame = item.expect(name);
            names.push(source.bus_names().name(frame.bus).map(str::to_owned));
            frames.push(frame.with_bus(0));
        }
        (frames, names)
    };
    let expected = read("frames.log");
    assert_eq!(expected.0.len(), 6);
    for name in FILES {
        assert_eq!(read(name), expected, "{name}");
    }
}

/// Reads all of it; how many items there were.
fn items(name: &str, bytes: &[u8]) -> usize {
    let names = BusNames::new();
    if name.ends_with("asc") {
        AscReader::new(bytes, name, names).count()
    } else if name.ends_with("blf") {
        BlfReader::new(bytes, name, names).count()
    } else {
        MdfReader::new(Cursor::new(bytes), name, names).map_or(1, Iterator::count)
    }
}

/// Small numbers for choices, from a seed.
struct Choices(u64);

impl Choices {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end.max(1)
    }
}

/// One to three changes: a bit, a word that a length or a link may be, a cut, a stretch moved or twice.
fn mutate(bytes: &mut Vec<u8>, choices: &mut Choices) {
    const WORDS: [u64; 8] = [0, 1, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0xffff_ffff, u64::MAX];
    for _ in 0..=choices.below(3) {
        let at = choices.below(bytes.len());
        match choices.below(6) {
            0 | 1 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << choices.below(8);
                }
            }
            2 | 3 => {
                let word = match choices.below(10) {
                    8 => choices.below(bytes.len()) as u64,
                    9 => choices.below(usize::MAX) as u64,
                    n => WORDS[n],
                };
                let width = [1, 2, 4, 8][choices.below(4)];
                let end = (at + width).min(bytes.len());
                bytes[at..end].copy_from_slice(&word.to_le_bytes()[..end - at]);
            }
            4 => bytes.truncate(at),
            _ => {
                let stretch = bytes[at..(at + choices.below(200)).min(bytes.len())].to_vec();
                let to = choices.below(bytes.len());
                bytes.splice(to..to, stretch);
            }
        }
    }
}

/// Reads mutations of the files of one format by `items`, which says how many frames and losses there were; a panic fails, as more than
/// `most` do of so many bytes.
pub(crate) fn read_mutations_of(
    format: &str,
    files: &[PathBuf],
    count: usize,
    items: impl Fn(&str, &[u8]) -> usize,
    most: impl Fn(usize) -> usize,
) {
    let start = Instant::now();
    let mut slowest_s = 0.0_f64;
    for n in 0..count {
        let file = &files[n % files.len()];
        let name = file.to_str().expect("a fixture");
        let mut bytes = std::fs::read(file).expect(name);
        mutate(&mut bytes, &mut Choices(n as u64));
        let one = Instant::now();
        let items = items(name, &bytes);
        assert!(items <= most(bytes.len()), "{name}, mutation {n}: {items} items");
        slowest_s = slowest_s.max(one.elapsed().as_secs_f64());
    }
    let all_s = start.elapsed().as_secs_f64();
    println!(
        "{format}: {count} mutations, 0 panics, {all_s:.1} s, slowest {:.1} ms",
        1e3 * slowest_s
    );
}

/// The layout of a drive by an EDS or DCF file; 1, whatever is wrong with it.
fn layout_of_drive(bytes: &[u8]) -> usize {
    let settings = DriveSettings {
        output_encoder: Some(1),
        ..DriveSettings::new(Preset::Cia402, 1)
    };
    let params = Config::default().actuators()[0].params;
    let dictionary = ObjectDictionary::parse(bytes, settings.node);
    dictionary.map_or(1, |dictionary| {
        usize::from(DriveBus::new(settings, &params, dictionary).is_ok())
    })
}

/// Reads mutations of every file.
fn read_mutations(of_each_format: usize) {
    let drives = ["drive.eds", "drive.dcf"].map(|name| folder().join("../drives").join(name));
    read_mutations_of("eds", &drives, of_each_format, |_, bytes| layout_of_drive(bytes), |_| 1);
    for (format, names) in [("asc", &FILES[..1]), ("blf", &FILES[1..2]), ("mf4", &FILES[2..])] {
        let files: Vec<PathBuf> = names.iter().map(|name| folder().join(name)).collect();
        // A compressed block has some thousand times its bytes at most.
        read_mutations_of(format, &files, of_each_format, items, |bytes| 2000 * bytes + 1);
    }
}

#[test]
fn damaged_files_are_refused_or_read() {
    read_mutations(2000);
}

#[test]
#[ignore = "ten thousand of each format; cargo test -p hmd-ingest --lib -- --ignored --nocapture mutations"]
fn ten_thousand_mutations_of_each_format() {
    read_mutations(10_000);
}
