//! What the relations between measured signals say of the units of the suite `robust`, without pipeline and daemon.
//!
//! `cargo run --release -p hmd-lab --example relations_robust -- [KEY=VALUE]…`; lists are separated by commas. Keys: `rate` (Hz),
//! `drive` (`own`: that of the unit; `vector`: every unit has a vector drive), `learn` and `judge` (motions of the commissioning
//! windows, in turn, and of the judged ones: mixed, step, ramp, chirp, speed), `n` (healthy windows of each unit, twice as many are
//! faulty), `seed` (of the units), `entry`, `actuator`, `keep` (folder that keeps the simulated windows), `show=1` (each window that is judged wrongly).
//! An alarm is a damage above 0.05 and above three sigmas, which are wider for motions that commissioning has not seen, as in
//! the daemon; a window that the torque balance does not explain gives none.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ema_identify::relations::{BalanceShape, MeasuredWindow, RELATION_COUNT, Relation, RelationsEstimate, commission};
use ema_identify::unit_calibration::{Motion, Seen, Unseen};
use ema_models::reference::{Drive, Scenario};
use ema_models::{FaultId, FaultVector, Profile, SensedSample, Setpoint};
use hmd_lab::evaluate::robust::{CatalogueUnit, entry_names};
use rayon::prelude::*;

/// Healthy windows to commission.
const COMMISSIONING: u64 = 12;

fn main() -> Result<(), Box<dyn Error>> {
    let given: BTreeMap<String, String> = std::env::args()
        .skip(1)
        .filter_map(|arg| {
            arg.split_once('=')
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
        })
        .collect();
    let list = |key: &str, otherwise: &str| -> Vec<String> {
        let text = given.get(key).map_or(otherwise, String::as_str);
        text.split(',')
            .filter(|item| !item.is_empty())
            .map(str::to_owned)
            .collect()
    };
    let run = Run {
        rate: list("rate", "2000")[0].parse()?,
        vector: list("drive", "own")[0] == "vector",
        n: list("n", "12")[0].parse()?,
        seed: list("seed", "1")[0].parse()?,
        keep: given.get("keep").map(PathBuf::from),
        learn: list("learn", "mixed"),
        judge: list("judge", "mixed"),
        show: given.contains_key("show"),
    };
    let entries = list("entry", "");
    let actuators = list("actuator", "bench,servo28,servo270");
    let units: Vec<(&str, &String)> = entry_names()
        .filter(|name| entries.is_empty() || entries.iter().any(|entry| entry == name))
        .flat_map(|name| actuators.iter().map(move |actuator| (name, actuator)))
        .collect();
    let results: Vec<UnitResult> = units
        .par_iter()
        .map(|(entry, actuator)| run.unit(entry, actuator))
        .collect::<Result<_, String>>()?;

    println!("{:>52} {}", "", Tally::HEAD);
    for result in &results {
        for (motion, tally) in run.judge.iter().zip(&result.judged) {
            println!("{:>44} {motion:>7} {}", result.name, tally.line());
        }
        for line in &result.shown {
            println!("    {line}");
        }
    }
    let is_vector = |result: &&UnitResult| result.is_vector;
    let is_hysteresis = |result: &&UnitResult| !result.is_vector;
    for (place, motion) in run.judge.iter().enumerate() {
        let sum = |meant: &dyn Fn(&&UnitResult) -> bool| {
            Tally::sum(
                results
                    .iter()
                    .filter(|result| meant(result))
                    .map(|result| &result.judged[place]),
            )
        };
        println!("\n{:>52} {}", format!("all, {motion}"), sum(&|_| true).line());
        println!("{:>52} {}", "vector drives", sum(&is_vector).line());
        println!("{:>52} {}", "hysteresis drives", sum(&is_hysteresis).line());
        for actuator in &actuators {
            let suffix = format!("/{actuator}");
            println!(
                "{actuator:>52} {}",
                sum(&|result| result.name.ends_with(&suffix)).line()
            );
        }
        for (fault, line) in FaultId::ALL.iter().zip(sum(&|_| true).faults()) {
            println!("{:>52} {line}", fault.name());
        }
    }
    Ok(())
}

struct Run {
    rate: f64,
    vector: bool,
    n: u64,
    seed: u64,
    keep: Option<PathBuf>,
    learn: Vec<String>,
    judge: Vec<String>,
    show: bool,
}

struct UnitResult {
    name: String,
    is_vector: bool,
    judged: Vec<Tally>,
    shown: Vec<String>,
}

