//! `hmd inspect`: the history of an actuator for people: trend, remaining life, events; and the catalogue of fault modes.

mod summary;

use ema_models::FaultId;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use anyhow::Context;
use prost::Message;
use serde::Serialize;

use super::recordings::{Wanted, recordings};
use super::table::{HEALTH_HEAD, health_row, left_cell};
use super::{Exit, Losses, Misuse, load_config, say, to_stderr, warn};
use hmd_core::catalogue::catalogue;
use hmd_core::config::Config;
use hmd_core::health::HealthState;
use hmd_core::history::{Event, EventKind, Events, ReplacedPart};
use hmd_core::newest::Newest;
use hmd_core::record::{Health, Interval, Log, Record, Rul};
use hmd_core::timestamp;
use hmd_ingest::file::open_recorded;
use hmd_storage::clock::now_ns;
use hmd_storage::event_file::load_events;
use hmd_storage::mcap::{McapMessages, NoWindows};
use hmd_storage::mcap_writer::METADATA_NAME;
use hmd_storage::{no_formula, number_cell, printable};

/// Print the history in recorded files: damage, remaining life, events.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd inspect flight.mcap\n\
    \x20 hmd inspect --csv monday.mcap tuesday.mcap > week.csv\n\
    \x20 hmd inspect --catalogue -c hmd.toml")]
pub struct Args {
    /// MCAP files that hmd wrote, in the order of time.
    #[arg(required_unless_present = "catalogue")]
    files: Vec<PathBuf>,
    /// Print a JSON object per line.
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print comma-separated values; events are left out.
    #[arg(long)]
    csv: bool,
    /// Print the newest state of each actuator as one line of at most 220 characters, fit for a downlink.
    #[arg(long, conflicts_with_all = ["json", "csv"])]
    summary: bool,
    /// Print the catalogue of fault modes as JSON instead of any file.
    #[arg(long, conflicts_with_all = ["files", "csv", "summary"])]
    catalogue: bool,
    /// Configuration whose levels the catalogue has, the defaults without one; of --summary, whose rul.events say what was replaced after the
    /// last window.
    #[arg(short, long, conflicts_with_all = ["json", "csv"])]
    config: Option<PathBuf>,
}

/// One line of the history.
#[derive(Debug, Serialize)]
struct Line<'a> {
    actuator: &'a str,
    window: u64,
    t_start_ns: u64,
    status: &'a str,
    health: &'a str,
    states: BTreeMap<&'static str, &'static str>,
    damage: BTreeMap<&'static str, Option<f64>>,
    suspects: &'a [String],
    hours_of: &'a str,
    operating_h: Option<f64>,
    operating_cycles: Option<f64>,
    rul_h: Option<Interval>,
    rul_cycles: Option<Interval>,
    failure_probability: Option<f64>,
    dominant_fault: &'a str,
    governed_by: &'a str,
    reason: &'a str,
    rul_reason: &'a str,
    serial_number: Option<&'a str>,
    file: &'a str,
}

/// How a history is printed.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Table,
    Json,
    Csv,
    /// Only the newest window of each actuator, at the end.
    Summary,
}

/// What is printed, in which form.
struct Printer {
    form: Form,
    /// The head stands above the first window.
    headed: bool,
    /// What the files so far say of each unit, the segments of a run as one.
    summaries: BTreeMap<Unit, Vec<(Option<String>, Newest)>>,
    /// The serial number that was last printed of each actuator.
    serials: BTreeMap<String, String>,
}

/// Name and serial number.
type Unit = (String, Option<String>);

/// Where a window comes from: two units may have the same name.
#[derive(Clone, Copy)]
struct Origin<'a> {
    serial_number: Option<&'a str>,
    file: &'a str,
}

