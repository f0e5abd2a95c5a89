//! One recorded log, whatever its format.
//!
//! The format is recognised by the first bytes, not by the name. A source is opened up to its first frame, so that a file
//! that has none is refused at once, unless it is a segment with marks of a run whose frames are in others.

mod error;
mod log_reader;

#[cfg_attr(not(feature = "signals"), path = "file/not_measured.rs")]
mod measured;

#[cfg(feature = "signals")]
mod survey;

pub use error::IngestError;
#[cfg(feature = "signals")]
pub use {
    measured::open_signals,
    survey::{Survey, SurveyedSignal, survey},
};

use log_reader::{Counted, LogReader};

use crate::Loss;
use crate::asc::{AscReader, is_asc};
use crate::blf::{self, BlfReader};
use crate::candump::CandumpReader;
use crate::foreign::unread_format;
use crate::mdf::{self, MdfReader};
use hmd_core::config::Config;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_storage::mcap::{McapFrames, McapMessages};
use hmd_storage::quoted;
use hmd_storage::regular_file::open_regular;
use hmd_storage::segment_store::current_path;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Losses before the first frame after which a text is not taken for a log; also the most that are held in memory.
pub const LEAD_LIMIT: usize = 1000;

/// First bytes of compressed files that may be given by mistake.
const COMPRESSED: [(&[u8], &str); 3] = [
    (&[0x1f, 0x8b], "gzip"),
    (&[0x28, 0xb5, 0x2f, 0xfd], "zstd"),
    (b"\xfd7zXZ\0", "xz"),
];

/// Bytes of a file that its format is recognised by: words about the recording may stand before a table.
const START: usize = 1 << 16;

/// What some editors put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Whether a text begins with the mark of UTF-16.
fn is_utf16(start: &[u8]) -> bool {
    start.starts_with(b"\xff\xfe") || start.starts_with(b"\xfe\xff")
}

/// Format of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogFormat {
    /// Text of `candump -l`.
    Candump,
    /// MCAP with our raw batches.
    Mcap,
    /// Text of Vector's tools.
    Asc,
    /// Binary log of Vector's tools.
    Blf,
    /// MDF version 4 with bus frames.
    Mdf,
    /// Table of measured signals as text.
    Csv,
    /// Table of measured signals in Parquet.
    Parquet,
}

/// Frames of one file.
#[derive(Debug)]
pub struct FrameSource {
    reader: Box<dyn LogReader>,
    /// What came before and with the first frame.
    lead: VecDeque<Result<RawFrame, Loss>>,
    total_bytes: Option<u64>,
    position: Arc<AtomicU64>,
}

/// Opens a log with a fresh table of interfaces.
///
/// # Errors
/// [`IngestError`] when nothing in the file can be used.
pub fn open(path: &Path) -> Result<FrameSource, IngestError> {
    open_with(path, BusNames::new())
}

/// Opens a file that hmd wrote; what is no regular file is refused, not waited for.
///
/// # Errors
/// What the system says; of a folder, which files in it are meant.
pub fn open_recorded(path: &Path) -> io::Result<File> {
    if path.is_dir() {
        let folder = path.display();
        let what = format!("expected files, found a folder; the records of hmd run are in {folder}/*-records.mcap");
        return Err(io::Error::new(io::ErrorKind::IsADirectory, what));
    }
    open_regular(&current_path(path))
}

/// Opens a log; `names` is the table of interfaces of the log before, so that an interface keeps its index.
///
/// # Errors
/// [`IngestError`] when nothing in the file can be used.
pub fn open_with(path: &Path, names: BusNames) -> Result<FrameSource, IngestError> {
    open_for(path, names, None)
}

/// Opens a log; one of measured signals by the map of `config`.
///
/// # Errors
/// [`IngestError`] when nothing in the file can be used.
pub fn open_mapped(path: &Path, names: BusNames, config: &Config) -> Result<FrameSource, IngestError> {
    open_for(path, names, Some(config))
}

