//! The `sensors` suite: wrong sensors, wires and configured numbers on healthy and on worn actuators.
//!
//! In: size, seed and a choice of entries and actuator types ([`SensorsOptions`]). Out: rates over all mistakes and for each
//! ([`SensorsReport`]). As in service, a unit makes several motions with its mistake: one of each profile, each under a load of its own.
//! It equals its type and has one mistake (`mistakes`) of one size. Each motion is a window, assessed by itself with the type's calibration
//! and again with that of the unit, which was commissioned before the mistake was made. Rates are of windows and of units. Sample rates and
//! drives take turns.

mod mistakes;
mod report;
mod score;
mod table;
mod unit;

use std::collections::HashMap;
use std::io;
use std::sync::Arc;

use ema_identify::unit_calibration::UnitCalibration;
use ema_models::{ActuatorParams, FaultId, FaultVector};
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Models};
use hmd_core::commissioning::{CommissioningError, calibrate_unit};
use hmd_core::config::{Config, ConfigError};
use hmd_core::frame::BusError;
use hmd_core::outbox::WindowJob;
use hmd_core::seed::{mix, name_hash};
use hmd_core::sensor_checks::Suspect;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::robust::single_fault;
use mistakes::{CONTROL, MISTAKES, Mistake, Truth};
use score::{Outcome, Tally};
use unit::{COMBINATIONS, Circumstances, NOISE_RMS_A, Recorded, SERIES, UNIT_FILE, Unit, commissioning_profile, units};

pub use report::{Case, Group, OfMistake, SensorsReport};
pub use score::Rates;
pub use table::sensors_table;

/// Name of the suite.
const SUITE: &str = "sensors";

/// Healthy units of each mistake and type without `--n`, and as many worn ones: every combination of rate and drive.
pub const SENSORS_UNITS: u64 = COMBINATIONS;

/// Windows that commission a unit.
const COMMISSIONING_WINDOWS: u64 = 12;

/// What is run.
#[derive(Clone, Debug)]
pub struct SensorsOptions {
    /// Healthy units of each mistake and type; as many are worn.
    pub n: u64,
    /// Seed of sizes and windows.
    pub seed: u64,
    /// Built-in actuator types.
    pub actuators: Vec<String>,
    /// Names of the entries; all where none is named.
    pub entries: Vec<String>,
}

/// Why the suite could not run.
#[derive(Debug, thiserror::Error)]
pub enum SensorsError {
    /// No entry of this name.
    #[error("--entry: expected one of {}, found {found:?}", sensors_entry_names().collect::<Vec<_>>().join(", "))]
    Entry {
        /// The name.
        found: String,
    },
    /// No built-in type of this name.
    #[error("--actuator: expected one of {}, found {found:?}", ActuatorParams::BUILT_IN.join(", "))]
    Actuator {
        /// The name.
        found: String,
    },
    /// A configuration is refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// An interface that is refused.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A window cannot be assessed.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// A unit cannot be commissioned, whatever its windows.
    #[error(transparent)]
    Commissioning(CommissioningError),
}

/// Names of all entries.
pub fn sensors_entry_names() -> impl Iterator<Item = &'static str> {
    MISTAKES.iter().map(|mistake| mistake.name)
}

/// Calibrations of the units of a type by rate and drive; `None` where commissioning was refused.
type Calibrations = HashMap<(u32, &'static str), Option<UnitCalibration>>;

/// One window to run.
struct Planned<'a> {
    mistake: &'static Mistake,
    actuator: &'a str,
    /// Place of the damaged element, and the fault vector.
    fault: Option<(usize, FaultVector)>,
    circumstances: Circumstances,
    /// Seed of the unit: of the size of its mistake, its wear and what a stuck sensor reads.
    unit: u64,
    /// Seed of the window.
    seed: u64,
}

/// A window before and after commissioning.
struct Run<'a> {
    planned: Planned<'a>,
    notices: Vec<String>,
    assessed: [Assessed; 2],
}

