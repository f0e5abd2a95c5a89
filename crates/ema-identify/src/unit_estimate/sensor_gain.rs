//! The gain of one current sensor where no sum of the phases shows it: shorts, and a phase with more than all its turns.
//!
//! Where the third current follows from two sensors, `i_l = −i_j − i_m`, a sensor of phase j that reads `1 + g` times its current leaves a
//! torque, for the currents as they are read, of `k (s_j i_j + s_m i_m + s_l i_l) − g k (s_j − s_l) i_j`. Its mean and its two components at
//! twice the electrical angle are those of a motor with `1 − 3/2 g` turns in phase j, `1 − g/2` in l and `1 + g/2` in m, currents in phase with
//! the back-EMF. No winding has more than all its turns: the excess tells the gain from shorts, as far as it goes, and what it leaves open is
//! a part of their sigmas. Derived here.

use ema_models::FaultVector;

use super::UnitEstimate;
use super::common_change::{SHORTS, common_factor};
use crate::inferred::Inferred;

/// Change of the turns of a phase for the gain of a sensor: that of its own, of that which is computed, of the other one.
const OWN: f64 = 1.5;
const COMPUTED: f64 = 0.5;
const OTHER: f64 = -0.5;

/// Standard deviation of the gain of a sensor since commissioning: twice the usual tolerance.
const GAIN_SIGMA: f64 = 0.02;

/// A further short beside the largest is as unlikely as so many standard deviations, below which it is an error of the turns.
const FURTHER_SHORT_SIGMA: f64 = 0.01;
const FURTHER_SHORT_MAX: f64 = 9.0;

/// Gains that are tried, in steps.
const GAIN_MAX: f64 = 0.15;
const STEPS: i32 = 120;

/// Sum of squares beyond the least up to which an explanation holds: two standard deviations. Three where a gain there must be, of any size.
const HOLDS: f64 = 4.0;
const HOLDS_BESIDE_GAIN: f64 = 9.0;

/// One explanation of the turns that a window shows.
#[derive(Clone, Copy, Debug)]
struct Explanation {
    /// Turns of the phases without that gain.
    turns: [f64; 3],
    /// Damage of each phase beside what all have in common.
    shorts: [f64; 3],
    /// Sum of squares, in standard deviations: turns beyond all, and shorts beside the largest.
    misfit: f64,
    /// The same with that of the gain.
    cost: f64,
}

impl Explanation {
    /// By the gain of the sensor of a phase, where the current of another phase is computed.
    fn new(turns: &[Inferred; 3], [own, computed]: [usize; 2], gain: f64) -> Self {
        let without = core::array::from_fn(|phase| {
            let change = match phase {
                _ if phase == own => OWN,
                _ if phase == computed => COMPUTED,
                _ => OTHER,
            };
            turns[phase].value + change * gain
        });
        let common = common_factor(&without);
        let squared = |value: f64| value * value;
        let excess = |phase: usize| ((without[phase] / common.max(1.0) - 1.0) / turns[phase].sigma).max(0.0);
        let shorts = without.map(|turns: f64| (1.0 - turns / common).clamp(0.0, 1.0));
        let further = |phase: usize| {
            let sigma: f64 = turns[phase].sigma.hypot(FURTHER_SHORT_SIGMA);
            squared(shorts[phase] / sigma).min(FURTHER_SHORT_MAX)
        };
        let largest = (0..3).max_by(|&one, &other| shorts[one].total_cmp(&shorts[other]));
        let all_further: f64 = (0..3).filter(|phase| Some(*phase) != largest).map(further).sum();
        let misfit = (0..3).map(|phase| squared(excess(phase))).sum::<f64>() + all_further;
        Self {
            turns: without,
            shorts,
            misfit,
            cost: misfit + squared(gain / GAIN_SIGMA),
        }
    }
}

