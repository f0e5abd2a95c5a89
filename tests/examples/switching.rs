//! How far the switching alone moves an estimate: `cargo run --release -p hmd-tests --example switching [seeds]`.
//!
//! Two units that differ by a millionth of the DC link's voltage switch at other instants. No monitor that averages over the
//! switching can tell them apart, so half the square of their estimates' distance is the variance that no such monitor avoids. The
//! floor is the error of an estimate that is right on average and scatters so: the truth, and that distance over √2 to either
//! side (of the eccentricity as the vector that it is: the direction of a small one is lost in a scatter of its size).
//! Prints the table of `docs/monitor.md`: that floor beside the error, for the vectors of the suites `paper` and `random`, and for
//! those of `noise` with its sensors and load. There both units have the same noise and are exactly of their type, so the suite's
//! own errors have more to them than this floor. Where several windows have the same vector, the last column is the error that
//! would be left if the mean of their estimates were the truth: what no constant correction of an estimate can take away.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, Method};
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, MotorKnowledge, Profile, Scale, Tolerances, rss_pct};
use hmd_lab::calibrate_type::random_faults;
use hmd_lab::evaluate::TABLE_III;
use hmd_lab::simulated::SimulatedWindow;
use rayon::prelude::*;

/// Change of the supply that nothing but the switching notices.
const NUDGE: f64 = 1e-6;

/// Its multiples spread evenly over the unit interval.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Faults of the suite `paper`: place in the vector, and its values; all three shorts in turn.
const SINGLE: [(usize, [f64; 3]); 7] = [
    (0, [0.25, 0.5, 0.75]),
    (1, [0.25, 0.5, 0.75]),
    (2, [0.25, 0.5, 0.75]),
    (3, [0.25, 0.5, 0.75]),
    (4, [0.25, 0.5, 0.75]),
    (5, [0.25, 0.5, 0.75]),
    (7, [0.625, 0.75, 0.875]),
];

fn main() {
    let seeds: u64 = std::env::args()
        .nth(1)
        .map_or(10, |n| n.parse().expect("a number of seeds"));
    println!(
        "| actuator | vectors | windows | floor of the switching, %: mean, median, p95, max | error, %: the same | scatter alone, %: the \
         same |"
    );
    println!("|---|---|---|---|---|---|");
    for (name, params) in [
        ("bench", ActuatorParams::bench()),
        ("servo28", ActuatorParams::servo28()),
    ] {
        let suites = [
            ("single", single(seeds), CLEAN),
            (
                "Table III",
                vec![FaultVector::from_array(TABLE_III); 10 * seeds as usize],
                CLEAN,
            ),
            ("random", random(seeds), CLEAN),
            ("noise, 2000 Hz", random(seeds), Sampling { noisy: true, ..CLEAN }),
            (
                "noise, 400 Hz",
                random(seeds),
                Sampling {
                    noisy: true,
                    rate_hz: 400.0,
                },
            ),
        ];
        for (vectors, truths, sampling) in suites {
            let mut params = params;
            params.sensors.sample_rate = sampling.rate_hz;
            let identifier = Identifier {
                params,
                calibration: TypeCalibration::built_in(name, MonitorForm::ThreePhase).expect("shipped"),
                method: Method::hybrid(),
                motor: MotorKnowledge::default(),
                tolerances: Tolerances::NONE,
            };
            let pairs = pairs(&identifier, &truths, sampling);
            let floors = pairs.iter().zip(&truths).map(|(pair, truth)| floor(truth, pair));
            let errors = pairs.iter().zip(&truths).map(|([one, _], truth)| rss_pct(one, truth));
            let (floors, errors) = (figures(floors.collect()), figures(errors.collect()));
            let scatters = scatters(&truths, &pairs).map_or("–".to_owned(), figures);
            println!(
                "| {name} | {vectors} | {} | {floors} | {errors} | {scatters} |",
                truths.len()
            );
        }
    }
}

/// How a window is sampled.
#[derive(Clone, Copy)]
struct Sampling {
    rate_hz: f64,
    /// With the converters and noise of the suite `noise`, under a load that is not measured.
    noisy: bool,
}

const CLEAN: Sampling = Sampling {
    rate_hz: 2000.0,
    noisy: false,
};

fn random(seeds: u64) -> Vec<FaultVector> {
    (0..20 * seeds).map(|n| random_faults(70_000 + n)).collect()
}

