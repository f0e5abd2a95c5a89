//! A window made ready for comparison once, for the many monitor runs of a search on the host.

use std::vec;
use std::vec::Vec;

use ema_models::{ActuatorParams, ComparedSample, InitialState, Recording, SensedSample, prepare_window};

use crate::counter_alignment::align_counters;
use crate::relations::{ByTypeBalance, by_type_balance};

/// A window made ready for comparison, owning its samples.
#[derive(Clone, Debug)]
pub struct Prepared {
    samples: Vec<ComparedSample>,
    initial: InitialState,
    /// As the sensors delivered them, and the indices of those that were not measured.
    sensed: Vec<SensedSample>,
    filled: Vec<usize>,
}

impl Prepared {
    /// Makes a window ready; its first `rest` samples precede the trigger, those of the indices `filled` were not measured, and
    /// `output_zero` is that of its unit, rad, where it is [known](crate::output_zero).
    #[must_use]
    pub fn new(
        params: &ActuatorParams,
        window: &[SensedSample],
        filled: &[usize],
        rest: usize,
        output_zero: Option<f64>,
    ) -> Self {
        let mut sensed = window.to_vec();
        let output_zero = align_counters(params, &mut sensed, output_zero);
        let mut samples = vec![ComparedSample::default(); sensed.len()];
        let initial = prepare_window(params, &sensed, filled, rest, output_zero, &mut samples);
        Self {
            samples,
            initial,
            sensed,
            filled: filled.to_vec(),
        }
    }

    /// What the torque balance of the type says of the window; `None` where the motion is too short.
    pub(crate) fn by_type_balance(&self, params: &ActuatorParams) -> Option<ByTypeBalance> {
        by_type_balance(params, &self.sensed, &self.filled, self.initial.backlash)
    }

    /// The samples and their initial state.
    #[must_use]
    pub fn recording(&self) -> Recording<'_> {
        Recording {
            samples: &self.samples,
            drive: &self.samples,
            initial: self.initial,
        }
    }
}
