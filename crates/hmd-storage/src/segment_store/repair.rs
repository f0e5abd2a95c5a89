//! Repairs the segments of earlier runs at a start: some of them were cut.
//!
//! A source goes only when nothing but its torn end was lost. Where a repair loses more, the source is kept beside the
//! copy ([`Stage::Damaged`]), for inspection; of those, the newest [`DAMAGED_MAX`] stay.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::disk::{Disk, rename};
use super::name::{NUMBER_MAX, Name, PROFILE, Stage, has_torn_start, is_segment};
use crate::mcap::McapFault;
use crate::recover::{RecoverError, Recovered, recover_within};
use crate::regular_file::open_regular;
use hmd_core::counted::counted;
use hmd_core::record::LogLevel;

/// Most damaged segments that are kept as they were; the oldest go.
const DAMAGED_MAX: usize = 8;
/// Most foreign files that are reported by name; the rest is counted.
const FOREIGN_REPORTED_MAX: usize = 16;

/// Longest cut segment that is repaired before the start is over, bytes; longer ones are repaired beside the watch.
const AT_START_BYTES_MAX: u64 = 8 << 20;
/// Bytes that chunks may expand to before the start is over: less than half a second of work. The rest is left to the background.
const AT_START_EXPANDED_MAX: u64 = 64 << 20;

/// Contents of the folder.
#[derive(Debug)]
pub(super) struct Found {
    /// Segments of ours, with their sizes. One that could not be repaired stays at [`Stage::Open`].
    pub(super) segments: BTreeMap<Name, u64>,
    /// One more than the largest number in any name.
    pub(super) next_number: u64,
    /// Notices for an operator.
    pub(super) messages: Vec<(LogLevel, String)>,
    /// Cut segments that are left to [`repair_one`]; they are among the segments, too.
    pub(super) pending: Vec<Name>,
    limits: Limits,
}

/// Up to where segments are repaired; what is not done by then is postponed.
#[derive(Debug, Default)]
struct Limits {
    /// What the chunks to come may expand to, where a start waits for them.
    expand_bytes_left: Option<u64>,
    /// Set when the process ends.
    stopped: Arc<AtomicBool>,
}

impl Limits {
    fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Reads every name in the folder, repairs cut segments, and touches nothing else.
///
/// # Errors
/// When the folder cannot be listed.
pub(super) fn repair_folder(folder: &Path, disk: &dyn Disk) -> io::Result<Found> {
    let mut found = Found::within(Limits {
        expand_bytes_left: Some(AT_START_EXPANDED_MAX),
        ..Limits::default()
    });
    let (mut ours, mut others) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let Some(name) = entry.file_name().to_str().and_then(Name::parse) else {
            continue;
        };
        let regular = entry.metadata().is_ok_and(|about| about.is_file());
        let is_segment = regular && is_segment(&entry.path()).unwrap_or(false);
        // No file must use our numbers up, whoever gave it its name.
        if name.number < NUMBER_MAX / 2 {
            found.next_number = found.next_number.max(name.number + 1);
        }
        if is_segment { &mut ours } else { &mut others }.push(name);
    }
    ours.sort_unstable();
    others.sort_unstable();
    // A power cut may leave the copy without its beginning; beside its source it counts as a segment.
    let (torn, others): (Vec<_>, Vec<_>) = others.into_iter().partition(|name| {
        let path = folder.join(name.to_string());
        name.stage == Stage::Repair
            && ours.contains(&name.with_stage(Stage::Open))
            && !path.is_symlink()
            && has_torn_start(&path).unwrap_or(false)
    });
    found.report_foreign(&others);
    let at = |stage| ours.iter().copied().filter(move |name| name.stage == stage);
    for name in at(Stage::Repair).chain(torn) {
        // A repair that was itself cut; its source is still there.
        found.remove(folder, name, disk);
    }
    for name in at(Stage::Open) {
        if found.limits.expand_bytes_left != Some(0) && size_of(folder, name) <= AT_START_BYTES_MAX {
            found.mend(folder, name, disk);
        } else {
            found.postpone(folder, name);
        }
    }
    if !found.pending.is_empty() {
        let segments = counted(found.pending.len() as u64, "cut segment is", "cut segments are");
        let text = format!("{segments} repaired in the background");
        found.report(LogLevel::Info, &text);
    }
    for name in at(Stage::Closed) {
        found.add(folder, name);
    }
    found.thin_out_damaged(folder, disk)?;
    Ok(found)
}

/// Repairs one cut segment that [`repair_folder`] left; it is still pending where `stopped` came meanwhile.
pub(super) fn repair_one(folder: &Path, name: Name, disk: &dyn Disk, stopped: &Arc<AtomicBool>) -> Found {
    let mut found = Found::within(Limits {
        expand_bytes_left: None,
        stopped: stopped.clone(),
    });
    // It may have been deleted for room meanwhile.
    if folder.join(name.to_string()).exists() {
        found.mend(folder, name, disk);
    }
    if let Err(cause) = found.thin_out_damaged(folder, disk) {
        found.report(LogLevel::Error, &format!("damaged segments cannot be listed: {cause}"));
    }
    found
}

