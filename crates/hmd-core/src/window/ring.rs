//! The last samples by number, with a place for every one that is missing.

use super::TimedSample;
use super::quality::{Defect, Part};
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

    fn numbers(slots: &[Slot]) -> Vec<u64> {
        slots.iter().map(|slot| slot.sample.seq).collect()
    }

    #[test]
    fn slots_are_found_by_their_number_while_they_are_kept() {
        let mut ring = Ring::with_capacity(5);
        assert!(ring.latest().is_none() && ring.newest(1).is_none() && ring.since(0).is_empty());
        for seq in 100..103 {
            ring.push(slot(seq));
        }
        assert!(ring.newest(4).is_none());
        assert_eq!(ring.newest(3).map(numbers), Some(vec![100, 101, 102]));
        assert_eq!(numbers(ring.since(101)), [101, 102]);
        assert_eq!(numbers(ring.since(102)), [102]);
        assert_eq!(
            numbers(ring.since(0)),
            [100, 101, 102],
            "no further back than the first"
        );
        ring.clear();
        assert!(ring.latest().is_none() && ring.since(100).is_empty());
    }

    #[test]
    fn the_capacity_is_kept_whenever_the_memory_is_moved() {
        let mut ring = Ring::with_capacity(5);
        for seq in 0..40 {
            ring.push(slot(seq));
            if seq >= 4 {
                assert_eq!(numbers(ring.since(seq - 4)), (seq - 4..=seq).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn a_copy_is_the_same_sample_under_its_number_and_was_received() {
        let timed = |slot: Slot| TimedSample {
            seq: slot.sample.seq,
            stamp_ns: 77,
            sensed: SensedSample { seq: 0, ..slot.sample },
        };
        let mut ring = Ring::with_capacity(5);
        assert!(!ring.holds_copy_of(&timed(slot(3))));
        for seq in 10..13 {
            ring.push(slot(seq));
        }
        ring.push(slot(12).missing_next());
        for seq in [10, 11, 12] {
            assert!(ring.holds_copy_of(&timed(slot(seq))), "{seq}");
        }
        assert!(!ring.holds_copy_of(&timed(slot(9))), "before the first");
        assert!(!ring.holds_copy_of(&timed(slot(14))), "after the last");
        assert!(!ring.holds_copy_of(&timed(slot(12).missing_next())), "never received");
        assert_eq!(
            Slot::received(&timed(slot(11))),
            Slot {
                stamp_ns: 77,
                ..slot(11)
            }
        );
        let mut other = slot(11);
        other.sample.output_counts = 1;
        assert!(!ring.holds_copy_of(&timed(other)));
    }

    #[test]
    fn a_place_without_sample_lacks_every_part_and_holds_the_setpoint() {
        let mut before = slot(7);
        before.sample.setpoint = Setpoint::Speed(3.0);
        let missing = before.missing_next();
        assert_eq!((missing.sample.seq, missing.sample.setpoint), (8, Setpoint::Speed(3.0)));
        assert!(before.was_received() && !before.is_flawed());
        assert!(!missing.was_received() && missing.is_flawed());
        assert_eq!(missing.first_defect(), Some(Defect::Missing));
        for part in [Part::Currents, Part::Motor, Part::Output, Part::Setpoint] {
            assert!(before.is_good(part) && !missing.is_good(part));
        }
    }

    #[test]
    fn a_refused_part_keeps_its_first_reason_and_the_others_are_good() {
        let mut slot = slot(7);
        slot.refuse(Part::Setpoint, Defect::CommandGlitch);
        slot.refuse(Part::Setpoint, Defect::Repeated);
        assert!(slot.is_command_glitch() && slot.was_received() && slot.is_flawed());
        assert!(slot.is_good(Part::Motor) && !slot.is_good(Part::Setpoint));
        slot.refuse(Part::Motor, Defect::Repeated);
        assert_eq!(slot.first_defect(), Some(Defect::Repeated));
        let mut other = slot.missing_next();
        other.refuse(Part::Setpoint, Defect::CommandGlitch);
        assert!(!other.is_command_glitch());
    }
}
