//! `hmd event`: enter maintenance, so that a new unit does not inherit a trend, or ask for the frames of a time.

use std::path::PathBuf;

use super::instant::instant;
use super::{Exit, Misuse, load_config, say, warn};
use crate::daemon::held_s;

use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::history::{Event, EventKind, ReplacedPart};
use hmd_core::timestamp;
use hmd_storage::clock::now_ns;
use hmd_storage::event_file::append;
use hmd_storage::history_file;

/// Most characters of a note: it goes into one line of the journal.
const NOTE_MAX: usize = 200;

/// Enter maintenance: a part was replaced, and its history is reset; or ask for the frames of a time.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd event --reset flap-left -c hmd.toml --at 2026-11-20T14:00Z --note S/N-4711\n\
    \x20 hmd event --reset flap-left --part gearbox -c hmd.toml\n\
    \x20 hmd event --keep flap-left -c hmd.toml --note noise")]
pub struct Args {
    #[command(flatten)]
    kind: Kind,
    /// Configuration; its rul.events names the file that the event is added to.
    #[arg(short, long)]
    config: PathBuf,
    /// When it happened, as 2026-11-20T14:00Z, 2026-11-20T15:00+01:00 or UTC ns; now without it.
    #[arg(long, value_name = "TIME", value_parser = instant)]
    at: Option<u64>,
    /// Of a reset: the part that was replaced, and what is known of the others stays; the whole unit without it.
    #[arg(long, value_name = "PART", conflicts_with = "keep", value_parser = part)]
    part: Option<ReplacedPart>,
    /// What was done; it stands in the journal and in reports.
    #[arg(long, value_name = "TEXT", value_parser = note)]
    note: Option<String>,
}

/// What happened, and to which actuator.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
struct Kind {
    /// The actuator that was replaced or overhauled; what is known of its wear is void.
    #[arg(long, value_name = "ACTUATOR")]
    reset: Option<String>,
    /// The actuator that did something worth a look: a daemon without output.raw_frames stores the frames around that time, of the
    /// last seconds at most.
    #[arg(long, value_name = "ACTUATOR")]
    keep: Option<String>,
}

impl Kind {
    /// Option, kind and actuator.
    fn chosen(&self) -> (&'static str, EventKind, &str) {
        match (&self.reset, &self.keep) {
            (None, Some(actuator)) => ("--keep", EventKind::Keep, actuator),
            (actuator, _) => ("--reset", EventKind::Reset, actuator.as_deref().unwrap_or_default()),
        }
    }
}

/// A part by its name.
fn part(text: &str) -> Result<ReplacedPart, String> {
    let known = || ReplacedPart::ALL.map(ReplacedPart::name).join(", ");
    ReplacedPart::from_name(text).ok_or_else(|| format!("expected one of {}, found {text:?}", known()))
}

/// One line of text.
fn note(text: &str) -> Result<String, String> {
    let length = text.chars().count();
    if length > NOTE_MAX || text.chars().any(char::is_control) {
        return Err(format!(
            "expected one line of at most {NOTE_MAX} characters, found {length}"
        ));
    }
    Ok(text.to_owned())
}

/// Start of the newest window in the history of the unit that a daemon keeps, UTC ns.
fn newest_window_ns(config: &Config, actuator: &ActuatorConfig) -> Option<u64> {
    let folder = config.resolve(config.rul().state.as_ref()?);
    let history = history_file::load(&folder, &actuator.name).ok()??;
    let is_of_unit = history.serial_number() == actuator.serial_number.as_deref();
    history.last_window_ns().filter(|_| is_of_unit)
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration, an actuator that it does not know, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = load_config(Some(&args.config))?;
    let Some(path) = &config.rul().events else {
        let file = args.config.display();
        return Err(Misuse(format!(
            "{file}: expected rul.events = \"FILE\", found none: events have no place"
        ))
        .into());
    };
    let (option, kind, actuator) = args.kind.chosen();
    let Some(of_actuator) = config.actuator_named(actuator) else {
        let known: Vec<&str> = config.actuators().iter().map(|a| a.name.as_str()).collect();
        let sentence = format!("{option}: expected one of {}, found {actuator:?}", known.join(", "));
        return Err(Misuse(sentence).into());
    };
    let output = config.output();
    if kind == EventKind::Keep && (output.raw_frames || !output.captures) {
        let found = if output.raw_frames {
            "output.raw_frames = true: all frames are stored"
        } else {
            "output.captures = false"
        };
        return Err(Misuse(format!("--keep: expected a configuration with captures, found {found}")).into());
    }
    let now = now_ns();
    let event = Event {
        t_ns: args.at.unwrap_or(now),
        actuator: actuator.to_owned(),
        event: kind,
        part: args.part,
        note: args.note.clone(),
    };
    let path = config.resolve(path);
    append(&path, &event)?;
    let (minute, noted) = (timestamp::minute(event.t_ns), path.display());
    if event.t_ns > now {
        warn(format_args!("--at: warning: {minute} UTC is still to come"));
    }
    let newest_ns = newest_window_ns(&config, of_actuator);
    if kind == EventKind::Reset && newest_ns.is_some_and(|newest_ns| event.t_ns <= newest_ns) {
        warn(format_args!(
            "--at: warning: {actuator} was assessed since {minute} UTC: what a daemon has said of it since then stays; a replay resets it \
             from then on"
        ));
    }
    let held_s = held_s(&config);
    let age_s = 1e-9 * now.saturating_sub(event.t_ns) as f64;
    if kind == EventKind::Keep && age_s > held_s {
        warn(format_args!(
            "--at: warning: {minute} UTC is {age_s:.0} s ago; a daemon that keeps up holds frames for {held_s:.1} s"
        ));
    }
    say(&match kind {
        EventKind::Reset => {
            let what = args.part.map_or_else(
                || "history reset".to_owned(),
                |part| format!("{} replaced, its faults begin anew", part.name()),
            );
            format!(
                "{actuator}: {what} from {minute} UTC on, with the next movement; noted in {noted} (to withdraw it, delete that line before then)"
            )
        }
        EventKind::Keep => format!(
            "{actuator}: frames from {} s before to {} s after {minute} UTC asked for; noted in {noted}",
            output.capture_before_s, output.capture_after_s
        ),
    })?;
    Ok(Exit::Done)
}
