//! The configuration from outside: limits, words, and what becomes of each section.

mod bus_load;
mod description;
mod drives;
mod limits;
mod maps;
mod names;
mod signals;
mod types;

use std::path::Path;

use hmd_core::config::Config;

/// A DBC file with a message of each kind: multiplexed, with a long identifier, longer than a classic frame.
const DBC: &str = include_str!("../../../../fixtures/foreign.dbc");

/// The drive of `fixtures/drives` as its master is configured.
const DCF: &[u8] = include_bytes!("../../../../fixtures/drives/drive.dcf");

/// The configuration of the actuator on the bus of [`DBC`].
const OF_DBC: &str = include_str!("../../../../fixtures/foreign.toml");

/// Reads files as the folder of the configuration has them: `foreign.dbc` and `drive.dcf`.
fn file(path: &Path) -> Result<Vec<u8>, String> {
    match path.to_str() {
        Some("foreign.dbc") => Ok(DBC.into()),
        Some("drive.dcf") => Ok(DCF.to_vec()),
        _ => Err("there is none".to_owned()),
    }
}

fn checked(text: &str) -> Result<Config, String> {
    let files = [("hmd.toml".to_owned(), text.to_owned())];
    Config::from_texts(&files, &[], &file).map_err(|refused| refused.to_string())
}

fn read(text: &str) -> Config {
    checked(text).unwrap_or_else(|refused| panic!("{refused}\n{text}"))
}

fn refusal(text: &str) -> String {
    match checked(text) {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(refused) => refused,
    }
}
