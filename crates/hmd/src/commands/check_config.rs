//! `hmd check-config`.

use std::path::PathBuf;

use super::{Exit, check_files_of_run, load_config, say};

/// Check a configuration and say what it means.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd check-config -c hmd.toml\n\
    \x20 hmd check-config -c hmd.toml --json")]
pub struct Args {
    /// Configuration file; without it the defaults are shown.
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Print the checked configuration as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = load_config(args.config.as_deref())?;
    check_files_of_run(&config)?;
    if args.json {
        say(&serde_json::to_string_pretty(&config.to_json())?)?;
    } else {
        say(config.describe().trim_end())?;
    }
    Ok(Exit::Done)
}
