//! A recorded log as another bus would have carried it: the health records are the same.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ema_wire::{Frame, Mode, Sample};
use hmd::replay::{Observer, Replay};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::frame::{FrameFlags, RawFrame};
use hmd_core::record::HealthLine;
use hmd_ingest::candump::{Decimals, emit};
use hmd_ingest::file;

const SEED: u64 = 1;

/// Identifiers of `fixtures/foreign.dbc`.
const PHASE: u32 = 0x2c0;
const ANGLES: u32 = 0x18fe_f100;
const DEMAND: u32 = 0x2c1;

#[derive(Default)]
struct Lines(Vec<String>);

impl Observer for Lines {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        self.0
            .push(HealthLine::from((&assessed.health, &assessed.rul)).to_json());
        Ok(())
    }

    fn notice(&mut self, _: &str) {}

    fn progress(&mut self, _: u64) {}
}

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures")
}

fn health(log: &Path, config: Config) -> Vec<String> {
    let (logs, mut lines) = ([log.to_owned()], Lines::default());
    let replay = Replay {
        logs: &logs,
        output: None,
        config: Arc::new(config),
        seed: SEED,
    };
    let summary = replay.run(&mut lines).expect("a log that can be read");
    let status = &summary.status;
    assert_eq!((status.lost_malformed, status.lost_samples), (0, 0), "{status:?}");
    lines.0
}

/// The frames of a sample on the other bus; the first and the last when ours were.
fn foreign(sample: &Sample) -> Vec<(u32, FrameFlags, Vec<u8>)> {
    let cycle = (sample.seq % 64) as u8;
    let phase = |branch: u8, milliamperes: i16| {
        let mut data = vec![(branch << 6) | cycle, 0, 0, 0, 0, 0, 0, 0];
        let amperes = f32::from(milliamperes) / 1e3;
        data[1..5].copy_from_slice(&amperes.to_be_bytes());
        (PHASE, FrameFlags::NONE, data)
    };
    let mut angles = sample.motor_counts.to_be_bytes().to_vec();
    angles.extend(&sample.output_counts.to_be_bytes()[1..]);
    angles.push(sample.seq as u8);
    let state = match sample.mode {
        Mode::Idle => 0,
        Mode::Position => 5,
        Mode::Speed => 6,
    };
    let mut demand = vec![state, 0];
    demand.extend(sample.time_us.to_be_bytes());
    demand.extend(sample.setpoint.to_le_bytes());
    vec![
        phase(0, sample.i_a_ma),
        phase(1, sample.i_b_ma),
        phase(2, sample.i_c_ma),
        (ANGLES, FrameFlags::EXTENDED, angles),
        (DEMAND, FrameFlags::NONE, demand),
    ]
}

/// The log as the other bus would have carried it.
fn translated(log: &Path) -> Vec<u8> {
    let mut text = Vec::new();
    let mut send = |stamp_ns, (id, flags, data): (u32, FrameFlags, Vec<u8>)| {
        let frame = RawFrame::new(stamp_ns, 0, id, flags, &data).expect("a frame that can be");
        emit(&frame, "can0", Decimals::Nine, &mut text);
        text.push(b'\n');
    };
    let (mut currents, mut position) = (None, None);
    for frame in file::open(log).expect("a log") {
        let frame = frame.expect("a frame");
        let id = u16::try_from(frame.id()).expect("11 bits");
        let (actuator, parsed) = Frame::parse(id, frame.data()).expect("valid").expect("ours");
        match parsed {
            Frame::Currents(found) => currents = Some((found, frame.stamp_ns)),
            Frame::Position(found) => position = Some(found),
            Frame::Command(command) => {
                let ((currents, stamp_ns), position) = (currents.expect("first"), position.expect("second"));
                let sample = Sample::from_parts(actuator, &currents, &position, &command).expect("one sample");
                for (n, part) in (0..).zip(foreign(&sample)) {
                    send(stamp_ns + n * 120_000, part);
                }
            }
            Frame::Status(status) => {
                let mut data = vec![(3 << 6) | (status.seq8 % 64)];
                data.extend(status.dc_link_dv.to_be_bytes());
                data.extend(status.winding_temp_dc.to_be_bytes());
                data.extend(status.load_torque_dnm.expect("measured").to_be_bytes());
                data.push(0);
                send(frame.stamp_ns + 300_000, (PHASE, FrameFlags::NONE, data));
            }
            Frame::SampleFd(_) => panic!("the log is classic"),
        }
    }
    text
}

#[test]
fn a_bus_with_a_layout_of_its_own_gives_the_same_health_records() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["healthy-400hz.mcap", "short-c-low-400hz.mcap", "table-iii-400hz.log"] {
        let log = fixtures().join("logs").join(name);
        let other = folder.path().join("foreign.log");
        std::fs::write(&other, translated(&log)).expect("a file");
        let ours = Config::from_toml_str("[type.bench.sensors]\nsample_rate_hz = 400", "hmd.toml").expect("valid");
        let expected = health(&log, ours);
        let map = hmd_storage::config_file::load_config(fixtures().join("foreign.toml")).expect("a map that fits");
        assert_eq!(expected.len(), 1, "{name}");
        assert!(!expected[0].contains("\"k\":null"), "{name}: {}", expected[0]);
        assert_eq!(health(&other, map), expected, "{name}");
    }
}
