//! Reading the file of a type calibration.

use std::path::Path;

use ema_identify::calibration::{CalibrationError, TypeCalibration};

/// Why a calibration file was refused.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationFileError {
    /// The file cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Its text is no usable calibration.
    #[error(transparent)]
    Content(#[from] CalibrationError),
}

/// Reads the calibration of a type from a file.
///
/// # Errors
/// [`CalibrationFileError`] when it cannot be read or is no calibration of this version.
pub fn load_calibration(path: &Path) -> Result<TypeCalibration, CalibrationFileError> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|source| CalibrationFileError::Io {
        path: name.clone(),
        source,
    })?;
    Ok(TypeCalibration::parse(&text, &name)?)
}
