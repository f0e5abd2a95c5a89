//! Running other programs: always from the workspace's root, shown before they start, their exit code checked.

use std::borrow::BorrowMut;
use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail};

/// Root of the workspace.
pub(crate) fn root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here)
}

/// Cargo's target directory: this program lies in `<target>/<profile>/`, wherever the environment put it.
pub(crate) fn target_dir() -> anyhow::Result<PathBuf> {
    let program = std::env::current_exe().context("path of this program")?;
    let target = program
        .ancestors()
        .nth(2)
        .with_context(|| format!("target directory of {}", program.display()))?;
    Ok(target.to_owned())
}

/// A program to run.
pub(crate) fn program<I, S>(name: impl AsRef<OsStr>, args: I) -> Command
where
    I: IntoIterator<Item = S>,
    S: AsRef<OsStr>,
{
    let mut command = Command::new(name);
    command.current_dir(root()).args(args);
    command
}

/// A cargo command of the toolchain that runs this.
pub(crate) fn cargo<I, S>(args: I) -> Command
where
    I: IntoIterator<Item = S>,
    S: AsRef<OsStr>,
{
    program(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()), args)
}

/// Runs a program; its output goes where ours does.
pub(crate) fn run(mut command: impl BorrowMut<Command>) -> anyhow::Result<()> {
    let command = command.borrow_mut();
    let shown = shown(command);
    eprintln!("$ {shown}");
    let status = command.status().with_context(|| shown.clone())?;
    if !status.success() {
        bail!("{shown}: {status}");
    }
    Ok(())
}

/// Runs a program with its stdout in a file and, if given, its stdin from one.
pub(crate) fn run_to_file(mut command: Command, input: Option<&Path>, output: &Path) -> anyhow::Result<()> {
    if let Some(input) = input {
        command.stdin(File::open(input).with_context(|| input.display().to_string())?);
    }
    command.stdout(File::create(output).with_context(|| output.display().to_string())?);
    run(command)
}

/// Whether a program can be started and succeeds; says nothing.
pub(crate) fn succeeds(mut command: Command) -> bool {
    let quiet = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    quiet.status().is_ok_and(|status| status.success())
}

/// The command line as one would type it; a program of the toolchain by its name alone.
fn shown(command: &Command) -> String {
    let name = Path::new(command.get_program());
    let name = name
        .file_name()
        .unwrap_or(name.as_os_str())
        .to_string_lossy()
        .into_owned();
    let args = command.get_args().map(|arg| arg.to_string_lossy().into_owned());
    std::iter::once(name).chain(args).collect::<Vec<_>>().join(" ")
}
