//! Section `[window]`: what an actuation window is, and how many samples it may lack.

use super::ConfigError;
use super::reader::Section;
use crate::window::WindowConfig;

/// The keys of the section.
pub(super) fn keys() -> [&'static str; WindowConfig::RANGES.len()] {
    WindowConfig::RANGES.map(|(key, _)| key)
}

/// Reads the section; every setting must be possible at each of the sample rates, Hz.
pub(super) fn read(
    section: &Section<'_>,
    sample_rates_hz: impl IntoIterator<Item = f64>,
) -> Result<WindowConfig, ConfigError> {
    let mut settings = WindowConfig::default().to_array();
    for ((key, range), setting) in WindowConfig::RANGES.into_iter().zip(&mut settings) {
        *setting = section.number(key, *setting, range)?;
    }
    let window = WindowConfig::from_array(settings);
    for rate_hz in sample_rates_hz {
        window
            .checked(rate_hz)
            .map_err(|refused| section.refuse_setting(&refused))?;
    }
    Ok(window)
}
