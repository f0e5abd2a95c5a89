//! A few seeds hold; `cargo xtask world` runs many.

use hmd_world::plan::Plan;
use hmd_world::run;

#[test]
fn in_a_few_worlds_everything_holds() {
    // The last one ends a run just behind frames that the kernel dropped.
    for seed in [1, 2, 1006] {
        let outcome = run(&Plan::of_seed(seed), false).expect("a world");
        assert!(outcome.violations.is_empty(), "seed {seed}: {:?}", outcome.violations);
        assert!(outcome.windows > 0 && outcome.replayed > 0, "seed {seed}");
    }
}

#[test]
fn one_seed_gives_one_world() {
    let again = || {
        let outcome = run(&Plan::of_seed(5), false).expect("a world");
        (outcome.windows, outcome.runs, outcome.replayed, outcome.disturbances)
    };
    assert_eq!(again(), again());
}
