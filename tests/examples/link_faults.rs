//! Verdicts behind a bad link: the worst mix and a mild one over healthy windows and windows with one fault each, and a few
//! drops over the latter.
//!
//! ```text
//! cargo run --release -p hmd-tests --example link_faults [WINDOWS [SEED]]
//! ```

#[path = "../link_suite/mod.rs"]
mod link_suite;

use firmware_sim::LinkFaults;
use link_suite::{Kind, Tally, one_fault, watch};

fn main() {
    let mut numbers = std::env::args()
        .skip(1)
        .map(|text| text.parse().expect("a whole number"));
    let windows = numbers.next().unwrap_or(1000);
    let seed = numbers.next().unwrap_or(1);
    let few_drops = LinkFaults {
        drop: 0.001,
        ..LinkFaults::NONE
    };
    let mild = LinkFaults {
        drop: 0.002,
        flip: 0.002,
        ..LinkFaults::WORST
    };
    println!("| link | windows | assessed | right of them | with a fault that is not there |");
    println!("|---|---|---|---|---|");
    for kind in [Kind::Serial, Kind::Can] {
        report(
            &format!("{kind:?}, worst mix, healthy"),
            &watch(kind, LinkFaults::WORST, windows, seed, |_| None),
        );
        report(
            &format!("{kind:?}, worst mix, one fault"),
            &watch(kind, LinkFaults::WORST, windows, seed, one_fault(seed)),
        );
        report(
            &format!("{kind:?}, mild mix, healthy"),
            &watch(kind, mild, windows, seed, |_| None),
        );
        report(
            &format!("{kind:?}, mild mix, one fault"),
            &watch(kind, mild, windows, seed, one_fault(seed)),
        );
        report(
            &format!("{kind:?}, 0.1 % drops, one fault"),
            &watch(kind, few_drops, windows, seed, one_fault(seed)),
        );
    }
    report(
        "perfect, one fault",
        &watch(Kind::Serial, LinkFaults::NONE, windows, seed, one_fault(seed)),
    );
}

fn report(what: &str, tally: &Tally) {
    let Tally {
        windows,
        assessed,
        right,
        false_faults,
        reasons,
        wrong,
    } = tally;
    println!(
        "| {what} | {windows} | {assessed} ({:.1} %) | {right} ({:.1} %) | {false_faults} |",
        100.0 * *assessed as f64 / *windows as f64,
        100.0 * *right as f64 / (*assessed).max(1) as f64,
    );
    eprintln!("{what}: not assessed: {reasons:?}");
    for line in wrong {
        eprintln!("{what}: {line}");
    }
}
