//! The `robust` suite: units with what real actuators have besides the ideal one, before and after their calibration.
//!
//! In: rate, size, seed and a choice of entries and actuator types ([`RobustOptions`]). Out: rates over all units, for each type
//! and for each entry ([`RobustReport`]). Each entry and type is one unit: healthy and faulty windows are assessed with the type's
//! calibration, the unit is calibrated from other healthy windows, and the same windows are assessed again, besides healthy ones of
//! motions that the calibration has not seen. Windows go as frames
//! through the pipeline, each assessed alone with the default configuration.

mod catalogue_unit;
mod entries;
mod report;
mod score;
mod state;
mod table;
mod unit;

use std::collections::HashMap;
use std::io;
use std::sync::Arc;

use ema_identify::unit_calibration::UnitCalibration;
use ema_identify::unit_fit::WINDOWS_MIN;
use ema_models::reference::EffectError;
use ema_models::{ActuatorParams, FaultVector, ParamsError, Profile};
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Models};
use hmd_core::commissioning::{CommissioningError, calibrate_unit};
use hmd_core::config::{Config, ConfigError};
use hmd_core::frame::BusError;
use hmd_core::outbox::WindowJob;
use hmd_core::seed::{mix, name_hash};
use rayon::prelude::*;

use entries::{ENTRIES, Entry};
use score::Tally;
use unit::{OTHER_PROFILES, UNIT_FILE, Unit, config_of, draw_effects};

pub(super) use unit::single_fault;

pub use catalogue_unit::CatalogueUnit;
pub use entries::{EntryKind, entry_names};
pub use report::{EntryReport, Group, OfType, RobustReport, UnitReport};
pub use score::Rates;
pub use state::{FinishedUnit, first_line, read_state};
pub use table::robust_table;

/// Name of the suite.
const SUITE: &str = "robust";

/// Healthy windows of a unit without `--n`.
pub const ROBUST_WINDOWS: u64 = 12;

/// Faulty windows for each healthy one.
const FAULTY_PER_HEALTHY: u64 = 2;

/// What is run.
#[derive(Clone, Debug)]
pub struct RobustOptions {
    /// Sample rate, Hz.
    pub rate_hz: f64,
    /// Healthy windows of each unit; twice as many are faulty, and as many, at least five, calibrate the unit.
    pub n: u64,
    /// Seed of the units and of their windows.
    pub seed: u64,
    /// Built-in actuator types.
    pub actuators: Vec<String>,
    /// Names of the entries; all where none is named.
    pub entries: Vec<String>,
}

/// Why the suite could not run.
#[derive(Debug, thiserror::Error)]
pub enum RobustError {
    /// No entry of this name.
    #[error("--entry: expected one of {}, found {found:?}", entry_names().collect::<Vec<_>>().join(", "))]
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
    /// The sample rate.
    #[error("--rate: {0}")]
    Rate(#[from] ParamsError),
    /// The sample rate, by the load of a bus.
    #[error("--rate: {0}")]
    Config(#[from] ConfigError),
    /// An effect that the reference refuses.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// An interface that is refused.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A window cannot be assessed.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// A unit cannot be calibrated, whatever its windows.
    #[error(transparent)]
    Commissioning(CommissioningError),
    /// A finished unit is none of this catalogue.
    #[error("expected the state of this catalogue, found {entry} on {actuator} with other effects; begin a new state")]
    OtherUnit {
        /// Its entry.
        entry: String,
        /// Its type.
        actuator: String,
    },
    /// The result of a unit cannot be kept.
    #[error("{0}")]
    Keep(#[from] io::Error),
}

/// Why the state of an earlier run was refused.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// It belongs to another run.
    #[error("expected the state of the run {expected}, found that of {found}")]
    OtherRun {
        /// This run.
        expected: String,
        /// That of the state.
        found: String,
    },
    /// It is no state.
    #[error("line {line}: expected the state of a run, found {found:?}")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// Its beginning.
        found: String,
    },
}

impl RobustOptions {
    /// Windows that are assessed or used for calibration.
    ///
    /// # Errors
    /// An unknown entry or type, or an impossible rate.
    pub fn windows(&self) -> Result<u64, RobustError> {
        Ok(self.plan()?.len() as u64 * self.windows_of_unit())
    }

    fn windows_of_unit(&self) -> u64 {
        2 * (1 + FAULTY_PER_HEALTHY) * self.n + self.commissioning_windows() + self.other_windows()
    }

