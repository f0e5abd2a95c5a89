//! What is on the disk after damage, kills and failures of the disk.

mod captures;
mod failing_disk;
mod in_progress;
mod killed;
mod power_cut;
mod recover;
mod side_by_side;
mod survive;
mod survive_rig;

use std::path::Path;
use std::process::Command;

/// What a verb says on stdout; it does its work and loses nothing.
#[allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]
fn hmd(folder: &Path, line: &str) -> String {
    hmd_with_code(folder, line, 0)
}

/// The same of a run that ends with another code.
#[allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]
fn hmd_with_code(folder: &Path, line: &str, code: i32) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
    let ended = command.args(line.split(' ')).current_dir(folder).output().unwrap();
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(code), "hmd {line}: {stderr}");
    String::from_utf8(ended.stdout).unwrap()
}

#[test]
#[ignore = "the process that the others start, and end"]
fn writer() {
    survive_rig::write();
}
