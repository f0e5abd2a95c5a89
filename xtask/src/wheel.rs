//! The Python package: built, installed where nothing else is, checked, and its notebook run from top to bottom.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::debian;
use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{program, root, run, target_dir};

/// What builds the wheel.
const BUILDER: [&str; 1] = ["maturin==1.16.0"];

/// What checks it: libraries that nobody here wrote, the engine of fleets, types and style, the notebook.
const PACKAGES: [&str; 12] = [
    "dask==2026.8.0",
    "distributed==2026.8.0",
    "ipykernel==7.4.0",
    "matplotlib==3.11.2",
    "mypy==2.4.1",
    "nbclient==0.11.0",
    "numpy==2.4.6",
    "pandas==3.1.1",
    "polars==2.1.0",
    "pyarrow==26.0.1",
    "pytest==9.2.0",
    "ruff==0.17.6",
];

const MANIFEST: &str = "python/Cargo.toml";

/// How the wheel is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Profile {
    /// As the tests, from what they have built.
    Dev,
    /// As it is shipped.
    Release,
}

/// Checks the package as one who installs it would.
pub(crate) fn check() -> anyhow::Result<()> {
    debian::install(&[("parallel", "/usr/bin/parallel")])?;
    let programs = Programs::build()?;
    let python = installed(Profile::Dev)?;
    let inside = |module: &str, args: &[&str]| {
        let mut command = program(python.interpreter(), ["-m", module]);
        command.args(args).current_dir(root().join("python"));
        command
    };
    run(inside("ruff", &["format", "--check", "."]))?;
    run(inside("ruff", &["check", "."]))?;
    run(inside("mypy", &["package", "examples"]))?;
    let pytest = ["--quiet", "-p", "no:cacheprovider"];
    run(inside("pytest", &pytest).env("HMD_PROGRAM", programs.hmd()))?;
    let place = folder()?.join("example");
    fs::create_dir_all(&place).with_context(|| place.display().to_string())?;
    let example = root().join("python/examples/wearing_unit.py");
    run(program(python.interpreter(), [example]).current_dir(&place))?;
    run_notebook(&python)
}

/// A fresh environment with the package in it, and with what checks it.
///
/// # Errors
/// The package cannot be built or installed.
pub(crate) fn installed(profile: Profile) -> anyhow::Result<Python> {
    let wheel = built(profile)?;
    let python = Python::fresh(&folder()?.join("environment"), &PACKAGES)?;
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    run(program(python.interpreter(), install).arg(format!("{}[dask]", wheel.display())))?;
    Ok(python)
}

/// The wheel.
///
/// # Errors
/// It cannot be built.
pub(crate) fn built(profile: Profile) -> anyhow::Result<PathBuf> {
    let wheels = folder()?.join("wheels");
    if wheels.exists() {
        fs::remove_dir_all(&wheels).with_context(|| wheels.display().to_string())?;
    }
    let builder = Python::with_packages(&BUILDER)?;
    let build = ["-m", "maturin", "build", "--locked", "--manifest-path", MANIFEST];
    let release: &[&str] = if profile == Profile::Release {
        &["--release"]
    } else {
        &[]
    };
    run(program(builder.interpreter(), build)
        .args(release)
        .arg("--out")
        .arg(&wheels)
        .env("CARGO_TARGET_DIR", target_dir()?))?;
    only_file(&wheels)
}

fn folder() -> anyhow::Result<PathBuf> {
    Ok(target_dir()?.join("wheel"))
}

fn only_file(folder: &Path) -> anyhow::Result<PathBuf> {
    let mut files = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let file = files
        .next()
        .with_context(|| format!("{}: expected a wheel, found none", folder.display()))?;
    Ok(file?.path())
}

/// Runs the notebook where it may write its logs; a cell that fails ends it.
fn run_notebook(python: &Python) -> anyhow::Result<()> {
    let place = folder()?.join("notebook");
    fs::create_dir_all(&place).with_context(|| place.display().to_string())?;
    fs::copy(root().join("python/first_look.ipynb"), place.join("first_look.ipynb")).context("first_look.ipynb")?;
    let jupyter = python.interpreter().with_file_name("jupyter-execute");
    run(program(jupyter, ["--timeout=300", "first_look.ipynb"]).current_dir(&place))
}
