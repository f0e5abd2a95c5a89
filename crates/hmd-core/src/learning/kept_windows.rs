//! Which windows of a unit wait for its commissioning. `model` explores it state by state.

/// The newest windows of a unit that is not commissioned yet, oldest first.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct KeptWindows<W>(Vec<W>);

impl<W> Default for KeptWindows<W> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<W> KeptWindows<W> {
    /// Windows kept.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Keeps a window; whether the unit can be commissioned now, which takes `needed` windows.
    pub(crate) fn keep(&mut self, window: W, needed: usize) -> bool {
        self.0.push(window);
        self.0.len() >= needed
    }

    /// The windows, oldest first.
    pub(crate) fn windows(&self) -> &[W] {
        &self.0
    }

    /// Drops the older half, of an odd number the larger one, after a commissioning that failed: the newer may belong to a unit in
    /// another condition. At least one goes, so that the next attempt has a window more to learn from.
    pub(crate) fn drop_older_half(&mut self) {
        self.0.drain(..self.0.len().div_ceil(2));
    }
}
