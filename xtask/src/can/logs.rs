//! The logs that are played in the guest, made beforehand by `hmd simulate`.

use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, ensure};

use crate::programs::Programs;
use crate::shell::{program, run, run_to_file};

/// Actuators, and after how many of them the next interface begins: six at 400 Hz fit on a bus of 1 Mbit/s.
pub(super) const ACTUATORS: u32 = 16;
const FIRST_OF_BUS: [u32; 4] = [0, 6, 11, ACTUATORS];

/// The actuators that have a fault: its name, and the option that makes it.
pub(super) const FAULTS: [(u32, &str, &str); 6] = [
    (1, "friction", "friction=0.4"),
    (4, "backlash", "backlash=0.5"),
    (7, "short_b", "short_b=0.4"),
    (9, "eccentricity", "eccentricity=0.5"),
    (12, "gain", "gain=0.75"),
    (15, "short_c", "short_c=0.3"),
];

/// Length of the stream in the time of the actuators, s: an actuation each second.
pub(super) const STREAM_S: u32 = 20;

/// The shipped calibration of the bench serves at any rate; the simulated actuators are their type exactly.
const AT_400_HZ: &str = "[type.bench]\ntolerances = \"exact\"\nsensors.sample_rate_hz = 400\n";

/// Stamps that `hmd simulate` begins with, s.
const EPOCH_S: u64 = 1_700_000_000;

/// Time that each bus has for one second of its stream, µs.
const TURN_US: u64 = 1_500_000;

/// Makes the streams of the three buses, each frame at the time at which it is played, and the configuration.
///
/// The guest has one processor, which cannot send and receive three full buses at once and identify. So the three take
/// turns, a second each in real time, and half a second of pause for identification.
pub(super) fn streams(hmd: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut config = String::from(AT_400_HZ);
    for (bus, ends) in FIRST_OF_BUS.windows(2).enumerate() {
        // All players begin with their first frame, so each log has one at time zero; it is of no actuator.
        let mut lines = vec![format!("({EPOCH_S}.000000) vcan{bus} 7FF#00")];
        for id in ends[0]..ends[1] {
            config += &format!("[[actuator]]\nid = {id}\nbus = \"vcan{bus}\"\n");
            let log = folder.join(format!("ema{id}.log"));
            let mut simulate = program(hmd, ["simulate", "--rate", "400", "--noise", "0.05", "--windows"]);
            simulate.arg(STREAM_S.to_string());
            simulate.args([
                "--id".to_owned(),
                id.to_string(),
                "--seed".to_owned(),
                (100 + id).to_string(),
            ]);
            for (_, _, fault) in FAULTS.iter().filter(|(at, _, _)| *at == id) {
                simulate.args(["--fault", fault]);
            }
            run(simulate.arg("-o").arg(&log))?;
            let text = fs::read_to_string(&log).with_context(|| log.display().to_string())?;
            for line in text.lines() {
                lines.push(in_turn(line, bus as u64).with_context(|| line.to_owned())?);
            }
        }
        // Stable: frames of one stamp stay in their order.
        lines.sort_by(|a, b| a[..18].cmp(&b[..18]));
        fs::write(folder.join(format!("stream{bus}.log")), lines.join("\n") + "\n")?;
    }
    fs::write(folder.join("stream.toml"), config)?;
    Ok(())
}

/// A line of `hmd simulate` (`(1700000000.000120) can0 …`) at its turn on its bus.
fn in_turn(line: &str, bus: u64) -> Option<String> {
    let (stamp, rest) = line.strip_prefix('(')?.split_once(") can0 ")?;
    let (seconds, fraction) = stamp.split_once('.')?;
    let second = seconds.parse::<u64>().ok()?.checked_sub(EPOCH_S)?;
    let played_us = (3 * second + bus) * TURN_US + fraction.parse::<u64>().ok()?;
    let (seconds, fraction) = (EPOCH_S + played_us / 1_000_000, played_us % 1_000_000);
    Some(format!("({seconds}.{fraction:06}) vcan{bus} {rest}"))
}

/// Makes logs of FD and classic frames of ours, and of frames of nobody; and the configurations of the short runs.
pub(super) fn shorts(programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let random = folder.join("random.log");
    let make = program(programs.example("random_candump"), ["3000", "1"]);
    run_to_file(make, None, &random)?;
    let text = fs::read_to_string(&random)?;
    let ours = text.replace(" can0 ", " vcan0 ");
    ensure!(ours.contains("##"), "expected FD frames among {}", random.display());
    fs::write(folder.join("fd.log"), ours)?;
    let mut foreign = fs::File::create(folder.join("foreign.log"))?;
    for n in 0..1000u32 {
        // Other 11-bit identifiers, extended ones with the low bits of ours, remote requests for ours.
        let frame = match n % 3 {
            0 => format!("{:03X}#0102030405060708", 0x200 + n % 0x500),
            1 => format!("{:08X}#0102030405060708", 0x0400_0100 + n % 0x100),
            _ => format!("{:03X}#R8", 0x100 + n % 0x100),
        };
        writeln!(foreign, "(0.{:06}) vcan0 {frame}", n * 100)?;
    }
    let all = |bus: &str, ids: std::ops::Range<u32>| -> String {
        let actuator = |id| format!("[[actuator]]\nid = {id}\nbus = \"{bus}\"\nname = \"{bus}-{id}\"\n");
        ids.map(actuator).collect()
    };
    let fd = AT_400_HZ.to_owned() + "[bus]\nfd = true\n";
    fs::write(
        folder.join("bus.toml"),
        fd.clone() + &all("vcan0", 0..16) + &all("vcan1", 0..1),
    )?;
    fs::write(folder.join("link.toml"), fd + &all("vcan0", 0..1))?;
    Ok(())
}

/// Windows of the log that comes through a serial adapter.
pub(super) const SLCAN_WINDOWS: u32 = 8;

/// Makes the log that comes through a serial adapter, of an actuator with friction, and its configuration.
pub(super) fn slcan(hmd: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut simulate = program(
        hmd,
        [
            "simulate",
            "--rate",
            "400",
            "--noise",
            "0.05",
            "--fault",
            "friction=0.4",
        ],
    );
    simulate.args(["--windows", &SLCAN_WINDOWS.to_string()]);
    run(simulate.arg("-o").arg(folder.join("slcan.log")))?;
    let actuator = "[[actuator]]\nid = 0\nbus = \"slcan0\"\n";
    fs::write(folder.join("slcan.toml"), AT_400_HZ.to_owned() + actuator)?;
    Ok(())
}

/// Frames in a log.
pub(super) fn frames(log: &Path) -> anyhow::Result<u64> {
    let text = fs::read_to_string(log).with_context(|| log.display().to_string())?;
    Ok(text.lines().count() as u64)
}