impl UnitEstimate {
    /// The same for currents of which no sum tells the gain of one sensor: with what such a gain leaves open in the sigmas of the shorts, and
    /// with the least gain taken out where shorts alone do not explain the window; whether that is so.
    ///
    /// Which sensor it is, the torque does not tell. Unchanged where the window does not show the turns of each phase.
    #[must_use]
    pub fn beside_gain_of_one_sensor(mut self) -> (Self, bool) {
        let [Some(a), Some(b), Some(c)] = self.turns() else {
            return (self, false);
        };
        let turns = [a, b, c];
        let pairs = (0..3).flat_map(|own| [[own, (own + 1) % 3], [own, (own + 2) % 3]]);
        let gains = (-STEPS..=STEPS).map(|step| GAIN_MAX * f64::from(step) / f64::from(STEPS));
        let all = pairs.flat_map(|pair| gains.clone().map(move |gain| Explanation::new(&turns, pair, gain)));
        let by_shorts = Explanation::new(&turns, [0, 1], 0.0);
        let best = all.clone().fold(
            by_shorts,
            |best, other| if other.cost < best.cost { other } else { best },
        );
        let has_gain = by_shorts.cost > best.cost + HOLDS_BESIDE_GAIN;
        let taken = if has_gain { best } else { by_shorts };
        let holds = |other: &Explanation| match has_gain {
            true => other.misfit <= best.misfit + HOLDS_BESIDE_GAIN,
            false => other.cost <= best.cost + HOLDS,
        };
        let mut spread = [0.0; 3];
        for other in all.filter(holds) {
            for ((spread, own), other) in spread.iter_mut().zip(taken.shorts).zip(other.shorts) {
                *spread = (other - own).abs().max(*spread);
            }
        }
        if has_gain {
            let mut k = self.estimate.fault.to_array();
            for (place, turns) in SHORTS.into_iter().zip(taken.turns) {
                k[place] = (1.0 - turns).clamp(0.0, 1.0);
            }
            self.estimate.fault = FaultVector::from_array(k);
            self.estimate.unknowns.fault = self.estimate.fault;
            for (inferred, value) in self.estimate.inferred.turns.iter_mut().zip(taken.turns) {
                *inferred = inferred.map(|inferred| Inferred { value, ..inferred });
            }
        }
        let half = |n: usize| {
            SHORTS
                .iter()
                .position(|place| *place == n)
                .map_or(0.0, |phase| 0.5 * spread[phase])
        };
        (self.with_sigmas(|n, sigma| sigma.hypot(half(n))), has_gain)
    }
}

#[cfg(test)]
mod tests {
    use super::super::common_change::tests::of_turns;
    use super::*;

    /// Turns of phases with these shorts, where the sensor of phase A reads `1 + gain` times its current and that of C is computed.
    fn turns(shorts: [f64; 3], gain: f64) -> [f64; 3] {
        let change = [OWN, OTHER, COMPUTED];
        core::array::from_fn(|phase| 1.0 - shorts[phase] - change[phase] * gain)
    }

    /// Shorts with their sigmas, and whether there is a gain.
    fn found(turns: [f64; 3], sigma: f64) -> ([(f64, f64); 3], bool) {
        let (found, has_gain) = of_turns(turns, sigma).beside_gain_of_one_sensor();
        let k = found.estimate.fault.to_array();
        (SHORTS.map(|n| (k[n], found.estimate.sigma[n].unwrap())), has_gain)
    }

    #[test]
    fn a_gain_is_no_short_and_is_named() {
        for gain in [-0.1, -0.06, 0.04, 0.08, 0.12] {
            let (shorts, has_gain) = found(turns([0.0; 3], gain), 0.005);
            assert!(
                has_gain && shorts.iter().all(|(k, sigma)| k < &(2.5 * sigma)),
                "{gain}: {shorts:?}"
            );
        }
    }

    #[test]
    fn shorts_alone_stay_and_their_sigmas_hold_a_usual_gain() {
        for short in [0.0, 0.05, 0.1, 0.3] {
            for phase in 0..3 {
                let mut shorts = [0.0; 3];
                shorts[phase] = short;
                let (found, has_gain) = found(turns(shorts, 0.0), 0.005);
                let (k, sigma) = found[phase];
                assert!(!has_gain && (k - short).abs() < 1e-12, "{short}: {found:?}");
                assert!((0.01..0.02).contains(&sigma), "{short}: {found:?}");
            }
        }
    }

    #[test]
    fn a_short_beside_a_gain_is_within_its_sigma() {
        for (short, gain) in [(0.1, -0.06), (0.15, -0.08), (0.1, 0.04), (0.3, -0.05)] {
            let (found, _) = found(turns([short, 0.0, 0.0], gain), 0.005);
            let (k, sigma) = found[0];
            assert!((k - short).abs() < 3.0 * sigma, "{short} {gain}: {found:?}");
            let mut others = found[1..].iter();
            assert!(others.all(|(k, sigma)| k < &(3.0 * sigma)), "{short} {gain}: {found:?}");
        }
    }

    #[test]
    fn what_all_phases_have_in_common_is_no_gain_of_one() {
        for turns in [[1.03, 1.031, 1.03], [0.97, 0.969, 0.97]] {
            assert!(!found(turns, 0.005).1, "{turns:?}");
        }
    }
}