/// Runs the verb.
///
/// # Errors
/// A file that is none of ours; a bad configuration.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    if args.catalogue {
        let config = load_config(args.config.as_deref())?;
        say(&serde_json::to_string_pretty(&catalogue(config.health().levels()))?)?;
        return Ok(Exit::Done);
    }
    if args.config.is_some() && !args.summary {
        return Err(Misuse("--config: expected --catalogue or --summary beside it, found neither".to_owned()).into());
    }
    let form = match (args.json, args.csv, args.summary) {
        (true, ..) => Form::Json,
        (_, true, _) => Form::Csv,
        (.., true) => Form::Summary,
        _ => Form::Table,
    };
    let mut printer = Printer {
        form,
        headed: false,
        summaries: BTreeMap::new(),
        serials: BTreeMap::new(),
    };
    let mut losses = Losses::default();
    let (mut windows, mut nothing) = (0, NoWindows::default());
    let files = recordings(&args.files, Wanted::Records)?;
    for path in &files {
        let name = path.display().to_string();
        let file = open_recorded(path).with_context(|| name.clone())?;
        let mut messages = McapMessages::of_recording(BufReader::new(file), &name).with_context(|| name.clone())?;
        windows += printer
            .print(&mut messages, &mut losses)
            .with_context(|| name.clone())?;
        nothing.note(&messages);
    }
    if windows == 0 {
        return Err(nothing.into());
    }
    let config = load_config(args.config.as_deref())?;
    let events = load_events(&config)?;
    for line in events.ignored_entries(&Events::default(), &config) {
        warn(format_args!("{line}"));
    }
    for line in printer.summary_lines(&events, &config, now_ns()) {
        say(&line)?;
    }
    Ok(losses.exit(&mut to_stderr))
}

impl Printer {
    /// Prints a file; how many windows it has.
    fn print(&mut self, messages: &mut McapMessages<BufReader<File>>, losses: &mut Losses) -> anyhow::Result<u64> {
        let mut windows = 0;
        let file = messages.file().clone();
        // The health of each actuator's newest window, until its remaining life comes.
        let mut waiting: BTreeMap<String, Health> = BTreeMap::new();
        let mut units: BTreeMap<Unit, Newest> = BTreeMap::new();
        while let Some(message) = messages.next() {
            let message = match message {
                Ok(message) => message,
                Err(loss) => {
                    losses.add(&loss);
                    continue;
                }
            };
            let data = message.data.as_slice();
            if *message.schema == *Health::SCHEMA_NAME {
                let health = Health::decode(data)?;
                waiting.insert(health.actuator.clone(), health);
            } else if *message.schema == *Rul::SCHEMA_NAME {
                let rul = Rul::decode(data)?;
                if let Some(health) = waiting.remove(&rul.actuator).filter(|h| h.window == rul.window) {
                    let origin = Origin {
                        serial_number: messages.serial_number(&rul.actuator),
                        file: &file,
                    };
                    self.window(&health, &rul, origin)?;
                    windows += 1;
                    if self.form == Form::Summary {
                        let unit = (health.actuator.clone(), origin.serial_number.map(str::to_owned));
                        let newest = units.entry(unit).or_default();
                        newest.add(health);
                        newest.add_rul(rul);
                    }
                }
            } else if *message.schema == *Log::SCHEMA_NAME {
                self.event(message.log_time_ns, &Log::decode(data)?.message)?;
            }
        }
        let metadata = messages.verified_metadata(METADATA_NAME).ok().flatten();
        let run = metadata.and_then(|metadata| metadata.get("run"));
        for (unit, newest) in units {
            let runs = self.summaries.entry(unit).or_default();
            let is_of_its_run = |before: &&mut (Option<String>, Newest)| run.is_some() && before.0.as_ref() == run;
            match runs.iter_mut().rev().find(is_of_its_run) {
                Some((_, whole)) => whole.continue_run(newest),
                None => runs.push((run.cloned(), newest)),
            }
        }
        Ok(windows)
    }