/// A window with its mistake, and what the same motion gives without it.
#[derive(Default)]
struct Assessed {
    window: Option<AssessedWindow>,
    /// Whether the motion shows the mistake.
    is_shown: bool,
    /// Whether the worn part is reported without it.
    is_findable: bool,
}

impl SensorsOptions {
    /// Windows that are run, those of commissioning included.
    ///
    /// # Errors
    /// An unknown entry or type.
    pub fn windows(&self) -> Result<u64, SensorsError> {
        let of_units = units().count() as u64 * COMMISSIONING_WINDOWS * self.actuators.len() as u64;
        Ok(self.plan()?.len() as u64 + of_units)
    }

    /// Every window in the order of the catalogue. The combinations of the mistakes are offset, so that few windows see all.
    fn plan(&self) -> Result<Vec<Planned<'_>>, SensorsError> {
        let known = |name: &&String| sensors_entry_names().any(|entry| entry == name.as_str());
        if let Some(unknown) = self.entries.iter().find(|name| !known(name)) {
            return Err(SensorsError::Entry { found: unknown.clone() });
        }
        if let Some(unknown) = self
            .actuators
            .iter()
            .find(|name| ActuatorParams::built_in(name).is_none())
        {
            return Err(SensorsError::Actuator { found: unknown.clone() });
        }
        let mut plan = Vec::new();
        for (number, mistake) in (0..).zip(&MISTAKES) {
            if !self.entries.is_empty() && !self.entries.iter().any(|entry| entry == mistake.name) {
                continue;
            }
            for (place, actuator) in (0..).zip(&self.actuators) {
                for n in 0..2 * self.n {
                    let (is_worn, n) = (n >= self.n, n % self.n);
                    let hashes = [name_hash(mistake.name), name_hash(actuator), u64::from(is_worn), n];
                    let unit = mix(self.seed, &hashes);
                    let combination = number + place + n + u64::from(is_worn) * COMBINATIONS / 2;
                    plan.extend((0..SERIES).map(|window| Planned {
                        mistake,
                        actuator,
                        // With each four mistakes one part further, so that each part meets each combination.
                        fault: is_worn.then(|| single_fault(number + number / COMBINATIONS + place + n, unit)),
                        circumstances: Circumstances::of(combination, window),
                        unit,
                        seed: mix(unit, &[window]),
                    }));
                }
            }
        }
        Ok(plan)
    }
}

/// The `sensors` suite; `done` gets the number of windows that are finished.
///
/// # Errors
/// [`SensorsError`].
pub fn sensors(options: &SensorsOptions, done: &(dyn Fn(u64) + Sync)) -> Result<SensorsReport, SensorsError> {
    let plan = options.plan()?;
    let mut calibrations: HashMap<&str, Calibrations> = HashMap::new();
    for actuator in &options.actuators {
        calibrations.insert(actuator, commission_all(actuator, options.seed, done)?);
    }
    let refused = calibrations.values().flat_map(HashMap::values);
    let refused = refused.filter(|calibration| calibration.is_none()).count() as u64;
    let runs: Vec<Run<'_>> = plan
        .into_par_iter()
        .map(|planned| {
            let unit = (planned.circumstances.rate_hz, planned.circumstances.drive);
            let calibration = calibrations
                .get(planned.actuator)
                .and_then(|of_type| of_type.get(&unit));
            let run = run(planned, calibration.and_then(Option::as_ref))?;
            done(1);
            Ok(run)
        })
        .collect::<Result<_, SensorsError>>()?;
    let controls = runs.partition_point(|run| run.planned.mistake.name == CONTROL);
    Ok(SensorsReport {
        suite: SUITE,
        n: options.n,
        seed: options.seed,
        refused,
        mistakes: group(&runs[controls..]),
        by_mistake: runs
            .chunk_by(|one, other| one.planned.mistake.name == other.planned.mistake.name)
            .map(|of_mistake| OfMistake {
                mistake: of_mistake[0].planned.mistake.name.to_owned(),
                group: group(of_mistake),
            })
            .collect(),
        cases: runs.iter().flat_map(Run::cases).collect(),
    })
}

