//! The power goes while the daemon writes to ext4 in a user-mode Linux.

use crate::shell::{cargo, run};
use crate::{debian, guest_state};

/// What it takes, each with a file of it.
const PACKAGES: [(&str, &str); 2] = [
    ("user-mode-linux", "/usr/bin/linux.uml"),
    ("e2fsprogs", "/usr/sbin/e2fsck"),
];

/// Cuts the power so many times; the test says what was told as synced and what was found.
pub(crate) fn check(cuts: u32) -> anyhow::Result<()> {
    debian::install(&PACKAGES)?;
    // Of the whole workspace, as the programs: nothing is compiled again.
    let test = ["test", "--workspace", "--test", "storage", "--"];
    let long = ["survives_power_loss", "--ignored", "--nocapture"];
    let preload = guest_state::library()?;
    run(cargo(test)
        .args(long)
        .env("HMD_POWER_CUTS", cuts.to_string())
        .env("HMD_GUEST_PRELOAD", preload))
}