impl Run {
    fn unit(&self, entry: &str, actuator: &str) -> Result<UnitResult, String> {
        let mut unit = CatalogueUnit::new(entry, actuator, self.rate, self.seed).map_err(|error| error.to_string())?;
        if self.vector && matches!(unit.effects.drive, Drive::Hysteresis) {
            unit.effects
                .set("pwm_frequency_hz", 16e3)
                .map_err(|error| error.to_string())?;
        }
        let params = unit.nominal;
        let assessed = 3 * self.n;
        let learnt_from: Vec<Vec<SensedSample>> = (0..COMMISSIONING)
            .map(|number| {
                let motion = &self.learn[number as usize % self.learn.len()];
                self.window(&unit, &format!("{actuator}-{entry}"), motion, assessed + number)
            })
            .collect();
        let windows: Vec<_> = learnt_from
            .iter()
            .map(|samples| MeasuredWindow::new(&params, samples, &[]))
            .collect();
        let mut result = UnitResult {
            name: format!("{entry}/{actuator}"),
            is_vector: !matches!(unit.effects.drive, Drive::Hysteresis),
            judged: vec![Tally::default(); self.judge.len()],
            shown: Vec::new(),
        };
        let learnt = match commission(&windows, &BalanceShape::usual(&params)) {
            Ok(learnt) => learnt,
            Err(error) => {
                result.shown.push(format!("not commissioned: {error}"));
                return Ok(result);
            }
        };
        if self.show {
            result.shown.push(format!("{:.6?}", unit.effects));
            result.shown.push(format!("{:.6?}", learnt.balance.values));
            result.shown.push(format!(
                "kernel {} s, {:?}, controller {} s, {:.4?}",
                learnt.balance.half_width_s, learnt.balance.shape.compliance, learnt.gain_half_width_s, learnt.baseline
            ));
            let start = Instant::now();
            for window in &windows {
                std::hint::black_box(learnt.estimate(std::hint::black_box(window)));
            }
            let each = start.elapsed().as_secs_f64() * 1e3 / windows.len() as f64;
            result.shown.push(format!("one estimate {each:.2} ms"));
        }
        let seen = Seen::of(
            &learnt_from
                .iter()
                .map(|samples| Motion::of(&params, samples))
                .collect::<Vec<_>>(),
        );
        for (motion, tally) in self.judge.iter().zip(&mut result.judged) {
            for number in 0..assessed {
                let (place, scenario) = unit.window(number, self.n);
                let samples = self.window(&unit, &format!("{actuator}-{entry}"), motion, number);
                let mut estimate = learnt.estimate(&MeasuredWindow::new(&params, &samples, &[]));
                let unseen = seen.unseen(&Motion::of(&params, &samples), &params);
                let factor: f64 = unseen.iter().map(Unseen::factor).product();
                for (sigma, spread) in estimate.sigma.iter_mut().zip(estimate.bridge_spread) {
                    *sigma =
                        sigma.map(|sigma| spread.hypot(factor * (sigma * sigma - spread * spread).max(0.0).sqrt()));
                }
                let right = tally.add(place, &scenario.fault, &estimate);
                if self.show && !right {
                    result.shown.push(line(motion, &scenario.fault, &estimate));
                }
            }
        }
        Ok(result)
    }

    /// A window of a unit, from the folder where it is kept.
    fn window(&self, unit: &CatalogueUnit, name: &str, motion: &str, number: u64) -> Vec<SensedSample> {
        let (_, mut scenario) = unit.window(number, self.n);
        scenario.effects = unit.effects;
        scenario.actuations.profile = match motion {
            "step" => Profile::Step,
            "ramp" => Profile::Ramp,
            "chirp" => Profile::Chirp,
            "speed" => Profile::Speed,
            _ => Profile::Mixed,
        };
        let drive = if self.vector { "vector" } else { "own" };
        let seed = if self.seed == 1 {
            String::new()
        } else {
            format!("{}-", self.seed)
        };
        let path = self.keep.as_ref().map(|folder| {
            folder.join(format!(
                "{seed}{}-{drive}-{motion}-{}-{name}-{number}",
                self.rate, self.n
            ))
        });
        if let Some(path) = path.as_deref() {
            fs::write(
                format!("{}.truth", path.display()),
                format!("{:?}", scenario.fault.to_array()),
            )
            .expect("a folder that can be written");
        }
        if let Some(samples) = path.as_deref().and_then(read) {
            return samples;
        }
        let samples = cut(&scenario);
        if let Some(path) = path {
            write(&path, &samples);
        }
        samples
    }
}

