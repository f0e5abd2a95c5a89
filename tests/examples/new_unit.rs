//! Units that nobody knows but by their data sheet and ten recordings: `cargo run --release -p hmd-tests --example new_unit --
//! [KEY=VALUE]…`.
//!
//! Keys: `units` (number of units, default 1), `seed` (of the first), `windows` (healthy windows of each, 200), `worn` (windows of
//! each fault and damage, 3), `compliance_hz` (of the transmission, 0: rigid), `type` (`bench`), `learn` (recordings, 10).
//!
//! Each unit has parameters drawn within the tolerances of its data sheet, a vector drive with dead time, a spring at the output,
//! cogging, errors of resolver and current sensors. It is commissioned by the recordings as `hmd calibrate` does, then assessed
//! healthy, and worn by each fault. Printed per unit and in all: recordings that accuse a part before commissioning, healthy windows
//! that are judged and that accuse a part, worn windows that name exactly the true part, errors within two sigmas, median error.

#[path = "../new_units.rs"]
mod new_units;

use std::collections::BTreeMap;
use std::error::Error;

use new_units::{Tally, Trial};

fn main() -> Result<(), Box<dyn Error>> {
    let given: BTreeMap<String, String> = std::env::args()
        .skip(1)
        .filter_map(|arg| {
            arg.split_once('=')
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
        })
        .collect();
    let number = |key: &str, otherwise: f64| given.get(key).map_or(Ok(otherwise), |text| text.parse());
    let full = Trial::of_type(given.get("type").map_or("bench", String::as_str))?;
    let trial = Trial {
        windows: number("windows", full.windows as f64)? as u64,
        worn: number("worn", full.worn as f64)? as u64,
        learn: number("learn", full.learn as f64)? as u64,
        compliance_hz: number("compliance_hz", full.compliance_hz)?,
        ..full
    };
    let mut all = Tally::default();
    let seed = number("seed", 1.0)? as u64;
    for seed in seed..seed + number("units", 1.0)? as u64 {
        match trial.unit(seed) {
            Ok(tally) => {
                println!("unit {seed}: {}", tally.line());
                all.add(tally);
            }
            Err(error) => println!("unit {seed}: {error}"),
        }
    }
    println!("all: {}", all.line());
    Ok(())
}