fn group(runs: &[Run<'_>]) -> Group {
    let mut tallies = [Tally::default(); 2];
    for of_unit in runs.chunk_by(|one, other| one.planned.unit == other.planned.unit) {
        let mut of_units = [Tally::default(); 2];
        for run in of_unit {
            let noticed = run.noticed();
            for (tally, assessed) in of_units.iter_mut().zip(&run.assessed) {
                let outcome = Outcome {
                    worn: run.worn().zip(run.planned.fault.map(|(_, fault)| fault)),
                    assessed: assessed.window.as_ref(),
                    noticed: &noticed,
                    is_shown: assessed.is_shown,
                    is_findable: assessed.is_findable,
                };
                tally.add(run.planned.mistake, &outcome);
            }
        }
        for (tally, of_unit) in tallies.iter_mut().zip(of_units) {
            tally.add_unit(&of_unit);
        }
    }
    Group {
        all: Tally::sum(tallies.iter()).rates(),
        before: tallies[0].rates(),
        after: tallies[1].rates(),
    }
}

impl Planned<'_> {
    fn worn(&self) -> Option<FaultId> {
        let (place, _) = self.fault?;
        FaultId::ALL.into_iter().find(|fault| fault.parameter() == place)
    }
}

impl Run<'_> {
    fn worn(&self) -> Option<FaultId> {
        self.planned.worn()
    }

    /// Suspects with whose names a notice begins, behind the actuator's.
    fn noticed(&self) -> Vec<Suspect> {
        let names = |notice: &String, suspect: Suspect| notice.contains(&format!(": {}", suspect.name()));
        let of = |notice: &String| Suspect::ALL.into_iter().find(|&suspect| names(notice, suspect));
        self.notices.iter().filter_map(of).collect()
    }

    fn cases(&self) -> Vec<Case> {
        let of = |(commissioned, Assessed { window, is_shown, .. }): (bool, &Assessed)| {
            let Circumstances {
                profile,
                rate_hz,
                drive,
            } = self.planned.circumstances;
            let suspects = window.iter().flat_map(|window| window.suspects.iter().copied());
            Case {
                mistake: self.planned.mistake.name,
                actuator: self.planned.actuator.to_owned(),
                unit: format!("{:016x}", self.planned.unit),
                circumstances: format!("{profile:?} {rate_hz} {drive}").to_lowercase(),
                commissioned,
                worn: self.worn().map(FaultId::name),
                is_shown: *is_shown,
                status: window.as_ref().map(|window| window.health.status.clone()),
                faults: window
                    .as_ref()
                    .map(|window| window.health.fault_list.clone())
                    .unwrap_or_default(),
                suspects: suspects.chain(self.noticed()).map(Suspect::name).collect(),
                reason: match window {
                    Some(window) => window.health.reason.clone(),
                    None => self.notices.join("; "),
                },
            }
        };
        [false, true].into_iter().zip(&self.assessed).map(of).collect()
    }
}

