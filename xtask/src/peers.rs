//! Minimisers and filters by others on our windows, monitor and cost, beside our search; the table stands in
//! `fixtures/results/peers.md`.

use std::fs;

use anyhow::Context;

use crate::progpy::replaced;
use crate::python::Python;
use crate::shell::{program, root, run, run_to_file, succeeds, target_dir};
use crate::wheel::{Profile, built};

/// The versions that the table was made with.
const PACKAGES: [&str; 4] = ["cma==4.5.0", "numpy==2.4.6", "pygad==3.9.2", "scipy==1.17.1"];

/// Has no wheel for every Python and processor; its rows say so where it does not install.
const PYGMO: &str = "pygmo==2.20.0";

const DOCUMENT: &str = "fixtures/results/peers.md";
const BEGIN: &str = "<!-- $ cargo xtask peers -->\n";

/// Lets all searches identify the same windows on one core, and puts the table in place.
pub(crate) fn compare(windows: u32) -> anyhow::Result<()> {
    let wheel = built(Profile::Release)?;
    let folder = target_dir()?.join("peers");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let python = Python::fresh(&folder.join("environment"), &PACKAGES)?;
    let pip = |package: &std::path::Path| {
        let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        let mut command = program(python.interpreter(), install);
        command.arg(package);
        command
    };
    run(pip(&wheel))?;
    if !succeeds(pip(PYGMO.as_ref())) {
        eprintln!("{PYGMO} does not install here: its rows stay empty");
    }
    let table = folder.join("table.md");
    let mut script = program(python.interpreter(), ["fixtures/reference/peers.py"]);
    script.arg(windows.to_string()).env("OMP_NUM_THREADS", "1");
    run_to_file(script, None, &table)?;

    let document = root().join(DOCUMENT);
    let text = fs::read_to_string(&document).context(DOCUMENT)?;
    let rows = fs::read_to_string(&table).with_context(|| table.display().to_string())?;
    fs::write(&document, replaced(&text, BEGIN, &rows)?).context(DOCUMENT)
}
