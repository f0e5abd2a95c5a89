//! The same as `serve.rs` where viewers are not built in: no option and no viewers.

use hmd_storage::recorder::RecordObserver;

/// No option.
#[derive(Debug, clap::Args)]
pub(super) struct Serve {}

/// Nobody.
#[derive(Clone, Debug)]
pub(super) struct Viewers;

#[expect(
    clippy::unnecessary_wraps,
    clippy::unused_self,
    reason = "the other build needs them"
)]
impl Serve {
    pub(super) fn is_asked_for(&self) -> bool {
        false
    }

    pub(super) fn open(&self, _: impl FnOnce(&str)) -> anyhow::Result<Viewers> {
        Ok(Viewers)
    }
}

#[expect(
    clippy::unnecessary_wraps,
    clippy::unused_self,
    reason = "the other build needs them"
)]
impl Viewers {
    pub(super) fn observer(&self) -> Option<Box<dyn RecordObserver>> {
        None
    }

    pub(super) fn wait(&self) -> anyhow::Result<()> {
        Ok(())
    }

    pub(super) fn stay(&self, _: impl FnOnce(&str)) -> anyhow::Result<()> {
        Ok(())
    }

    pub(super) fn finish(&self) {}
}
