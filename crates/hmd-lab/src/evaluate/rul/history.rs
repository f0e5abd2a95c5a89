//! Simulated histories of actuators, drawn at random, as the windows of a monitor show them.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::errors::ErrorTable;
use hmd_core::rul::Odometer;

/// Damage at the end of life, the default of the configuration.
pub(super) const END_OF_LIFE: f64 = 0.8;

/// Lifetimes, h; log-uniform.
pub(super) const LIFETIME_H: [f64; 2] = [500.0, 5000.0];

/// Rate × life of an exponential growth; uniform.
pub(super) const RATE_TIMES_LIFETIME: [f64; 2] = [2.0, 5.0];

/// How often the rate of use changes in a life, each number equally likely.
pub(super) const USE_CHANGES: [u32; 2] = [2, 4];

/// Largest factor of a change of the rate of use; log-uniform between it and its inverse.
pub(super) const USE_FACTOR: f64 = 2.0;

/// Windows over a life.
const WINDOWS: [u32; 2] = [50, 500];

/// Standard deviation of each step of growth, as a share of it.
const GROWTH_NOISE: f64 = 0.1;

const MISSING: f64 = 0.10;
const INVALID: f64 = 0.02;
const OUTLIER: f64 = 0.01;

/// Use in the beginning: actuations per hour, and work of each.
const CYCLES_PER_HOUR: f64 = 10.0;
const WORK_PER_CYCLE_J: f64 = 50.0;

/// How damage grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Growth {
    /// With the hours.
    Linear,
    /// Ever faster with the hours.
    Exponential,
    /// With the work done.
    Work,
}

impl Growth {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Exponential, Self::Work];
}

/// Estimate of a monitor after one window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Seen {
    /// Use so far.
    pub at: Odometer,
    /// Damage and its standard deviation; `None` in a window that is not fit to be assessed.
    pub estimate: Option<(f64, f64)>,
}

/// A history, from the new part to the end of life.
#[derive(Clone, Debug, Serialize)]
pub struct History {
    /// The true law.
    pub growth: Growth,
    /// The true life, h.
    pub life_h: f64,
    /// The windows, in order.
    pub windows: Vec<Seen>,
    /// Use: from when on, h, and its rate relative to the first.
    #[serde(skip)]
    pub(super) use_pieces: Vec<(f64, f64)>,
}

/// Piecewise constant use.
struct UseProfile {
    /// From when on, and the rate relative to the first.
    pieces: Vec<(f64, f64)>,
}

impl UseProfile {
    fn draw(life_h: f64, rng: &mut ChaCha8Rng) -> Self {
        let changes = rng.random_range(USE_CHANGES[0]..=USE_CHANGES[1]);
        let mut at: Vec<f64> = (0..changes).map(|_| rng.random_range(0.0..life_h)).collect();
        at.sort_by(f64::total_cmp);
        let mut pieces = vec![(0.0, 1.0)];
        let mut rate = 1.0;
        for hours in at {
            rate *= rng.random_range(-USE_FACTOR.ln()..USE_FACTOR.ln()).exp();
            pieces.push((hours, rate));
        }
        Self { pieces }
    }

    fn odometer(&self, hours: f64) -> Odometer {
        let mut equivalent = 0.0;
        for (n, &(from, rate)) in self.pieces.iter().enumerate() {
            let to = self.pieces.get(n + 1).map_or(f64::INFINITY, |next| next.0).min(hours);
            equivalent += rate * (to - from).max(0.0);
        }
        let cycles = CYCLES_PER_HOUR * equivalent;
        Odometer {
            hours,
            cycles,
            work_j: WORK_PER_CYCLE_J * cycles,
        }
    }
}

