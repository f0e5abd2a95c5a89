//! One identification of each of many random windows: what it found, its work and its processor time. One JSON line per window, then
//! their summary.
//!
//! `cargo run --release -p hmd-lab --example search_windows -- [KEY=VALUE]…`. Keys: `actuator`, `rate` (Hz), `n`, `seed`; `unit`: `exact`
//! (the type, load measured), `noisy` (the motor of the suite `noise`) or `catalogue` (imperfections of the suite `robust`);
//! `method`: `hybrid` or `least-squares`, that of a controller; `tolerances`: `none` or `usual`; `profile`: `mixed` or `any`; `faults`:
//! `random` (those of the suite) or `hard` (up to 1, several at once).

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::str::FromStr;

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::effort::{Allowance, Effort, Request, Stage};
use ema_identify::{Identifier, Method};
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{
    ActuatorParams, FAULT_COUNT, FaultVector, MotorDeviation, MotorKnowledge, Profile, SIGNAL_COUNT, Scale, Tolerances,
    rss_pct,
};
use hmd_core::seed::mix;
use hmd_lab::calibrate_type::random_faults;
use hmd_lab::evaluate::robust::{CatalogueUnit, entry_names};
use hmd_lab::simulated::SimulatedWindow;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};

type Failed = Box<dyn Error + Send + Sync>;

/// What was asked for.
struct Asked(BTreeMap<String, String>);

impl Asked {
    fn text<'a>(&'a self, key: &str, otherwise: &'a str) -> &'a str {
        self.0.get(key).map_or(otherwise, String::as_str)
    }

    fn number<T: FromStr<Err: Error + Send + Sync + 'static>>(&self, key: &str, otherwise: &str) -> Result<T, Failed> {
        Ok(self.text(key, otherwise).parse()?)
    }
}

fn main() -> Result<(), Failed> {
    let args = std::env::args().skip(1);
    let pairs = args.filter_map(|arg| {
        arg.split_once('=')
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
    });
    let asked = Asked(pairs.collect());
    // One thread, so that processor time is one identification's.
    let lines = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()?
        .install(|| -> Result<Vec<Value>, Failed> {
            let of_window = |number| -> Result<Value, Failed> {
                let line = line(&asked, number)?;
                println!("{line}");
                Ok(line)
            };
            (0..asked.number("n", "100")?).map(of_window).collect()
        })?;
    let share = |key: &str| {
        let mut found: Vec<f64> = lines.iter().filter_map(|line| line[key].as_f64()).collect();
        found.sort_by(f64::total_cmp);
        let at = |share: f64| found.get(((found.len() - 1) as f64 * share).round() as usize).copied();
        json!({"median": at(0.5), "p95": at(0.95), "p99": at(0.99), "max": at(1.0)})
    };
    let mean = |key: &str, place: usize| {
        let sum: f64 = lines.iter().filter_map(|line| line[key][place].as_f64()).sum();
        sum / lines.len().max(1) as f64
    };
    let phase = |key: &str| json!({"runs": mean(key, 0), "ms": mean(key, 1)});
    let profiles: BTreeSet<&str> = lines.iter().filter_map(profile_of).collect();
    let by_profile: BTreeMap<&str, Value> = profiles
        .into_iter()
        .map(|profile| {
            (
                profile,
                covers_pct(lines.iter().filter(|line| profile_of(line) == Some(profile))),
            )
        })
        .collect();
    let twice = lines.iter().filter(|line| line["searches"].as_u64() > Some(1)).count();
    println!(
        "{}",
        json!({
            "windows": lines.len(), "ms": share("ms"), "evaluations": share("evaluations"), "rss_pct": share("rss_pct"),
            "mean": {"search": phase("search"), "conclusion": phase("conclusion")}, "with_a_second_search": twice,
            "covers_pct": covers_pct(lines.iter()), "covers_pct_by_profile": by_profile,
        })
    );
    Ok(())
}

/// Name of a line's profile, without the seed of a service.
fn profile_of(line: &Value) -> Option<&str> {
    line["profile"].as_str()?.split('(').next()
}

/// Share of the elements with a sigma, in modelled windows, whose 95 % interval holds the truth; a direction counts where there is an eccentricity.
fn covers_pct<'a>(lines: impl Iterator<Item = &'a Value>) -> Value {
    let (mut all, mut covered) = (0, 0);
    for line in lines.filter(|line| line["unmodelled"] == false) {
        let has_direction = line["truth"][5].as_f64() > Some(ANY_ECCENTRICITY);
        for p in (0..FAULT_COUNT).filter(|&p| p != DIRECTION || has_direction) {
            let [found, truth, sigma] = ["k", "truth", "sigma"].map(|key| line[key][p].as_f64());
            if let (Some(found), Some(truth), Some(sigma)) = (found, truth, sigma) {
                let error = if p == DIRECTION {
                    (found - truth + 0.5).rem_euclid(1.0) - 0.5
                } else {
                    found - truth
                };
                all += 1;
                covered += u64::from(error.abs() <= 1.96 * sigma);
            }
        }
    }
    json!(if all > 0 {
        Some(100.0 * covered as f64 / all as f64)
    } else {
        None
    })
}

/// Element of the direction of the eccentricity.
const DIRECTION: usize = 6;

/// Least eccentricity that has a direction.
const ANY_ECCENTRICITY: f64 = 0.02;

