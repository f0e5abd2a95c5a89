//! What the verbs that run until a signal have in common.

use std::io;

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;

use super::{Exit, warn};
use hmd_core::record::Status;

/// Request of an operator to a running daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Request {
    /// SIGINT or SIGTERM.
    Stop,
    /// SIGHUP.
    Reload,
}

/// Requests that wait while one is carried out: a reload takes the configuration as it is then, so that a second asks for nothing
/// new, and there is always room for a stop.
const WAITING_MAX: usize = 2;

/// Signals from now on, on a thread of their own: none is missed before the daemon runs, or between two runs of it.
pub(super) fn signals() -> io::Result<mpsc::Receiver<Request>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    let (sender, receiver) = mpsc::channel(WAITING_MAX);
    let [mut interrupt, mut terminate, mut hangup, _too_large] = {
        let _inside = runtime.enter();
        [
            signal(SignalKind::interrupt())?,
            signal(SignalKind::terminate())?,
            signal(SignalKind::hangup())?,
            // A file larger than the limit of the process is an error of the write, which costs a segment, not the run.
            signal(SignalKind::from_raw(libc::SIGXFSZ))?,
        ]
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        runtime.block_on(async {
            loop {
                let request = tokio::select! {
                    _ = interrupt.recv() => Request::Stop,
                    _ = terminate.recv() => Request::Stop,
                    _ = hangup.recv() => Request::Reload,
                };
                if request == Request::Stop || sender.capacity() == WAITING_MAX {
                    // A full channel asks for the stop already.
                    let _ = sender.try_send(request);
                }
            }
        });
    })?;
    Ok(receiver)
}

/// Prints what came in and what was lost.
pub(super) fn report(status: &Status) -> Exit {
    warn(format_args!(
        "{} frames received: {} decoded, {} of no actuator that is watched, {} error frames",
        status.frames_received, status.frames_decoded, status.frames_filtered, status.frames_error
    ));
    if !status.data_lost() {
        return Exit::Done;
    }
    warn(format_args!(
        "data lost: {} frames by full receive queues, {} unreadable frames, {} malformed frames, {} samples, {} frames \
         out of order, {} windows, {} frames and {} records not stored",
        status.lost_socket_queue,
        status.lost_unreadable,
        status.lost_malformed,
        status.lost_samples,
        status.lost_late,
        status.lost_windows,
        status.lost_storage_frames,
        status.lost_storage_records
    ));
    Exit::DataLost
}
