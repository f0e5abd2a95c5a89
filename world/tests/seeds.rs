//! A few seeds hold; `cargo xtask world` runs many.

use std::time::Duration;

use hmd_world::plan::{Disturbance, Plan, What};
use hmd_world::run;

#[test]
fn in_a_few_worlds_everything_holds() {
    let mut replayed = 0;
    for seed in 1..=3 {
        let outcome = run(&Plan::of_seed(seed), false).expect("a world");
        assert!(outcome.violations.is_empty(), "seed {seed}: {:?}", outcome.violations);
        assert!(outcome.windows > 0, "seed {seed}");
        replayed += outcome.replayed;
    }
    assert!(replayed > 0);
}

#[test]
fn frames_that_the_kernel_dropped_last_are_told_of_by_the_next_run() {
    // 417 ms of the bus, and the end within them.
    let disturbances = [What::Overflow(0, 2_000), What::Restart];
    let listed = disturbances.into_iter().enumerate().map(|(number, what)| Disturbance {
        number,
        at: Duration::from_millis(20_000 + 250 * number as u64),
        what,
    });
    let plan = Plan {
        seed: 1006,
        length: Duration::from_secs(50),
        disturbances: listed.collect(),
    };
    let outcome = run(&plan, false).expect("a world");
    assert!(outcome.violations.is_empty(), "{:?}", outcome.violations);
    assert_eq!(outcome.runs, 2);
}

#[test]
fn one_seed_gives_one_world() {
    let again = || {
        let outcome = run(&Plan::of_seed(5), false).expect("a world");
        (outcome.windows, outcome.runs, outcome.replayed, outcome.disturbances)
    };
    assert_eq!(again(), again());
}