    fn window(&mut self, health: &Health, rul: &Rul, origin: Origin<'_>) -> anyhow::Result<()> {
        let is_first = !std::mem::replace(&mut self.headed, true);
        match self.form {
            Form::Table => {
                if is_first {
                    say(&format!("{:>10} {:<22} {HEALTH_HEAD}", "used, h", "left (10…90 %), h"))?;
                }
                if let Some(number) = self.other_serial(&health.actuator, origin.serial_number) {
                    say(&format!(
                        "{:>10} {} is serial number {number}",
                        "",
                        printable(&health.actuator)
                    ))?;
                }
                say(&table_row(health, rul))
            }
            Form::Json => say(&serde_json::to_string(&line(health, rul, origin))?),
            Form::Csv => {
                if is_first {
                    say(&csv_head())?;
                }
                say(&csv_row(health, rul, origin))
            }
            Form::Summary => Ok(()),
        }
    }

    /// The serial number of an actuator, where another unit of its name was printed before.
    fn other_serial<'a>(&mut self, actuator: &str, serial_number: Option<&'a str>) -> Option<Cow<'a, str>> {
        let number = serial_number?;
        let before = self.serials.insert(actuator.to_owned(), number.to_owned())?;
        (before != number).then(|| printable(number))
    }

    /// A line for each unit, with its serial number where others have the same name in the line; the recording with the newest window has the last word.
    /// What was replaced after its newest window and until now, UTC ns, by these events is unknown.
    fn summary_lines(self, events: &Events, config: &Config, now_ns: u64) -> impl Iterator<Item = String> {
        let names: Vec<String> = self.summaries.keys().map(|(name, _)| name.clone()).collect();
        let is_one_of = move |is_same: &dyn Fn(&str) -> bool| names.iter().filter(|name| is_same(name)).count() > 1;
        self.summaries.into_iter().map(move |((actuator, unit_number), runs)| {
            let (actuator, sent) = (actuator.as_str(), summary::sent_name(&actuator));
            let serial_number = unit_number.as_deref().filter(|_| is_one_of(&|name| name == actuator));
            let sent_number = unit_number.as_deref().filter(|_| is_one_of(&|name| summary::sent_name(name) == sent));
            let is_replacement = |event: &&Event| {
                let is_reset = event.event == EventKind::Reset && event.is_about(actuator, serial_number, config);
                is_reset && event.t_ns <= now_ns
            };
            let replacements: Vec<&Event> = events.list.iter().filter(is_replacement).collect();
            let mut runs: Vec<Newest> = runs.into_iter().map(|(_, newest)| newest).collect();
            runs.sort_by_key(Newest::order);
            let is_ahead = runs.iter().any(|run| run.newest_ns() > now_ns);
            let joined = Newest::joined(runs, &replacements, now_ns);
            if joined.overlap {
                warn(format_args!(
                    "{}: recordings overlap in time: they are of several units, or of one twice; the newest window counts",
                    printable(actuator)
                ));
            }
            if is_ahead {
                warn(format_args!(
                    "{}: windows are dated after the present: where that clock was wrong, they count as the newest, and newer ones as older",
                    printable(actuator)
                ));
            }
            for event in joined.entered_late {
                warn(format_args!(
                    "{}: {} entered as replaced at {} UTC, but these windows were assessed before that: hmd replay of the logs, or the next \
                     movement of a running hmd, takes it over",
                    printable(actuator),
                    event.part.map_or("actuator", ReplacedPart::name),
                    timestamp::minute(event.t_ns)
                ));
            }
            let mut newest = joined.newest;
            joined.since.into_iter().for_each(|event| newest.replace(event.part));
            summary::summary_line(&newest, config.health().levels(), sent_number)
        })
    }

    fn event(&self, t_ns: u64, message: &str) -> anyhow::Result<()> {
        match self.form {
            Form::Table => say(&format!("{:>10} {}", "", printable(message))),
            Form::Json => say(&serde_json::json!({ "t_ns": t_ns, "event": message }).to_string()),
            Form::Csv | Form::Summary => Ok(()),
        }
    }
}

