//! Repairs of cut segments beside the watch: a start waits for short ones alone.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};

use super::disk::Disk;
use super::name::Name;
use super::repair::{Found, repair_one};

/// A thread that repairs one segment after the other. Dropped, it ends after the one in hand; the next start does the others.
pub(super) struct BackgroundRepair {
    done: mpsc::Receiver<(Name, Found)>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl BackgroundRepair {
    /// Begins; without a thread the segments are left to the next start.
    pub(super) fn begin(folder: PathBuf, names: Vec<Name>, disk: Arc<dyn Disk>) -> Self {
        let (sender, done) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let work = move || {
            for name in names {
                if stopped.load(Ordering::Relaxed) {
                    return;
                }
                if sender.send((name, repair_one(&folder, name, &*disk))).is_err() {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("repair".to_owned()).spawn(work).ok();
        Self { done, stop, thread }
    }

    /// What was repaired since the last call.
    pub(super) fn take(&self) -> Vec<(Name, Found)> {
        self.done.try_iter().collect()
    }
}

impl Drop for BackgroundRepair {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in it was reported by itself; the segment is left to the next start.
            let _ = thread.join();
        }
    }
}
