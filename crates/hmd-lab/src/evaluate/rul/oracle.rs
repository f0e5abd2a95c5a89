//! Upper bound of any forecast: a filter that knows the true law and the distribution of its parameters, but not their values.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::history::{END_OF_LIFE, Growth, History, LIFETIME_H, RATE_TIMES_LIFETIME, Seen, USE_CHANGES, USE_FACTOR};
use hmd_core::rul::{Clock, Law, Odometer, Remaining, UseRate};

/// Ratio of neighbouring exponential rates.
const RATE_STEP: f64 = 1.02;

/// Remaining hours drawn for one forecast where use decides.
const DRAWS: u64 = 400;

/// Filter with the true law; damage begins at 0.
pub(super) struct Oracle<'a> {
    history: &'a History,
    laws: Vec<Law>,
    last: Odometer,
    squared_steps: f64,
}

impl<'a> Oracle<'a> {
    pub(super) fn new(history: &'a History) -> Self {
        let whole_work = LIFETIME_H[0] * history.windows.first().map_or(1.0, |w| w.at.work_j / w.at.hours);
        let new = |clock, rate, slope_sigma| Law::new(clock, rate, 0.0, 0.0, slope_sigma);
        let laws = match history.growth {
            Growth::Linear => vec![new(Clock::Hours, 0.0, END_OF_LIFE / LIFETIME_H[0])],
            Growth::Work => vec![new(Clock::Work, 0.0, 4.0 * END_OF_LIFE / whole_work)],
            Growth::Exponential => {
                let (low, high) = (
                    RATE_TIMES_LIFETIME[0] / LIFETIME_H[1],
                    RATE_TIMES_LIFETIME[1] / LIFETIME_H[0],
                );
                let count = ((high / low).ln() / RATE_STEP.ln()).ceil() as i32;
                (0..=count)
                    .map(|n| new(Clock::Hours, low * RATE_STEP.powi(n), END_OF_LIFE / LIFETIME_H[0]))
                    .collect()
            }
        };
        Self {
            history,
            laws,
            last: Odometer::default(),
            squared_steps: 0.0,
        }
    }

    pub(super) fn update(&mut self, seen: &Seen) {
        let Some((damage, sigma)) = seen.estimate else { return };
        let passed = seen.at.since(&self.last);
        for law in &mut self.laws {
            law.advance(passed.by_clock(law.clock));
            law.observe(damage, sigma * sigma);
        }
        self.last = seen.at;
        self.squared_steps += passed.hours * passed.hours;
    }

