use std::time::Duration;

use super::window_queue::*;

#[test]
fn the_popping_thread_is_busy_until_it_pops_again() {
    let queue = WindowQueue::new();
    assert_eq!(queue.busy_for(), Duration::ZERO);
    assert_eq!(queue.push(1), None);
    assert_eq!(queue.busy_for(), Duration::ZERO, "waiting is not busy");
    assert_eq!(queue.pop(), Some(1));
    std::thread::sleep(Duration::from_millis(20));
    assert!(queue.busy_for() >= Duration::from_millis(20));
    queue.close();
    assert_eq!(queue.pop(), None);
    assert_eq!(queue.busy_for(), Duration::ZERO);
}

#[test]
fn the_oldest_gives_way() {
    let queue = WindowQueue::new();
    for n in 0..QUEUE_WINDOWS {
        assert_eq!(queue.push(n), None);
    }
    assert_eq!(queue.push(QUEUE_WINDOWS), Some(0));
    assert_eq!((queue.len(), queue.pop()), (QUEUE_WINDOWS, Some(1)));
}
