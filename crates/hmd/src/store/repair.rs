//! What a start finds: segments of earlier runs, some of them cut.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::Path;

use super::disk::{Disk, rename};
use super::name::{Name, PROFILE, Stage, is_ours};
use crate::record::LogLevel;
use crate::recover::{RecoverError, recover};

/// What lies in the folder.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Segments of ours, with their sizes. One that could not be repaired stays at [`Stage::Open`].
    pub(super) segments: BTreeMap<Name, u64>,
    /// One more than the largest number in any name.
    pub(super) next_number: u64,
    /// What an operator should read.
    pub(super) messages: Vec<(LogLevel, String)>,
}

/// Looks at every name in the folder, repairs cut segments, and touches nothing else.
///
/// # Errors
/// When the folder cannot be listed.
pub(super) fn look(folder: &Path, disk: &dyn Disk) -> io::Result<Found> {
    let mut found = Found::default();
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let Some(name) = entry.file_name().to_str().and_then(Name::parse) else {
            continue;
        };
        found.next_number = found.next_number.max(name.number + 1);
        let regular = entry.metadata().is_ok_and(|about| about.is_file());
        if regular && is_ours(&entry.path()).unwrap_or(false) {
            names.push(name);
        } else {
            let text = format!("storage: {name} is not one of our segments; it is left alone");
            found.messages.push((LogLevel::Warning, text));
        }
    }
    names.sort_unstable();
    for name in names.iter().filter(|name| name.stage == Stage::Repair) {
        // A repair that was itself cut; its source is still there.
        found.remove(folder, *name);
    }
    for name in names.iter().filter(|name| name.stage == Stage::Open) {
        if names.contains(&name.at(Stage::Closed)) {
            // Repaired and renamed; only the removal of the source was cut.
            found.remove(folder, *name);
        } else {
            found.repair(folder, *name, disk);
        }
    }
    for name in names.iter().filter(|name| name.stage == Stage::Closed) {
        found.add(folder, *name);
    }
    Ok(found)
}

impl Found {
    fn add(&mut self, folder: &Path, name: Name) {
        let size = fs::metadata(folder.join(name.to_string())).map_or(0, |about| about.len());
        self.segments.insert(name, size);
    }

    fn remove(&mut self, folder: &Path, name: Name) {
        if let Err(cause) = fs::remove_file(folder.join(name.to_string())) {
            let text = format!("storage: {name} cannot be removed: {cause}");
            self.messages.push((LogLevel::Error, text));
            self.add(folder, name);
        }
    }

    fn repair(&mut self, folder: &Path, name: Name, disk: &dyn Disk) {
        let (level, text) = match repaired(folder, name, disk) {
            Ok((0, _, bytes)) => {
                self.remove(folder, name);
                let text = format!("{name} was cut before its first record; its {bytes} bytes are removed");
                (LogLevel::Warning, text)
            }
            Ok((messages, damaged, bytes)) => {
                let closed = name.at(Stage::Closed);
                self.add(folder, closed);
                self.remove(folder, name);
                let text = format!(
                    "{name} was cut: {messages} records kept in {closed}; {damaged} damaged places in its {bytes} bytes"
                );
                (LogLevel::Warning, text)
            }
            Err(cause) => {
                // It may be repaired by the next start, or by hand.
                let _ = fs::remove_file(folder.join(name.at(Stage::Repair).to_string()));
                self.add(folder, name);
                (
                    LogLevel::Error,
                    format!("{name} was cut and cannot be repaired: {cause}"),
                )
            }
        };
        self.messages.push((level, format!("storage: {text}")));
    }
}

/// Writes the intact part of a cut segment beside it and gives it the closed name; messages kept, damaged places, and
/// bytes of the cut one.
fn repaired(folder: &Path, name: Name, disk: &dyn Disk) -> Result<(u64, u64, u64), RecoverError> {
    let path = |stage| folder.join(name.at(stage).to_string());
    let input_error = |cause| RecoverError::Input {
        file: name.to_string(),
        cause,
    };
    let input = fs::File::open(path(Stage::Open)).map_err(input_error)?;
    let bytes = input.metadata().map_err(input_error)?.len();
    let output_error = |cause: io::Error| RecoverError::Output(cause.into());
    let out = disk.create(&path(Stage::Repair)).map_err(output_error)?;
    // The copy ends with a flush, which for a segment is a sync.
    let (_, report) = recover(input, &name.to_string(), out, PROFILE)?;
    if report.messages == 0 {
        fs::remove_file(path(Stage::Repair)).map_err(output_error)?;
    } else {
        rename(folder, name.at(Stage::Repair), name.at(Stage::Closed)).map_err(output_error)?;
    }
    Ok((report.messages, report.losses_total, bytes))
}
