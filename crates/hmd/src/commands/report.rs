//! `hmd report`: one page about one actuator or several.

use std::path::{Path, PathBuf};

use anyhow::Context;

use super::outputs::Outputs;
use super::recordings::{Wanted, recordings};
use super::{Exit, Losses, Misuse, load_config, to_stderr};
use hmd_report::pdf;
use hmd_report::report::{Files, Maintenance, View, Zone, page};
use hmd_storage::clock::now_ns;
use hmd_storage::event_file::load_events;
use hmd_storage::output_file;

/// Write a report of one actuator or several: one HTML file that needs nothing else.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd replay flight.log -o flight.mcap && hmd report flight.mcap -o ema0.html\n\
    \x20 hmd report --actuator flap-left monday.mcap tuesday.mcap -o flap-left.html --zone Europe/Berlin")]
pub struct Args {
    /// MCAP files that hmd wrote, in the order of time, or folders of them.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// The HTML file.
    #[arg(short, long)]
    output: PathBuf,
    /// Only this actuator; without it all, with an overview.
    #[arg(long, value_name = "NAME")]
    actuator: Option<String>,
    /// Configuration whose damage levels the page shows; without one those that the files were recorded with, the defaults where they do not say
    /// them.
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Time zone of the page, as Europe/Berlin or UTC; without it that of this computer.
    #[arg(long, value_name = "NAME")]
    zone: Option<String>,
    /// Print the page to this PDF file as well, with the Chromium of this computer.
    #[arg(long, value_name = "FILE")]
    pdf: Option<PathBuf>,
}

/// Runs the verb.
///
/// # Errors
/// A file that is none of ours, an actuator that it does not have, an output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    run_with(args, &mut to_stderr)
}

/// The same; `tell` gets what the command would write to standard error.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: &Args, tell: &mut dyn FnMut(&str)) -> anyhow::Result<Exit> {
    let recorded = recordings(&args.files, Wanted::Records)?;
    let written: Vec<&Path> = [args.output.as_path()].into_iter().chain(args.pdf.as_deref()).collect();
    let outputs = Outputs {
        others: &written,
        ..Outputs::default()
    };
    let config = load_config(args.config.as_deref())?;
    outputs.check(recorded.iter().chain(&config.files()))?;
    for (option, path, extension) in [
        ("--output", Some(&args.output), "html"),
        ("--pdf", args.pdf.as_ref(), "pdf"),
    ] {
        if let Some(path) = path.filter(|path| {
            path.extension()
                .is_none_or(|found| !found.eq_ignore_ascii_case(extension))
        }) {
            let found = path.display();
            return Err(Misuse(format!(
                "{option}: expected a name that ends in .{extension}, found {found}"
            ))
            .into());
        }
    }
    let zone = zone(args.zone.as_deref())?;
    let mut losses = Losses::default();
    let maintenance = Maintenance {
        events: &load_events(&config)?,
        config: &config,
        now_ns: now_ns(),
    };
    let files = Files::read(&recorded, &maintenance, &mut |loss| losses.add(loss))?;
    // The levels of a configuration that is named, else those of the recordings, else the defaults.
    let recorded = files.recorded_levels().filter(|_| args.config.is_none());
    let is_other = files.has_other_configuration(&config);
    let notice = (is_other && recorded.is_none()).then(|| {
        let levels = args.config.as_ref().map_or_else(
            || "the defaults (-c CONFIG has others)".to_owned(),
            |path| format!("those of {}", path.display()),
        );
        format!("The levels are {levels}; the files were recorded with another configuration.")
    });
    // The defaults were asked for by no configuration; another one may be a mistake.
    if let Some(notice) = notice.as_ref().filter(|_| args.config.is_some()) {
        tell(notice);
    }
    let are_known = recorded.is_some() || args.config.is_some() || !is_other;
    let (levels, critical_h) = recorded.unwrap_or((*config.health().levels(), config.rul().critical_h));
    let view = View {
        zone,
        levels,
        critical_h,
        are_known,
        notice,
    };
    let histories = files.actuators(args.actuator.as_deref())?;
    let text = page(&files, &histories, &view);
    output_file::write(&args.output, text).with_context(|| args.output.display().to_string())?;
    if let Some(pdf) = &args.pdf {
        pdf::print(&args.output, pdf).context("--pdf")?;
    }
    Ok(losses.exit(tell))
}

fn zone(name: Option<&str>) -> Result<Zone, Misuse> {
    let Some(name) = name else {
        return Ok(Zone::of_this_computer());
    };
    Zone::named(name).ok_or_else(|| Misuse(format!("--zone: expected a time zone of this computer, found {name:?}")))
}
