//! `hmd check-config`.

use std::path::{Path, PathBuf};

use hmd_core::config::{Config, EffectiveParameter, parameters_of_unit, write_parameters};
use hmd_core::config_warnings::warnings;
use hmd_storage::calibration_file::{load_learnt, load_type_models, load_unit};

use hmd_storage::event_file::load_events;

use super::{Exit, Settings, check_files_of_run, load_config_with, say, to_stderr};

/// Check a configuration and say what it means.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd check-config hmd.toml\n\
    \x20 hmd check-config -c hmd.toml --json")]
pub struct Args {
    /// Configuration file; without it the defaults are shown.
    #[arg(value_name = "FILE", conflicts_with = "config")]
    file: Option<PathBuf>,
    /// The same, as other verbs take it.
    #[arg(short, long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    /// Print the checked configuration as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    say(&meaning(args, &mut to_stderr)?)?;
    Ok(Exit::Done)
}

/// What the verb prints; `tell` gets what it would write to standard error.
///
/// # Errors
/// As [`run`].
pub fn meaning(args: &Args, tell: &mut dyn FnMut(&str)) -> anyhow::Result<String> {
    let given = args.file.as_deref().or(args.config.as_deref());
    let config = load_config_with(given, &args.settings)?;
    check_files_of_run(&config, tell)?;
    for bad in load_events(&config)?.unreadable {
        tell(&bad.to_string());
    }
    let units = units(&config)?;
    let warnings = warnings(&config, &load_type_models(&config)?);
    let file = given.unwrap_or(Path::new("defaults")).display();
    for warning in &warnings {
        tell(&format!("{file}: warning: {warning}"));
    }
    if args.json {
        let mut text = config.to_json();
        let of_units = units.iter().map(|unit| (unit.actuator.clone(), &unit.parameters));
        text["units"] = serde_json::to_value(of_units.collect::<std::collections::BTreeMap<_, _>>())?;
        text["warnings"] = serde_json::to_value(&warnings)?;
        return Ok(serde_json::to_string_pretty(&text)?);
    }
    let mut text = config.describe();
    for unit in &units {
        text += &format!("unit {}:\n", unit.actuator);
        write_parameters(&mut text, &unit.parameters)?;
    }
    Ok(text.trim_end().to_owned())
}

/// What is known of a commissioned unit.
struct Unit {
    actuator: String,
    parameters: Vec<EffectiveParameter>,
}

/// The units that have a calibration, given or learnt by earlier runs.
fn units(config: &Config) -> anyhow::Result<Vec<Unit>> {
    let mut found = Vec::new();
    for actuator in config.actuators() {
        if let Some(path) = &actuator.calibration {
            let path = config.resolve(path);
            found.push((actuator, load_unit(&path, &actuator.type_name)?, path));
        }
    }
    found.extend(
        load_learnt(config)?
            .into_iter()
            .map(|kept| (kept.actuator, kept.calibration, kept.path)),
    );
    Ok(found
        .into_iter()
        .map(|(actuator, unit, path)| Unit {
            actuator: actuator.name.clone(),
            parameters: parameters_of_unit(&actuator.params, &unit, &path.display().to_string()),
        })
        .collect())
}
