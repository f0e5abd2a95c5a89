//! `hmd bench`: evaluations and identifications per second on this computer.

use std::num::NonZeroUsize;

use super::{Exit, progress, say};
use hmd_lab::bench::{BenchReport, bench, figures};

/// Measure how fast this computer evaluates monitors and identifies windows.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd bench\n\
    \x20 hmd bench --threads 1 --json")]
pub struct Args {
    /// Threads; all cores without it.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// Print everything as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
///
/// # Errors
/// Threads that cannot be started.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let threads = args.threads.map_or_else(rayon::current_num_threads, NonZeroUsize::get);
    let bar = progress::over_pieces(figures(threads));
    let report = bench(threads, &|| bar.inc(1))?;
    bar.finish_and_clear();
    say(&if args.json {
        serde_json::to_string(&report)?
    } else {
        tables(&report)
    })?;
    Ok(Exit::Done)
}

/// The figures as Markdown.
fn tables(report: &BenchReport) -> String {
    let mut text = format!(
        "{} monitor of {}, step {} us, window {} s at {} Hz; {}, {} monitors side by side\n",
        report.monitor,
        report.actuator,
        report.step_us,
        report.window_s,
        report.sample_rate_hz,
        report.instruction_set,
        report.lanes
    );
    text += "\n| one core | evaluations/s | over scalar f64 |\n|---|---|---|\n";
    text += &format!("| scalar f64 | {:.0} | 1.0 |\n", report.scalar_f64_per_s);
    for set in &report.instruction_sets {
        text += &format!(
            "| {} | {:.0} | {:.1} |\n",
            set.name, set.evaluations_per_s, set.over_scalar_f64
        );
    }
    text += &format!("\nOne linearisation: {:.2} ms\n", report.linearisation_ms);
    text += "\n| threads | evaluations/s | over one | one identification, ms | identifications/s |\n|---|---|---|---|---|\n";
    for f in &report.threads {
        text += &format!(
            "| {} | {:.0} | {:.2} | {:.1} | {:.0} |\n",
            f.threads, f.evaluations_per_s, f.over_one, f.identification_ms, f.identifications_per_s
        );
    }
    text += "\n| window, s | sample rate, Hz | one evaluation on one core, us |\n|---|---|---|\n";
    for f in report.by_window.iter().chain(&report.by_sample_rate) {
        text += &format!("| {} | {} | {:.1} |\n", f.window_s, f.sample_rate_hz, f.evaluation_us);
    }
    text += "\n| population | evaluations | one identification on all threads, ms |\n|---|---|---|\n";
    for f in &report.by_population {
        text += &format!(
            "| {} | {} | {:.1} |\n",
            f.population, f.evaluations, f.identification_ms
        );
    }
    text += "\n| actuators | one window of each on all threads, ms |\n|---|---|\n";
    for f in &report.by_actuators {
        text += &format!("| {} | {:.1} |\n", f.actuators, f.all_ms);
    }
    text.truncate(text.trim_end().len());
    text
}