/// Whether a cut segment was repaired, and only what becomes of it is left to do.
fn has_copy(folder: &Path, name: Name) -> bool {
    let closed = folder.join(name.with_stage(Stage::Closed).to_string());
    is_segment(&closed).unwrap_or(false)
}

fn size_of(folder: &Path, name: Name) -> u64 {
    fs::metadata(folder.join(name.to_string())).map_or(0, |about| about.len())
}

impl Found {
    fn within(limits: Limits) -> Self {
        Self {
            segments: BTreeMap::new(),
            next_number: 0,
            messages: Vec::new(),
            pending: Vec::new(),
            limits,
        }
    }

    fn postpone(&mut self, folder: &Path, name: Name) {
        self.pending.push(name);
        // One that has its copy is counted by that.
        if !has_copy(folder, name) {
            self.add(folder, name);
        }
    }

    fn report(&mut self, level: LogLevel, text: &str) {
        self.messages.push((level, format!("storage: {text}")));
    }

    fn report_foreign(&mut self, others: &[Name]) {
        for name in others.iter().take(FOREIGN_REPORTED_MAX) {
            let text = format!("{name} is not one of our segments; it is left alone");
            self.report(LogLevel::Warning, &text);
        }
        if let Some(more) = others.len().checked_sub(FOREIGN_REPORTED_MAX).filter(|more| *more > 0) {
            let text = format!(
                "{}; left alone",
                counted(
                    more as u64,
                    "more file with the name of a segment is none",
                    "more files with names of segments are none"
                )
            );
            self.report(LogLevel::Warning, &text);
        }
    }

    fn add(&mut self, folder: &Path, name: Name) {
        self.segments.insert(name, size_of(folder, name));
    }

    /// What cannot be removed is not counted: the closed one of the same number is, and the next start tries again.
    fn remove(&mut self, folder: &Path, name: Name, disk: &dyn Disk) {
        if let Err(cause) = disk.remove(&folder.join(name.to_string()))
            && cause.kind() != io::ErrorKind::NotFound
        {
            self.report(LogLevel::Error, &format!("{name} cannot be removed: {cause}"));
        }
    }

    fn mend(&mut self, folder: &Path, name: Name, disk: &dyn Disk) {
        if has_copy(folder, name) {
            // Repaired and renamed; only what becomes of the source was cut.
            self.settle(folder, name, disk);
        } else {
            self.repair(folder, name, disk);
        }
    }

    fn repair(&mut self, folder: &Path, name: Name, disk: &dyn Disk) {
        let repaired = repaired(folder, name, disk, &self.limits);
        repaired.iter().for_each(|repaired| self.account(repaired));
        match repaired {
            Ok(repaired) if repaired.is_postponed => self.postpone(folder, name),
            Ok(repaired) => {
                let closed = name.with_stage(Stage::Closed);
                let (bytes, is_spent) = (repaired.bytes, repaired.is_source_spent);
                let (messages, lost) = (repaired.report.messages, repaired.report.losses_total);
                let lost = counted(lost, "damaged place", "damaged places");
                let text = match messages {
                    0 if is_spent => format!("before its first record, after {bytes} bytes"),
                    0 => format!("none of its {bytes} bytes could be kept; {lost}"),
                    _ => {
                        let records = counted(messages, "record", "records");
                        format!("{records} kept in {closed}; {lost} in its {bytes} bytes")
                    }
                };
                self.report(LogLevel::Warning, &format!("{name} was cut: {text}"));
                if messages > 0 {
                    self.add(folder, closed);
                }
                self.dispose(folder, name, is_spent, disk);
            }
            Err(cause) => {
                // It may be repaired by the next start, or by hand; its copy may be there, and not safe yet.
                let closed = name.with_stage(Stage::Closed);
                self.add(folder, if has_copy(folder, name) { closed } else { name });
                self.report(
                    LogLevel::Error,
                    &format!("{name} was cut and cannot be repaired: {cause}"),
                );
            }
        }
    }

    fn account(&mut self, repaired: &Repaired) {
        if let Some(left) = &mut self.limits.expand_bytes_left {
            let expanded = repaired.report.expanded_bytes;
            *left = if repaired.is_postponed {
                0
            } else {
                left.saturating_sub(expanded)
            };
        }
    }

    /// Does with a source that has its copy what the repair would have done.
    fn settle(&mut self, folder: &Path, name: Name, disk: &dyn Disk) {
        let copied = copied(folder, name, io::empty(), &self.limits);
        copied.iter().for_each(|copied| self.account(copied));
        match copied {
            Ok(copied) if copied.is_postponed => self.postpone(folder, name),
            Ok(copied) => self.dispose(folder, name, copied.is_source_spent, disk),
            Err(cause) => {
                let text = format!("{name} was repaired and cannot be read again: {cause}");
                self.report(LogLevel::Error, &text);
            }
        }
    }

