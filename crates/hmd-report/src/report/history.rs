//! What recorded files say of one actuator.

use std::collections::BTreeMap;

use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;
use hmd_core::record::{Estimate, Health, Rul, Window};

/// One window of a history.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Number of the window.
    pub window: u64,
    /// Its start, UTC ns.
    pub t_start_ns: u64,
    /// `ok`, `degraded`, `invalid` or `unmodelled`.
    pub status: String,
    /// State of health.
    pub health: String,
    /// Fault vector, if it was assessed.
    pub estimate: Option<Estimate>,
    /// Root mean square of the current residual, A.
    pub residual_rms_a: Option<f64>,
    /// Operating hours so far.
    pub used_h: Option<f64>,
    /// Hours left: 10, 50 and 90 % quantile.
    pub left_h: Option<[f64; 3]>,
    /// What was replaced before it: `unit`, or parts, joined by commas.
    pub replaced: String,
    /// Names of the faults that it reported.
    pub faults: Vec<String>,
}

/// What is known of one actuator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Its name.
    pub actuator: String,
    /// Its windows, as recorded.
    pub points: Vec<Point>,
    /// The newest health record, and what was left then.
    pub newest: (Health, Rul),
    /// The newest health record with an estimate.
    pub assessed: Option<Health>,
    /// Part and serial number, in words; empty where its configuration had none.
    pub identity: String,
    /// The newest window that was fitted.
    pub fitted: Option<Window>,
    /// Samples of all windows: called for, received, missing.
    pub samples: [u64; 3],
    /// Reasons of windows that are not `ok`, with their number.
    pub reasons: BTreeMap<String, u64>,
    /// What was replaced after the newest window, as it was entered, each once: a part, or `None` for the whole actuator.
    pub replaced_since: Vec<Option<ReplacedPart>>,
}

/// The newest windows, as far as none of them was assessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unassessed {
    /// How many.
    pub(super) windows: usize,
    /// Start of the first of them, UTC ns.
    pub(super) since_ns: u64,
}

impl History {
    /// The newest windows without an estimate; `None` if the newest has one.
    pub(super) fn unassessed(&self) -> Option<Unassessed> {
        let tail = self.points.rsplit(|point| point.estimate.is_some()).next()?;
        tail.first().map(|first| Unassessed {
            windows: tail.len(),
            since_ns: first.t_start_ns,
        })
    }

    /// The record that damages are taken from: the newest with an estimate, unless the history began anew since.
    pub(super) fn damaged_as_of(&self) -> &Health {
        let newest = &self.newest.0;
        let knows_nothing = HealthState::named(&newest.health) == HealthState::Unknown;
        self.assessed.as_ref().filter(|_| !knows_nothing).unwrap_or(newest)
    }

    /// Goes on with what a later file says of the same actuator.
    pub(super) fn go_on(&mut self, later: Self) {
        let Self {
            actuator: _,
            points,
            newest,
            assessed,
            identity,
            fitted,
            samples,
            reasons,
            replaced_since: _,
        } = later;
        if !points.is_empty() {
            self.newest = newest;
        }
        self.points.extend(points);
        self.assessed = assessed.or(self.assessed.take());
        if !identity.is_empty() {
            self.identity = identity;
        }
        self.fitted = fitted.or(self.fitted.take());
        for (sum, count) in self.samples.iter_mut().zip(samples) {
            *sum += count;
        }
        for (reason, count) in reasons {
            *self.reasons.entry(reason).or_default() += count;
        }
    }
}
