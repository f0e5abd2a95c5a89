//! Orders of pushing, popping and closing, drawn at random from a fixed seed, and by a scheduler that prefers rare ones.

use std::time::Duration;

use shuttle::scheduler::{PctScheduler, RandomScheduler, Scheduler};
use shuttle::sync::Arc;
use shuttle::{Config, Runner, thread};

use crate::window_queue::{QUEUE_WINDOWS, WindowQueue};

/// Orders of each scheduler.
const ORDERS: usize = 20_000;
const SEED: u64 = 1;
/// Preemptions that the second scheduler places.
const DEPTH: usize = 3;

fn in_any_order(body: impl Fn() + Send + Sync + Clone + 'static) {
    fn run(scheduler: impl Scheduler + 'static, body: impl Fn() + Send + Sync + 'static) {
        Runner::new(scheduler, Config::new()).run(body);
    }
    run(RandomScheduler::new_from_seed(SEED, ORDERS), body.clone());
    run(PctScheduler::new_from_seed(SEED, DEPTH, ORDERS), body);
}

/// Windows that are more than the queue holds.
const WINDOWS: usize = QUEUE_WINDOWS + 6;

#[test]
fn every_window_is_popped_or_returned_once_and_in_order() {
    in_any_order(|| {
        let queue = Arc::new(WindowQueue::new());
        let consumer = {
            let queue = queue.clone();
            thread::spawn(move || std::iter::from_fn(|| queue.pop()).collect::<Vec<usize>>())
        };
        let dropped: Vec<usize> = (0..WINDOWS).filter_map(|n| queue.push(n)).collect();
        queue.close();
        let popped = consumer.join().unwrap();
        assert!(popped.is_sorted() && dropped.is_sorted(), "{popped:?} {dropped:?}");
        assert_eq!(popped.last(), Some(&(WINDOWS - 1)), "the newest is popped");
        let mut all = [popped, dropped].concat();
        all.sort_unstable();
        assert_eq!(all, (0..WINDOWS).collect::<Vec<_>>());
    });
}

#[test]
fn the_last_windows_are_all_popped_and_waited_for() {
    in_any_order(|| {
        let queue = Arc::new(WindowQueue::new());
        let consumer = {
            let queue = queue.clone();
            thread::spawn(move || std::iter::from_fn(|| queue.pop()).count())
        };
        for n in 0..WINDOWS {
            queue.push_last(n);
        }
        while !queue.wait_idle(Duration::MAX) {}
        assert_eq!(queue.len(), 0);
        queue.close();
        assert_eq!(consumer.join().unwrap(), WINDOWS);
    });
}

#[test]
fn closing_the_queue_unblocks_all_threads() {
    in_any_order(|| {
        let queue = Arc::new(WindowQueue::new());
        let consumer = {
            let queue = queue.clone();
            thread::spawn(move || {
                let first = queue.pop();
                queue.close();
                first
            })
        };
        for n in 0..WINDOWS {
            queue.push_last(n);
        }
        while !queue.wait_idle(Duration::MAX) {}
        assert!(queue.is_closed());
        assert_eq!(consumer.join().unwrap(), Some(0));
        assert_eq!(queue.take_all().len(), WINDOWS - 1);
    });
}
