//! The link-fault suite in its small form; `examples/link_faults.rs` is the long one.

#[path = "../link_suite/mod.rs"]
mod link_suite;

use firmware_sim::LinkFaults;
use link_suite::{Kind, one_fault, watch};

const SEED: u64 = 1;

#[test]
fn a_healthy_actuator_behind_the_worst_link_has_no_fault() {
    for kind in [Kind::Serial, Kind::Can] {
        let tally = watch(kind, LinkFaults::WORST, 20, SEED, |_| None);
        assert_eq!((tally.windows, tally.false_faults), (20, 0), "{kind:?}: {tally:?}");
    }
}

#[test]
fn a_few_lost_frames_leave_the_verdict_right() {
    let faults = LinkFaults {
        drop: 0.001,
        ..LinkFaults::NONE
    };
    for kind in [Kind::Serial, Kind::Can] {
        let tally = watch(kind, faults, 14, SEED, one_fault(SEED));
        assert!(tally.assessed >= 13, "{kind:?}: {tally:?}");
        assert!(tally.right + 1 >= tally.assessed, "{kind:?}: {tally:?}");
    }
}
