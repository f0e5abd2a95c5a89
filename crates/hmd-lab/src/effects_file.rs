//! Files of effects: TOML of `name = value`, and `drive = "hysteresis"` or `"vector"`, read into [`EffectSettings`].

use std::io;
use std::path::Path;

use ema_models::reference::{Drive, EffectError, EffectSettings};
use hmd_storage::regular_file::read_regular_text;
use thiserror::Error;
use toml::de::{DeTable, DeValue};

/// Most bytes of a file: every effect has one line.
const BYTES_MAX: u64 = 1 << 20;

/// Key that names the kind of drive; every other key is an effect.
const DRIVE: &str = "drive";

/// Why a file of effects was refused; displays as one sentence with file, line, name, expected and found.
#[derive(Debug, Error)]
pub enum EffectsFileError {
    /// The file cannot be read.
    #[error("{file}: expected a readable file, found: {cause}")]
    Read {
        /// File name as given.
        file: String,
        /// The error of the system.
        cause: io::Error,
    },
    /// The text is not TOML.
    #[error("{file}:{line}: not valid TOML: {message}")]
    Syntax {
        /// File name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// What the parser expected.
        message: String,
    },
    /// A value of the wrong kind.
    #[error("{file}:{line}: {name}: expected {expected}")]
    Value {
        /// File name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Name of the effect, or `drive`.
        name: String,
        /// What the value must be.
        expected: &'static str,
    },
    /// An unknown name or a value out of range.
    #[error("{file}:{line}: {}", refusal(.name, .cause))]
    Effect {
        /// File name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// The name in the file.
        name: String,
        /// Why it was refused.
        cause: EffectError,
    },
}

/// A refused effect as a sentence that begins with its name.
fn refusal(name: &str, cause: &EffectError) -> String {
    match cause {
        EffectError::Unknown(_) => format!("{name}: {cause}"),
        EffectError::OutOfRange { .. } => cause.to_string(),
    }
}

/// The settings of a file.
///
/// # Errors
/// The first thing that is wrong with it.
pub fn load(path: &Path) -> Result<EffectSettings, EffectsFileError> {
    let file = path.display().to_string();
    match read_regular_text(path, BYTES_MAX) {
        Ok(text) => parse(&file, &text),
        Err(cause) => Err(EffectsFileError::Read { file, cause }),
    }
}

/// The settings of a text; `file` is its name in messages.
fn parse(file: &str, text: &str) -> Result<EffectSettings, EffectsFileError> {
    let line = |at: usize| 1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count();
    let table = DeTable::parse(text).map_err(|error| EffectsFileError::Syntax {
        file: file.to_owned(),
        line: line(error.span().map_or(0, |span| span.start)),
        message: error.message().lines().collect::<Vec<_>>().join("; "),
    })?;
    let mut settings = EffectSettings::default();
    for (key, value) in table.get_ref() {
        let name = key.get_ref().as_ref();
        let line = line(key.span().start);
        let expected = |expected| EffectsFileError::Value {
            file: file.to_owned(),
            line,
            name: name.to_owned(),
            expected,
        };
        if name == DRIVE {
            let drive = value.get_ref().as_str().and_then(Drive::from_name);
            settings.drive = Some(drive.ok_or_else(|| expected("\"hysteresis\" or \"vector\""))?);
            continue;
        }
        let number = number(value.get_ref()).ok_or_else(|| expected("a number"))?;
        settings.set(name, number).map_err(|cause| EffectsFileError::Effect {
            file: file.to_owned(),
            line,
            name: name.to_owned(),
            cause,
        })?;
    }
    Ok(settings)
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().replace('_', "").parse().ok(),
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
            .ok()
            .map(|n| n as f64),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_sets_numbers_by_name_and_the_drive() {
        let text =
            "# A unit.\ndrive = \"vector\"\ncogging_nm = 0.05\npwm_frequency_hz = 16_000\ndead_time_s = 1.5e-6\n";
        let settings = parse("unit.toml", text).unwrap();
        let mut expected = EffectSettings::with_drive(Drive::from_name("vector"));
        for (name, value) in [
            ("cogging_nm", 0.05),
            ("pwm_frequency_hz", 16e3),
            ("dead_time_s", 1.5e-6),
        ] {
            expected.set(name, value).unwrap();
        }
        assert_eq!(settings, expected);
        assert_eq!(parse("unit.toml", "").unwrap(), EffectSettings::default());
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, sentence) in [
            (
                "\ncoging_nm = 1\n",
                "unit.toml:2: coging_nm: unknown effect: expected a name such as cogging_nm",
            ),
            (
                "emf_5 = 2",
                "unit.toml:1: emf_5 = 2: expected a number from -0.3 to 0.3",
            ),
            ("emf_5 = \"2\"", "unit.toml:1: emf_5: expected a number"),
            (
                "emf_5 = nan",
                "unit.toml:1: emf_5 = NaN: expected a number from -0.3 to 0.3",
            ),
            ("[emf_5]\na = 1", "unit.toml:1: emf_5: expected a number"),
            (
                "drive = \"stepper\"",
                "unit.toml:1: drive: expected \"hysteresis\" or \"vector\"",
            ),
            ("drive = 1", "unit.toml:1: drive: expected \"hysteresis\" or \"vector\""),
            ("emf_5 = 0.01\nemf_5 = 0.02", "unit.toml:2: not valid TOML: "),
            ("emf_5 = ", "unit.toml:1: not valid TOML: "),
        ] {
            let found = parse("unit.toml", text).unwrap_err().to_string();
            assert!(found.starts_with(sentence), "{found}");
        }
    }
}
