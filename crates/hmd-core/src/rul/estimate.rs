//! Damage that one window showed.

use serde::{Deserialize, Serialize};

use super::usage::Odometer;

/// Two estimates further apart than this, in standard deviations, do not agree.
pub(super) const DISAGREEMENT_SIGMAS: f64 = 5.0;

/// Damage at some use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Estimate {
    pub(super) at: Odometer,
    pub(super) damage: f64,
    pub(super) variance: f64,
}