/// One window.
fn line(asked: &Asked, number: u64) -> Result<Value, Failed> {
    let actuator = asked.text("actuator", "bench");
    let rate: f64 = asked.number("rate", "2000")?;
    // High bits: those of the number are the low ones.
    let seed = mix(asked.number::<u64>("seed", "1")? << 32, &[number]);
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[1]));
    let fault = match asked.text("faults", "random") {
        "random" => random_faults(mix(seed, &[2])),
        _ => hard_faults(&mut rng),
    };
    let profile = match asked.text("profile", "mixed") {
        "mixed" => Profile::Mixed,
        _ => any_profile(&mut rng),
    };
    let mut params = ActuatorParams::built_in(actuator).ok_or("no such actuator")?;
    params.sensors.sample_rate = rate;
    let mut scenario = Scenario {
        actuations: Actuations::single(profile),
        ..Scenario::new(params, fault, seed)
    };
    let mut motor = MotorKnowledge::default();
    let unit = asked.text("unit", "exact");
    let mut entry = "";
    if unit != "exact" {
        let load = 0.05 * Scale::new(&params).load_unit();
        scenario.load_torque = rng.random_range(-load..load);
        scenario.sensing = CurrentSensing {
            quantised: true,
            noise_rms: 0.05,
        };
        motor = MotorKnowledge {
            mean: MotorDeviation::default(),
            covariance: [[0.05 * 0.05, 0.0], [0.0, 0.03 * 0.03]],
        };
        if unit == "catalogue" {
            let names: Vec<&str> = entry_names().collect();
            entry = names[rng.random_range(0..names.len())];
            scenario.effects = CatalogueUnit::new(entry, actuator, rate, seed)?.effects;
        } else {
            scenario.unit.motor.r_s *= 1.0 + rng.random_range(-0.05..0.05);
            scenario.unit.motor.k *= 1.0 + rng.random_range(-0.03..0.03);
        }
    }
    let mut window = SimulatedWindow::first_of(&scenario);
    if unit != "exact" {
        window.conditions.load_torque = None;
    }
    let identifier = Identifier {
        params,
        calibration: TypeCalibration::built_in(actuator, MonitorForm::ThreePhase).ok_or("no calibration")?,
        method: match asked.text("method", "hybrid") {
            "hybrid" => Method::hybrid(),
            _ => Method::LeastSquares,
        },
        motor,
        tolerances: match asked.text("tolerances", "none") {
            "none" => Tolerances::NONE,
            _ => Tolerances::USUAL,
        },
    };
    let before = processor_ms();
    let mut phases = Phases {
        last_ms: before,
        ..Phases::default()
    };
    let found = identifier.identify_within(&window.prepared, window.conditions, seed, &Effort::within(&mut phases))?;
    let found = found.ok_or("an estimate")?;
    let ms = processor_ms() - before;
    let weights = identifier.calibration.weights(rate).to_array();
    let (mut earlier, mut sum, mut count) = ([0.0; SIGNAL_COUNT], 0.0, 0);
    for (_, residuals) in identifier.residuals(&window.prepared, window.conditions, &found) {
        let now = residuals.to_array();
        for signal in 0..SIGNAL_COUNT {
            sum += 0.5 * weights[signal] * weights[signal] * earlier[signal] * now[signal];
        }
        (earlier, count) = (now, count + 1);
    }
    let systematic = sum / f64::from(count.max(1));
    Ok(json!({
        "number": number, "entry": entry, "profile": format!("{profile:?}"), "truth": fault.to_array(), "k": found.fault.to_array(),
        "sigma": found.sigma, "load": found.unknowns.load_torque, "cost": found.cost, "systematic": systematic, "unmodelled": found.is_unmodelled(),
        "rss_pct": rss_pct(&found.fault, &fault), "evaluations": found.evaluations, "ambiguous": found.competing_optimum.is_some(),
        "locked": found.locked, "ms": ms, "search": phases.search, "conclusion": phases.conclusion, "searches": phases.searches,
    }))
}

/// Monitor runs and processor time of each phase.
#[derive(Default)]
struct Phases {
    last_ms: f64,
    /// Runs and ms.
    search: [f64; 2],
    conclusion: [f64; 2],
    /// Searches with their conclusions: a second one has the population.
    searches: u64,
}

impl Allowance for Phases {
    fn grant(&mut self, request: &Request) -> u64 {
        request.runs
    }

    fn ran(&mut self, stage: Stage, _: f64, runs: u64) {
        let now = processor_ms();
        let phase = match stage {
            Stage::Search => &mut self.search,
            Stage::Conclusion | Stage::Relations => &mut self.conclusion,
        };
        self.searches += u64::from(stage == Stage::Conclusion);
        phase[0] += runs as f64;
        phase[1] += now - self.last_ms;
        self.last_ms = now;
    }
}

/// Several faults at once, each of any size.
fn hard_faults(rng: &mut ChaCha8Rng) -> FaultVector {
    let mut k = [0.0; FAULT_COUNT];
    for value in k.iter_mut().take(6) {
        let present = rng.random_bool(0.6);
        let size = rng.random_range(0.0..1.0);
        *value = if present { size } else { 0.0 };
    }
    k[6] = rng.random_range(0.0..1.0);
    k[7] = rng.random_range(0.1..0.9);
    FaultVector::from_array(k)
}

fn any_profile(rng: &mut ChaCha8Rng) -> Profile {
    match rng.random_range(0..8) {
        0 => Profile::Step,
        1 => Profile::Ramp,
        2 => Profile::Chirp,
        3 => Profile::Speed,
        4 => Profile::SpeedRamp,
        5 => Profile::SpeedChirp,
        6 => Profile::Service(rng.random_range(0..1 << 32)),
        _ => Profile::Mixed,
    }
}

/// Processor time of this thread so far, ms.
fn processor_ms() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 * 1e3 + now.tv_nsec as f64 / 1e6
}
