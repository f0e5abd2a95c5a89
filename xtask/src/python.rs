//! The Python environment of the readers, the viewers, the oracle, progpy and the report, under the target directory.

use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::shell::{program, run, target_dir};

/// A virtual environment with packages in it.
pub(crate) struct Python {
    program: PathBuf,
}

impl Python {
    /// Makes the environment if it is missing, and installs what it lacks.
    ///
    /// # Errors
    /// No Python, no `venv` module, no network.
    pub(crate) fn with_packages(packages: &[&str]) -> anyhow::Result<Self> {
        let folder = target_dir()?.join("python");
        let program_path = folder.join("bin/python");
        // pip is the last thing that goes into an environment; without it, a run was interrupted.
        if !folder.join("bin/pip").exists() {
            run(program("python3", ["-m", "venv", "--clear"]).arg(&folder)).context(
                "expected a Python 3 with its venv module (Debian: apt-get install python3-venv), found none that works",
            )?;
        }
        let python = Self { program: program_path };
        let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        run(program(&python.program, quiet).args(packages)).context("cannot install Python packages")?;
        Ok(python)
    }

    /// Its interpreter.
    pub(crate) fn interpreter(&self) -> &Path {
        &self.program
    }

    /// Runs a script of this workspace.
    ///
    /// # Errors
    /// The script's exit code is not 0.
    pub(crate) fn script(&self, script: &str, args: &[&Path]) -> anyhow::Result<()> {
        self.script_with(script, args, &[])
    }

    /// Runs a script with files and then further arguments.
    ///
    /// # Errors
    /// The script's exit code is not 0.
    pub(crate) fn script_with(&self, script: &str, files: &[&Path], more: &[String]) -> anyhow::Result<()> {
        run(program(&self.program, [script]).args(files).args(more))
    }
}
