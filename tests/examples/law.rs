//! What a better law of the mean currents would bring for one fault vector:
//! `cargo run --release -p hmd-tests --features study --example law`.
//!
//! The mean currents of the reference with the vector of [P] Table III, beyond the monitor's own, are learnt from windows that are
//! not those of the suite, by the voltage's amplitude and direction: more than one law for all vectors knows.
//! The monitor adds them, and the suite `paper` is identified again. Prints the table of `docs/monitor.md`.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, Method};
use ema_models::reference::{Reference, Scenario};
use ema_models::study::{CurrentTable, TABLE_HARMONICS, TABLE_VOLTAGES, set_current_table};
use ema_models::{
    ActuatorParams, FaultVector, Monitor, MotorDeviation, MotorKnowledge, Profile, REFERENCE_STEP, Tolerances,
    Unknowns, alpha_beta_from_abc, rss_pct,
};
use hmd_lab::evaluate::{Estimator, TABLE_III, paper};
use hmd_lab::simulated::SimulatedWindow;
use nalgebra::{Complex, SMatrix, SVector};
use rayon::prelude::*;

/// Windows from which the currents are learnt, and the first one's seed.
const LEARNT_FROM: u64 = 40;
const FIRST_SEED: u64 = 1000;

/// Windows that are identified beside the suite's.
const WINDOWS: u64 = 100;

/// Weight of no current at all, in control periods at each place and harmonic.
const RIDGE: f64 = 3.0;

/// Coefficients of a table.
const COEFFICIENTS: usize = TABLE_VOLTAGES.len() * TABLE_HARMONICS.len();

fn main() {
    let params = ActuatorParams::servo28();
    let identifier = Identifier {
        params,
        calibration: TypeCalibration::built_in("servo28", MonitorForm::ThreePhase).expect("shipped"),
        method: Method::hybrid(),
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    };
    println!("| actuator | monitor | the suite's 10 windows, %: mean | 100 windows, %: mean, median, p95, max |");
    println!("|---|---|---|---|");
    println!("| servo28 | as it is | {} |", figures(&identifier));
    assert!(set_current_table(learn(&identifier)), "taught once");
    println!(
        "| servo28 | with the reference's mean currents | {} |",
        figures(&identifier)
    );
}

/// Errors of the windows with several faults.
fn figures(identifier: &Identifier) -> String {
    let report = paper(&Estimator::Search(Box::new(identifier.clone())), "", 1, &|| ()).expect("valid settings");
    let truth = FaultVector::from_array(TABLE_III);
    let mut all: Vec<f64> = (0..WINDOWS)
        .into_par_iter()
        .map(|n| {
            let seed = 80_000 + n;
            let window = SimulatedWindow::new(&identifier.params, truth, Profile::Mixed, seed);
            let found = identifier.identify(&window.prepared, window.conditions, seed);
            rss_pct(&found.expect("valid settings").fault, &truth)
        })
        .collect();
    all.sort_by(f64::total_cmp);
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
    format!(
        "{:.2} | {mean:.2}, {:.2}, {:.2}, {:.2}",
        report.multi.mean_rss_pct,
        at(0.5),
        at(0.95),
        at(1.0)
    )
}

/// One control period of the reference: the voltage (α + jβ, in shares of half the DC link's) that carries it, and what its mean
/// current is beyond the monitor's, A.
struct Period {
    voltage: Complex<f64>,
    beyond: Complex<f64>,
}

/// The table that fits the reference's mean currents best.
fn learn(identifier: &Identifier) -> CurrentTable {
    let fault = FaultVector::from_array(TABLE_III);
    let periods: Vec<Vec<Period>> = (FIRST_SEED..FIRST_SEED + LEARNT_FROM)
        .into_par_iter()
        .map(|seed| periods(identifier, fault, seed))
        .collect();
    let mut normal = SMatrix::<Complex<f64>, COEFFICIENTS, COEFFICIENTS>::identity() * Complex::from(RIDGE);
    let mut right = SVector::<Complex<f64>, COEFFICIENTS>::zeros();
    for period in periods.iter().flatten() {
        let shape = shape(period.voltage);
        for (r, a) in &shape {
            right[*r] += a.conj() * period.beyond;
            for (c, b) in &shape {
                normal[(*r, *c)] += a.conj() * b;
            }
        }
    }
    let found = normal.lu().solve(&right).expect("the ridge makes it regular");
    CurrentTable(std::array::from_fn(|h| {
        std::array::from_fn(|n| {
            let c = found[h * TABLE_VOLTAGES.len() + n];
            [c.re, c.im]
        })
    }))
}

/// Coefficients that have a part in the current under a voltage, and their factors.
fn shape(voltage: Complex<f64>) -> Vec<(usize, Complex<f64>)> {
    let last = TABLE_VOLTAGES.len() - 1;
    let amplitude = voltage
        .re
        .hypot(voltage.im)
        .clamp(TABLE_VOLTAGES[0], TABLE_VOLTAGES[last]);
    let direction = voltage / voltage.re.hypot(voltage.im).max(1e-12);
    let n = TABLE_VOLTAGES[1..last]
        .iter()
        .take_while(|place| **place <= amplitude)
        .count();
    let share = (amplitude - TABLE_VOLTAGES[n]) / (TABLE_VOLTAGES[n + 1] - TABLE_VOLTAGES[n]);
    let of = |(h, harmonic): (usize, &i32)| {
        let turned = direction.powi(*harmonic);
        let first = h * TABLE_VOLTAGES.len() + n;
        [(first, turned * (1.0 - share)), (first + 1, turned * share)]
    };
    TABLE_HARMONICS.iter().enumerate().flat_map(of).collect()
}

/// The control periods of one window, but those at rest.
fn periods(identifier: &Identifier, fault: FaultVector, seed: u64) -> Vec<Period> {
    let params = identifier.params;
    let unknowns = Unknowns {
        fault,
        load_torque: 0.0,
        integral: 0.0,
        motor: MotorDeviation::default(),
    };
    let monitor = Monitor::new(
        &params,
        &identifier.calibration.coefficients(),
        params.motor.v_dc,
        &unknowns,
    );
    let run = Scenario::new(params, fault, seed).run();
    let mut state = *run.state();
    let reference = Reference::new(&params, &params, &fault, 0.0);
    let per_sample = (1.0 / (params.sensors.sample_rate * params.controller.period)).round() as u32;
    let per_period = (params.controller.period / REFERENCE_STEP).round() as u32;
    let mut model = monitor.state_at((state.theta_m, state.omega_m));
    let mut found = Vec::new();
    for sample in run {
        for _ in 0..per_sample {
            let mut motion = [(state.theta_m, state.omega_m); 3];
            let mut mean = [0.0; 2];
            for n in 1..=per_period {
                reference.step(&mut state, sample.setpoint);
                let i = alpha_beta_from_abc(state.i);
                mean = [0, 1].map(|axis: usize| mean[axis] + i[axis] / f64::from(per_period));
                if n == per_period / 2 {
                    motion[1] = (state.theta_m, state.omega_m);
                }
            }
            motion[2] = (state.theta_m, state.omega_m);
            let (v, taken) = monitor.control_period_along(&mut model, state.i_ref, motion);
            if motion[0].1 != 0.0 {
                found.push(Period {
                    voltage: Complex::new(v[0], v[1]) / (0.5 * params.motor.v_dc),
                    beyond: Complex::new(mean[0] - taken[0], mean[1] - taken[1]),
                });
            }
        }
    }
    found
}
