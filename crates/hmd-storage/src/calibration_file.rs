//! Files of calibrations: of a type and of one unit.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use ema_identify::calibration::MonitorForm;
use ema_identify::unit_calibration::UnitCalibration;
use hmd_core::assess::{AssessError, Models, TypeModel, model_hash};
use hmd_core::config::{ActuatorConfig, ActuatorType, Config};
use hmd_core::learning::LearntUnit;
use hmd_core::metadata_checksum::hex;
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::is_full;
use crate::output_file::{self, folder_of, sync_folder_of};
use crate::regular_file::read_regular_text;

/// Reads everything that the windows of a configuration are assessed with.
///
/// # Errors
/// The first calibration that cannot be read or used.
pub fn load_models(config: &Config) -> Result<Models, AssessError> {
    Models::load(config, &read_text)
}

/// Reads the calibrations of the types alone, as for units without a calibration of their own.
///
/// # Errors
/// The first calibration that cannot be read or used.
pub fn load_type_models(config: &Config) -> Result<Models, AssessError> {
    Models::load_types(config, &read_text)
}

/// Reads the calibration of a type, from the file that the configuration names or as shipped.
///
/// # Errors
/// It cannot be read or used.
pub fn load_type_model(
    name: &str,
    of_type: &ActuatorType,
    form: MonitorForm,
    config: &Config,
) -> Result<TypeModel, AssessError> {
    let path = of_type.calibration.as_deref().map(|path| config.resolve(path));
    TypeModel::load(name, &of_type.params, form, path.as_deref(), &read_text)
}

/// Reads the calibration of a unit of a type.
///
/// # Errors
/// It cannot be read or used.
pub fn load_unit(path: &Path, actuator_type: &str) -> Result<UnitCalibration, AssessError> {
    read_unit(path, actuator_type).map(|(unit, _)| unit)
}

/// The calibration of a unit, and the SHA-256 of its file.
fn read_unit(path: &Path, actuator_type: &str) -> Result<(UnitCalibration, String), AssessError> {
    let name = path.display().to_string();
    let text = read_text(path).map_err(|source| AssessError::Read {
        path: name.clone(),
        source,
    })?;
    let unit = UnitCalibration::parse(&text, &name, actuator_type)?;
    Ok((unit, hex(&Sha256::digest(text))))
}

/// What a run learnt of a unit, as it is kept.
#[derive(Clone, Debug)]
pub struct KeptUnit<'a> {
    /// Its file.
    pub path: PathBuf,
    /// Its actuator.
    pub actuator: &'a ActuatorConfig,
    /// What was learnt.
    pub calibration: UnitCalibration,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
}

/// Reads what earlier runs learnt of the units of a configuration.
///
/// # Errors
/// As [`load_learnt_unit`], the first.
pub fn load_learnt(config: &Config) -> Result<Vec<KeptUnit<'_>>, AssessError> {
    let of_each = config.actuators().iter();
    of_each
        .filter_map(|actuator| load_learnt_unit(config, actuator).transpose())
        .collect()
}

/// Reads what an earlier run learnt of an actuator's unit; `None` where nothing is kept.
///
/// # Errors
/// The file cannot be read or used, or belongs to a unit with another serial number.
pub fn load_learnt_unit<'a>(
    config: &Config,
    actuator: &'a ActuatorConfig,
) -> Result<Option<KeptUnit<'a>>, AssessError> {
    let Some(path) = config.learnt_file(actuator) else {
        return Ok(None);
    };
    let (calibration, sha256) = match read_unit(&path, &actuator.type_name) {
        Err(AssessError::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other?,
    };
    if calibration.serial_number != actuator.serial_number {
        let serial = |of: &Option<String>| of.clone().unwrap_or_else(|| "none".to_owned());
        return Err(AssessError::Serial {
            path: path.display().to_string(),
            expected: serial(&actuator.serial_number),
            found: serial(&calibration.serial_number),
        });
    }
    Ok(Some(KeptUnit {
        path,
        actuator,
        calibration,
        sha256,
    }))
}

/// Whether the folder of each unit that is to be learnt can be written to; one that is missing is made.
///
/// # Errors
/// The first actuator whose folder cannot, with the folder and what the system says.
pub fn check_learn_folders(config: &Config) -> Result<(), (String, AssessError)> {
    for actuator in config.actuators() {
        let Some(path) = config.learnt_file(actuator) else {
            continue;
        };
        let folder = folder_of(&path);
        let tried = fs::create_dir_all(folder).and_then(|()| NamedTempFile::new_in(folder).map(drop));
        match tried {
            // Room may come before the unit is learnt.
            Err(cause) if is_full(&cause) => {}
            Err(source) => {
                let path = folder.display().to_string();
                return Err((actuator.name.clone(), AssessError::Read { path, source }));
            }
            Ok(()) => {}
        }
    }
    Ok(())
}

/// Writes what was learnt of a unit; a folder that is missing is made.
///
/// # Errors
/// The file, and what the system says.
pub fn save_learnt(config: &Config, learnt: &LearntUnit) -> Result<PathBuf, AssessError> {
    let path = config.learnt_file(&learnt.actuator).unwrap_or_default();
    let put = || {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        save(&path, &learnt.calibration.emit())
    };
    match put() {
        Ok(()) => Ok(path),
        Err(source) => Err(AssessError::Read {
            path: path.display().to_string(),
            source,
        }),
    }
}

/// Removes what was learnt of the unit that an actuator had before; it stays removed after a power cut.
///
/// # Errors
/// The file is there and cannot be removed.
pub fn remove_learnt(config: &Config, actuator: &ActuatorConfig) -> Result<(), AssessError> {
    let Some(path) = config.learnt_file(actuator) else {
        return Ok(());
    };
    match fs::remove_file(&path).and_then(|()| sync_folder_of(&path)) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => Err(AssessError::Read {
            path: path.display().to_string(),
            source,
        }),
        _ => Ok(()),
    }
}

/// Hash of the calibrations that a configuration names, of its types as shipped or as their files stand, and of its units.
#[must_use]
pub fn hash_of_models(config: &Config) -> String {
    model_hash(config, &[], &read_text)
}

/// The same of a run, which goes on with what earlier ones learnt of units.
#[must_use]
pub fn hash_of_models_of_run(config: &Config) -> String {
    let files = config
        .actuators()
        .iter()
        .filter_map(|actuator| config.learnt_file(actuator));
    model_hash(config, &files.collect::<Vec<_>>(), &read_text)
}

/// Most bytes of a calibration: thousands of times what ours have.
const BYTES_MAX: u64 = 16 << 20;

/// The text of a calibration file, of at most 16 MiB.
///
/// # Errors
/// What the system says, or that it is no regular file or too long.
pub fn read_text(path: &Path) -> io::Result<String> {
    read_regular_text(path, BYTES_MAX)
}

/// Writes the text of a calibration: to a temporary file beside its place, then onto it, so that there is always a whole one, and on
/// the disk when this returns.
///
/// # Errors
/// What the system says.
pub fn save(path: &Path, text: &str) -> io::Result<()> {
    output_file::write(path, text)
}
