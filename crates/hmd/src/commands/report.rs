//! `hmd report`: one page about one actuator or several.

use std::iter;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::outputs::{Content, Outputs};
use super::recordings::{Wanted, recordings};
use super::{Exit, Losses, Misuse, load_config, to_stderr};
use ema_models::FaultId;
use hmd_core::health::Levels;
use hmd_core::history::Events;
use hmd_report::pdf;
use hmd_report::report::{Files, Maintenance, RecordedLevels, View, Zone, page};
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
    /// Configuration whose damage levels the page shows; without one those of the newest file that says its own, the defaults where none does.
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
    let pdf = args.pdf.as_deref().map(|path| (path, Content::Pdf));
    let written: Vec<(&Path, Content)> = iter::once((args.output.as_path(), Content::Page)).chain(pdf).collect();
    let config = load_config(args.config.as_deref())?;
    Outputs(&written).check(recorded.iter().chain(&config.files()))?;
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
    let events = load_events(&config)?;
    events
        .ignored_entries(&Events::default(), &config)
        .iter()
        .for_each(|line| tell(line));
    let maintenance = Maintenance {
        events: &events,
        config: &config,
        now_ns: now_ns(),
    };
    let files = Files::read(&recorded, &maintenance, &mut |loss| losses.add(loss))?;
    let configured = Configured {
        path: args.config.as_deref(),
        levels: *config.health().levels(),
        critical_h: config.rul().critical_h,
        is_other: files.has_other_configuration(&config),
    };
    let view = view(zone, files.recorded_levels(), &configured);
    // The defaults were asked for by no configuration; another one may be a mistake.
    if let Some(notice) = view.notice.as_ref().filter(|_| args.config.is_some()) {
        tell(notice);
    }
    let histories = files.actuators(args.actuator.as_deref())?;
    let text = page(&files, &histories, &view);
    output_file::write(&args.output, text).with_context(|| args.output.display().to_string())?;
    if let Some(pdf) = &args.pdf {
        pdf::print(&args.output, pdf).context("--pdf")?;
    }
    Ok(losses.exit(tell))
}

/// The configuration of the command line, or the defaults.
struct Configured<'a> {
    /// The file, where one is named.
    path: Option<&'a Path>,
    levels: [Levels; FaultId::COUNT],
    critical_h: f64,
    /// Whether some file was recorded with another one.
    is_other: bool,
}

/// By which levels a page is drawn: those of a configuration that is named, else those of the newest recording that says them, else the defaults;
/// and whether the windows were assessed by them.
fn view(zone: Zone, recorded: Option<RecordedLevels>, configured: &Configured<'_>) -> View {
    let is_named = configured.path.is_some();
    let (levels, critical_h) = match recorded {
        Some(of) if !is_named => (of.levels, of.critical_h),
        _ => (configured.levels, configured.critical_h),
    };
    let are_levels_of_windows = match recorded {
        // Of a file that does not say its own, the configuration that is named does.
        Some(of) => {
            !of.differ && (of.levels, of.critical_h) == (levels, critical_h) && (of.are_said_by_all || is_named)
        }
        None => is_named || !configured.is_other,
    };
    let are_said_by_all = recorded.is_some_and(|of| of.are_said_by_all);
    // A named configuration that other files may have been recorded with may be a mistake.
    let is_doubtful = !are_levels_of_windows || (is_named && configured.is_other && !are_said_by_all);
    let notice = is_doubtful.then(|| {
        let page = match (configured.path, recorded) {
            (Some(path), _) => format!("those of {}", path.display()),
            (None, Some(_)) => "those of the newest file that says them (-c CONFIG has others)".to_owned(),
            (None, None) => "the defaults (-c CONFIG has others)".to_owned(),
        };
        let files = match recorded {
            Some(of) if is_named && !of.differ && !are_levels_of_windows => "the files were recorded with others",
            Some(_) => "some files were recorded with others, or do not say theirs",
            None => "the files were recorded with another configuration",
        };
        format!("The levels are {page}; {files}.")
    });
    View {
        zone,
        levels,
        critical_h,
        are_levels_of_windows,
        notice,
    }
}

fn zone(name: Option<&str>) -> Result<Zone, Misuse> {
    let Some(name) = name else {
        return Ok(Zone::of_this_computer());
    };
    Zone::named(name).ok_or_else(|| Misuse(format!("--zone: expected a time zone of this computer, found {name:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_those_of_the_windows_only_where_no_recording_says_others() {
        let low = Levels {
            critical: 0.4,
            ..Levels::default()
        };
        let said = |levels: Levels, differ: bool, are_said_by_all: bool| RecordedLevels {
            levels: [levels; FaultId::COUNT],
            critical_h: 0.0,
            differ,
            are_said_by_all,
        };
        let of = |recorded: Option<RecordedLevels>, path: Option<&str>| {
            let configured = Configured {
                path: path.map(Path::new),
                levels: [Levels::default(); FaultId::COUNT],
                critical_h: 0.0,
                is_other: true,
            };
            let view = view(Zone::utc(), recorded, &configured);
            (view.levels[0] == low, view.are_levels_of_windows, view.notice.is_some())
        };
        // Levels of the recording, known, notice.
        assert_eq!(of(Some(said(low, false, true)), None), (true, true, false));
        assert_eq!(of(Some(said(low, true, true)), None), (true, false, true));
        assert_eq!(of(Some(said(low, false, false)), None), (true, false, true));
        assert_eq!(of(None, None), (false, false, true));
        // A configuration that the recordings contradict explains no level of them.
        let named = Some("hmd.toml");
        assert_eq!(of(Some(said(low, false, true)), named), (false, false, true));
        let default = Levels::default();
        // Levels that are the same are no matter for a notice, whatever else the configuration has.
        assert_eq!(of(Some(said(default, false, true)), named), (false, true, false));
        assert_eq!(of(Some(said(default, false, false)), named), (false, true, true));
        assert_eq!(of(Some(said(default, true, true)), named), (false, false, true));
        assert_eq!(of(None, named), (false, true, true));
    }
}