/// Opens a file, or the pipe of a shell. A named pipe is refused: opening it waits for a writer, who may never come.
fn open_log(path: &Path) -> io::Result<File> {
    let is_pipe = std::fs::metadata(path).is_ok_and(|about| about.file_type().is_fifo());
    if is_pipe && std::fs::canonicalize(path).is_ok() {
        let what = "expected a regular file, found a named pipe";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    File::open(path)
}

fn open_for(path: &Path, names: BusNames, config: Option<&Config>) -> Result<FrameSource, IngestError> {
    let file = path.display().to_string();
    let unreadable = |cause| IngestError::Unreadable {
        file: file.clone(),
        cause,
    };
    let input = open_log(&current_path(path)).map_err(unreadable)?;
    let about = input.metadata().map_err(unreadable)?;
    if about.is_dir() {
        return Err(IngestError::Directory { file });
    }
    let position = Arc::new(AtomicU64::new(0));
    let counted = Counted {
        file: input,
        position: position.clone(),
    };
    let mut input = BufReader::with_capacity(START, counted);
    let start = input.fill_buf().map_err(unreadable)?;
    if start.is_empty() {
        return Err(IngestError::Empty { file });
    }
    for (magic, format) in COMPRESSED {
        if start.starts_with(magic) {
            return Err(IngestError::Compressed { file, format });
        }
    }
    if is_utf16(start) {
        return Err(IngestError::Utf16 { file });
    }
    let text = start.strip_prefix(BYTE_ORDER_MARK).unwrap_or(start);
    if let Some(format) = unread_format(text) {
        return Err(IngestError::Foreign { file, format });
    }
    let reader: Box<dyn LogReader> = if let Some(format) = measured::format(start) {
        if !about.is_file() && format.is_sought() {
            return Err(IngestError::NotSeekable { file });
        }
        measured::open(format, input, &file, names, config)?
    } else if start.starts_with(mcap::MAGIC) {
        if !about.is_file() {
            return Err(IngestError::NotSeekable { file });
        }
        let input = input.into_inner().file;
        let messages = McapMessages::of_recording(input, &file).map_err(unreadable)?;
        Box::new(McapFrames::of_messages(messages, names))
    } else if mdf::MAGICS.iter().any(|magic| start.starts_with(magic)) {
        if !about.is_file() {
            return Err(IngestError::NotSeekable { file });
        }
        Box::new(open_mdf_frames(input.into_inner().file, &file, names)?)
    } else if start.starts_with(blf::MAGIC) {
        Box::new(BlfReader::new(input, &file, names))
    } else {
        if start.contains(&0) && !start.contains(&b'\n') {
            return Err(IngestError::Binary {
                file,
                found: quoted(start),
            });
        }
        let is_asc = is_asc(text);
        if start.starts_with(BYTE_ORDER_MARK) {
            input.consume(BYTE_ORDER_MARK.len());
        }
        if is_asc {
            Box::new(AscReader::new(input, &file, names))
        } else {
            Box::new(CandumpReader::new(input, &file, names))
        }
    };
    let total_bytes = about.is_file().then_some(about.len());
    let mut source = FrameSource {
        reader,
        lead: VecDeque::new(),
        total_bytes,
        position,
    };
    source.find_first_frame(file)?;
    Ok(source)
}

fn open_mdf_frames(input: File, file: &str, names: BusNames) -> Result<MdfReader<File>, IngestError> {
    MdfReader::new(input, file, names).map_err(|damage| IngestError::NoForeignFrame {
        file: file.to_owned(),
        format: "MF4",
        first: Some(Box::new(damage.into())),
    })
}

impl FrameSource {
    /// Format of the file.
    pub fn format(&self) -> LogFormat {
        self.reader.format()
    }

    /// The interfaces seen so far; it has every interface of a frame that was handed out.
    pub fn bus_names(&self) -> &BusNames {
        self.reader.bus_names()
    }

    /// The table of interfaces, to go on with in the next log.
    pub fn into_bus_names(self) -> BusNames {
        self.reader.into_bus_names()
    }

    /// Size of the file, bytes; `None` for a pipe.
    pub fn total_bytes(&self) -> Option<u64> {
        self.total_bytes
    }

    /// How far the file was read, bytes; ahead of the frames handed out by at most one block.
    pub fn position(&self) -> u64 {
        let of_reader = self.reader.position();
        of_reader.unwrap_or_else(|| self.position.load(Ordering::Relaxed))
    }

    /// The metadata record `name` of an MCAP file, if it was read already (ours stand at the start of the file).
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.reader.metadata(name)
    }

    /// What an operator should know of what was read so far, a sentence each: what was interpolated.
    pub fn remarks(&self) -> Vec<String> {
        self.reader.remarks()
    }

    fn find_first_frame(&mut self, file: String) -> Result<(), IngestError> {
        while self.lead.len() < LEAD_LIMIT {
            match self.reader.next_frame() {
                Some(Ok(frame)) => {
                    self.lead.push_back(Ok(frame));
                    return Ok(());
                }
                Some(Err(loss)) => self.lead.push_back(Err(loss)),
                None if self.reader.has_marks() => return Ok(()),
                None => break,
            }
        }
        let first = self.lead.pop_front().and_then(Result::err).map(Box::new);
        Err(self.reader.no_frame(file, first))
    }
}