/// Records one window and assesses it with the type's calibration, then with the unit's, where there is one.
fn run<'a>(planned: Planned<'a>, calibration: Option<&UnitCalibration>) -> Result<Run<'a>, SensorsError> {
    let Circumstances {
        profile,
        rate_hz,
        drive,
    } = planned.circumstances;
    let unit = unit_of(planned.actuator, rate_hz, drive)?;
    let mistake = planned
        .mistake
        .draw(&mut ChaCha8Rng::seed_from_u64(mix(planned.unit, &[5])));
    let config = Arc::new(unit.config(&mistake)?);
    let fault = planned.fault.map_or(FaultVector::NOMINAL, |(_, fault)| fault);
    let Recorded { job, samples, notices } =
        unit.recorded(&config, profile, fault, &mistake, [planned.unit, planned.seed])?;
    let no_mistake = MISTAKES[0].draw(&mut ChaCha8Rng::seed_from_u64(planned.seed));
    let without = Arc::new(unit.config(&no_mistake)?);
    let right = unit.recorded(&without, profile, fault, &no_mistake, [planned.unit, planned.seed])?;
    let load_nm = unit.load(planned.seed);
    let load_read_nm = job.as_ref().and_then(|job| job.conditions.load_torque_nm);
    let truth = Truth {
        nominal: &unit.nominal,
        drive: config.actuators()[0].drive.kind,
        fault: &fault,
        load_nm,
        load_read_nm: load_read_nm.unwrap_or(load_nm),
        noise_rms_a: NOISE_RMS_A,
        right: &right.samples,
        wrong: &samples,
        is_commissioned: false,
    };
    let mut assessed = [Assessed::default(), Assessed::default()];
    for (found, calibration) in assessed.iter_mut().zip([None, Some(calibration)]) {
        let assess = |config: &Arc<Config>, job: &WindowJob| {
            let models = match calibration {
                None => Models::load_types(config, &no_file)?,
                Some(None) => return Ok(None),
                Some(Some(calibration)) => Models::load(config, &|_| Ok(calibration.emit()))?,
            };
            Assessor::new(config.clone(), models, planned.seed)
                .assess(job.clone())
                .map(Some)
        };
        let of_right = right
            .job
            .as_ref()
            .map(|job| assess(&without, job))
            .transpose()?
            .flatten();
        *found = Assessed {
            window: job.as_ref().map(|job| assess(&config, job)).transpose()?.flatten(),
            is_shown: mistake.is_shown(&Truth {
                is_commissioned: calibration.flatten().is_some(),
                ..truth
            }),
            is_findable: of_right
                .zip(planned.worn())
                .is_some_and(|(window, worn)| window.health.fault_list.iter().any(|name| name == worn.name())),
        };
    }
    Ok(Run {
        assessed,
        planned,
        notices,
    })
}

