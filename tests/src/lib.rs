//! End-to-end tests; see the files beside this package's manifest.

use hmd_core::config::Config;

/// Tolerances of simulated units without effects: nothing but the motor differs from the type.
pub const KNOWN_UNITS: &str = include_str!("../../fixtures/known.toml");

/// The configuration under which such units are assessed.
///
/// # Panics
/// The fixture is no configuration.
#[must_use]
pub fn known_units() -> Config {
    Config::from_toml_str(KNOWN_UNITS, "known.toml").unwrap_or_else(|error| panic!("{error}"))
}
