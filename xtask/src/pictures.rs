//! Pictures in the documentation of what the program shows, made again.

use crate::debian;
use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{root, target_dir};

/// A terminal, and what makes pictures small.
const PACKAGES: [&str; 2] = ["pyte==0.8.2", "pillow==13.0.0"];

/// Writes them to `docs/img`.
pub(crate) fn make() -> anyhow::Result<()> {
    debian::install(&[("chromium", "/usr/bin/chromium")])?;
    let python = Python::with_packages(&PACKAGES)?;
    let hmd = Programs::build()?.hmd();
    let [folder, pictures] = [target_dir()?.join("pictures"), root().join("docs/img")];
    python.script("fixtures/pictures.py", &[&hmd, &folder, &pictures])
}