/// Commissions a unit of each rate and drive on healthy windows without a mistake.
fn commission_all(actuator: &str, seed: u64, done: &(dyn Fn(u64) + Sync)) -> Result<Calibrations, SensorsError> {
    let units: Vec<(u32, &'static str)> = units().collect();
    units
        .into_par_iter()
        .map(|(rate_hz, drive)| {
            let unit = unit_of(actuator, rate_hz, drive)?;
            let seed = mix(seed, &[name_hash(actuator), u64::from(rate_hz), name_hash(drive)]);
            let calibration = commission(&unit, seed)?;
            done(COMMISSIONING_WINDOWS);
            Ok(((rate_hz, drive), calibration))
        })
        .collect()
}

fn commission(unit: &Unit, seed: u64) -> Result<Option<UnitCalibration>, SensorsError> {
    let right = MISTAKES[0].draw(&mut ChaCha8Rng::seed_from_u64(seed));
    let config = Arc::new(unit.config(&right)?);
    let mut jobs = Vec::new();
    for n in 0..COMMISSIONING_WINDOWS {
        let profile = commissioning_profile(n);
        let recorded = unit.recorded(&config, profile, FaultVector::NOMINAL, &right, [seed, mix(seed, &[n])])?;
        jobs.extend(recorded.job.filter(|job| job.window.quality.is_fit()));
    }
    let assessor = Assessor::new(config.clone(), Models::load_types(&config, &no_file)?, seed);
    match calibrate_unit(&assessor, config.health().levels(), &mut jobs, seed, &|_| ()) {
        Ok(found) => {
            let text = found.calibration.emit();
            Ok(UnitCalibration::parse(&text, UNIT_FILE, &unit.actuator).ok())
        }
        Err(refused) if refused.is_by_windows() => Ok(None),
        Err(error) => Err(SensorsError::Commissioning(error)),
    }
}

fn unit_of(actuator: &str, rate_hz: u32, drive: &'static str) -> Result<Unit, SensorsError> {
    Unit::new(actuator, rate_hz, drive).ok_or_else(|| SensorsError::Actuator {
        found: actuator.to_owned(),
    })
}

/// The built-in types read no file.
fn no_file(_: &std::path::Path) -> io::Result<String> {
    Err(io::Error::from(io::ErrorKind::Unsupported))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tiny() -> SensorsOptions {
        SensorsOptions {
            n: 1,
            seed: 3,
            actuators: vec!["bench".to_owned()],
            entries: [CONTROL, "phases_swapped", "setpoint_thousandth"]
                .map(str::to_owned)
                .to_vec(),
        }
    }

    #[test]
    #[ignore = "long form: cargo xtask robust"]
    fn wrong_wires_are_named_and_a_run_gives_the_same_on_any_number_of_threads() {
        let run = |threads: usize, entries: Vec<String>| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = SensorsOptions { entries, ..tiny() };
            pool.install(|| sensors(&options, &|_| ())).unwrap()
        };
        let report = run(2, tiny().entries);
        // An entry alone, by one thread, is what it is among others.
        let alone = run(1, vec!["phases_swapped".to_owned()]);
        assert_eq!(
            serde_json::to_string(&report.by_mistake[1]).unwrap(),
            serde_json::to_string(&alone.by_mistake[0]).unwrap()
        );
        assert!((report.mistakes.all.named_rate - 1.0).abs() < 1e-12);
        let [right, swapped, unit] = &report.by_mistake[..] else {
            panic!("three entries")
        };
        assert!(right.group.all.wrongly_named_rate <= 0.0 && right.group.all.accused_rate <= 0.0);
        assert_eq!((swapped.group.all.windows, swapped.group.all.units), (16, 4));
        assert!(unit.group.all.judged_rate <= 0.0);
        let json = serde_json::to_value(&report).unwrap();
        for group in [&json, &json["by_mistake"][1], &json["before"]] {
            for key in [
                "accused_rate",
                "named_rate",
                "wrongly_named_rate",
                "found_rate",
                "units_named_rate",
                "units_wrongly_named_rate",
            ] {
                assert!(group[key].is_f64(), "{key}");
            }
        }
    }

    #[test]
    fn unknown_names_are_refused() {
        let entries = vec!["load_zer".to_owned()];
        assert!(matches!(
            SensorsOptions { entries, ..tiny() }.windows(),
            Err(SensorsError::Entry { .. })
        ));
        let actuators = vec!["servo".to_owned()];
        assert!(matches!(
            SensorsOptions { actuators, ..tiny() }.windows(),
            Err(SensorsError::Actuator { .. })
        ));
    }

    #[test]
    fn every_part_is_worn_at_every_rate_with_every_drive() {
        let options = SensorsOptions {
            entries: Vec::new(),
            ..tiny()
        };
        let plan = options.plan().unwrap();
        let worn = plan.iter().filter_map(|planned| {
            let (_, vector) = planned.fault?;
            let worse_gain = vector.gain < FaultVector::NOMINAL.gain;
            let circumstances = &planned.circumstances;
            Some((
                planned.worn()?.name(),
                worse_gain,
                circumstances.rate_hz,
                circumstances.drive,
            ))
        });
        let met: std::collections::BTreeSet<_> = worn.collect();
        // Seven parts, the gain in two directions.
        assert_eq!(met.len() as u64, 8 * COMBINATIONS, "{met:?}");
    }

    #[test]
    fn every_combination_of_profile_rate_and_drive_is_met() {
        let mut all: Vec<String> = (0..COMBINATIONS)
            .flat_map(|unit| (0..SERIES).map(move |window| format!("{:?}", Circumstances::of(unit, window))))
            .collect();
        all.sort();
        all.dedup();
        assert_eq!(all.len() as u64, COMBINATIONS * SERIES);
    }
}