impl History {
    /// Draws one.
    #[must_use]
    pub(super) fn draw(fault: usize, errors: &ErrorTable, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let growth = Growth::ALL[rng.random_range(0..Growth::ALL.len())];
        let nominal_h = rng.random_range(LIFETIME_H[0].ln()..LIFETIME_H[1].ln()).exp();
        let kappa: f64 = rng.random_range(RATE_TIMES_LIFETIME[0]..RATE_TIMES_LIFETIME[1]);
        let usage = UseProfile::draw(nominal_h, &mut rng);
        let whole_work = usage.odometer(nominal_h).work_j;
        let law = |at: &Odometer| {
            END_OF_LIFE
                * match growth {
                    Growth::Linear => at.hours / nominal_h,
                    Growth::Exponential => (kappa * at.hours / nominal_h).exp_m1() / kappa.exp_m1(),
                    Growth::Work => at.work_j / whole_work,
                }
        };
        // Noise may let the part outlive its nominal life: windows go on, as dense as before.
        let windows = rng.random_range(WINDOWS[0]..=WINDOWS[1]);
        let mut hours: Vec<f64> = (0..2 * windows)
            .map(|_| rng.random_range(0.0..2.0 * nominal_h))
            .collect();
        hours.sort_by(f64::total_cmp);

        let mut history = Self {
            growth,
            life_h: 0.0,
            windows: Vec::new(),
            use_pieces: Vec::new(),
        };
        let (mut before, mut lawful, mut damage) = (0.0, 0.0, 0.0);
        for now in hours {
            let at = usage.odometer(now);
            let noise: f64 = StandardNormal.sample(&mut rng);
            let growth = (law(&at) - lawful) * (1.0 + GROWTH_NOISE * noise).max(0.0);
            if damage + growth >= END_OF_LIFE {
                history.life_h = before + (now - before) * (END_OF_LIFE - damage) / growth;
                break;
            }
            (lawful, damage, before) = (law(&at), damage + growth, now);
            if rng.random_bool(MISSING) {
                continue;
            }
            let estimate = if rng.random_bool(INVALID) {
                None
            } else {
                errors.draw(fault, &mut rng).map(|(error, sigma)| {
                    let outlier = rng.random_bool(OUTLIER);
                    let anything = rng.random_range(0.0..1.0);
                    let found = if outlier {
                        anything
                    } else {
                        (damage + error).clamp(0.0, 1.0)
                    };
                    (found, sigma)
                })
            };
            history.windows.push(Seen { at, estimate });
        }
        history.use_pieces = usage.pieces;
        history
    }
}

impl History {
    /// Rate of use at a time, J/h, between the windows around it.
    pub(super) fn work_rate_at(&self, hours: f64) -> f64 {
        let piece = self
            .use_pieces
            .iter()
            .rev()
            .find(|piece| piece.0 <= hours)
            .map_or(1.0, |piece| piece.1);
        CYCLES_PER_HOUR * WORK_PER_CYCLE_J * piece
    }
}

impl Growth {
    /// The name that reports use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Exponential => "exponential",
            Self::Work => "work",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_are_distributed_as_specified() -> Result<(), serde_json::Error> {
        let errors = ErrorTable::stored()?;
        let (mut windows, mut assessed, mut by_growth) = (0, 0, [0; 3]);
        for seed in 0..300 {
            let history = History::draw((seed % 7) as usize, &errors, seed);
            assert!((450.0..5500.0).contains(&history.life_h), "life {}", history.life_h);
            assert!((3..=5).contains(&history.use_pieces.len()));
            assert!(
                history
                    .windows
                    .is_sorted_by(|a, b| a.at.hours < b.at.hours && a.at.work_j < b.at.work_j)
            );
            assert!(history.windows.last().is_some_and(|w| w.at.hours < history.life_h));
            windows += history.windows.len();
            assessed += history.windows.iter().filter(|w| w.estimate.is_some()).count();
            by_growth[history.growth as usize] += 1;
        }
        assert!(by_growth.iter().all(|&n| n > 70), "{by_growth:?}");
        // 275 windows on average, of which a tenth is missing; 2 % invalid.
        let mean = windows as f64 / 300.0;
        assert!((225.0..270.0).contains(&mean), "{mean}");
        let share = assessed as f64 / windows as f64;
        assert!((0.97..0.99).contains(&share), "{share}");
        Ok(())
    }
}
