//! `hmd record`: capture alone.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use super::Exit;
use super::live::{report, stop_signal};
use crate::config::OutputConfig;
use crate::daemon::{Daemon, Observer};
use crate::ingest::can::{CanSource, Wanted};
use crate::ingest::live::LiveSource;
use crate::judge::Judged;
use crate::recorder::Recorder;

/// Record every frame of some interfaces until SIGINT or SIGTERM; nothing is filtered and nothing judged.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// CAN interfaces.
    #[arg(required = true)]
    interfaces: Vec<String>,
    /// MCAP file for the frames, or a folder (it is one, or ends with "/") for segments that survive.
    #[arg(short, long, value_name = "OUT.mcap|FOLDER/")]
    output: PathBuf,
}

/// Runs the verb.
///
/// # Errors
/// An output that cannot be written. A bad bus is no error: it is waited for.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let sources = args.interfaces.iter().map(|name| {
        let source = LiveSource::Can(CanSource::new(name, Wanted::All));
        (name.clone(), source)
    });
    let metadata = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION"))),
        ("clock_source", "host"),
    ];
    let metadata: BTreeMap<String, String> = metadata
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .collect();
    let daemon = Daemon {
        sources: sources.collect(),
        recorder: Some(Recorder::open(
            &args.output,
            &metadata,
            OutputConfig::default().limits(),
        )?),
        watch: None,
    };
    Ok(report(&daemon.run(stop_signal(), &Teller)?))
}

struct Teller;

impl Observer for Teller {
    fn judged(&self, _: &Judged) -> io::Result<()> {
        Ok(())
    }

    fn notice(&self, message: &str) {
        eprintln!("{message}");
    }
}
