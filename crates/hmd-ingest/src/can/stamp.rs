//! From the clock of a CAN controller to UTC.
//!
//! A hardware stamp says best when a frame came, but on a clock of its own; the kernel's software stamp is UTC, but late
//! by what else the computer had to do. So the hardware clock is tied to UTC by the software stamps, slowly: the
//! jitter averages out, and a drift of 100 ppm stays below 0.1 ms at 1 000 frames/s.

/// Ties a hardware clock to UTC.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HardwareClock {
    /// UTC minus hardware time, ns.
    offset_ns: Option<i128>,
}

impl HardwareClock {
    /// Share of a new difference that is taken over, as a divisor.
    const SMOOTHING: i128 = 1024;
    /// A difference above this, ns, is a clock that was set: tied anew at once.
    const JUMP_NS: i128 = 100_000_000;

    /// UTC of a frame, ns, from its two stamps, ns.
    pub(super) fn utc_ns(&mut self, hardware_ns: u64, software_ns: u64) -> u64 {
        let seen = i128::from(software_ns) - i128::from(hardware_ns);
        let offset = match self.offset_ns {
            Some(offset) if (seen - offset).abs() <= Self::JUMP_NS => offset + (seen - offset) / Self::SMOOTHING,
            _ => seen,
        };
        self.offset_ns = Some(offset);
        u64::try_from(i128::from(hardware_ns) + offset).unwrap_or(software_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EPOCH_NS: u64 = 1_700_000_000_000_000_000;

    #[test]
    fn jitter_of_the_software_stamps_does_not_reach_the_frames() {
        let mut clock = HardwareClock::default();
        for n in 0..10_000u64 {
            let (hardware, late) = (5_000 + n * 1_000_000, (n % 7) * 1_000_000);
            let utc = clock.utc_ns(hardware, EPOCH_NS + n * 1_000_000 + late);
            let jitter = utc.abs_diff(EPOCH_NS + n * 1_000_000 + 3_000_000);
            assert!(n < 5_000 || jitter < 30_000, "frame {n}: {jitter} ns");
        }
    }

    #[test]
    fn drift_is_followed_and_a_set_clock_is_tied_anew() {
        let mut clock = HardwareClock::default();
        for n in 0..100_000u64 {
            let utc = EPOCH_NS + n * 1_000_000;
            let hardware = n * 1_000_100; // 100 ppm fast
            let off = clock.utc_ns(hardware, utc).abs_diff(utc);
            assert!(off < 110_000, "frame {n}: {off} ns");
        }
        let later = EPOCH_NS + 3_600_000_000_000;
        assert_eq!(clock.utc_ns(7, later), later);
    }
}
