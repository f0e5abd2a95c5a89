//! `hmd completions` and `hmd man`: what a package ships besides the program.

use std::path::PathBuf;

use anyhow::Context;
use clap::Command;
use clap_complete::Shell;

use super::Exit;

/// Print a completion script for a shell.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  hmd completions bash > /etc/bash_completion.d/hmd")]
pub struct Completions {
    /// The shell.
    shell: Shell,
}

/// Write the manual pages of hmd and of each of its verbs.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  hmd man man1 && man -l man1/hmd-replay.1")]
pub struct Man {
    /// Folder for them; made if need be.
    folder: PathBuf,
}

/// Prints the script for the command line as it is defined.
///
/// # Errors
/// None; a reader that has gone away is no failure.
pub fn completions(args: &Completions, mut command: Command) -> anyhow::Result<Exit> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "hmd", &mut script);
    super::say(String::from_utf8_lossy(&script).trim_end())?;
    Ok(Exit::Done)
}

/// Writes `hmd.1` and `hmd-VERB.1`.
///
/// # Errors
/// When the folder cannot be written.
pub fn man(args: &Man, command: Command) -> anyhow::Result<Exit> {
    let folder = args.folder.display();
    std::fs::create_dir_all(&args.folder).with_context(|| folder.to_string())?;
    clap_mangen::generate_to(command, &args.folder).with_context(|| folder.to_string())?;
    Ok(Exit::Done)
}