/// Samples from 20 ms before the trigger to 480 ms after it, with currents in whole mA as on the bus.
fn cut(scenario: &Scenario) -> Vec<SensedSample> {
    let samples: Vec<SensedSample> = scenario.run().collect();
    let commanded = |sample: &SensedSample| match sample.setpoint {
        Setpoint::Position(angle) => angle,
        Setpoint::Speed(speed) => speed,
        Setpoint::Idle => 0.0,
    };
    let rest = commanded(&samples[0]);
    let trigger = samples
        .iter()
        .position(|sample| (commanded(sample) - rest).abs() > 1e-3)
        .unwrap_or(0);
    let rate = scenario.nominal.sensors.sample_rate;
    let start = trigger.saturating_sub((0.02 * rate) as usize);
    let end = (start + (0.5 * rate) as usize).min(samples.len());
    let on_the_bus = |sample: &SensedSample| SensedSample {
        currents: sample.currents.map(|i| (i * 1e3).round() * 1e-3),
        ..*sample
    };
    samples[start..end].iter().map(on_the_bus).collect()
}

fn write(path: &Path, samples: &[SensedSample]) {
    let mut bytes = Vec::with_capacity(samples.len() * 19);
    for sample in samples {
        for i in sample.currents {
            bytes.extend(((i * 1e3).round() as i16).to_le_bytes());
        }
        bytes.extend((sample.motor_counts as i32).to_le_bytes());
        bytes.extend((sample.output_counts as i32).to_le_bytes());
        let (kind, value) = match sample.setpoint {
            Setpoint::Position(angle) => (0, angle * 1e6),
            Setpoint::Speed(speed) => (1, speed * 1e3),
            Setpoint::Idle => (2, 0.0),
        };
        bytes.push(kind);
        bytes.extend((value.round() as i32).to_le_bytes());
    }
    let _ = path.parent().map(fs::create_dir_all);
    fs::write(path, bytes).expect("the folder of the windows can be written");
}

fn read(path: &Path) -> Option<Vec<SensedSample>> {
    let bytes = fs::read(path).ok()?;
    let word = |bytes: &[u8]| f64::from(i32::from_le_bytes(bytes.try_into().unwrap_or_default()));
    let sample = |(seq, bytes): (usize, &[u8])| SensedSample {
        seq: seq as u64,
        currents: [0, 2, 4].map(|at| f64::from(i16::from_le_bytes([bytes[at], bytes[at + 1]])) * 1e-3),
        motor_counts: word(&bytes[6..10]) as i64,
        output_counts: word(&bytes[10..14]) as i64,
        setpoint: match bytes[14] {
            0 => Setpoint::Position(word(&bytes[15..19]) * 1e-6),
            1 => Setpoint::Speed(word(&bytes[15..19]) * 1e-3),
            _ => Setpoint::Idle,
        },
    };
    Some(bytes.chunks_exact(19).enumerate().map(sample).collect())
}

/// Largest sigma of a damage that a window shows.
const OBSERVABLE_SIGMA: f64 = 0.1;

/// Damage per unit of a fault's parameter.
fn per_parameter(fault: FaultId) -> f64 {
    if fault == FaultId::Gain { 2.0 } else { 1.0 }
}

const KINDS: usize = FaultId::ALL.len();

/// Counts over windows; those of several units add up.
#[derive(Clone, Debug, Default)]
struct Tally {
    healthy: usize,
    false_alarms: usize,
    /// For each fault: false alarms, faulty windows, windows that show the damaged element, those named exactly, those with another
    /// fault as well, healthy windows that show the element.
    kinds: [[usize; 6]; KINDS],
    /// |Δ| of each damaged element that is shown.
    errors: [Vec<f64>; KINDS],
    /// Error over sigma of the damaged element.
    damaged_z: [Vec<f64>; KINDS],
    /// Error over sigma of the same element in healthy windows.
    healthy_z: [Vec<f64>; KINDS],
    /// Healthy and faulty windows that a relation does not explain.
    unexplained: [[usize; 2]; RELATION_COUNT],
}

impl Tally {
    const HEAD: &str = "  false   shown named/shown named  median    95 %  cover  cover healthy, healthy and faulty not explained by each relation";

