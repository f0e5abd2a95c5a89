//! What the verbs that run until a signal have in common.

use std::fmt::Display;
use std::io;
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::Notify;

use super::requests::{Request, Requests};
use super::{Exit, warn};
use hmd_core::counted::counted;
use hmd_core::record::Status;

/// Signals of this process, as requests.
pub(super) struct Signals(Arc<(Mutex<Requests>, Notify)>);

impl Signals {
    /// Signals from now on, on a thread of their own: none is missed before the daemon runs, or between two runs of it.
    pub(super) fn listen() -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
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
        let shared = Arc::new((Mutex::<Requests>::default(), Notify::new()));
        let asked = shared.clone();
        std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
            runtime.block_on(async {
                loop {
                    let request = tokio::select! {
                        _ = interrupt.recv() => Request::Stop,
                        _ = terminate.recv() => Request::Stop,
                        _ = hangup.recv() => Request::Reload,
                    };
                    lock(&asked.0).ask(request);
                    asked.1.notify_one();
                }
            });
        })?;
        Ok(Self(shared))
    }

    /// The next request, if there is one.
    pub(super) fn poll(&self) -> Option<Request> {
        lock(&self.0.0).next()
    }

    /// Waits for the next request.
    pub(super) async fn next(&self) -> Request {
        loop {
            if let Some(request) = self.poll() {
                return request;
            }
            self.0.1.notified().await;
        }
    }
}

/// Longest time that a line waits for the reader of a stream: a daemon waits for it.
pub(super) const STALLED: Duration = Duration::from_secs(5);

/// Whether a stream can be written to within some time. A pipe that is ready has room for a page, which is longer than a line.
pub(super) fn is_writable(stream: impl AsFd, within: Duration) -> bool {
    let within = Timespec::try_from(within).ok();
    let mut streams = [PollFd::new(&stream, PollFlags::OUT)];
    // An error is reported by the write.
    !matches!(poll(&mut streams, within.as_ref()), Ok(0))
}

/// Writes a line to stderr as [`warn`] does; one that nobody reads in time is dropped, and until somebody reads again the next ones at once.
pub(super) fn tell(line: impl Display) {
    static IS_STALLED: AtomicBool = AtomicBool::new(false);
    let within = if IS_STALLED.load(Ordering::Relaxed) {
        Duration::ZERO
    } else {
        STALLED
    };
    let is_read = is_writable(io::stderr(), within);
    IS_STALLED.store(!is_read, Ordering::Relaxed);
    if is_read {
        warn(line);
    }
}

fn lock(requests: &Mutex<Requests>) -> MutexGuard<'_, Requests> {
    requests.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Prints what came in and what was lost; whether any actuator `is_watched` decides what is said of frames that were not decoded.
pub(super) fn report(status: &Status, is_watched: bool) -> Exit {
    if is_watched {
        tell(format_args!(
            "{} received: {} decoded, {} of others than the actuators watched, {}",
            counted(status.frames_received, "frame", "frames"),
            status.frames_decoded,
            status.frames_filtered,
            counted(status.frames_error, "error frame", "error frames")
        ));
    } else {
        tell(format_args!(
            "{} recorded, {}",
            counted(status.frames_received, "frame", "frames"),
            counted(status.frames_error, "error frame", "error frames")
        ));
    }
    if !status.data_lost() {
        return Exit::Done;
    }
    let lost: Vec<String> = [
        (
            status.lost_socket_queue,
            "frame by full receive queues",
            "frames by full receive queues",
        ),
        (status.lost_unreadable, "unreadable frame", "unreadable frames"),
        (status.lost_malformed, "malformed frame", "malformed frames"),
        (status.lost_samples, "sample", "samples"),
        (status.lost_late, "frame out of order", "frames out of order"),
        (status.lost_windows, "window", "windows"),
        (status.lost_storage_frames, "frame not stored", "frames not stored"),
        (status.lost_storage_records, "record not stored", "records not stored"),
        (status.lost_captures, "capture", "captures"),
    ]
    .into_iter()
    .filter(|(count, ..)| *count > 0)
    .map(|(count, one, many)| counted(count, one, many))
    .collect();
    tell(format_args!("data lost: {}", lost.join(", ")));
    Exit::DataLost
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn a_full_pipe_is_not_writable() {
        let (reader, mut writer) = io::pipe().unwrap();
        let soon = Duration::from_millis(10);
        assert!(is_writable(&writer, soon));
        // A page at a time, until the next would wait.
        while is_writable(&writer, soon) {
            writer.write_all(&[b'x'; 4096]).unwrap();
        }
        drop(reader);
        assert!(is_writable(&writer, soon), "the write says that it is broken");
    }
}
