//! Slots for the tests of the modules below.

use ema_models::{ActuatorParams, SensedSample, Setpoint};

use super::limits::Limits;
use super::quality::Part;
use super::ring::Slot;
use super::{TimedSample, WindowConfig};

/// Number of the first sample: far enough from 0 to show a number that is taken for an index.
pub(super) const FIRST: u64 = 1_000_000;

/// Limits of the bench with the default settings.
pub(super) fn limits(sample_rate: f64) -> Limits {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = sample_rate;
    Limits::new(&WindowConfig::default(), &params)
}

/// Samples at 2 kHz of an actuator at rest, changed by `change`, which gets the index.
pub(super) fn slots(count: usize, change: impl Fn(usize, &mut SensedSample)) -> Vec<Slot> {
    (0..count)
        .map(|n| {
            let seq = FIRST + n as u64;
            let mut sensed = SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: 0,
                output_counts: 0,
                setpoint: Setpoint::Position(0.0),
            };
            change(n, &mut sensed);
            Slot::received(&TimedSample {
                seq,
                stamp_ns: 1_000_000_000 + 500_000 * n as u64,
                sensed,
            })
        })
        .collect()
}

/// The sample of this index, not the first, did not come.
pub(super) fn lose(slots: &mut [Slot], index: usize) {
    slots[index] = slots[index - 1].missing_next();
}

/// Indices of the slots of which a part is not good.
pub(super) fn flawed_in(slots: &[Slot], part: Part) -> Vec<usize> {
    (0..slots.len()).filter(|&n| !slots[n].is_good(part)).collect()
}
