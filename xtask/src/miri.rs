//! Undefined behaviour and byte order: unit tests of the library crates in Miri, on a processor of the other byte order.
//!
//! That processor has no vector instructions that we use, so that the scalar path is what runs, and none of the assembler of `libm`,
//! which Miri does not know. `nalgebra`'s views break the stacked borrows of Miri; tree borrows are what they keep.

use anyhow::ensure;

use crate::shell::{program, run, succeeds, target_dir};

/// A big-endian processor of 64 bits.
const TARGET: &str = "s390x-unknown-linux-gnu";

/// Crates, their features, and tests that take minutes there because they run the monitor many times.
const CRATES: [(&str, &[&str], &[&str]); 3] = [
    ("ema-wire", &[], &[]),
    ("ema-ga", &[], &[]),
    (
        "ema-identify",
        &["--features", "std"],
        &[
            "slow_slopes_of_the_same_point",
            "only_optima_that_differ",
            "a_start_that_shows_nearly_all",
            "the_share_of_an_admittance",
            "unit_calibration::tests",
            "the_torque_is_that_of_the_equation_of_the_loop",
        ],
    ),
];

/// Runs the tests of each.
///
/// # Errors
/// Without a nightly compiler with Miri, or when it finds anything.
pub(crate) fn check() -> anyhow::Result<()> {
    ensure!(
        succeeds(program("cargo", ["+nightly", "miri", "--version"])),
        "expected Miri: rustup toolchain install nightly --component miri"
    );
    for (krate, features, skipped) in CRATES {
        let mut miri = program("cargo", ["+nightly", "miri", "test", "--lib", "--target", TARGET]);
        miri.args(["--package", krate]).args(features).arg("--");
        miri.args(skipped.iter().flat_map(|name| ["--skip", name]));
        run(miri
            .env("CARGO_TARGET_DIR", target_dir()?.join("miri"))
            .env("MIRIFLAGS", "-Zmiri-disable-isolation -Zmiri-tree-borrows")
            .env("PROPTEST_CASES", "2")
            // C code of a benchmark's dependency is compiled, and neither linked nor run.
            .env("CC_s390x_unknown_linux_gnu", "cc")
            .env("AR_s390x_unknown_linux_gnu", "ar"))?;
    }
    Ok(())
}
