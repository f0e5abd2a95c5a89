//! Residuals of the last point at which a monitor ran.

use std::vec::Vec;

use ema_models::SIGNAL_COUNT;

/// Unweighted residuals of each sample, zero where it was not measured.
pub(super) type Rows = Vec<[f64; SIGNAL_COUNT]>;

/// Residuals of one point.
#[derive(Clone, Debug)]
pub(super) struct ResidualsAt<P> {
    pub(super) at: Option<P>,
    pub(super) rows: Rows,
}

impl<P> Default for ResidualsAt<P> {
    fn default() -> Self {
        Self {
            at: None,
            rows: Rows::new(),
        }
    }
}

impl<P: Copy + PartialEq> ResidualsAt<P> {
    /// Those of a point of a window with as many samples; `run` fills them in unless the point was the last one.
    pub(super) fn of(&mut self, at: &P, samples: usize, run: impl FnOnce(&mut Rows)) -> &Rows {
        if self.at != Some(*at) {
            self.at = Some(*at);
            self.rows.clear();
            self.rows.resize(samples, [0.0; SIGNAL_COUNT]);
            run(&mut self.rows);
        }
        &self.rows
    }
}
