//! Settings of a command line, `KEY=VALUE`, as texts behind the files: the same checks, and places like those of a file.

use toml::de::DeTable;

use super::ConfigError;

/// What errors call a setting, with its number as the line.
pub(super) const NAME: &str = "--set";

/// Each setting as a text of its own, so that a later one holds over an earlier one.
pub(super) fn as_files(settings: &[String]) -> Result<Vec<(String, String)>, ConfigError> {
    let as_file = |(n, setting): (usize, &String)| {
        let refused = |found: &str| ConfigError::Syntax {
            file: NAME.to_owned(),
            line: n + 1,
            message: format!("expected KEY=VALUE in one line, found {found:?}"),
        };
        let (key, value) = setting.split_once('=').ok_or_else(|| refused(setting))?;
        if key.trim().is_empty() || setting.chars().any(char::is_control) {
            return Err(refused(setting));
        }
        let line = format!("{key} = {value}");
        // A word needs no quotes: `method=ga`.
        let line = if DeTable::parse(&line).is_ok() {
            line
        } else {
            format!("{key} = {}", toml::Value::from(value.trim()))
        };
        Ok((NAME.to_owned(), "\n".repeat(n) + &line))
    };
    settings.iter().enumerate().map(as_file).collect()
}