fn table_row(health: &Health, rul: &Rul) -> String {
    let used = rul.operating_h.map_or_else(String::new, |hours| format!("{hours:.1}"));
    let mut row = format!("{used:>10} {:<22} {}", left_cell(rul), health_row(health));
    if !rul.governed_by.is_empty() && rul.governed_by != "damage" {
        row += &format!("  (ends by {})", printable(&rul.governed_by));
    }
    row
}

fn line<'a>(health: &'a Health, rul: &'a Rul, origin: Origin<'a>) -> Line<'a> {
    let states = health.states().map(|states| states.map(HealthState::name));
    Line {
        actuator: &health.actuator,
        window: health.window,
        t_start_ns: health.t_start_ns,
        status: &health.status,
        health: &health.health,
        states: FaultId::NAMES.into_iter().zip(states.into_iter().flatten()).collect(),
        damage: FaultId::NAMES.into_iter().zip(health.damages()).collect(),
        suspects: &health.suspects,
        hours_of: &rul.hours_of,
        operating_h: rul.operating_h,
        operating_cycles: rul.operating_cycles,
        rul_h: Interval::new(rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h),
        rul_cycles: Interval::new(rul.rul_p10_cycles, rul.rul_p50_cycles, rul.rul_p90_cycles),
        failure_probability: rul.failure_probability,
        dominant_fault: &rul.dominant_fault,
        governed_by: &rul.governed_by,
        reason: &health.reason,
        rul_reason: &rul.reason,
        serial_number: origin.serial_number,
        file: origin.file,
    }
}

fn csv_head() -> String {
    let columns = |of: &str| FaultId::NAMES.map(|fault| format!("{of}_{fault}")).join(",");
    let (damages, states) = (columns("damage"), columns("state"));
    format!(
        "actuator,window,t_start_ns,status,health,{damages},operating_h,operating_cycles,rul_p10_h,rul_p50_h,rul_p90_h,\
         rul_p10_cycles,rul_p50_cycles,rul_p90_cycles,failure_probability,dominant_fault,governed_by,\
         {states},suspects,hours_of,serial_number,file"
    )
}

/// What does not exist is empty.
fn csv_row(health: &Health, rul: &Rul, origin: Origin<'_>) -> String {
    let cell = |value: Option<f64>| value.map_or_else(String::new, number_cell);
    let mut cells = vec![
        health.actuator.clone(),
        health.window.to_string(),
        health.t_start_ns.to_string(),
        health.status.clone(),
        health.health.clone(),
    ];
    cells.extend(health.damages().map(cell));
    cells.extend(
        [
            rul.operating_h,
            rul.operating_cycles,
            rul.rul_p10_h,
            rul.rul_p50_h,
            rul.rul_p90_h,
            rul.rul_p10_cycles,
            rul.rul_p50_cycles,
            rul.rul_p90_cycles,
            rul.failure_probability,
        ]
        .map(cell),
    );
    cells.extend([rul.dominant_fault.clone(), rul.governed_by.clone()]);
    let states = health.states().map(|states| states.map(HealthState::name));
    cells.extend(states.unwrap_or_default().map(str::to_owned));
    cells.extend([
        health.suspects.join(","),
        rul.hours_of.clone(),
        origin.serial_number.unwrap_or_default().to_owned(),
        origin.file.to_owned(),
    ]);
    cells.iter().map(|cell| csv_cell(cell)).collect::<Vec<_>>().join(",")
}

/// A cell that neither a terminal nor a spreadsheet obeys, in quotes where need be.
fn csv_cell(text: &str) -> String {
    // A number may begin with a minus.
    let text = if text.parse::<f64>().is_ok() {
        text.into()
    } else {
        no_formula(text)
    };
    let text = printable(&text);
    if text.contains(['"', ',']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.into_owned()
    }
}
