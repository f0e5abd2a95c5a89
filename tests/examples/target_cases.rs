//! Windows for `firmware_image` as Rust source, and what this machine makes of them.
//!
//! `cargo run -p hmd-tests --example target_cases -- FILE [LOG …|all]` writes the source to FILE and prints what the image
//! must print too, as `name value` lines: the worn actuator with noise first, then the logs of `fixtures/logs`.

#[path = "../target_cases.rs"]
mod target_cases;

use std::error::Error;
use std::fmt::Write;

use ema_identify::relations::CommissionedRelations;
use ema_models::{FaultVector, rss_pct};
use firmware_image::{EstimateLines, RelationsLines};
use target_cases::{Case, commissioned, golden, golden_logs, worn};

/// Name of the first window.
const WORN: &str = "worn";

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("expected the file to write")?;
    let mut logs: Vec<String> = args.collect();
    if logs == ["all"] {
        logs = golden_logs();
    }
    let mut cases = vec![(WORN.to_owned(), worn())];
    cases.extend(logs.into_iter().map(|log| {
        let case = golden(&log);
        (log, case)
    }));
    let unit = commissioned();
    std::fs::write(path, source(&cases, &unit)?)?;

    for (name, case) in &cases {
        let estimate = &case.on_the_host();
        println!("{}", EstimateLines { name, estimate });
    }
    let estimate = &cases[0].1.by_relations(&unit);
    println!("{}", RelationsLines { name: WORN, estimate });
    let truth = FaultVector {
        friction: 0.4,
        backlash: 0.1,
        short_b: 0.15,
        ..FaultVector::NOMINAL
    };
    let found = cases[0].1.on_the_host();
    println!("rss_pct {:.3}", rss_pct(&found.fault, &truth));
    Ok(())
}

/// The constants `CASES`, `LONGEST` and `UNIT`; a number's debug text is Rust that gives the same bits.
fn source(cases: &[(String, Case)], unit: &CommissionedRelations) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    let longest = cases.iter().map(|(_, case)| case.samples.len()).max();
    writeln!(text, "const LONGEST: usize = {};", longest.unwrap_or_default())?;
    writeln!(text, "static CASES: [Case; {}] = [", cases.len())?;
    for (name, case) in cases {
        let Case {
            actuator,
            conditions,
            rest,
            ..
        } = case;
        writeln!(
            text,
            "Case {{ name: {name:?}, actuator: {actuator:?}, conditions: {conditions:?}, rest: {rest}, words: &["
        )?;
        for s in &case.samples {
            writeln!(
                text,
                "    ({:?}, {}, {}, {}, {:?}),",
                s.currents_ma, s.motor_counts, s.output_counts, s.setpoint, s.mode
            )?;
        }
        writeln!(text, "] }},")?;
    }
    writeln!(text, "];")?;
    writeln!(text, "static UNIT: CommissionedRelations = {unit:?};")?;
    Ok(text)
}
