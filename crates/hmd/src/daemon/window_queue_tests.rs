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

#[test]
fn an_end_waits_for_what_is_assessed_and_what_is_left_is_taken_out() {
    let (queue, soon) = (WindowQueue::new(), Duration::from_millis(5));
    assert!(queue.wait_idle(soon), "nothing waits");
    for n in 0..2 * QUEUE_WINDOWS {
        queue.push_last(n);
    }
    assert_eq!(queue.pop(), Some(0));
    assert_eq!(queue.unassessed(), 2 * QUEUE_WINDOWS as u64);
    assert!(!queue.wait_idle(soon));
    let second = Duration::from_secs(1);
    assert!(!queue.is_over(Duration::MAX));
    queue.end_by(second);
    assert!(!queue.is_over(second - soon) && queue.is_over(second));
    assert!(queue.take_all().into_iter().eq(1..2 * QUEUE_WINDOWS));
    assert!(!queue.wait_idle(soon), "one is being assessed");
    std::thread::scope(|scope| {
        scope.spawn(|| queue.pop());
        assert!(queue.wait_idle(Duration::from_secs(60)));
        queue.push_last(0);
    });
    queue.push_last(1);
    queue.close();
    assert!(queue.wait_idle(soon), "nobody pops");
}

#[test]
fn several_are_taken_together_as_far_as_they_wait() {
    let queue = WindowQueue::new();
    for n in 0..5 {
        queue.push(n);
    }
    assert_eq!(queue.pop_some(|waiting| waiting.len() - 3), Some(vec![0, 1]));
    assert_eq!(queue.unassessed(), 5);
    assert_eq!(queue.pop_some(|_| 0), Some(vec![2]));
    assert_eq!(queue.pop_some(|_| 9), Some(vec![3, 4]));
    assert_eq!(queue.unassessed(), 2);
    std::thread::sleep(Duration::from_millis(20));
    queue.one_done();
    assert!(queue.busy_for() < Duration::from_millis(20), "the next one begins");
    assert_eq!(queue.unassessed(), 1);
    queue.one_done();
    assert_eq!(queue.unassessed(), 1, "the last one until the next are taken");
    queue.give_back([3, 4].into_iter());
    queue.push(5);
    assert_eq!(queue.pop_some(|_| 9), Some(vec![3, 4, 5]));
    queue.close();
    assert_eq!(queue.pop_some(|_| 9), None);
    assert_eq!(queue.unassessed(), 0);
}
