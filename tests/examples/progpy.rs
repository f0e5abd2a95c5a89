//! The histories of `hmd evaluate rul` for another program, and its forecasts beside ours; `cargo xtask progpy` runs both.
//!
//! `progpy histories N SEED` prints the first N histories of each fault, a line each, without the truth. `progpy score N
//! SEED FILE` reads a line for each history, `{"seconds": …, "lives": […]}` (see [`hmd_lab::evaluate::Lives`]), and prints a table.

use std::error::Error;
use std::time::Instant;

use hmd_core::health::FAULTS;
use hmd_core::rul::Prognosis;
use hmd_lab::evaluate::{Beside, History, Lives, Scores, rul_beside, rul_histories};

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
    let (mut theirs, mut seconds): (Vec<Lives>, f64) = (Vec::new(), 0.0);
    for line in std::fs::read_to_string(file)?.lines() {
        let mut told: serde_json::Value = serde_json::from_str(line)?;
        seconds += told["seconds"].as_f64().ok_or("expected seconds")?;
        theirs.push(serde_json::from_value(told["lives"].take())?);
    }
    println!(
        "| histories | α-λ passed, % | horizon, % of life | cumulative relative accuracy | 80 % interval covers, % | convergence |"
    );
    println!("|---|---|---|---|---|---|");
    for beside in rul_beside(histories, &theirs)? {
        println!("{}", row(&beside));
    }
    let windows = histories.iter().map(|history| history.windows.len()).sum::<usize>() as f64;
    println!(
        "\nEach cell: this monitor / `progpy` / an oracle that knows the true law. Time of one window, update and forecast, on one core: {:.2} ms / {:.1} ms.",
        1e3 * our_seconds(histories) / windows,
        1e3 * seconds / windows
    );
    Ok(())
}

fn row(beside: &Beside) -> String {
    let cell = |of: fn(&Scores) -> f64, factor: f64, digits: usize| {
        format!(
            "{:.*} / {:.*} / {:.*}",
            digits,
            factor * of(&beside.ours),
            digits,
            factor * of(&beside.theirs),
            digits,
            factor * of(&beside.oracle)
        )
    };
    let name = if beside.name == "all" { "**all**" } else { &beside.name };
    format!(
        "| {name} ({}) | {} | {} | {} | {} | {} |",
        beside.histories,
        cell(|s| s.alpha_lambda_pass_rate, 100.0, 1),
        cell(|s| s.prognostic_horizon_fraction, 100.0, 1),
        cell(|s| s.cra, 1.0, 3),
        cell(|s| s.coverage_80, 100.0, 1),
        cell(|s| s.convergence, 1.0, 3),
    )
}

/// Time of all updates and forecasts, one after the other.
fn our_seconds(histories: &[History]) -> f64 {
    let since = Instant::now();
    for history in histories {
        let mut prognosis = Prognosis::new([0.8; FAULTS]);
        for seen in &history.windows {
            let mut estimates = [None; FAULTS];
            estimates[0] = seen.estimate;
            prognosis.update(seen.at, &estimates);
            std::hint::black_box(prognosis.forecast(100.0));
        }
    }
    since.elapsed().as_secs_f64()
}
