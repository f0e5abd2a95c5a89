//! Python environments under the target directory: one for the readers, the viewers, the oracle, progpy and the report, others made
//! anew.

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
        // pip is the last thing that goes into an environment; without it, a run was interrupted.
        if folder.join("bin/pip").exists() {
            Self::at(&folder).install(packages)
        } else {
            Self::fresh(&folder, packages)
        }
    }

    /// Makes an environment anew, with these packages and what they need.
    ///
    /// # Errors
    /// No Python, no `venv` module, no network.
    pub(crate) fn fresh(folder: &Path, packages: &[&str]) -> anyhow::Result<Self> {
        run(program("python3", ["-m", "venv", "--clear"]).arg(folder)).context(
            "expected a Python 3 with its venv module (Debian: apt-get install python3-venv), found none that works",
        )?;
        Self::at(folder).install(packages)
    }

    fn at(folder: &Path) -> Self {
        Self {
            program: folder.join("bin/python"),
        }
    }

    fn install(self, packages: &[&str]) -> anyhow::Result<Self> {
        let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        run(program(&self.program, quiet).args(packages)).context("cannot install Python packages")?;
        Ok(self)
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
