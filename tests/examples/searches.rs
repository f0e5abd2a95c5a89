//! Compares the searches on random fault vectors: `cargo run --release -p hmd-tests --example searches [windows]`.
//!
//! Prints the table of `docs/search.md`. Every search sees the same windows (random vectors on `bench`, mixed profile, 2 kHz,
//! no noise), each with its own seed. A search succeeds where its error stays below 2 %.

use std::time::{Duration, Instant};

use ema_ga::{CmaConfig, DeConfig, GaConfig, StopRule};
use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, Method, Population};
use ema_models::{ActuatorParams, FAULT_COUNT, MotorKnowledge, Profile, Tolerances, rss_pct};
use hmd_lab::calibrate_type::random_faults;
use hmd_lab::simulated::SimulatedWindow;

/// Error up to which a search counts as successful, percent.
const SUCCESS_PCT: f64 = 2.0;

/// Windows of the paper's search, which takes ten seconds for each.
const PAPER_WINDOWS: usize = 20;

const DIMENSION: u32 = FAULT_COUNT as u32;

fn main() {
    let windows: usize = std::env::args()
        .nth(1)
        .map_or(100, |n| n.parse().expect("a number of windows"));
    let params = ActuatorParams::bench();
    let windows: Vec<SimulatedWindow> = (0..windows as u64)
        .map(|n| SimulatedWindow::new(&params, random_faults(50_000 + n), Profile::Mixed, 60_000 + n))
        .collect();
    println!("| search | windows | median error | p95 | below 2 % | evaluations | ms, one thread |");
    println!("|---|---|---|---|---|---|---|");
    let one_thread = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    for (name, form, method) in searches() {
        let count = if form == MonitorForm::Paper {
            PAPER_WINDOWS
        } else {
            windows.len()
        };
        let row = one_thread.install(|| row(&params, form, method, &windows[..count.min(windows.len())]));
        println!("| {name} | {row} |");
    }
}

fn searches() -> Vec<(&'static str, MonitorForm, Method)> {
    let ga = GaConfig::for_dimension(DIMENSION);
    let stop = StopRule::for_dimension(DIMENSION);
    let de = DeConfig::for_dimension(DIMENSION);
    let cma = CmaConfig::for_dimension(DIMENSION);
    // Two batches of 16 lanes, as the default search.
    let wide_cma = CmaConfig { population: 32, ..cma };
    let short = |stop: StopRule, generations| StopRule {
        max_generations: generations,
        ..stop
    };
    let three = MonitorForm::ThreePhase;
    vec![
        (
            "the paper's: its GA, cost and monitor",
            MonitorForm::Paper,
            Method::paper_ga(),
        ),
        (
            "GA, toolbox defaults",
            three,
            Method::Population(Population::Genetic(ga)),
        ),
        (
            "differential evolution",
            three,
            Method::Population(Population::Differential(de)),
        ),
        ("CMA-ES", three, Method::Population(Population::CmaEs(wide_cma))),
        ("least squares from health", three, Method::LeastSquares),
        (
            "CMA-ES, 10 generations, then least squares",
            three,
            Method::Hybrid(Population::CmaEs(CmaConfig {
                stop: short(stop, 10),
                ..wide_cma
            })),
        ),
        (
            "GA, 5 generations, then least squares (default)",
            three,
            Method::hybrid(),
        ),
    ]
}

fn row(params: &ActuatorParams, form: MonitorForm, method: Method, windows: &[SimulatedWindow]) -> String {
    let identifier = Identifier {
        params: *params,
        calibration: TypeCalibration::built_in("bench", form).expect("shipped"),
        method,
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    };
    let (mut errors, mut evaluations, mut time) = (Vec::new(), 0, Duration::ZERO);
    for (seed, window) in windows.iter().enumerate() {
        let begun = Instant::now();
        let estimate = identifier
            .identify(&window.prepared, window.conditions, seed as u64)
            .expect("valid settings");
        time += begun.elapsed();
        evaluations += estimate.evaluations;
        errors.push(rss_pct(&estimate.fault, &window.truth));
    }
    errors.sort_by(f64::total_cmp);
    let count = errors.len();
    let succeeded = errors.iter().filter(|error| **error < SUCCESS_PCT).count();
    format!(
        "{count} | {:.2} % | {:.2} % | {} of {count} | {} | {:.0}",
        errors[count / 2],
        errors[(count * 95 / 100).min(count - 1)],
        succeeded,
        evaluations / count as u64,
        1e3 * time.as_secs_f64() / count as f64,
    )
}
