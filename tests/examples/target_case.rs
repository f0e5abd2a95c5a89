//! One window of a worn actuator for `firmware_image`, as Rust source, and what this machine makes of it.
//!
//! `cargo run --release -p hmd-tests --example target_case -- FILE` writes the source to FILE and prints, as `name value`
//! lines, what the image must print too, and how far single precision and the host's own identification are from the truth.

#[path = "../target_case.rs"]
mod target_case;

use std::error::Error;
use std::fmt::Write;

use ema_models::{Scale, rss_pct};
use ema_wire::Sample;
use firmware_image::{Identification, RecordedWindow};
use target_case::{Case, REST};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).ok_or("expected the file to write")?;
    let case = Case::new().ok_or("expected a calibration and an actuation")?;
    std::fs::write(path, source(&case.identification, &case.samples)?)?;

    let params = &case.identification.params;
    let window = RecordedWindow::new(params, &case.samples, REST).ok_or("expected a window that can be read")?;
    let found = case.identification.identify(&window);
    for (p, x) in found.at.0.iter().enumerate() {
        println!("x{p} {:016x}", x.to_bits());
    }
    println!("cost {:016x}", found.cost.to_bits());
    println!("linearisations {}", found.linearisations);
    println!("runs {}", found.runs);
    let single = Scale::new(params).unknowns(&found.at).fault;
    let double = case
        .identifier
        .identify(&case.simulated.prepared, case.simulated.conditions, 1)?;
    println!("single_rss_pct {:.3}", rss_pct(&single, &case.worn));
    println!("double_rss_pct {:.3}", rss_pct(&double.fault, &case.worn));
    println!("apart_rss_pct {:.3}", rss_pct(&single, &double.fault));
    Ok(())
}

/// The constants `IDENTIFICATION`, `REST` and `WINDOW`; a number's debug text is Rust that gives the same bits.
fn source(identification: &Identification, samples: &[Sample]) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    writeln!(text, "const IDENTIFICATION: Identification = {identification:?};")?;
    writeln!(text, "const REST: usize = {REST};")?;
    writeln!(text, "static WINDOW: [Word; {}] = [", samples.len())?;
    for s in samples {
        let Sample {
            i_a_ma, i_b_ma, i_c_ma, ..
        } = s;
        writeln!(
            text,
            "    ({i_a_ma}, {i_b_ma}, {i_c_ma}, {}, {}, {}),",
            s.motor_counts, s.output_counts, s.setpoint
        )?;
    }
    writeln!(text, "];")?;
    Ok(text)
}
