//! Time from the return of a serial line to the first assessed window, of a device that moves over and over: a pseudo-terminal pulled out
//! for half a second and plugged in again, as often as the argument says (20 times without one). Real time; a table for `docs/live.md`.
#![allow(clippy::unwrap_used, reason = "a failed step ends the measurement")]

#[path = "../tests/program/lines.rs"]
#[allow(dead_code, reason = "tests use more of it")]
mod lines;
#[path = "../tests/program/serial_rig/mod.rs"]
#[allow(dead_code, reason = "tests use more of it")]
mod serial_rig;

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use hmd::daemon::Daemon;
use hmd_core::config::Config;
use hmd_ingest::live::LiveSource;
use hmd_ingest::serial::SerialSource;
use lines::Lines;
use serial_rig::{Device, Plug};

const CONFIG: &str = "[type.slow]\nbased_on = \"bench\"\nsensors.sample_rate_hz = 400\ntolerances = \"exact\"\n\
                      [[actuator]]\nid = 0\nname = \"a\"\nbus = \"uart1\"\ntype = \"slow\"\n\
                      [[serial]]\nbus = \"uart1\"\ndevice = \"line\"\n";

/// How long the line is out, and how long the device is watched after its return.
const OUT: Duration = Duration::from_millis(500);
const WATCHED: Duration = Duration::from_secs(3);

fn main() {
    let returns: usize = std::env::args().nth(1).map_or(20, |count| count.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let config = Arc::new(Config::from_toml_str(CONFIG, "hmd.toml").unwrap());
    let rate = config.serial("uart1").unwrap().bitrate_bit_s;
    let (mut plug, lines) = (Plug::new(folder.path()), Lines::default());
    let daemon = Daemon {
        sources: vec![(
            "uart1".to_owned(),
            LiveSource::Serial(SerialSource::new(plug.path(), rate)),
        )],
        recorder: None,
        watch: Some((config, 1)),
    };
    let mut taken_s = Vec::new();
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    thread::scope(|scope| {
        let shutdown = async {
            let _ = stopped.await;
        };
        let (observer, found) = (&lines, &lines);
        let running = scope.spawn(move || daemon.run(shutdown, observer).unwrap());
        for n in 0..returns {
            let assessed = found.assessed();
            let mut device = Device::start(n as u64 + 1);
            plug.plug();
            let since = Instant::now();
            // Polled beside the device, which plays in real time.
            let first = thread::scope(|scope| {
                let waiting = scope.spawn(|| {
                    while found.assessed() == assessed && since.elapsed() < WATCHED {
                        thread::sleep(Duration::from_millis(1));
                    }
                    since.elapsed()
                });
                device.play(&plug, WATCHED);
                waiting.join().unwrap()
            });
            taken_s.push(first.as_secs_f64());
            plug.unplug();
            thread::sleep(OUT);
        }
        drop(stop);
        running.join().unwrap();
    });
    taken_s.sort_by(f64::total_cmp);
    let [least, median, most] = [0, returns / 2, returns - 1].map(|n| taken_s[n]);
    println!("| returns | first verdict after, s: least | median | most |\n|---|---|---|---|");
    println!("| {returns} | {least:.2} | {median:.2} | {most:.2} |");
}
