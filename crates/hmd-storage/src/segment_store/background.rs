//! Repairs of cut segments beside the watch: a start waits for short ones alone.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};

use super::disk::Disk;
use super::name::Name;
use super::repair::{Found, repair_one};

/// A thread that repairs one segment after the other. Dropped, it leaves the one in hand as it was, and all others, to the next start.
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
        let stopped = Arc::clone(&stop);
        let work = move || {
            for name in names {
                if stopped.load(Ordering::Relaxed) {
                    return;
                }
                let found = repair_one(&folder, name, &*disk, &stopped);
                if !found.pending.is_empty() {
                    return;
                }
                // It is received until this thread has ended.
                let _ = sender.send((name, found));
            }
        };
        let thread = thread::Builder::new().name("repair".to_owned()).spawn(work).ok();
        Self { done, stop, thread }
    }

    /// Ends after the chunk in hand, and waits for that.
    pub(super) fn stop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in it was reported by itself; the segment is left to the next start.
            let _ = thread.join();
        }
    }

    /// What was repaired since the last call.
    pub(super) fn take(&self) -> Vec<(Name, Found)> {
        self.done.try_iter().collect()
    }
}

impl Drop for BackgroundRepair {
    fn drop(&mut self) {
        self.stop();
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::path::Path;
    use std::time::{Duration, Instant};

    use super::super::disk::{Out, RealDisk};
    use super::super::name::{Kind, Stage};
    use super::super::tests::cut_segment;
    use super::*;

    /// A disk on which it takes a while to make a file.
    #[derive(Default)]
    struct SlowDisk(AtomicBool);

    impl Disk for SlowDisk {
        fn create(&self, path: &Path) -> io::Result<Box<dyn Out>> {
            self.0.store(true, Ordering::Relaxed);
            thread::sleep(Duration::from_millis(200));
            RealDisk.create(path)
        }

        fn free_bytes(&self, folder: &Path) -> io::Result<u64> {
            RealDisk.free_bytes(folder)
        }
    }

    /// Three cut segments, and their repair as soon as the first is in hand.
    fn first_in_hand(folder: &Path) -> (Vec<Name>, BackgroundRepair) {
        let names: Vec<Name> = (1..4)
            .map(|number| Name {
                number,
                kind: Kind::Raw,
                stage: Stage::Open,
            })
            .collect();
        for name in &names {
            std::fs::write(folder.join(name.to_string()), cut_segment()).unwrap();
        }
        let disk = Arc::new(SlowDisk::default());
        let repair = BackgroundRepair::begin(folder.to_owned(), names.clone(), disk.clone());
        let begun = Instant::now();
        while !disk.0.load(Ordering::Relaxed) {
            assert!(begun.elapsed() < Duration::from_secs(60));
            thread::yield_now();
        }
        (names, repair)
    }

    fn assert_nothing_is_changed(folder: &Path, names: &[Name]) {
        let exists = |name: &Name, stage| folder.join(name.with_stage(stage).to_string()).exists();
        let state = |name: &Name| [Stage::Open, Stage::Repair, Stage::Closed].map(|stage| exists(name, stage));
        for name in names {
            assert_eq!(state(name), [true, false, false], "left to the next start");
        }
    }

    #[test]
    fn stopped_it_leaves_the_segment_in_hand_and_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let (names, mut repair) = first_in_hand(folder.path());
        repair.stop();
        assert!(repair.take().is_empty());
        assert_nothing_is_changed(folder.path(), &names);
    }

    /// Whoever takes the folder next must not find it at work.
    #[test]
    fn dropped_it_waits_until_the_thread_has_ended() {
        let folder = tempfile::tempdir().unwrap();
        let (names, repair) = first_in_hand(folder.path());
        drop(repair);
        assert_nothing_is_changed(folder.path(), &names);
    }
}
