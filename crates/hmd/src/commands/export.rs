//! `hmd export`: recorded files as a table.

use std::path::{Path, PathBuf};

use super::outputs::{Content, Outputs};
use super::recordings::{Wanted, recordings};
use super::{Exit, Losses, Misuse, to_stderr};
use hmd_report::export::{CsvTable, Late, ParquetTable, Table, TableKind, export, metadata_path};

/// Write what was recorded as a table: CSV or Parquet, wide by time, units in the metadata.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd export flight.mcap -o flight.parquet\n\
    \x20 hmd export --table samples flight.mcap -o samples.csv")]
pub struct Args {
    /// MCAP files that hmd wrote, in the order of time, or folders of them.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// The table, `.csv` or `.parquet`; beside a CSV file, `FILE.metadata.json` holds the units.
    #[arg(short, long)]
    output: PathBuf,
    /// What makes a row: a window with its health and remaining life, or a stored sample of it.
    #[arg(long, value_enum, default_value_t = TableKind::Health)]
    table: TableKind,
}

/// Runs the verb.
///
/// # Errors
/// A file that is none of ours, is damaged and has no row, or has frames alone; an output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    run_with(args, &mut to_stderr)
}

/// The same; `tell` gets what the command would write to standard error.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: &Args, tell: &mut dyn FnMut(&str)) -> anyhow::Result<Exit> {
    let recorded = recordings(&args.files, Wanted::Records)?;
    let beside = metadata_path(&args.output);
    let is_csv = args.output.extension().is_some_and(|extension| extension == "csv");
    let written: &[(&Path, Content)] = if is_csv {
        &[(&args.output, Content::Csv), (&beside, Content::Metadata)]
    } else {
        &[(&args.output, Content::Parquet)]
    };
    Outputs(written).check(&recorded)?;
    let (output, heads) = (args.output.clone(), args.table.heads());
    let extension = args.output.extension().and_then(|extension| extension.to_str());
    let table: Box<dyn Table> = match extension {
        Some("csv") => Box::new(Late::new(move || Ok(Box::new(CsvTable::new(&output, heads)?) as _))),
        Some("parquet") => Box::new(Late::new(move || Ok(Box::new(ParquetTable::new(&output, heads)?) as _))),
        _ => {
            let output = args.output.display();
            return Err(Misuse(format!(
                "--output: expected a name that ends in .csv or .parquet, found {output}"
            ))
            .into());
        }
    };
    let mut losses = Losses::default();
    let exported = export(&recorded, args.table, table, &mut |loss| losses.add(loss))?;
    if exported.rows == 0 {
        tell("a table without rows: no actuation was recorded");
    }
    Ok(losses.exit(tell))
}