    /// Whether the window is judged rightly.
    fn add(&mut self, place: Option<usize>, truth: &FaultVector, estimate: &RelationsEstimate) -> bool {
        for (counts, share) in self.unexplained.iter_mut().zip(estimate.residual_share) {
            counts[usize::from(place.is_some())] += usize::from(share >= 1.0);
        }
        let mut alarms = [false; KINDS];
        for (fault, alarm) in FaultId::ALL.iter().zip(&mut alarms) {
            let parameter = fault.parameter();
            let damage = FaultVector::from_array(estimate.k).damage_of(*fault);
            *alarm = estimate.is_explained_by(Relation::TorqueBalance)
                && estimate.sigma[parameter]
                    .is_some_and(|sigma| damage > (3.0 * per_parameter(*fault) * sigma).max(0.05));
        }
        let Some(place) = place else {
            self.healthy += 1;
            self.false_alarms += usize::from(alarms.contains(&true));
            for (kind, fault) in FaultId::ALL.iter().enumerate() {
                self.kinds[kind][0] += usize::from(alarms[kind]);
                let parameter = fault.parameter();
                if let Some(sigma) = estimate.sigma[parameter] {
                    self.kinds[kind][5] += 1;
                    self.healthy_z[kind].push((estimate.k[parameter] - truth.to_array()[parameter]).abs() / sigma);
                }
            }
            return !alarms.contains(&true);
        };
        let kind = FaultId::ALL
            .iter()
            .position(|fault| fault.parameter() == place)
            .unwrap_or(0);
        let counts = &mut self.kinds[kind];
        counts[1] += 1;
        let others = alarms.iter().enumerate().any(|(other, alarm)| *alarm && other != kind);
        counts[4] += usize::from(others);
        let Some(sigma) =
            estimate.sigma[place].filter(|sigma| per_parameter(FaultId::ALL[kind]) * sigma <= OBSERVABLE_SIGMA)
        else {
            return false;
        };
        let named = alarms[kind] && !others;
        counts[2] += 1;
        counts[3] += usize::from(named);
        let error = (estimate.k[place] - truth.to_array()[place]).abs();
        self.errors[kind].push(error);
        self.damaged_z[kind].push(error / sigma);
        named
    }

    fn sum<'a>(tallies: impl Iterator<Item = &'a Self>) -> Self {
        let mut sum = Self::default();
        for tally in tallies {
            sum.healthy += tally.healthy;
            sum.false_alarms += tally.false_alarms;
            for (sum, counts) in sum.unexplained.iter_mut().zip(&tally.unexplained) {
                *sum = [sum[0] + counts[0], sum[1] + counts[1]];
            }
            for kind in 0..KINDS {
                for m in 0..6 {
                    sum.kinds[kind][m] += tally.kinds[kind][m];
                }
                sum.errors[kind].extend(&tally.errors[kind]);
                sum.damaged_z[kind].extend(&tally.damaged_z[kind]);
                sum.healthy_z[kind].extend(&tally.healthy_z[kind]);
            }
        }
        sum
    }

    fn line(&self) -> String {
        let total = |m: usize| self.kinds.iter().map(|counts| counts[m]).sum::<usize>();
        let row = row(
            self.false_alarms,
            self.healthy,
            [total(1), total(2), total(3)],
            self.errors.concat(),
            &self.damaged_z.concat(),
            &self.healthy_z.concat(),
        );
        format!("{row} {:?}", self.unexplained)
    }

    fn faults(&self) -> Vec<String> {
        (0..KINDS)
            .map(|kind| {
                let counts = &self.kinds[kind];
                row(
                    counts[0],
                    counts[5],
                    [counts[1], counts[2], counts[3]],
                    self.errors[kind].clone(),
                    &self.damaged_z[kind],
                    &self.healthy_z[kind],
                )
            })
            .collect()
    }
}

fn row(
    false_alarms: usize,
    healthy: usize,
    [faulty, shown, named]: [usize; 3],
    mut errors: Vec<f64>,
    damaged_z: &[f64],
    healthy_z: &[f64],
) -> String {
    let share = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    let covered = |z: &[f64]| share(z.iter().filter(|z| **z <= 1.96).count(), z.len());
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| {
        errors
            .get((errors.len() as f64 * share) as usize)
            .copied()
            .unwrap_or(f64::NAN)
    };
    format!(
        "{:6.2} % {:6.1} {:6.1} {:6.1}   {:7.4} {:7.4} {:6.1} {:6.1}",
        share(false_alarms, healthy),
        share(shown, faulty),
        share(named, shown),
        share(named, faulty),
        at(0.5),
        at(0.95),
        covered(damaged_z),
        covered(healthy_z),
    )
}

fn line(motion: &str, truth: &FaultVector, estimate: &RelationsEstimate) -> String {
    let mut text = format!("{motion:>6}");
    let truth = truth.to_array();
    for place in [0, 1, 2, 3, 4, 5, 7] {
        let sigma = estimate.sigma[place].map_or("    -".to_owned(), |sigma| format!("{sigma:5.3}"));
        text += &format!(" | {:5.2} {:6.3} ±{sigma}", truth[place], estimate.k[place]);
    }
    format!(
        "{text} | {:.4} Nm, {} rows, load {:.2} Nm, {:.1} Nm/rad",
        estimate.torque_residual_rms, estimate.torque_rows, estimate.load_torque, estimate.spring_stiffness
    )
}
