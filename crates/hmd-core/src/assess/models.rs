//! Calibrations of types and of units, with which windows are assessed. They are loaded before the first window.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use ema_ga::ConfigError as SearchError;
use ema_identify::calibration::{CalibrationError, MonitorForm, TypeCalibration};
use ema_identify::unit_calibration::{UnitCalibration, UnitError};
use ema_models::{ActuatorParams, FaultVector, MotorKnowledge};
use sha2::{Digest, Sha256};

use super::motor_within;
use crate::config::{ActuatorConfig, ActuatorType, Config};
use crate::functional_check::{CHECK_LANES, unmet_requirements};
use crate::health::LevelsError;
use crate::metadata_checksum::hex;

/// Why windows cannot be assessed; each has its cause in the configuration.
#[derive(Debug, thiserror::Error)]
pub enum AssessError {
    /// A calibration cannot be read, or not be written.
    #[error("{path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The error of the system.
        source: io::Error,
    },
    /// A type calibration is unusable.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A calibration file belongs to another monitor form.
    #[error("{path}: expected a calibration of the {expected:?} monitor, found one of the {found:?} monitor")]
    Form {
        /// The file.
        path: String,
        /// The form the configuration asks for.
        expected: MonitorForm,
        /// The form of the file.
        found: MonitorForm,
    },
    /// A unit's calibration is unusable.
    #[error(transparent)]
    Unit(#[from] UnitError),
    /// What was learnt of a unit belongs to another one.
    #[error("{path}: expected the unit with serial number {expected}, found that with {found}")]
    Serial {
        /// The file.
        path: String,
        /// Serial number of the configuration.
        expected: String,
        /// Serial number in the file.
        found: String,
    },
    /// A unit's calibration names an estimator that it does not hold.
    #[error("{0}: expected the estimator that its calibration names, found none")]
    NoEstimator(String),
    /// A type's specification is one that not even a healthy actuator of the type meets.
    #[error(
        "type.{type_name}.specification: expected requirements that a healthy actuator meets, found that its simulated step of {step_rad} rad \
         misses {requirement}"
    )]
    Specification {
        /// The type.
        type_name: String,
        /// Height of the step, rad at the output.
        step_rad: f64,
        /// The requirement that is missed first.
        requirement: &'static str,
    },
    /// No calibration was loaded for a type.
    #[error("type {0}: expected a loaded calibration, found none")]
    NoModel(String),
    /// The search's settings contradict each other.
    #[error("identification: {0}")]
    Search(#[from] SearchError),
    /// The health levels contradict each other.
    #[error("health: {0}")]
    Levels(#[from] LevelsError),
}

/// Reads the text of a calibration file.
pub type ReadText<'a> = &'a dyn Fn(&Path) -> io::Result<String>;

/// A type's calibration, and whether anybody made it.
#[derive(Clone, Debug)]
pub struct TypeModel {
    /// The calibration that the type's windows are assessed with.
    pub calibration: TypeCalibration,
    /// Whether it was made for this type; otherwise it stands in for one.
    pub calibrated: bool,
}

impl TypeModel {
    /// From a file if the configuration names one, else as shipped.
    ///
    /// A shipped calibration belongs to the parameters of a built-in type; a type that changes them has none.
    ///
    /// # Errors
    /// The file cannot be read, is no calibration, or belongs to another monitor form.
    pub fn load(
        type_name: &str,
        params: &ActuatorParams,
        form: MonitorForm,
        path: Option<&Path>,
        read: ReadText<'_>,
    ) -> Result<Self, AssessError> {
        if let Some(path) = path {
            let text = read_text(path, read)?;
            let name = path.display().to_string();
            let calibration = TypeCalibration::parse(&text, &name)?;
            if calibration.monitor != form {
                return Err(AssessError::Form {
                    path: name,
                    expected: form,
                    found: calibration.monitor,
                });
            }
            return Ok(Self {
                calibration,
                calibrated: true,
            });
        }
        // The name does not count. Nor does the sample rate: it is read from the device's own time, and the
        // calibration serves any.
        let same = |name: &&str| {
            ActuatorParams::built_in(name).is_some_and(|mut built_in| {
                built_in.sensors.sample_rate = params.sensors.sample_rate;
                built_in == *params
            })
        };
        let built_in = ActuatorParams::BUILT_IN.into_iter().find(same);
        let shipped = built_in.and_then(|name| TypeCalibration::built_in(name, form));
        Ok(match shipped {
            Some(calibration) => Self {
                calibration: TypeCalibration {
                    actuator_type: type_name.to_owned(),
                    ..calibration
                },
                calibrated: true,
            },
            None => Self {
                calibration: TypeCalibration::uncalibrated(type_name, form, params),
                calibrated: false,
            },
        })
    }
}

fn read_text(path: &Path, read: ReadText<'_>) -> Result<String, AssessError> {
    read(path).map_err(|source| AssessError::Read {
        path: path.display().to_string(),
        source,
    })
}

/// The models of all types and units that a configuration's actuators are of.
#[derive(Clone, Debug, Default)]
pub struct Models {
    types: BTreeMap<String, TypeModel>,
    units: BTreeMap<String, UnitCalibration>,
}

/// Refuses what was learnt of another unit, where both serial numbers are known.
///
/// # Errors
/// [`AssessError::Serial`].
pub fn check_serial(path: &Path, actuator: &ActuatorConfig, unit: &UnitCalibration) -> Result<(), AssessError> {
    match (&actuator.serial_number, &unit.serial_number) {
        (Some(expected), Some(found)) if expected != found => Err(AssessError::Serial {
            path: path.display().to_string(),
            expected: expected.clone(),
            found: found.clone(),
        }),
        _ => Ok(()),
    }
}

impl Models {
    /// Loads the calibrations of every actuator of a configuration, its unit's and its type's.
    ///
    /// # Errors
    /// The first calibration that cannot be read or used.
    pub fn load(config: &Config, read: ReadText<'_>) -> Result<Self, AssessError> {
        let mut models = Self::load_types(config, read)?;
        for actuator in config.actuators() {
            if let Some(path) = &actuator.calibration {
                let path = config.resolve(path);
                let text = read_text(&path, read)?;
                let name = path.display().to_string();
                let unit = UnitCalibration::parse(&text, &name, &actuator.type_name)?;
                check_serial(&path, actuator, &unit)?;
                models.units.insert(actuator.name.clone(), unit);
            }
        }
        Ok(models)
    }

    /// Loads the calibrations of the types alone, as for units that are not calibrated yet.
    ///
    /// # Errors
    /// The first calibration that cannot be read or used.
    pub fn load_types(config: &Config, read: ReadText<'_>) -> Result<Self, AssessError> {
        let form = config.identification().monitor;
        let mut models = Self::default();
        for actuator in config.actuators() {
            if !models.types.contains_key(&actuator.type_name) {
                let path = actuator.type_calibration.as_deref().map(|path| config.resolve(path));
                let found = TypeModel::load(&actuator.type_name, &actuator.params, form, path.as_deref(), read)?;
                check_specification(actuator, &found)?;
                models.types.insert(actuator.type_name.clone(), found);
            }
        }
        Ok(models)
    }

    /// The models of a configuration that names no calibration file.
    ///
    /// # Errors
    /// It names one.
    pub fn without_files(config: &Config) -> Result<Self, AssessError> {
        Self::load(config, &|_| Err(io::Error::from(io::ErrorKind::Unsupported)))
    }

    /// The model of a type.
    ///
    /// # Errors
    /// None was loaded.
    pub fn of_type(&self, type_name: &str) -> Result<&TypeModel, AssessError> {
        let found = self.types.get(type_name);
        found.ok_or_else(|| AssessError::NoModel(type_name.to_owned()))
    }

    /// What was learnt of a commissioned actuator.
    #[must_use]
    pub fn unit(&self, actuator: &ActuatorConfig) -> Option<&UnitCalibration> {
        self.units.get(&actuator.name)
    }

    /// Sets what was learnt of an actuator's unit.
    pub(super) fn set_unit(&mut self, actuator: &str, unit: UnitCalibration) {
        self.units.insert(actuator.to_owned(), unit);
    }

    /// Forgets what was learnt of an actuator's unit.
    pub(super) fn remove_unit(&mut self, actuator: &str) {
        self.units.remove(actuator);
    }

    /// Prior knowledge of an actuator's motor: its own calibration, else the tolerances of its type.
    #[must_use]
    pub fn motor(&self, actuator: &ActuatorConfig) -> MotorKnowledge {
        let monitor = self.unit(actuator).and_then(|unit| unit.monitor);
        monitor.map_or_else(|| motor_within(&actuator.tolerances), |monitor| monitor.motor())
    }
}

/// Refuses requirements that a healthy actuator of the type misses: the functional end of its life would be now.
fn check_specification(actuator: &ActuatorConfig, model: &TypeModel) -> Result<(), AssessError> {
    let specification = &actuator.specification;
    if !specification.is_set() {
        return Ok(());
    }
    let coefficients = model.calibration.coefficients();
    let healthy = [FaultVector::NOMINAL; CHECK_LANES];
    let [missed, ..] = unmet_requirements(&actuator.params, &coefficients, specification, &healthy);
    match missed {
        Some(missed) => Err(AssessError::Specification {
            type_name: actuator.type_name.clone(),
            step_rad: specification.step_rad,
            requirement: missed.name(),
        }),
        None => Ok(()),
    }
}

/// Hash of the parameters of an actuator's type, whatever its sample rate.
#[must_use]
pub fn hash_of_type(actuator: &ActuatorConfig) -> String {
    hex(&Sha256::digest(actuator.parameters_as_text()))
}

/// The same of a type.
#[must_use]
pub fn hash_of_parameters(of_type: &ActuatorType) -> String {
    hex(&Sha256::digest(of_type.parameters_as_text()))
}

/// Hash of the calibrations that a configuration names, of its types as shipped or as their files stand, and of its units; and of the
/// further ones of units that `learnt` names.
#[must_use]
pub fn model_hash(config: &Config, learnt: &[PathBuf], read: ReadText<'_>) -> String {
    let mut hash = Sha256::new();
    let form = config.identification().monitor;
    let mut types: Vec<&str> = config.actuators().iter().map(|a| a.type_name.as_str()).collect();
    types.push("bench");
    types.sort_unstable();
    types.dedup();
    for name in types {
        if let Some(found) = config.actuator_type(name) {
            let path = found.calibration.as_deref().map(|path| config.resolve(path));
            if let Ok(known) = TypeModel::load(name, &found.params, form, path.as_deref(), read) {
                hash.update(known.calibration.emit());
            }
        }
    }
    let named = config.actuators().iter().filter_map(|unit| unit.calibration.as_ref());
    let named = named.map(|path| config.resolve(path));
    for text in named.chain(learnt.iter().cloned()).filter_map(|path| read(&path).ok()) {
        hash.update(text);
    }
    hex(&hash.finalize())
}
