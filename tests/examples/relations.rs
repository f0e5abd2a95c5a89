//! What the relations between measured signals say of units with a vector drive, far from their data sheet.
//!
//! `cargo run --release -p hmd-tests --example relations [-- FOLDER]` prints the table of `docs/design/relations.md`; with a
//! folder it also writes each window as a candump log, for other programs: `UNIT-KIND-NUMBER.log`.

#[path = "../relations_units.rs"]
mod relations_units;

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use ema_identify::relations::{MeasuredWindow, RelationsEstimate};
use ema_models::reference::Scenario;
use ema_models::{FAULT_COUNT, FaultId, FaultVector};
use ema_wire::ActuatorId;
use hmd_core::frame::RawFrame;
use hmd_ingest::candump::{Decimals, emit};
use hmd_lab::simulate::{EPOCH_NS, traffic};
use relations_units::{FAULTS, UNITS, Unit, simulated};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1);
    for (number, unit) in UNITS.iter().enumerate() {
        if let Some(folder) = &folder {
            write_logs(Path::new(folder), number, unit)?;
        }
        report(unit);
        rates(unit);
    }
    Ok(())
}

fn report(unit: &Unit) {
    println!("\n{} ({})", unit.name, unit.actuator);
    let learnt = unit.learnt();
    println!(
        "torque residual of the healthy windows {:.4} Nm",
        learnt.balance.residual_rms
    );
    println!(
        "{:>26}   k1     k2     k3     k4     k5     k6     k7     k8   residual",
        ""
    );
    let healthy = unit.estimates(&learnt, &unit.healthy());
    for (number, estimate) in healthy.iter().enumerate() {
        line(&format!("healthy {number}"), estimate);
    }
    for (&(parameter, value), estimate) in FAULTS.iter().zip(&unit.estimates(&learnt, &unit.faulty())) {
        line(&format!("{} {value}", FaultVector::NAMES[parameter]), estimate);
    }

    let params = unit.params();
    let recordings = simulated(&unit.healthy()[..1]);
    let window = MeasuredWindow::new(&params, &recordings[0], &[]);
    const RUNS: u32 = 200;
    let start = Instant::now();
    for _ in 0..RUNS {
        std::hint::black_box(learnt.estimate(std::hint::black_box(&window)));
    }
    println!(
        "one estimate {:.2} ms",
        start.elapsed().as_secs_f64() * 1e3 / f64::from(RUNS)
    );
}

/// Healthy windows, and windows of each fault, from which rates are counted.
const HEALTHY_WINDOWS: u64 = 120;
const WINDOWS_PER_FAULT: u64 = 10;

/// Prints how many windows are named rightly, with an alarm at damages above 0.05 and three sigmas, and the errors' coverage.
fn rates(unit: &Unit) {
    let learnt = unit.learnt();
    let mut errors = Vec::new();
    let (mut inside, mut all) = (0, 0);
    let mut rightly_named = |k: [f64; FAULT_COUNT], windows: std::ops::Range<u64>| {
        let truth = FaultVector::from_array(k);
        let scenarios: Vec<Scenario> = windows.map(|seed| unit.scenario(truth, seed)).collect();
        let is_right = |estimate: &RelationsEstimate| {
            let mut right = true;
            for fault in FaultId::ALL {
                let parameter = fault.parameter();
                let Some(sigma) = estimate.sigma[parameter] else {
                    right = false;
                    continue;
                };
                let error = estimate.k[parameter] - k[parameter];
                (inside, all) = (inside + u32::from(error.abs() < 1.96 * sigma), all + 1);
                let found = FaultVector::from_array(estimate.k).damage_of(fault);
                let per_parameter = if fault == FaultId::Gain { 2.0 } else { 1.0 };
                let is_damaged = truth.damage_of(fault) > 0.0;
                right &= is_damaged == (found > (3.0 * per_parameter * sigma).max(0.05));
                if is_damaged {
                    errors.push((found - truth.damage_of(fault)).abs());
                }
            }
            right
        };
        unit.estimates(&learnt, &scenarios)
            .iter()
            .map(is_right)
            .filter(|right| *right)
            .count()
    };
    let nominal = FaultVector::NOMINAL.to_array();
    let healthy = rightly_named(nominal, 5000..5000 + HEALTHY_WINDOWS);
    let mut faulty = 0;
    for (first, (parameter, value)) in (6000..).step_by(100).zip(FAULTS) {
        let mut k = nominal;
        k[parameter] = value;
        faulty += rightly_named(k, first..first + WINDOWS_PER_FAULT);
    }
    errors.sort_by(f64::total_cmp);
    let coverage = 100.0 * f64::from(inside) / f64::from(all);
    println!(
        "{healthy} of {HEALTHY_WINDOWS} healthy windows without an alarm, {faulty} of {} faults named; error of the damage {:.4}, 95 % {:.4}; {coverage:.1} % within 1.96 sigma",
        errors.len(),
        errors[errors.len() / 2],
        errors[errors.len() * 95 / 100],
    );
}

fn line(name: &str, estimate: &RelationsEstimate) {
    let number = |n: usize| match estimate.needed[n] {
        None => format!("{:7.3}", estimate.k[n]),
        Some(_) => "      -".to_owned(),
    };
    let sigma = |n: usize| estimate.sigma[n].map_or("      -".to_owned(), |sigma| format!("{sigma:7.3}"));
    let all = |column: &dyn Fn(usize) -> String| (0..8).map(column).collect::<String>();
    println!("{name:>24} {}   {:.4} Nm", all(&number), estimate.torque_residual_rms);
    println!("{:>24} {}", "sigma", all(&sigma));
}

fn write_logs(folder: &Path, number: usize, unit: &Unit) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let kinds = [
        ("commissioning", unit.commissioning()),
        ("healthy", unit.healthy()),
        ("faulty", unit.faulty()),
    ];
    for (kind, scenarios) in kinds {
        for (window, scenario) in scenarios.iter().enumerate() {
            std::fs::write(
                folder.join(format!("{number}-{kind}-{window:02}.log")),
                candump(scenario),
            )?;
        }
    }
    Ok(())
}

fn candump(scenario: &Scenario) -> Vec<u8> {
    let actuator = ActuatorId::new(0).expect("the first actuator");
    let mut text = Vec::new();
    let frames: Vec<RawFrame> = traffic(scenario, actuator, EPOCH_NS).collect();
    for frame in &frames {
        emit(frame, "can0", Decimals::Six, &mut text);
    }
    text
}
