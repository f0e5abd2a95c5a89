//! A device on a pseudo-terminal that can be pulled out.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ema_models::reference::{Actuations, Scenario, ScenarioRun};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{ActuatorId, SerialPacket};
use hmd_lab::simulate::encode;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// One end of a serial line; the other is found under a path that stays the same.
pub(crate) struct Plug {
    path: PathBuf,
    master: Option<File>,
}

impl Plug {
    /// Nothing is plugged in yet.
    pub(crate) fn new(folder: &Path) -> Self {
        Self {
            path: folder.join("line"),
            master: None,
        }
    }

    /// The same path, with nothing to plug.
    pub(crate) fn clone_path(&self) -> Self {
        Self {
            path: self.path.clone(),
            master: None,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn plug(&mut self) {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        fcntl_setfl(&master, OFlags::NONBLOCK).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        symlink(name.to_str().unwrap(), &self.path).unwrap();
        self.master = Some(File::from(master));
    }

    pub(crate) fn unplug(&mut self) {
        fs::remove_file(&self.path).unwrap();
        self.master = None;
    }

    /// Sends, if it is plugged in; what nobody reads in time is lost, as on a wire.
    pub(crate) fn write(&self, bytes: &[u8]) {
        let sent = self.master.as_ref().map(|mut master| master.write_all(bytes));
        match sent {
            Some(Err(e)) if e.kind() != io::ErrorKind::WouldBlock => panic!("pseudo-terminal: {e}"),
            _ => {}
        }
    }
}

/// A healthy actuator at 400 Hz: 40 ms of rest, half a second of motion, over and over.
pub(crate) struct Device(ScenarioRun);

/// Sample rate of the device, Hz.
const RATE_HZ: f64 = 400.0;

impl Device {
    pub(crate) fn start(seed: u64) -> Self {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = RATE_HZ;
        let scenario = Scenario {
            actuations: Actuations {
                count: 1000,
                ..Actuations::single(Profile::Step)
            },
            ..Scenario::new(params, FaultVector::NOMINAL, seed)
        };
        Self(scenario.run())
    }

    /// Goes on for some time, in real time.
    pub(crate) fn play(&mut self, plug: &Plug, duration: Duration) {
        let start = Instant::now();
        let mut first_us = None;
        for sensed in &mut self.0 {
            let time_us = (sensed.seq as f64 * 1e6 / RATE_HZ).round() as u64;
            let since = Duration::from_micros(time_us - *first_us.get_or_insert(time_us));
            std::thread::sleep(since.saturating_sub(start.elapsed()));
            let packet = SerialPacket::Sample(encode(ActuatorId::new(0).unwrap(), &sensed, time_us));
            plug.write(packet.emit(&mut [0; MAX_FRAME_LEN]).unwrap());
            if since >= duration {
                return;
            }
        }
    }
}
