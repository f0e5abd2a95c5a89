//! What the verbs that run until they are told to stop have in common.

use tokio::signal::unix::{SignalKind, signal};

use super::Exit;
use crate::record::Status;

/// Resolves at the first SIGINT or SIGTERM.
pub(super) async fn stop_signal() {
    let (interrupt, terminate) = (signal(SignalKind::interrupt()), signal(SignalKind::terminate()));
    match (interrupt, terminate) {
        (Ok(mut interrupt), Ok(mut terminate)) => tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        },
        // Without handlers the signals end the process at once; there is nothing to wait for.
        _ => std::future::pending().await,
    }
}

/// Says what came in and what was lost.
pub(super) fn report(status: &Status) -> Exit {
    eprintln!(
        "{} frames received: {} decoded, {} of no actuator that is watched, {} error frames",
        status.frames_received, status.frames_decoded, status.frames_filtered, status.frames_error
    );
    if !status.data_lost() {
        return Exit::Done;
    }
    eprintln!(
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
    );
    Exit::DataLost
}