fn single(seeds: u64) -> Vec<FaultVector> {
    let mut all = Vec::new();
    for (place, values) in SINGLE {
        for value in values {
            let mut k = FaultVector::NOMINAL.to_array();
            k[place] = value;
            all.extend((0..seeds).map(|_| FaultVector::from_array(k)));
        }
    }
    all
}

/// Estimates of each vector from two units that differ by nothing but the switching.
fn pairs(identifier: &Identifier, truths: &[FaultVector], sampling: Sampling) -> Vec<[FaultVector; 2]> {
    truths
        .par_iter()
        .enumerate()
        .map(|(n, truth)| {
            let seed = 80_000 + n as u64;
            [0.0, NUDGE].map(|nudge| estimate(identifier, *truth, seed, nudge, sampling))
        })
        .collect()
}

/// Error of the truth off by the pair's distance over √2, to either side, percent.
fn floor(truth: &FaultVector, [one, other]: &[FaultVector; 2]) -> f64 {
    let (truth_at, one, other) = (coordinates(truth), coordinates(one), coordinates(other));
    let off = |sign: f64| {
        let share = sign / std::f64::consts::SQRT_2;
        let at = std::array::from_fn(|n| truth_at[n] + share * (one[n] - other[n]));
        rss_pct(&from_coordinates(at), truth)
    };
    0.5 * (off(1.0) + off(-1.0))
}

/// Error of each first estimate if the mean of those of its vector were the truth, percent; `None` where vectors are drawn, each
/// for itself.
fn scatters(truths: &[FaultVector], pairs: &[[FaultVector; 2]]) -> Option<Vec<f64>> {
    let mut all = Vec::new();
    let mut rest = pairs;
    for group in truths.chunk_by(|a, b| a == b) {
        let (mine, others) = rest.split_at(group.len());
        rest = others;
        if mine.len() < 2 {
            return None;
        }
        let estimates: Vec<_> = mine.iter().map(|[one, _]| coordinates(one)).collect();
        let count = estimates.len() as f64;
        let mean: [f64; 8] = std::array::from_fn(|n| estimates.iter().map(|at| at[n]).sum::<f64>() / count);
        // The mean is of these same windows.
        let widened = (count / (count - 1.0)).sqrt();
        let truth_at = coordinates(&group[0]);
        all.extend(estimates.iter().map(|at| {
            let at = std::array::from_fn(|n| truth_at[n] + widened * (at[n] - mean[n]));
            rss_pct(&from_coordinates(at), &group[0])
        }));
    }
    Some(all)
}

/// A fault vector with its eccentricity as a vector. Unlike those of `Scale`, these have no limits: a scatter about 0 has two sides.
fn coordinates(fault: &FaultVector) -> [f64; 8] {
    let mut at = fault.to_array();
    let (sin, cos) = (std::f64::consts::TAU * at[6]).sin_cos();
    [at[5], at[6]] = [at[5] * cos, at[5] * sin];
    at
}

fn from_coordinates(mut at: [f64; 8]) -> FaultVector {
    let [x, y] = [at[5], at[6]];
    at[5] = x.hypot(y);
    at[6] = (y.atan2(x) / std::f64::consts::TAU).rem_euclid(1.0);
    FaultVector::from_array(at)
}

fn estimate(identifier: &Identifier, truth: FaultVector, seed: u64, nudge: f64, sampling: Sampling) -> FaultVector {
    let mut scenario = Scenario {
        actuations: Actuations::single(Profile::Mixed),
        ..Scenario::new(identifier.params, truth, seed)
    };
    scenario.unit.motor.v_dc *= 1.0 + nudge;
    if sampling.noisy {
        // ±10 Nm on `bench`, elsewhere the same share of what the motor lifts; each window another.
        let largest =
            10.0 * Scale::new(&identifier.params).load_unit() / Scale::new(&ActuatorParams::bench()).load_unit();
        scenario.load_torque = largest * (2.0 * (seed as f64 * GOLDEN).fract() - 1.0);
        scenario.sensing = CurrentSensing {
            quantised: true,
            noise_rms: 0.05,
        };
    }
    let mut window = SimulatedWindow::first_of(&scenario);
    if sampling.noisy {
        window.conditions.load_torque = None;
    }
    let found = identifier.identify(&window.prepared, window.conditions, seed);
    found.expect("valid settings").fault
}

fn figures(mut all: Vec<f64>) -> String {
    all.sort_by(f64::total_cmp);
    let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    format!("{mean:.2}, {:.2}, {:.2}, {:.2}", at(0.5), at(0.95), at(1.0))
}
