//! Names of actuators and of types, which become parts of topics.

/// What [`is_name`] asks for, in words.
pub(super) const NAME_EXPECTED: &str = "a name of 1 to 64 letters, digits, '_', '-' or '.'";

/// Whether `name` can be part of a topic.
pub(super) fn is_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    (1..=64).contains(&name.len()) && name.chars().all(allowed)
}
