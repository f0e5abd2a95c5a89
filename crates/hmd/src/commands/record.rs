//! `hmd record`: capture alone.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::live::{Signals, report, tell};
use super::{Exit, Misuse, no_recording};
use crate::daemon::{Daemon, Observer};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::{DEFAULT_BITRATE_BIT_S, OutputConfig};
use hmd_core::frame::BusNames;
use hmd_core::record::Status;
use hmd_ingest::can::{CanSource, Wanted};
use hmd_ingest::live::LiveSource;
use hmd_ingest::serial::SerialSource;
use hmd_storage::recorder::Recorder;

/// Record every frame of some buses until SIGINT or SIGTERM; nothing is filtered and nothing assessed.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd record can0 -o capture.mcap\n\
    \x20 hmd record can0 can1 --serial uart1=/dev/ttyUSB0@921600 -o captures/")]
pub struct Args {
    /// CAN interfaces.
    #[arg(required_unless_present = "serial")]
    interfaces: Vec<String>,
    /// A serial line and the name of its bus; the bit rate, bit/s, is 921600 unless given.
    #[arg(long, value_name = "BUS=DEVICE[@BITRATE]", value_parser = serial_line)]
    serial: Vec<(String, SerialSource)>,
    /// MCAP file for the frames, or a folder (it is one, or ends with "/") for segments that survive.
    #[arg(short, long, value_name = "OUT.mcap|FOLDER/")]
    output: PathBuf,
}

/// Runs the verb.
///
/// # Errors
/// An output that cannot be written. A bad bus is no error: its source waits.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let on_can = args.interfaces.iter().map(|name| {
        let source = LiveSource::Can(CanSource::new(name, Wanted::All));
        (name.clone(), source)
    });
    let lines = args.serial.iter().cloned();
    let sources = on_can.chain(lines.map(|(bus, source)| (bus, LiveSource::Serial(source))));
    let metadata = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION"))),
        ("clock_source", "host"),
    ];
    let metadata: BTreeMap<String, String> = metadata
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .collect();
    check_names(args)?;
    no_recording(&args.output)?;
    let signals = Signals::listen().context("signals")?;
    let daemon = Daemon {
        sources: sources.collect(),
        recorder: Some(Recorder::open(
            &args.output,
            &metadata,
            OutputConfig::default().limits(),
        )?),
        watch: None,
    };
    let end = async {
        signals.next().await;
    };
    Ok(report(&daemon.run(end, &NoticePrinter)?, false))
}

/// Refuses a name that is no interface's, and one that is given twice: frames would be of the wrong bus.
fn check_names(args: &Args) -> Result<(), Misuse> {
    let mut names = BusNames::new();
    for (n, name) in args
        .interfaces
        .iter()
        .chain(args.serial.iter().map(|(bus, _)| bus))
        .enumerate()
    {
        let number = names
            .intern(name)
            .map_err(|cause| Misuse(format!("interface {name:?}: {cause}")))?;
        if usize::from(number) != n {
            return Err(Misuse(format!("expected each interface once, found {name:?} twice")));
        }
    }
    Ok(())
}

fn serial_line(text: &str) -> Result<(String, SerialSource), String> {
    let (bus, device) = text.split_once('=').ok_or("expected BUS=DEVICE")?;
    let (device, rate) = match device.rsplit_once('@') {
        Some((device, rate)) => (device, rate.parse().ok().filter(|&rate| rate > 0)),
        None => (device, Some(DEFAULT_BITRATE_BIT_S)),
    };
    let rate = rate.ok_or("expected a bit rate after @, as in 921600")?;
    BusNames::new().intern(bus).map_err(|error| error.to_string())?;
    Ok((bus.to_owned(), SerialSource::new(Path::new(device), rate)))
}

struct NoticePrinter;

impl Observer for NoticePrinter {
    fn assessed(&self, _: &AssessedWindow) -> io::Result<()> {
        Ok(())
    }

    fn notice(&self, message: &str) {
        tell(message);
    }

    fn failed(&self, status: &Status) {
        report(status, false);
    }
}