    /// Healthy windows of motions that the calibration has not seen, as many of each.
    fn other_windows(&self) -> u64 {
        (self.n.div_ceil(OTHER_PROFILES.len() as u64)) * OTHER_PROFILES.len() as u64
    }

    fn commissioning_windows(&self) -> u64 {
        self.n.max(WINDOWS_MIN as u64)
    }

    /// Entry and type of every unit, in the order of the catalogue.
    fn plan(&self) -> Result<Vec<(&'static Entry, &str)>, RobustError> {
        let known = |name: &&String| entry_names().any(|entry| entry == name.as_str());
        if let Some(unknown) = self.entries.iter().find(|name| !known(name)) {
            return Err(RobustError::Entry { found: unknown.clone() });
        }
        for name in &self.actuators {
            let Some(mut params) = ActuatorParams::built_in(name) else {
                return Err(RobustError::Actuator { found: name.clone() });
            };
            params.sensors.sample_rate = self.rate_hz;
            params.checked()?;
        }
        let is_meant = |entry: &&Entry| self.entries.is_empty() || self.entries.contains(&entry.name);
        let of_entry = |entry| self.actuators.iter().map(move |actuator| (entry, actuator.as_str()));
        Ok(ENTRIES.iter().filter(is_meant).flat_map(of_entry).collect())
    }
}

/// The `robust` suite. `finished` are units of an earlier run with the same options, `keep` gets every unit that is finished now,
/// `done` the number of windows that are.
///
/// One unit after the other, its windows in parallel, so that a run that ends early has lost one unit.
///
/// # Errors
/// [`RobustError`].
pub fn robust(
    options: &RobustOptions,
    finished: Vec<FinishedUnit>,
    keep: &mut dyn FnMut(&FinishedUnit) -> io::Result<()>,
    done: &(dyn Fn(u64) + Sync),
) -> Result<RobustReport, RobustError> {
    let mut finished: HashMap<(String, String), FinishedUnit> = finished
        .into_iter()
        .map(|unit| ((unit.entry.clone(), unit.actuator.clone()), unit))
        .collect();
    let mut units: Vec<(&Entry, UnitReport, FinishedUnit)> = Vec::new();
    for (entry, actuator) in options.plan()? {
        let config = config_of(actuator, options.rate_hz)?;
        let of_type = &config.actuators()[0];
        let effects = draw_effects(entry, &of_type.params, &of_type.drive, options.seed)?;
        let result = if let Some(unit) = finished.remove(&(entry.name.clone(), actuator.to_owned())) {
            if unit.drawn != state::drawn(&effects, &config.actuators()[0].params) {
                let (entry, actuator) = (unit.entry, unit.actuator);
                return Err(RobustError::OtherUnit { entry, actuator });
            }
            done(options.windows_of_unit());
            unit
        } else {
            let unit = run_unit(options, entry, actuator, &Unit::new(Arc::new(config), effects), done)?;
            keep(&unit)?;
            unit
        };
        let report = UnitReport {
            actuator: actuator.to_owned(),
            effects: effects.active().collect(),
            before: result.before.rates(),
            after: result.after.rates(),
            elsewhere: result.elsewhere.rates(),
            reason: result.refused.clone(),
        };
        units.push((entry, report, result));
    }
    let group = |is_meant: &dyn Fn(&FinishedUnit) -> bool| {
        Group::of(units.iter().map(|unit| &unit.2).filter(|unit| is_meant(unit)))
    };
    Ok(RobustReport {
        suite: SUITE,
        rate_hz: options.rate_hz,
        n: options.n,
        seed: options.seed,
        all: group(&|_| true),
        actuators: options
            .actuators
            .iter()
            .map(|actuator| OfType {
                actuator: actuator.clone(),
                group: group(&|unit| unit.actuator == *actuator),
            })
            .collect(),
        entries: units
            .chunk_by(|one, other| one.0.name == other.0.name)
            .map(|of_entry| EntryReport {
                entry: of_entry[0].0.name.clone(),
                kind: of_entry[0].0.kind,
                group: Group::of(of_entry.iter().map(|unit| &unit.2)),
                of_units: of_entry.iter().map(|unit| unit.1.clone()).collect(),
            })
            .collect(),
    })
}

/// A simulated window: the damaged element of a faulty one, the truth, the window if one was cut, and the seed of its search.
#[derive(Clone)]
struct Simulated {
    place: Option<usize>,
    truth: FaultVector,
    job: Option<WindowJob>,
    seed: u64,
}

/// Simulates and assesses one unit.
fn run_unit(
    options: &RobustOptions,
    entry: &Entry,
    actuator: &str,
    unit: &Unit,
    done: &(dyn Fn(u64) + Sync),
) -> Result<FinishedUnit, RobustError> {
    let seed = mix(options.seed, &[name_hash(&entry.name), name_hash(actuator)]);
    let assessed_windows = (1 + FAULTY_PER_HEALTHY) * options.n;
    let mixed_windows = assessed_windows + options.commissioning_windows();
    let windows: Vec<Simulated> = (0..mixed_windows + options.other_windows())
        .into_par_iter()
        .map(|n| {
            let seed = mix(seed, &[2, n]);
            let (place, truth) = if (options.n..assessed_windows).contains(&n) {
                let (place, fault) = single_fault(n - options.n, seed);
                (Some(place), fault)
            } else {
                (None, FaultVector::NOMINAL)
            };
            let profile = match n.checked_sub(mixed_windows) {
                None => Profile::Mixed,
                Some(n) => OTHER_PROFILES[n as usize % OTHER_PROFILES.len()],
            };
            let job = unit.window(profile, truth, seed)?;
            Ok(Simulated {
                place,
                truth,
                job,
                seed,
            })
        })
        .collect::<Result<_, RobustError>>()?;
    let (mixed, others) = windows.split_at(mixed_windows as usize);
    let (assessed, commissioning) = mixed.split_at(assessed_windows as usize);

    let of_type = Models::load_types(&unit.config, &no_file)?;
    let (before, calibrated) = rayon::join(
        || assess_all(&unit.config, &of_type, assessed, done),
        || {
            let mut jobs: Vec<WindowJob> = commissioning.iter().filter_map(|window| window.job.clone()).collect();
            jobs.retain(|job| job.window.quality.is_fit());
            let assessor = Assessor::new(unit.config.clone(), of_type.clone(), seed);
            let levels = unit.config.health().levels();
            let calibrated = calibrate_unit(&assessor, levels, &mut jobs, seed, &|_| ());
            done(options.commissioning_windows());
            calibrated
        },
    );
    let before = before?;
    let usable = match calibrated {
        // What `hmd calibrate` would not write.
        Ok(found) => UnitCalibration::parse(&found.calibration.emit(), UNIT_FILE, actuator).map_err(|e| e.to_string()),
        Err(refused) if refused.is_by_windows() => Err(refused.to_string()),
        Err(error) => return Err(RobustError::Commissioning(error)),
    };
    let (refused, models) = match usable {
        Ok(calibration) => (None, Some(models_of(&unit.config, &calibration)?)),
        Err(refused) => (Some(refused), None),
    };
    let after = match &models {
        Some(of_unit) => assess_all(&unit.config, of_unit, assessed, done)?,
        None => {
            done(assessed.len() as u64);
            before.clone()
        }
    };
    let elsewhere = assess_all(&unit.config, models.as_ref().unwrap_or(&of_type), others, done)?;
    Ok(FinishedUnit {
        entry: entry.name.clone(),
        actuator: actuator.to_owned(),
        drawn: unit.drawn(),
        refused,
        before,
        after,
        elsewhere,
    })
}

/// Assesses windows, each without the history of the others.
fn assess_all(
    config: &Arc<Config>,
    models: &Models,
    windows: &[Simulated],
    done: &(dyn Fn(u64) + Sync),
) -> Result<Tally, RobustError> {
    let assessed: Vec<Option<AssessedWindow>> = windows
        .par_iter()
        .map(|window| {
            let mut assessor = Assessor::new(config.clone(), models.clone(), window.seed);
            let assessed = window.job.clone().map(|job| assessor.assess(job)).transpose()?;
            done(1);
            Ok(assessed)
        })
        .collect::<Result<_, AssessError>>()?;
    let mut tally = Tally::default();
    for (window, assessed) in windows.iter().zip(&assessed) {
        match window.place {
            None => tally.add_healthy(assessed.as_ref()),
            Some(place) => tally.add_faulty(assessed.as_ref(), place, &window.truth),
        }
    }
    Ok(tally)
}

/// The models with which the daemon would assess a unit with this calibration.
fn models_of(config: &Config, calibration: &UnitCalibration) -> Result<Models, AssessError> {
    Models::load(config, &|_| Ok(calibration.emit()))
}

/// The built-in types read no file.
fn no_file(_: &std::path::Path) -> io::Result<String> {
    Err(io::Error::from(io::ErrorKind::Unsupported))
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    fn tiny() -> RobustOptions {
        RobustOptions {
            rate_hz: 400.0,
            n: 1,
            seed: 3,
            actuators: vec!["bench".to_owned(), "servo270".to_owned()],
            entries: vec!["stribeck".to_owned()],
        }
    }

    /// The report as JSON, and the state that the run kept.
    fn run(options: &RobustOptions, threads: usize, finished: Vec<FinishedUnit>) -> (String, String) {
        let mut state = first_line(options);
        let windows = Mutex::new(0);
        let mut keep = |unit: &FinishedUnit| {
            state += &unit.line();
            Ok(())
        };
        let done = |n| *windows.lock().unwrap() += n;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let report = pool.install(|| robust(options, finished, &mut keep, &done)).unwrap();
        assert_eq!(*windows.lock().unwrap(), options.windows().unwrap());
        (serde_json::to_string(&report).unwrap(), state)
    }

    #[test]
    fn a_run_gives_the_same_on_any_number_of_threads_and_when_it_is_resumed() {
        let options = tiny();
        let (alone, state) = run(&options, 1, Vec::new());

        // The state as a kill in the middle of a line leaves it.
        let cut = &state[..state.len() - 10];
        let (mut finished, whole) = read_state(cut, &options).unwrap();
        finished[0].drawn.clear();
        let refused = robust(&options, finished, &mut |_| Ok(()), &|_| ()).unwrap_err();
        assert!(matches!(refused, RobustError::OtherUnit { .. }), "{refused}");
        let (finished, _) = read_state(cut, &options).unwrap();
        assert_eq!((finished.len(), cut.as_bytes()[whole - 1]), (1, b'\n'));
        // The second unit, by two threads.
        let (resumed, added) = run(&options, 2, finished);
        assert_eq!(alone, resumed);
        assert_eq!(added.lines().count(), 2);

        let report: serde_json::Value = serde_json::from_str(&alone).unwrap();
        for group in [&report, &report["entries"][0], &report["actuators"][1]] {
            assert!(group["elsewhere"]["false_fault_rate"].is_f64());
            for key in [
                "judged_rate",
                "false_fault_rate",
                "named_rate",
                "wrong_rate",
                "median_error",
                "coverage_95",
            ] {
                assert!(
                    group["before"].get(key).is_some() && group["after"].get(key).is_some(),
                    "{key}"
                );
            }
            assert!(group["refused"].is_u64());
        }
        assert_eq!(report["entries"][0]["of_units"][1]["actuator"], "servo270");
        assert!(report["entries"][0]["of_units"][0]["effects"]["stribeck_nm"].is_f64());
    }

    #[test]
    fn the_state_of_another_run_and_unknown_names_are_refused() {
        let options = tiny();
        let other = RobustOptions { seed: 4, ..tiny() };
        assert!(matches!(
            read_state(&first_line(&other), &options),
            Err(StateError::OtherRun { .. })
        ));
        // Another build has another executable.
        let mut of_other_build: serde_json::Value = serde_json::from_str(&first_line(&options)).unwrap();
        assert!(of_other_build["program"].is_string());
        of_other_build["program"] = "0".into();
        assert!(matches!(
            read_state(&format!("{of_other_build}\n"), &options),
            Err(StateError::OtherRun { .. })
        ));
        assert!(matches!(
            read_state("actuation\n", &options),
            Err(StateError::Line { line: 1, .. })
        ));
        assert!(matches!(
            read_state("notes without an end of line", &options),
            Err(StateError::Line { line: 1, .. })
        ));
        let cut = first_line(&options);
        assert!(read_state(&cut[..cut.len() - 5], &options).is_ok_and(|(_, whole)| whole == 0));
        assert!(read_state("", &options).is_ok_and(|(units, whole)| units.is_empty() && whole == 0));
        let unknown = RobustOptions {
            entries: vec!["stribek".to_owned()],
            ..tiny()
        };
        assert!(matches!(unknown.windows(), Err(RobustError::Entry { .. })));
        let unknown = RobustOptions {
            actuators: vec!["servo".to_owned()],
            ..tiny()
        };
        assert!(matches!(unknown.windows(), Err(RobustError::Actuator { .. })));
        for rate_hz in [333.0, f64::NAN, -1.0] {
            let odd = RobustOptions { rate_hz, ..tiny() };
            assert!(matches!(odd.windows(), Err(RobustError::Rate(_))), "{rate_hz}");
        }
    }
}
