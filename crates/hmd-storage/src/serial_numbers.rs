//! Which units a log is of.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use crate::mcap::McapMessages;
use crate::mcap_writer::METADATA_NAME;
use hmd_core::metadata_checksum::is_sealed;

/// Serial numbers of the actuators in a log, from its writer's configuration; none in a text log.
#[must_use]
pub fn serial_numbers(log: &Path) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    // Nothing else than a regular file can be read twice.
    if !log.metadata().is_ok_and(|of| of.is_file()) {
        return found;
    }
    let Ok(file) = File::open(log) else { return found };
    let Ok(mut messages) = McapMessages::new(BufReader::new(file), &log.display().to_string()) else {
        return found;
    };
    // The metadata stand before the first message.
    let _ = messages.next();
    let metadata = messages
        .metadata(METADATA_NAME)
        .filter(|found| is_sealed(METADATA_NAME, found));
    for (key, value) in metadata.into_iter().flatten() {
        if let Some(actuator) = key.strip_suffix(".serial_number") {
            found.insert(actuator.to_owned(), value.clone());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorder::{Recorder, metadata};
    use hmd_core::config::Config;
    use hmd_core::record::Status;

    #[test]
    fn a_log_contains_the_serial_numbers_of_its_units() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("unit.mcap");
        let text = "[[actuator]]\nid = 0\nserial_number = \"S7\"";
        let config = Config::from_toml_str(text, "test").unwrap();
        let mut recorder = Recorder::create(&path, &metadata(&config, "log", 1)).unwrap();
        recorder.write_status(1, &Status::default()).unwrap();
        recorder.finish().unwrap();
        let expected = BTreeMap::from([("ema0".to_owned(), "S7".to_owned())]);
        assert_eq!(serial_numbers(&path), expected);
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(2).position(|two| two == b"S7").unwrap();
        bytes[at + 1] = b'8';
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(serial_numbers(&path), BTreeMap::new(), "no checksum vouches for S8");
        std::fs::write(&path, "no log").unwrap();
        assert_eq!(serial_numbers(&path), BTreeMap::new());
    }
}
