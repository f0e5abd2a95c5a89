//! Centre-aligned pulse-width modulation of one half bridge, with dead time and exact instants of its edges.

/// Interval of one PWM period in which a leg is commanded high, s from the beginning of the period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pulse {
    rise: f64,
    fall: f64,
}

impl Pulse {
    /// The pulse of a duty cycle, limited to 0 to 1, in the middle of a period.
    pub(super) fn centred(duty: f64, period: f64) -> Self {
        let half = 0.5 * period * duty.clamp(0.0, 1.0);
        Self {
            rise: 0.5 * period - half,
            fall: 0.5 * period + half,
        }
    }
}

/// One half bridge: the commanded level, and the level of its output.
///
/// After a commanded edge both switches are open for the dead time, and the current's diode determines the level: current out of
/// the leg keeps it low, current into the leg keeps it high. So the edge is late by the dead time when the diode holds the old
/// level, and a pulse shorter than the dead time may vanish. A current that reaches zero within the dead time is not modelled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leg {
    commanded: bool,
    high: bool,
    /// Time at which the output follows the command, s from the beginning of the period; infinite while they agree.
    follows_at: f64,
}

impl Default for Leg {
    fn default() -> Self {
        Self {
            commanded: false,
            high: false,
            follows_at: f64::INFINITY,
        }
    }
}

impl Leg {
    /// Whether the output is high.
    pub(super) fn is_high(&self) -> bool {
        self.high
    }

    /// Begins a new PWM period, s after the last one.
    pub(super) fn begin_period(&mut self, period: f64) {
        self.follows_at -= period;
    }

    /// Time of the next change after `t`, s, if the command stays.
    pub(super) fn next_change(&self, pulse: Pulse, t: f64) -> f64 {
        let edge = if t < pulse.rise {
            pulse.rise
        } else if t < pulse.fall {
            pulse.fall
        } else {
            f64::INFINITY
        };
        edge.min(self.follows_at)
    }

    /// Time for which the output is high from `from` to `to` within a period, s, at a current out of the leg, A.
    pub(super) fn advance(&mut self, pulse: Pulse, from: f64, to: f64, dead_time: f64, current: f64) -> f64 {
        let mut time_high = 0.0;
        let mut t = from;
        while t < to {
            let commanded = pulse.rise <= t && t < pulse.fall;
            if commanded != self.commanded {
                self.commanded = commanded;
                let held_by_diode = if commanded { current > 0.0 } else { current < 0.0 };
                self.follows_at = if self.high == commanded {
                    f64::INFINITY
                } else if held_by_diode {
                    t + dead_time
                } else {
                    t
                };
            }
            if self.follows_at <= t {
                self.high = self.commanded;
                self.follows_at = f64::INFINITY;
            }
            let end = self.next_change(pulse, t).min(to);
            if self.high {
                time_high += end - t;
            }
            t = end;
        }
        time_high
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 50e-6;

    /// Mean share of high time over some periods, in steps of 0.7 µs, which meet no edge.
    fn mean(duty: f64, dead_time: f64, current: f64) -> f64 {
        let (mut leg, mut sum) = (Leg::default(), 0.0);
        let pulse = Pulse::centred(duty, PERIOD);
        for _ in 0..20 {
            let mut t = 0.0;
            leg.begin_period(PERIOD);
            while t < PERIOD {
                let to = (t + 0.7e-6).min(PERIOD);
                sum += leg.advance(pulse, t, to, dead_time, current);
                t = to;
            }
        }
        sum / (20.0 * PERIOD)
    }

    #[test]
    fn the_mean_is_the_duty_cycle_less_the_dead_time_along_the_current() {
        for duty in [0.1, 0.31, 0.5, 0.87] {
            assert!((mean(duty, 0.0, 1.0) - duty).abs() < 1e-9);
            for (current, sign) in [(2.0, 1.0), (-2.0, -1.0)] {
                let expected = duty - sign * 1.5e-6 / PERIOD;
                assert!(
                    (mean(duty, 1.5e-6, current) - expected).abs() < 1e-9,
                    "{duty} {current}"
                );
            }
        }
    }

    #[test]
    fn a_pulse_shorter_than_the_dead_time_vanishes_and_full_duty_has_no_edges() {
        // 0.02 of 50 µs is 1 µs.
        assert!(mean(0.02, 1.5e-6, 1.0).abs() < 1e-12);
        assert!((mean(0.02, 1.5e-6, -1.0) - 0.05).abs() < 1e-9);
        assert!((mean(0.98, 1.5e-6, -1.0) - 1.0).abs() < 2e-3);
        assert!(mean(0.0, 1.5e-6, -1.0).abs() < 1e-12);
        assert!((mean(1.0, 1.5e-6, -1.0) - 1.0).abs() < 1e-9);
    }
}
