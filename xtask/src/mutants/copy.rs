//! A copy of the workspace with mutants in one package, and its tests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde_json::Value;

use super::Module;
use super::switched::{Mutant, SWITCH_MODULE, Switched, switched};
use crate::shell::{cargo, program, target_dir};

/// Packages whose optimisation takes longer than what it saves in the tests that are run.
const NOT_OPTIMISED: [&str; 4] = ["ema-ga", "ema-identify", "hmd-core", "hmd-storage"];

/// A copy of the workspace's files.
pub(super) struct Copy {
    folder: PathBuf,
}

/// A program with tests, and the folder in which it is to run.
pub(super) type Program = (PathBuf, PathBuf);

/// Programs with tests, in which each of these mutants can be switched on.
pub(super) struct Built {
    pub(super) programs: Vec<Program>,
    pub(super) mutants: Vec<usize>,
}

impl Copy {
    /// What is tracked, or would be; what is the same already stays, so that it is not built again.
    pub(super) fn of_sources(folder: &Path) -> anyhow::Result<Self> {
        let listed = program("git", ["ls-files", "-z", "--cached", "--others", "--exclude-standard"]).output()?;
        ensure!(listed.status.success(), "git ls-files: {}", listed.status);
        let copy = Self {
            folder: folder.to_owned(),
        };
        let listed = String::from_utf8(listed.stdout).context("git ls-files")?;
        for name in listed.split_terminator('\0') {
            match fs::read(crate::shell::root().join(name)) {
                Ok(bytes) => copy.put(name, &bytes)?,
                // Deleted, and still tracked; a link to a folder.
                Err(cause) if matches!(cause.kind(), ErrorKind::NotFound | ErrorKind::IsADirectory) => {}
                Err(cause) => return Err(cause).context(name.to_owned()),
            }
        }
        Ok(copy)
    }

    fn put(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let path = self.folder.join(name);
        if fs::read(&path).is_ok_and(|before| before == bytes) {
            return Ok(());
        }
        fs::create_dir_all(path.parent().context("folder of a file")?)?;
        fs::write(&path, bytes).with_context(|| path.display().to_string())
    }

    /// Builds the tests of a module with all mutants that the compiler takes.
    pub(super) fn built(&self, module: &Module, mutants: &BTreeMap<usize, Mutant>) -> anyhow::Result<Built> {
        let mut left: BTreeSet<usize> = mutants.keys().copied().collect();
        loop {
            let sources = self.with_mutants(module, mutants, &left)?;
            left = sources
                .values()
                .flat_map(|source| source.lines.keys())
                .copied()
                .collect();
            let (messages, is_built) = self.compiled(module)?;
            if is_built {
                return Ok(Built {
                    programs: messages
                        .iter()
                        .filter_map(|message| self.test_program(message))
                        .collect(),
                    mutants: left.into_iter().collect(),
                });
            }
            let errors = messages.iter().filter(|message| message["message"]["level"] == "error");
            let refused: BTreeSet<usize> = errors.flat_map(|error| refused_by(error, &sources)).collect();
            if refused.is_empty() {
                let text = messages
                    .iter()
                    .filter_map(|message| message["message"]["rendered"].as_str());
                ensure!(
                    false,
                    "expected the tests to compile, found: {}",
                    text.collect::<String>()
                );
            }
            eprintln!("{} of {} mutants do not compile", refused.len(), left.len());
            left.retain(|number| !refused.contains(number));
        }
    }

    /// Writes the module's files with these mutants, by their names.
    fn with_mutants(
        &self,
        module: &Module,
        mutants: &BTreeMap<usize, Mutant>,
        left: &BTreeSet<usize>,
    ) -> anyhow::Result<BTreeMap<String, Switched>> {
        let mut by_file: BTreeMap<&str, Vec<(usize, &Mutant)>> = BTreeMap::new();
        for (number, mutant) in mutants {
            let in_file = by_file.entry(&mutant.file).or_default();
            if left.contains(number) {
                in_file.push((*number, mutant));
            }
        }
        let root_file = format!("crates/{}/src/lib.rs", module.package);
        by_file.entry(&root_file).or_default();
        let mut sources = BTreeMap::new();
        for (name, in_file) in by_file {
            let source = fs::read_to_string(crate::shell::root().join(name)).with_context(|| name.to_owned())?;
            let mut source = switched(&source, &in_file).with_context(|| name.to_owned())?;
            if name == root_file {
                source.text.push_str(SWITCH_MODULE);
            }
            self.put(name, source.text.as_bytes())?;
            sources.insert(name.to_owned(), source);
        }
        Ok(sources)
    }

    /// What the compiler says of the tests, and whether it made them.
    fn compiled(&self, module: &Module) -> anyhow::Result<(Vec<Value>, bool)> {
        let mut command = cargo(["test", "--no-run", "--lib", "--tests", "--message-format", "json"]);
        command.current_dir(&self.folder);
        command.args(module.tests.iter().flat_map(|package| ["--package", package]));
        for package in NOT_OPTIMISED {
            command.arg(format!("--config=profile.dev.package.{package}.opt-level=0"));
        }
        command.arg("--config=profile.dev.lto='off'");
        command.env("CARGO_TARGET_DIR", target_dir()?.join("mutants-build"));
        let output = command
            .stderr(std::process::Stdio::inherit())
            .output()
            .context("cargo test")?;
        let text = String::from_utf8(output.stdout).context("cargo test")?;
        let messages: Result<_, _> = text.lines().map(serde_json::from_str).collect();
        Ok((messages.context("cargo test")?, output.status.success()))
    }

    /// The program of a message on one that was made.
    fn test_program(&self, message: &Value) -> Option<Program> {
        let program = message["executable"].as_str()?;
        let manifest = Path::new(message["manifest_path"].as_str()?);
        Some((program.into(), manifest.parent()?.to_owned()))
    }
}

/// The mutants that an error is about.
fn refused_by(error: &Value, sources: &BTreeMap<String, Switched>) -> Vec<usize> {
    let spans = || error["message"]["spans"].as_array().into_iter().flatten();
    let of = |span: &Value| -> Option<usize> {
        let line = usize::try_from(span["line_start"].as_u64()?).ok()?;
        let source = sources.get(span["file_name"].as_str()?)?;
        let found = source.lines.iter().find(|(_, lines)| lines.contains(&line));
        found.map(|(number, _)| *number)
    };
    let primary: Vec<usize> = spans()
        .filter(|span| span["is_primary"] == true)
        .filter_map(of)
        .collect();
    if primary.is_empty() {
        spans().filter_map(of).collect()
    } else {
        primary
    }
}
