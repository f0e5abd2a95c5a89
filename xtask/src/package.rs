//! The library crates as they would be published: packed, and each built from its package alone.

use crate::shell::{cargo, run};

/// Those that can be published, a crate after the ones it needs.
pub(crate) const CRATES: [&str; 9] = [
    "ema-models",
    "ema-ga",
    "ema-wire",
    "ema-identify",
    "hmd-core",
    "hmd-storage",
    "hmd-ingest",
    "hmd-report",
    "hmd-lab",
];

/// Packs them; cargo refuses one whose files or dependencies are not in its package.
pub(crate) fn check() -> anyhow::Result<()> {
    let packages = CRATES.iter().flat_map(|name| ["--package", name]);
    run(cargo(["package", "--locked"]).args(packages))
}
