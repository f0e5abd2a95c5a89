//! The programs of this workspace that the verbs run, built as the tests need them.

use std::path::PathBuf;

use crate::shell::{cargo, run, target_dir};

/// What is built, in cargo's words.
const TARGETS: [(&str, &str); 8] = [
    ("--bin", "hmd"),
    ("--bin", "firmware_sim"),
    ("--example", "decode_candump"),
    ("--example", "decode_dbc"),
    ("--example", "oracle"),
    ("--example", "random_candump"),
    ("--example", "read_log"),
    ("--example", "target_cases"),
];

/// Where they are, after they were built.
pub(crate) struct Programs {
    folder: PathBuf,
}

impl Programs {
    /// Builds them.
    ///
    /// Of the whole workspace, and with an example among them: then every dependency has the features that it has for
    /// `cargo test --workspace`, and nothing is compiled that the tests have not compiled. With `--package hmd` alone, half of
    /// the dependencies and all of ours would be compiled again.
    ///
    /// # Errors
    /// They cannot be built.
    pub(crate) fn build() -> anyhow::Result<Self> {
        let mut build = cargo(["build", "--quiet", "--workspace"]);
        for (kind, name) in TARGETS {
            build.args([kind, name]);
        }
        run(build)?;
        Ok(Self {
            folder: target_dir()?.join("debug"),
        })
    }

    /// The folder of the programs.
    pub(crate) fn folder(&self) -> &PathBuf {
        &self.folder
    }

    /// `hmd`.
    pub(crate) fn hmd(&self) -> PathBuf {
        self.folder.join("hmd")
    }

    /// The simulated actuator.
    pub(crate) fn firmware_sim(&self) -> PathBuf {
        self.folder.join("firmware_sim")
    }

    /// An example.
    pub(crate) fn example(&self, name: &str) -> PathBuf {
        self.folder.join("examples").join(name)
    }
}
