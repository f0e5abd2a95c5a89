//! The histories of `hmd evaluate rul` for another program, and the scores of its forecasts and of this monitor; `cargo xtask progpy` runs both.
//!
//! `progpy histories N SEED` prints the first N histories of each fault, a line each, without the truth. `progpy score N
//! SEED FILE` reads a line for each history, `{"seconds": …, "hours_left": […]}` (see [`hmd_lab::evaluate::RemainingHoursSamples`]), and prints a table.

use ema_models::FaultId;
use std::error::Error;
use std::time::Instant;

use hmd_core::rul::Prognosis;
use hmd_lab::evaluate::{Comparison, History, RemainingHoursSamples, Scores, compare_forecasts, rul_histories};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        ["histories", n, seed] => print_histories(&rul_histories(n.parse()?, seed.parse()?)?),
        ["score", n, seed, file] => print_scores(&rul_histories(n.parse()?, seed.parse()?)?, file),
        _ => Err("expected: histories N SEED, or score N SEED FILE".into()),
    }
}

fn print_histories(histories: &[History]) -> Result<(), Box<dyn Error>> {
    for history in histories {
        println!("{}", serde_json::to_string(&history.windows)?);
    }
    Ok(())
}

fn print_scores(histories: &[History], file: &str) -> Result<(), Box<dyn Error>> {
    let (mut other, mut seconds): (Vec<RemainingHoursSamples>, f64) = (Vec::new(), 0.0);
    for line in std::fs::read_to_string(file)?.lines() {
        let mut line: serde_json::Value = serde_json::from_str(line)?;
        seconds += line["seconds"].as_f64().ok_or("expected seconds")?;
        other.push(serde_json::from_value(line["hours_left"].take())?);
    }
    println!(
        "| histories | α-λ passed, % | horizon, % of life | cumulative relative accuracy | 80 % interval covers, % | convergence |"
    );
    println!("|---|---|---|---|---|---|");
    for comparison in compare_forecasts(histories, &other)? {
        println!("{}", row(&comparison));
    }
    let windows = histories.iter().map(|history| history.windows.len()).sum::<usize>() as f64;
    println!(
        "\nEach cell: this monitor / `progpy` / an oracle that knows the true law. Time of one window, update and forecast, on one core: {:.2} ms / {:.1} ms.",
        1e3 * own_seconds(histories) / windows,
        1e3 * seconds / windows
    );
    Ok(())
}

fn row(comparison: &Comparison) -> String {
    let cell = |of: fn(&Scores) -> f64, factor: f64, digits: usize| {
        format!(
            "{:.*} / {:.*} / {:.*}",
            digits,
            factor * of(&comparison.own),
            digits,
            factor * of(&comparison.other),
            digits,
            factor * of(&comparison.oracle)
        )
    };
    let name = if comparison.name == "all" {
        "**all**"
    } else {
        &comparison.name
    };
    format!(
        "| {name} ({}) | {} | {} | {} | {} | {} |",
        comparison.histories,
        cell(|s| s.alpha_lambda_pass_rate, 100.0, 1),
        cell(|s| s.prognostic_horizon_fraction, 100.0, 1),
        cell(|s| s.cra, 1.0, 3),
        cell(|s| s.coverage_80, 100.0, 1),
        cell(|s| s.convergence, 1.0, 3),
    )
}

/// Time of all updates and forecasts, one after the other.
fn own_seconds(histories: &[History]) -> f64 {
    let since = Instant::now();
    for history in histories {
        let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
        for seen in &history.windows {
            let mut estimates = [None; FaultId::COUNT];
            estimates[0] = seen.estimate;
            prognosis.update(seen.at, &estimates);
            std::hint::black_box(prognosis.forecast(100.0));
        }
    }
    since.elapsed().as_secs_f64()
}
