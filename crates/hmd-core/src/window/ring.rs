//! The last samples by number, with a place for every one that is missing.

use super::TimedSample;
use super::verdict::{Defect, Part};
use ema_models::SensedSample;

/// One place on the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slot {
    pub(super) sample: SensedSample,
    pub(super) stamp_ns: u64,
    /// Why each [`Part`] cannot be used, if so.
    defects: [Option<Defect>; Part::COUNT],
}

impl Slot {
    pub(super) fn received(sample: &TimedSample) -> Self {
        Self {
            sample: SensedSample {
                seq: sample.seq,
                ..sample.sensed
            },
            stamp_ns: sample.stamp_ns,
            defects: [None; Part::COUNT],
        }
    }

    /// The place after this one, of a sample that did not come; it holds the setpoint.
    pub(super) fn missing_next(&self) -> Self {
        let sample = SensedSample {
            seq: self.sample.seq + 1,
            ..self.sample
        };
        Self {
            sample,
            stamp_ns: 0,
            defects: [Some(Defect::Missing); Part::COUNT],
        }
    }

    pub(super) fn was_received(&self) -> bool {
        self.defects != [Some(Defect::Missing); Part::COUNT]
    }

    pub(super) fn is_good(&self, part: Part) -> bool {
        self.defects[part as usize].is_none()
    }

    /// Whether any part is missing or refused.
    pub(super) fn is_flawed(&self) -> bool {
        self.first_defect().is_some()
    }

    pub(super) fn first_defect(&self) -> Option<Defect> {
        self.defects.iter().find_map(|&defect| defect)
    }

    pub(super) fn is_command_glitch(&self) -> bool {
        self.defects[Part::Setpoint as usize] == Some(Defect::CommandGlitch)
    }

    /// Refuses a part; the first reason stays.
    pub(super) fn refuse(&mut self, part: Part, why: Defect) {
        self.defects[part as usize].get_or_insert(why);
    }
}

/// A ring of slots with consecutive sample numbers; its memory is reserved once.
///
/// The oldest slot makes room for the newest. Slots lie so that the window can be handed out as one slice: the buffer is
/// twice the capacity, and is moved to its front once per capacity.
#[derive(Clone, Debug)]
pub(super) struct Ring {
    slots: Vec<Slot>,
    capacity: usize,
}

impl Ring {
    pub(super) fn with_capacity(capacity: usize) -> Self {
        Self {
            slots: Vec::with_capacity(2 * capacity),
            capacity,
        }
    }

    /// Adds the slot that follows the latest.
    pub(super) fn push(&mut self, slot: Slot) {
        debug_assert!(
            self.latest()
                .is_none_or(|latest| latest.sample.seq + 1 == slot.sample.seq)
        );
        if self.slots.len() == 2 * self.capacity {
            self.slots.copy_within(self.capacity + 1.., 0);
            self.slots.truncate(self.capacity - 1);
        }
        self.slots.push(slot);
    }

    pub(super) fn clear(&mut self) {
        self.slots.clear();
    }

    pub(super) fn latest(&self) -> Option<&Slot> {
        self.slots.last()
    }

    /// The newest `count` slots, oldest first; `None` while there are fewer.
    pub(super) fn newest(&self, count: usize) -> Option<&[Slot]> {
        debug_assert!(count <= self.capacity);
        self.slots.len().checked_sub(count).map(|start| &self.slots[start..])
    }

    /// All slots from a sample number on.
    pub(super) fn since(&mut self, first_seq: u64) -> &mut [Slot] {
        let count = self
            .latest()
            .map_or(0, |latest| latest.sample.seq.saturating_sub(first_seq) + 1) as usize;
        let start = self.slots.len().saturating_sub(count);
        &mut self.slots[start..]
    }

    /// Whether the very same sample lies here already.
    pub(super) fn holds_copy_of(&self, sample: &TimedSample) -> bool {
        let Some(latest) = self.latest() else { return false };
        let back = latest
            .sample
            .seq
            .checked_sub(sample.seq)
            .and_then(|back| usize::try_from(back).ok());
        back.and_then(|back| self.slots.len().checked_sub(back + 1))
            .is_some_and(|index| {
                let slot = &self.slots[index];
                slot.was_received()
                    && slot.sample
                        == SensedSample {
                            seq: sample.seq,
                            ..sample.sensed
                        }
            })
    }

    #[cfg(test)]
    pub(super) fn reserved(&self) -> usize {
        self.slots.capacity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::Setpoint;

    fn slot(seq: u64) -> Slot {
        let sensed = SensedSample {
            seq,
            currents: [0.0; 3],
            motor_counts: seq as i64,
            output_counts: 0,
            setpoint: Setpoint::Idle,
        };
        Slot::received(&TimedSample {
            seq,
            stamp_ns: 0,
            sensed,
        })
    }

    #[test]
    fn the_newest_are_kept_in_order_and_memory_does_not_grow() {
        let mut ring = Ring::with_capacity(7);
        let reserved = ring.reserved();
        for seq in 0..1000 {
            ring.push(slot(seq));
            let count = 7.min(seq as usize + 1);
            let numbers: Vec<u64> = ring.newest(count).unwrap().iter().map(|s| s.sample.seq).collect();
            assert_eq!(numbers, (seq + 1 - count as u64..=seq).collect::<Vec<_>>());
        }
        assert_eq!(ring.reserved(), reserved);
        assert_eq!(ring.since(995).len(), 5);
    }
}