impl Iterator for FrameSource {
    type Item = Result<RawFrame, Loss>;

    fn next(&mut self) -> Option<Self::Item> {
        self.lead.pop_front().or_else(|| self.reader.next_frame())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::frame::FrameFlags;
    use hmd_core::record::Ended;
    use hmd_storage::segment_store::{RealDisk, SegmentStore, raw_segments, records_segments};
    use std::time::Instant;

    #[test]
    fn a_segment_with_marks_of_a_run_alone_is_read_and_one_of_records_refused() {
        let folder = tempfile::tempdir().unwrap();
        let limits = Config::default().output().limits();
        let mut now = Instant::now();
        let (none, disk) = (BTreeMap::new(), Box::new(RealDisk));
        let mut store = SegmentStore::open(folder.path(), &none, limits, disk, now).unwrap();
        let mut names = BusNames::new();
        names.intern("can0").unwrap();
        let frame = RawFrame::new(1, 0, 1, FrameFlags::NONE, &[]).unwrap();
        store.write_frame(&frame, &names);
        // The bus falls silent, and the run ends.
        now += limits.segment_age;
        store.tick(now);
        store.write_to_raw(2, &Ended { t_ns: 2 });
        store.finish();
        let raw = raw_segments(folder.path()).unwrap();
        let frames = raw.values().map(|segment| open(&segment.path).unwrap().count());
        assert_eq!(frames.collect::<Vec<_>>(), [1, 0]);
        let records = records_segments(folder.path(), 0).unwrap();
        let refused = open(&records.values().next().unwrap().path);
        assert!(matches!(refused, Err(IngestError::NoFrames { .. })));
    }

    fn refused(name: &str, content: &[u8]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let text = open(&path).unwrap_err().to_string();
        assert!(!text.contains('\n'));
        text.replace(&path.display().to_string(), "F")
    }

    #[test]
    fn useless_files_are_refused_in_one_sentence() {
        for (name, content, found) in [
            ("a.log", &b""[..], "an empty file"),
            ("a.mcap", b"\x00\x01\x02", r#"binary data starting with "\x00\x01\x02""#),
            (
                "a.log",
                b"hello\nworld\n",
                "no valid line in 2; the first: F:1: expected a stamp \"(seconds.fraction)\" with 6 or 9 decimals, found \"hello\"",
            ),
            ("a.log", b"\n\n", "no valid line in 2"),
            ("a.csv", b"\xff\xfet\0,\0a\0\n\0", "text as UTF-16; save it as UTF-8"),
            ("b.csv", b"\xfe\xff\0t\0,\0a\0\n", "text as UTF-16; save it as UTF-8"),
            (
                "a.trc",
                b";$FILEVERSION=2.1\n;$STARTTIME=45244.9\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n;\n",
                "a trace of PEAK (.trc); convert it to BLF, as python-can's can_logconvert does",
            ),
            (
                "b.trc",
                b";##########\n;   a.trc\n;\n",
                "a trace of PEAK (.trc); convert it to BLF, as python-can's can_logconvert does",
            ),
            (
                "a.csv",
                b"timestamp,arbitration_id,extended,remote,error,dlc,data\n1.0,0x100,0,0,0,1,AA==\n",
                "a table of frames by python-can; convert it to BLF, as python-can's can_logconvert does",
            ),
        ] {
            assert_eq!(
                refused(name, content),
                format!(
                    "F: expected a log of a format that is known ({}), found {found}",
                    error::FORMATS
                )
            );
        }
        assert_eq!(
            refused("a.mcap", mcap::MAGIC),
            "F: expected raw frames (schema hmd.v1.RawBatch) on topics /bus/<interface>/raw, found no topic; \
             F: at byte 8: expected a record, found the end of the file: it was cut or never finished"
        );
        let garbage: Vec<u8> = (0..100_000_u32)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        assert!(refused("a.log", &garbage).contains("found no valid line in "));
    }

    #[test]
    fn a_path_that_is_no_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(open(folder.path()), Err(IngestError::Directory { .. })));
        assert!(matches!(
            open(&folder.path().join("none")),
            Err(IngestError::Unreadable { .. })
        ));
    }