    /// Removes the source of a repair, or keeps it aside.
    fn dispose(&mut self, folder: &Path, name: Name, is_spent: bool, disk: &dyn Disk) {
        if is_spent {
            return self.remove(folder, name, disk);
        }
        let aside = name.with_stage(Stage::Damaged);
        match rename(disk, folder, name, aside) {
            Ok(()) => self.report(LogLevel::Error, &format!("{name} was damaged, and is kept as {aside}")),
            // It was deleted for room meanwhile.
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => {}
            Err(cause) => {
                let text = format!("{name} was damaged, and cannot be kept as {aside}: {cause}; it stays");
                self.report(LogLevel::Error, &text);
            }
        }
    }

    /// Removes the oldest damaged segments beyond [`DAMAGED_MAX`].
    fn thin_out_damaged(&mut self, folder: &Path, disk: &dyn Disk) -> io::Result<()> {
        let mut damaged = Vec::new();
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let name = entry.file_name().to_str().and_then(Name::parse);
            let regular = entry.metadata().is_ok_and(|about| about.is_file());
            if let Some(name) = name.filter(|name| regular && name.stage == Stage::Damaged)
                && is_segment(&entry.path()).unwrap_or(false)
            {
                damaged.push(name);
            }
        }
        damaged.sort_unstable();
        let beyond = damaged.len().saturating_sub(DAMAGED_MAX);
        for name in damaged.into_iter().take(beyond) {
            let text = format!("{name} is removed: the newest {DAMAGED_MAX} damaged segments are kept");
            self.report(LogLevel::Warning, &text);
            self.remove(folder, name, disk);
        }
        Ok(())
    }
}

/// What became of a cut segment.
struct Repaired {
    report: Recovered,
    /// Size of the source.
    bytes: u64,
    /// All that was in the source is in the copy, but for its torn end.
    is_source_spent: bool,
    /// It was given up for the sake of the start; there is no copy.
    is_postponed: bool,
}

/// Writes the intact part of a cut segment beside it and gives it the closed name, if there is any.
fn repaired(folder: &Path, name: Name, disk: &dyn Disk, limits: &Limits) -> Result<Repaired, RecoverError> {
    let output_error = |cause: io::Error| RecoverError::Output(cause.into());
    let copy = folder.join(name.with_stage(Stage::Repair).to_string());
    let out = disk.create(&copy).map_err(output_error)?;
    // The copy ends with a flush, which for a segment is a sync.
    let copied = copied(folder, name, out, limits);
    let is_kept = |copied: &Repaired| copied.report.messages > 0 && !copied.is_postponed;
    let kept = copied.as_ref().is_ok_and(is_kept);
    let renamed = kept.then(|| {
        rename(
            disk,
            folder,
            name.with_stage(Stage::Repair),
            name.with_stage(Stage::Closed),
        )
    });
    if !matches!(renamed, Some(Ok(()))) {
        // It is ours: it was made above. After a folder that could not be synced it has its new name.
        match disk.remove(&copy) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(output_error(cause)),
            _ => {}
        }
    }
    renamed.transpose().map_err(output_error)?;
    copied
}

/// Copies the intact part of a cut segment.
fn copied<W: Write + Seek>(folder: &Path, name: Name, out: W, limits: &Limits) -> Result<Repaired, RecoverError> {
    let input_error = |cause| RecoverError::Input {
        file: name.to_string(),
        cause,
    };
    let mut input = open_regular(&folder.join(name.to_string())).map_err(input_error)?;
    let bytes = input.metadata().map_err(input_error)?.len();
    let limit = limits.expand_bytes_left.unwrap_or(u64::MAX);
    let is_stopped = || limits.is_stopped();
    let (_, report) = recover_within(&input, &name.to_string(), out, PROFILE, limit, &is_stopped)?;
    let is_source_spent = is_spent(&mut input, &report).map_err(input_error)?;
    Ok(Repaired {
        is_postponed: report.is_given_up && (limits.expand_bytes_left.is_some() || limits.is_stopped()),
        report,
        bytes,
        is_source_spent,
    })
}

/// Whether nothing but a torn end was lost; of a segment without any record, not even a torn chunk.
fn is_spent(input: &mut fs::File, report: &Recovered) -> io::Result<bool> {
    if report.is_intact() {
        return Ok(true);
    }
    let torn_at = match report.losses.as_slice() {
        // Behind a length that is wrong, chunks may follow: then it is no end.
        [loss]
            if loss.fault == McapFault::Truncated
                && report.attachments_lost == 0
                && report.last_chunk_at.is_none_or(|at| at < loss.at_byte) =>
        {
            loss.at_byte
        }
        _ => return Ok(false),
    };
    let mut opcode = Vec::new();
    input.seek(SeekFrom::Start(torn_at))?;
    input.take(1).read_to_end(&mut opcode)?;
    Ok(report.messages > 0 || opcode != [mcap::records::op::CHUNK])
}

#[cfg(test)]
mod tests;
