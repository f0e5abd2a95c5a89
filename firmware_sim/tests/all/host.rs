//! The host program: its output in a file and on a pseudo-terminal.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::{ActuatorId, Deframer, SerialPacket};
use firmware_sim::write_stream;

fn firmware_sim() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_firmware_sim"));
    command.args(["--rate", "400", "--profile", "step"]);
    command
}

fn scratch(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a scratch folder");
    folder
}

#[test]
fn a_file_receives_the_whole_stream_less_the_link_faults() {
    let file = scratch("file").join("line.bin");
    let packets = |more: &[&str]| {
        let status = firmware_sim().arg("-o").arg(&file).args(more).status();
        assert!(status.expect("the program runs").success());
        let mut deframer = Deframer::new();
        let count = deframer.push_slice(&fs::read(&file).expect("its file")).count();
        (count, deframer.stats().dropped())
    };
    // 1.5 s at 400 Hz and ten status packets a second.
    assert_eq!(packets(&[]), (615, 0));
    let (count, dropped) = packets(&["--drop", "0.1", "--flip", "0.1"]);
    assert!(count < 560 && dropped > 20, "{count} {dropped}");
}

#[test]
fn wrong_options_are_rejected_with_one_line() {
    for (options, message) in [
        (&["--drop", "2"][..], "expected a number from 0 to 1"),
        (&["--growth", "1,2"], "expected 8 numbers, found 2"),
        (&["--can", "a", "--pty", "b"], "cannot be used with"),
        (&["--with", "coging_nm=0.1"], "expected a name such as cogging_nm"),
        (&["--with", "emf_5=2"], "emf_5 = 2: expected a number from -0.3 to 0.3"),
        (
            &["--with", "decoupling=0.5"],
            "decoupling: expected the vector drive, found the hysteresis drive",
        ),
        (&["--drive", "stepper"], "expected hysteresis or vector"),
    ] {
        let output = firmware_sim().args(options).output().expect("the program runs");
        assert_eq!(output.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&output.stderr).contains(message), "{options:?}");
    }
}

/// The bytes that the program writes with these options.
fn stream(name: &str, options: &str) -> Vec<u8> {
    let file = scratch(name).join("line.bin");
    let status = firmware_sim().arg("-o").arg(&file).args(options.split(' ')).status();
    assert!(status.expect("the program runs").success(), "{options}");
    fs::read(&file).expect("its file")
}

/// FNV-1a.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The hashes are those of the program of commit de39b47, which knew no effects.
#[test]
fn without_effects_the_stream_keeps_its_bytes() {
    for (actuator, expected) in [("bench", 0x3271_7736_74b7_2f88_u64), ("servo28", 0x8563_cfd9_1bfe_8a2e)] {
        let found = hash(&stream(
            &format!("plain-{actuator}"),
            &format!(
                "--actuator {actuator} --windows 2 --noise 0.05 --k 0.2,0,0,0.1,0,0.3,0.5,0.5 \
                 --growth 0.1,0.1,0,0,0,0,0,0 --load 3 --seed 9"
            ),
        ));
        assert_eq!(found, expected, "{actuator}: 0x{found:016x}");
    }
}

#[test]
fn effects_and_mode_reach_the_simulated_unit() {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let mut scenario = Scenario {
        actuations: Actuations {
            profile: Profile::SpeedStep,
            count: 1,
            rest: 0.5,
            length: 0.5,
        },
        ..Scenario::new(params, FaultVector::NOMINAL, 1)
    };
    for (name, value) in [("dead_time_s", 1e-6), ("temperature_rise_k", -30.0)] {
        scenario.effects.set(name, value).expect("an effect");
    }
    let mut expected = Vec::new();
    let ema0 = ActuatorId::new(0).expect("0 is below 16");
    write_stream(&scenario, ema0, &mut expected).expect("writing to a Vec does not fail");
    let options = "--drive vector --with dead_time_s=1e-6 --with temperature_rise_k=-30 --mode speed";
    assert!(stream("effects", options) == expected);

    // The unit measures its temperature.
    let mut deframer = Deframer::new();
    let mut temperatures = deframer.push_slice(&expected).filter_map(|packet| match packet {
        SerialPacket::Status { status, .. } => Some(status.winding_temp_dc),
        SerialPacket::Sample(_) => None,
    });
    assert_eq!(temperatures.next(), Some(-100));
}

/// Kills the program at the end of the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // The program may have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_pseudo_terminal_delivers_samples_in_real_time() {
    let link = scratch("pty").join("ema0");
    let child = firmware_sim()
        .arg("--pty")
        .arg(&link)
        .args(["--windows", "100"])
        .spawn();
    let _running = Running(child.expect("the program runs"));
    let started = Instant::now();
    let mut line = loop {
        match File::open(&link) {
            Ok(line) => break line,
            Err(_) if started.elapsed() < Duration::from_secs(20) => std::thread::sleep(Duration::from_millis(5)),
            Err(e) => panic!("no pseudo-terminal: {e}"),
        }
    };
    let (mut deframer, mut seqs) = (Deframer::new(), Vec::new());
    let mut buffer = [0; 256];
    while seqs.len() < 200 {
        let got = line.read(&mut buffer).expect("the other end is open");
        for packet in deframer.push_slice(&buffer[..got]) {
            if let SerialPacket::Sample(sample) = packet {
                seqs.push(sample.seq);
            }
        }
    }
    assert_eq!(deframer.stats().dropped(), 0);
    assert!(seqs.windows(2).all(|pair| pair[1] == pair[0] + 1), "{seqs:?}");
    // 200 samples at 400 Hz, less those buffered before the terminal was opened.
    assert!(
        started.elapsed() > Duration::from_millis(400),
        "{:?}",
        started.elapsed()
    );
}
