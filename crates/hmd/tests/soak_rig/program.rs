//! The program itself in real time, on four serial lines, as a service.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ema_wire::{Sample, SerialPacket};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use super::{
    ACTUATION_SAMPLES, ACTUATORS, ACTUATORS_PER_BUS, BUSES, PERIOD_NS, REST, SAMPLES_PER_MINUTE, STATUS_EVERY,
    Template, config, status,
};

/// What the run showed.
pub(crate) struct Measurements {
    /// From the start of the process to its word that it is ready.
    pub(crate) ready: Duration,
    /// From the last sample of each window to its line, which is printed once its records are synced.
    pub(crate) records: Vec<Duration>,
    /// Highest resident memory, KiB.
    pub(crate) resident_kib: u64,
}

/// Runs the program for so long; all files in `folder`.
pub(crate) fn run(folder: &Path, time: Duration) -> Measurements {
    let lines: Vec<(File, String)> = (0..BUSES).map(|_| line()).collect();
    let mut text = config();
    for (bus, (_, device)) in lines.iter().enumerate() {
        text += &format!("[[serial]]\nbus = \"can{bus}\"\ndevice = \"{device}\"\n");
    }
    fs::write(folder.join("hmd.toml"), text).unwrap();
    let manager = UnixDatagram::bind(folder.join("notify")).unwrap();
    manager.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let since = Instant::now();
    let mut program = Command::new(env!("CARGO_BIN_EXE_hmd"))
        .args(["run", "--json", "-c", "hmd.toml", "-o", "segments/"])
        .current_dir(folder)
        .env("NOTIFY_SOCKET", folder.join("notify"))
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    let mut observed = [0; 64];
    let length = manager.recv(&mut observed).unwrap();
    let ready = since.elapsed();
    assert_eq!(&observed[..length], b"READY=1\n");
    // Nobody listens to the signs of life that follow; a full socket must not matter.
    drop(manager);

    let printed = Arc::new(Mutex::new(Vec::new()));
    let reader = {
        let (printed, out) = (printed.clone(), BufReader::new(program.stdout.take().unwrap()));
        std::thread::spawn(move || {
            for line in out.lines() {
                printed.lock().unwrap().push((line.unwrap(), Instant::now()));
            }
        })
    };
    let ended = play(&lines, time);
    let resident_kib = highest_kib(&program);
    stop(&mut program);
    reader.join().unwrap();
    let printed = printed.lock().unwrap();
    let records = ended.iter().map(|(id, at)| {
        let of = format!("\"actuator\":\"ema{id}\"");
        let (line, then) = printed.iter().find(|(line, _)| line.contains(&of)).unwrap();
        assert!(line.contains("\"status\":\"ok\""), "{line}");
        then.duration_since(*at)
    });
    Measurements {
        ready,
        records: records.collect(),
        resident_kib,
    }
}

fn line() -> (File, String) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let device = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (File::from(master), device)
}

/// Sends everything in real time for so long; when the last sample of each actuator's window had been sent.
fn play(lines: &[(File, String)], time: Duration) -> Vec<(u8, Instant)> {
    let templates = Template::all();
    let mut ended = Vec::new();
    let start = Instant::now();
    for seq in 0..time.as_nanos() as u64 / PERIOD_NS {
        std::thread::sleep(Duration::from_nanos(seq * PERIOD_NS).saturating_sub(start.elapsed()));
        for id in 0..ACTUATORS as u8 {
            let sample = templates[usize::from(id % 4)].sample(id, seq);
            let line = &lines[usize::from(id) / ACTUATORS_PER_BUS as usize].0;
            send(line, &sample, seq);
            if seq == u64::from(id) * SAMPLES_PER_MINUTE / ACTUATORS + REST + ACTUATION_SAMPLES {
                ended.push((id, Instant::now()));
            }
        }
    }
    ended
}

fn send(mut line: &File, sample: &Sample, seq: u64) {
    let mut bytes = [0; ema_wire::serial::MAX_FRAME_LEN];
    line.write_all(SerialPacket::Sample(*sample).emit(&mut bytes).unwrap())
        .unwrap();
    if seq.is_multiple_of(STATUS_EVERY) {
        let packet = SerialPacket::Status {
            actuator: sample.actuator,
            status: status(sample),
        };
        line.write_all(packet.emit(&mut bytes).unwrap()).unwrap();
    }
}

fn highest_kib(program: &Child) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", program.id())).unwrap();
    super::kib(&status, "VmHWM:")
}

fn stop(program: &mut Child) {
    let id = program.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert_eq!(program.wait().unwrap().code(), Some(0), "data were lost");
}