    /// The hours left at a window: the possible lifetimes with their weights.
    pub(super) fn remaining(&self, seen: &Seen, seed: u64) -> Forecast<'_> {
        if self.history.growth == Growth::Work {
            return Forecast::Weighted(self.draw_remaining_hours(seen, seed));
        }
        let elapsed = self.last.hours;
        let best = self
            .laws
            .iter()
            .map(|l| l.log_evidence)
            .fold(f64::NEG_INFINITY, f64::max);
        let weigh = |law: &Law| {
            let slope = law.slope.max(law.slope_sigma());
            let evidence = (law.log_evidence - best).exp() / (slope * (-law.rate * elapsed).exp());
            let life = elapsed + law.time_to((END_OF_LIFE - law.damage).max(0.0) / slope);
            let kappa = law.rate * life;
            let possible =
                (RATE_TIMES_LIFETIME[0]..=RATE_TIMES_LIFETIME[1]).contains(&kappa) && is_possible_lifetime(life);
            if possible { evidence * -(-kappa).exp_m1() } else { 0.0 }
        };
        let mut laws: Vec<_> = self
            .laws
            .iter()
            .map(|law| (law, if law.rate == 0.0 { 1.0 } else { weigh(law) }))
            .collect();
        laws.retain(|(_, w)| *w > 1e-6);
        let sum: f64 = laws.iter().map(|(_, w)| w).sum();
        for (_, weight) in &mut laws {
            *weight /= sum;
        }
        let rate = UseRate {
            cycles_per_hour: 0.0,
            work_j_per_hour: 0.0,
            step_hours: self.squared_steps / elapsed,
            log_sigma: 0.0,
            observed_h: elapsed,
        };
        let passed = seen.at.hours - self.last.hours;
        Forecast::Laws(Box::new(Remaining::from_laws(laws, END_OF_LIFE, elapsed, passed, rate)))
    }

    /// Remaining hours of all possible uses to come, drawn and weighed: the work that is left is known well, when it will have been
    /// done is not. For a use to come of a given shape the life follows; its prior is log-uniform, and the changes so far
    /// have the likelihood of c of n changes falling where they did.
    fn draw_remaining_hours(&self, seen: &Seen, seed: u64) -> Vec<(f64, f64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let law = &self.laws[0];
        let now = seen.at.hours;
        let changes = self.history.use_pieces[1..]
            .iter()
            .filter(|piece| piece.0 <= now)
            .count() as u32;
        let rate = self.history.work_rate_at(now);
        let mut draws = Vec::new();
        for _ in 0..DRAWS {
            let all = rng.random_range(USE_CHANGES[0]..=USE_CHANGES[1]);
            if all < changes {
                continue;
            }
            let (d, v) = sample(law, &mut rng);
            let work = ((END_OF_LIFE - d) / v.max(f64::MIN_POSITIVE) - (seen.at.work_j - self.last.work_j)).max(0.0);
            let mut at: Vec<f64> = (changes..all).map(|_| rng.random_range(0.0..1.0)).collect();
            at.sort_by(f64::total_cmp);
            at.push(1.0);
            let (mut mean, mut factor, mut from) = (0.0, 1.0, 0.0);
            for to in at {
                mean += factor * (to - from);
                factor *= rng.random_range(-USE_FACTOR.ln()..USE_FACTOR.ln()).exp();
                from = to;
            }
            let left = work / (rate * mean);
            let life = now + left;
            if !is_possible_lifetime(life) {
                continue;
            }
            let placed: f64 = (all - changes + 1..=all).map(f64::from).product();
            let weight =
                placed * life.powi(-(changes as i32)) * (left / life).powi((all - changes) as i32) * left / life;
            draws.push((left, weight));
        }
        draws
    }
}

/// Noise may end a life a little before or after its nominal end.
fn is_possible_lifetime(hours: f64) -> bool {
    (0.95 * LIFETIME_H[0]..=1.05 * LIFETIME_H[1]).contains(&hours)
}

/// A damage and a slope out of a law's distribution.
fn sample(law: &Law, rng: &mut ChaCha8Rng) -> (f64, f64) {
    let [dd, dv, vv] = law.covariance;
    let [a, b]: [f64; 2] = [StandardNormal.sample(rng), StandardNormal.sample(rng)];
    let v = vv.sqrt() * a;
    let d = if vv > 0.0 {
        dv / vv * v + (dd - dv * dv / vv).max(0.0).sqrt() * b
    } else {
        dd.sqrt() * b
    };
    (law.damage + d, law.slope + v)
}

/// A forecast in either form.
pub(super) enum Forecast<'a> {
    /// By laws.
    Laws(Box<Remaining<'a>>),
    /// By remaining hours with weights.
    Weighted(Vec<(f64, f64)>),
}

impl Forecast<'_> {
    /// Probability that life ends within this many hours.
    pub(super) fn probability_within(&self, hours: f64) -> f64 {
        match self {
            Self::Laws(remaining) => remaining.probability_within(hours),
            Self::Weighted(draws) => {
                let sum: f64 = draws.iter().map(|draw| draw.1).sum();
                let within: f64 = draws.iter().filter(|draw| draw.0 <= hours).map(|draw| draw.1).sum();
                if sum > 0.0 { within / sum } else { 0.0 }
            }
        }
    }
}
