//! Names of actuators and of types, which become parts of topics.

/// What [`is_name`] asks for, in words.
pub(super) const NAME_EXPECTED: &str =
    "a name of 1 to 64 letters, digits, '_', '-' or '.', which begins with none of the last two";

/// Whether `name` can be part of a topic, and as the name of a file is neither a path nor hidden nor an option.
pub(super) fn is_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    (1..=64).contains(&name.len()) && !name.starts_with(['-', '.']) && name.chars().all(allowed)
}