    #[test]
    fn a_text_log_is_read_whatever_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        std::fs::write(&path, "bad\n(1.000000) vcan0 123#00\nbad\n(2.000000) vcan1 123#00\n").unwrap();
        let mut source = open(&path).unwrap();
        assert_eq!((source.format(), source.total_bytes()), (LogFormat::Candump, Some(56)));
        let stamps: Vec<_> = source
            .by_ref()
            .map(|item| item.ok().map(|frame| frame.stamp_ns / 1_000_000_000))
            .collect();
        assert_eq!(stamps, [None, Some(1), None, Some(2)]);
        assert_eq!(source.position(), 56);
        assert_eq!(source.bus_names().iter().collect::<Vec<_>>(), ["vcan0", "vcan1"]);
    }

    #[test]
    fn the_same_frames_come_from_mcap_and_from_candump() {
        let folder = tempfile::tempdir().unwrap();
        let [text, recorded] = ["a.log", "a.mcap"].map(|name| folder.path().join(name));
        let mut names = BusNames::new();
        for name in ["vcan0", "vcan1"] {
            names.intern(name).unwrap();
        }
        let mut log = Vec::new();
        let out = std::fs::File::create(&recorded).unwrap();
        let mut writer = hmd_storage::mcap_writer::McapWriter::new(out, &std::collections::BTreeMap::new()).unwrap();
        let mut frames = Vec::new();
        for i in 0..500_u64 {
            let stamp_ns = 1_700_000_000_000_000_000 + 1000 * i;
            let data = i.wrapping_mul(0x9E37_79B9_7F4A_7C15).to_le_bytes();
            let (id, flags, data) = match i % 11 {
                3 => (0x1234_5678, FrameFlags::EXTENDED, &data[..5]),
                5 => (0x80, FrameFlags::ERROR, &data[..]),
                7 => (0x321, FrameFlags::REMOTE, &data[..4]),
                _ => (0x100 + (i % 4) as u32, FrameFlags::NONE, &data[..]),
            };
            let bus = u16::from(i > 0 && (i / 3) % 3 == 0);
            let frame = RawFrame::new(stamp_ns, bus, id, flags, data).unwrap();
            crate::candump::emit(
                &frame,
                names.name(bus).unwrap(),
                crate::candump::Decimals::Six,
                &mut log,
            );
            writer.write_frame(&frame, &names).unwrap();
            frames.push(frame);
        }
        writer.finish().unwrap();
        std::fs::write(&text, log).unwrap();
        for path in [text, recorded] {
            let read: Result<Vec<_>, _> = open(&path).unwrap().collect();
            assert_eq!(read.unwrap(), frames, "{}", path.display());
        }
    }

    #[test]
    fn a_foreign_file_is_named_as_such() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.mcap");
        let write = |topic: &str, schema: &str| {
            let mut writer = ::mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
            let schema = writer.add_schema(schema, "protobuf", b"").unwrap();
            let id = writer
                .add_channel(schema, topic, "protobuf", &std::collections::BTreeMap::new())
                .unwrap();
            let header = ::mcap::records::MessageHeader {
                channel_id: id,
                sequence: 0,
                log_time: 1,
                publish_time: 1,
            };
            writer.write_to_known_channel(&header, b"\xFF\xFF").unwrap();
            writer.finish().unwrap();
            let text = open(&path).unwrap_err().to_string();
            text.replace(&path.display().to_string(), "F")
        };
        assert_eq!(
            write("/camera", "foxglove.Image"),
            "F: expected raw frames (schema hmd.v1.RawBatch) on topics /bus/<interface>/raw, found only /camera"
        );
        assert!(
            write("/bus/can0/raw", "a.B").ends_with("expected schema hmd.v1.RawBatch on /bus/can0/raw, found \"a.B\"")
        );
        assert!(write("/bus/can0/raw", "hmd.v1.RawBatch").contains("expected a raw batch, found another message: "));
    }
}
