//! What is on the disk after damage, kills and failures of the disk.

mod captures;
mod failing_disk;
mod in_progress;
mod power_cut;
mod recover;
mod survive;
mod survive_rig;

#[test]
#[ignore = "the process that the others start, and end"]
fn writer() {
    survive_rig::write();
}
