//! `--serve` of the verbs that assess windows: their records for viewers, while they run.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use anyhow::Context;

use super::live::Signals;
use super::metrics_http::loopback;
use crate::serve::{Hub, listen};
use hmd_storage::recorder::RecordObserver;

/// Address of the viewers' server without an argument.
const ADDRESS: &str = "127.0.0.1:8765";

/// Longest wait, at the end of a run, for clients to take what is queued.
const TIMEOUT: Duration = Duration::from_secs(2);

/// The option.
#[derive(Debug, clap::Args)]
pub(super) struct Serve {
    /// Stream the records to viewers (Foxglove, Lichtblick) over a WebSocket, for this computer alone; at 127.0.0.1:8765
    /// without an address.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = loopback, num_args = 0..=1, require_equals = true,
          default_missing_value = ADDRESS)]
    serve: Option<SocketAddr>,
    /// A web page whose viewer may connect besides those of this computer, as https://app.foxglove.dev; may be repeated.
    #[arg(long, value_name = "ORIGIN", requires = "serve")]
    serve_origin: Vec<String>,
}

/// Those who look on, if they may.
#[derive(Clone, Debug)]
pub(super) struct Viewers(Option<Hub>);

impl Serve {
    /// Whether viewers may come.
    pub(super) fn is_asked_for(&self) -> bool {
        self.serve.is_some()
    }

    /// Listens if asked to, and reports the address.
    pub(super) fn open(&self, tell: impl FnOnce(&str)) -> anyhow::Result<Viewers> {
        let Some(address) = self.serve else {
            return Ok(Viewers(None));
        };
        let hub = Hub::default();
        // A viewer that finds another process at the same address forgets what it had.
        let session = format!("{}-{}", std::process::id(), hmd_storage::clock::now_ns());
        let address =
            listen(address, hub.clone(), &session, &self.serve_origin).with_context(|| format!("--serve {address}"))?;
        tell(&format!("viewers: ws://{address}"));
        Ok(Viewers(Some(hub)))
    }
}

impl Viewers {
    /// Observer of the recorder for the viewers.
    pub(super) fn observer(&self) -> Option<Box<dyn RecordObserver>> {
        self.0.clone().map(|hub| Box::new(hub) as Box<dyn RecordObserver>)
    }

    /// Waits for the first of them.
    pub(super) fn wait(&self) -> anyhow::Result<()> {
        if let Some(hub) = &self.0 {
            let runtime = tokio::runtime::Builder::new_current_thread().build();
            runtime.context("runtime")?.block_on(hub.arrived());
        }
        Ok(())
    }

    /// Goes on for those who look until a signal ends it.
    pub(super) fn stay(&self, tell: impl FnOnce(&str)) -> anyhow::Result<()> {
        if self.0.is_some() {
            let signals = Signals::listen().context("signals")?;
            tell("replayed; served on until Ctrl-C");
            let runtime = tokio::runtime::Builder::new_current_thread().build();
            runtime.context("runtime")?.block_on(signals.next());
        }
        Ok(())
    }

    /// Lets them take what is queued, as long as they do.
    pub(super) fn finish(&self) {
        let Some(hub) = &self.0 else { return };
        let since = Instant::now();
        while !hub.is_idle() && since.elapsed() < TIMEOUT {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
