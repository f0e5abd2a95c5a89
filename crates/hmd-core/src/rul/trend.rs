//! The trend of one fault: all laws of growth at once, weighed by how well each predicted the estimates.

use serde::{Deserialize, Serialize};

use super::estimate::{DISAGREEMENT_SIGMAS, Estimate};
use super::jump;
use super::later_lines::{self, LaterLines};
use super::law::{Clock, Law};
use super::usage::Odometer;

/// Ratio of neighbouring exponential rates. At 1.1 the nearest rate misses the true one by enough to spoil the intervals.
const RATE_STEP: f64 = 1.04;

/// An exponential differs visibly from a straight line once rate × time reaches this.
const CURVATURE_VISIBLE: f64 = 0.05;

/// A law is dropped when rate × time exceeds this.
const LAW_DROPPED: f64 = 16.0;

/// Largest rate × life of an exponential growth; beyond it is a shock, not a trend.
const RATE_LIFE_MAX: f64 = 8.0;

/// Evidence is kept to this below the best law's, so that one which has lost can win again when growth changes.
const LOG_EVIDENCE_FLOOR: f64 = 30.0;

/// Smallest standard deviation that is accepted: the monitor's own error moves slowly from window to window.
const SIGMA_MIN: f64 = 1e-3;

/// Estimates with which a trend begins: enough to see whether the first is an outlier.
const START: usize = 3;

/// Keeps the squares of slopes in the machine's range, for estimates that are next to no time apart.
const SLOPE_SIGMA_MAX: f64 = 1e100;

/// Estimates in a row that fit no law, or lie apart from those before them, with which a new trend begins.
pub(super) const JUMP_AFTER: usize = 4;

/// Estimates before those of a jump that are compared with them.
const JUMP_BEFORE: usize = 2;

/// Estimates up to which a trend is so young that its laws, open as they are, may follow any jump: growth later fits none of them.
const YOUNG: u64 = 24;

/// Estimates from which on a damage at the end of life is one.
const ESTIMATES_AT_END: u32 = 2;

/// Windows over which the scatter is compared with the stated sigma.
const SCATTER_MEMORY: f64 = 20.0;

/// Largest contribution of a single estimate to the scatter, in variances.
const SCATTER_CAP: f64 = 9.0;

/// Upper limit on laws in a stored trend; about 150 occur.
const LAWS_MAX: usize = 200;

/// Beyond this `RATE_STEP^number` is no longer a number of the machine.
const NUMBER_MAX: u32 = 18_000;

/// More estimates than any life has.
const ESTIMATES_MAX: u64 = 1 << 53;

/// Filter over the estimates of one fault, of bounded size: at most about 150 laws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trend {
    /// Damage at the end of life.
    pub(super) end_of_life: f64,
    /// The first estimates, until there are enough to begin with.
    start: Vec<Estimate>,
    /// Straight over hours, straight over work, then exponentials over hours, fastest first.
    pub(super) laws: Vec<Law>,
    /// Number of the slowest exponential: its rate is `RATE_STEP^−number` per hour.
    slowest: Option<i32>,
    /// Lines that begin later. Older files had none.
    #[serde(default)]
    later: LaterLines,
    /// The estimate with which the laws began.
    pub(super) first: Estimate,
    /// Where the laws stand.
    laws_at: Odometer,
    /// Where the last estimate was taken.
    pub(super) last: Odometer,
    /// Estimates since the trend began.
    pub(super) estimates: u64,
    /// The newest estimates, at most [`JUMP_BEFORE`] + [`JUMP_AFTER`]. Older files had none.
    #[serde(default)]
    recent: Vec<Estimate>,
    /// Estimates in a row that fit no law.
    misfits: u32,
    /// Estimates in a row that are at the end of life and that no law explains: those of the start among them, and those before a
    /// jump. Older files had none.
    #[serde(default)]
    misfits_at_end: u32,
    /// Variance of the estimates over the stated one, at least 1.
    scatter: f64,
    /// Trends before this one that broke off.
    pub(super) jumps: u32,
}

impl Trend {
    /// A trend to this damage.
    #[must_use]
    pub fn new(end_of_life: f64) -> Self {
        Self {
            end_of_life,
            start: Vec::new(),
            laws: Vec::new(),
            slowest: None,
            later: LaterLines::default(),
            first: Estimate::default(),
            laws_at: Odometer::default(),
            last: Odometer::default(),
            estimates: 0,
            recent: Vec::new(),
            misfits: 0,
            misfits_at_end: 0,
            scatter: 1.0,
            jumps: 0,
        }
    }

    /// Whether it could have come about: a file may say anything.
    pub(super) fn is_possible(&self) -> bool {
        let straight = |law: &Law| law.rate == 0.0;
        let begun = self.laws.len() >= 2 && self.laws.len() <= LAWS_MAX && self.laws[..2].iter().all(straight);
        let variances = |law: &Law| law.covariance[0] >= 0.0 && law.covariance[2] >= 0.0;
        (self.laws.is_empty() || begun)
            && self.laws.iter().all(variances)
            && self.later.are_possible()
            && self.start.len() < START
            && self.slowest.is_none_or(|number| number.unsigned_abs() <= NUMBER_MAX)
            && self.recent.len() <= JUMP_BEFORE + JUMP_AFTER
            && self.misfits_at_end <= (JUMP_AFTER + START) as u32
            && self.misfits < JUMP_AFTER as u32
            && self.estimates <= ESTIMATES_MAX
    }

    /// Takes an estimate and its standard deviation. One that is no number, or not taken later than the one before, is
    /// passed over.
    pub fn update(&mut self, at: Odometer, damage: f64, sigma: f64) {
        if !(damage.is_finite() && sigma.is_finite() && sigma >= 0.0) {
            return;
        }
        if self.estimates > 0 && !at.is_after(&self.last) {
            return;
        }
        let variance = self.scatter * sigma.max(SIGMA_MIN).powi(2);
        let estimate = Estimate { at, damage, variance };
        self.last = at;
        self.estimates += 1;
        if self.recent.len() == JUMP_BEFORE + JUMP_AFTER {
            self.recent.remove(0);
        }
        self.recent.push(estimate);
        if !self.laws.is_empty() {
            self.learn_from(&estimate);
            if self.misfits >= JUMP_AFTER as u32
                || (self.estimates <= YOUNG && jump::lies_between(&self.recent, JUMP_BEFORE, JUMP_AFTER))
            {
                self.begin_anew();
            } else if self.later.are_due(self.estimates) && self.recent.len() >= later_lines::FITTED {
                self.begin_lines();
            }
            return;
        }
        self.start.push(estimate);
        self.count_at_end(true, damage);
        if self.start.len() == START {
            let start = std::mem::take(&mut self.start);
            self.begin(&start);
        }
    }

    /// Begins with the first estimates; the very first is left out if the two after it agree against it.
    fn begin(&mut self, start: &[Estimate]) {
        let apart = |a: &Estimate, b: &Estimate| {
            (a.damage - b.damage).powi(2) > DISAGREEMENT_SIGMAS * DISAGREEMENT_SIGMAS * (a.variance + b.variance)
        };
        let [a, b, c] = [&start[0], &start[1], &start[2]];
        let outlier = apart(a, b) && apart(a, c) && !apart(b, c);
        let begun = &start[usize::from(outlier)..];
        self.first = begun[0];
        self.laws_at = begun[0].at;
        self.misfits_at_end = 0;
        for clock in [Clock::Hours, Clock::Work] {
            // Between the first two estimates the damage moves by no more than about 1.
            let passed = begun[1].at.since(&begun[0].at).by_clock(clock);
            let slope_sigma = if passed > 0.0 {
                (1.0 / passed).min(SLOPE_SIGMA_MAX)
            } else {
                0.0
            };
            self.laws
                .push(Law::new(clock, 0.0, begun[0].damage, begun[0].variance, slope_sigma));
        }
        for estimate in &begun[1..] {
            self.learn_from(estimate);
        }
    }

    /// Advances the laws to an estimate and updates them with it.
    fn learn_from(&mut self, estimate: &Estimate) {
        let passed = estimate.at.since(&self.laws_at);
        self.add_exponentials(estimate.at.since(&self.first.at).hours);
        let (mut weight, mut inlier, mut squared) = (0.0, 0.0, f64::INFINITY);
        let best = self.best_evidence();
        for law in self.laws.iter_mut().chain(&mut self.later.lines) {
            let w = (law.log_evidence - best).exp();
            law.advance(passed.by_clock(law.clock));
            let (p, s) = law.observe(estimate.damage, estimate.variance);
            weight += w;
            inlier += w * p;
            squared = squared.min(s);
        }
        self.laws_at = estimate.at;
        let best = self.best_evidence();
        for law in self.laws.iter_mut().chain(&mut self.later.lines) {
            law.log_evidence = (law.log_evidence - best).max(-LOG_EVIDENCE_FLOOR);
        }
        self.scatter += (self.scatter * squared.min(SCATTER_CAP) - self.scatter) / SCATTER_MEMORY;
        self.scatter = self.scatter.max(1.0);
        let is_misfit = inlier < 0.5 * weight;
        self.misfits = if is_misfit { self.misfits + 1 } else { 0 };
        self.count_at_end(is_misfit, estimate.damage);
    }

    /// Begins lines through the newest estimates.
    fn begin_lines(&mut self) {
        let best = self.best_evidence();
        let evidence: f64 = self.all_laws().map(|law| (law.log_evidence - best).exp()).sum();
        let newest = &self.recent[self.recent.len() - later_lines::FITTED..];
        self.later.begin(newest, self.estimates, best + evidence.ln());
    }

    /// Begins a new trend with the newest estimates: those before a jump tell nothing of what comes.
    fn begin_anew(&mut self) {
        let newest = self.recent.len().saturating_sub(JUMP_AFTER);
        let recent = self.recent.split_off(newest);
        *self = Self {
            scatter: self.scatter,
            jumps: self.jumps.saturating_add(1),
            misfits_at_end: self.misfits_at_end,
            last: self.last,
            estimates: recent.len() as u64,
            ..Self::new(self.end_of_life)
        };
        // An older file had no newest estimates.
        if recent.len() < START {
            self.start.clone_from(&recent);
        } else {
            self.begin(&recent);
        }
        self.recent = recent;
    }

    fn count_at_end(&mut self, is_unexplained: bool, damage: f64) {
        let is_at_end = is_unexplained && damage >= self.end_of_life;
        self.misfits_at_end = if is_at_end { self.misfits_at_end + 1 } else { 0 };
    }

    /// An exponential whose curvature cannot have shown yet is the straight line; it starts as that line's copy.
    fn add_exponentials(&mut self, hours: f64) {
        let limit = f64::from(NUMBER_MAX);
        let number_for = |curvature: f64| {
            let number = (hours / curvature).ln() / RATE_STEP.ln();
            number.floor().clamp(-limit, limit) as i32
        };
        let newest = number_for(CURVATURE_VISIBLE);
        let oldest = number_for(LAW_DROPPED) + 1;
        for number in self.slowest.map_or(oldest, |slowest| oldest.max(slowest + 1))..=newest {
            let rate = RATE_STEP.powi(-number);
            self.laws.push(Law {
                rate,
                ..self.laws[0].clone()
            });
            self.slowest = Some(number);
        }
        self.laws.retain(|law| law.rate * hours <= LAW_DROPPED);
    }

    /// Damage at the last estimate: the laws' mean, or before there are any what the last two estimates agree on, 0 before the second: a
    /// single one may be an outlier. After a jump there are laws at once; of an older file, the one estimate on which those before had agreed.
    pub(super) fn damage(&self) -> f64 {
        let mean = |weights: Vec<f64>| {
            self.all_laws()
                .zip(weights)
                .map(|(law, weight)| weight * law.damage)
                .sum()
        };
        match self.start.as_slice() {
            [.., before, last] => before.damage.min(last.damage),
            [one] if self.jumps > 0 => one.damage,
            [] if !self.laws.is_empty() => mean(self.weights()),
            _ => 0.0,
        }
    }

    /// Number of the newest estimates in a row that fit no law, the newest of them above all laws; `None` where it is less than two, as a
    /// single one is rather an outlier.
    pub(super) fn above(&self) -> Option<u32> {
        let is_above = self.recent.last().is_some_and(|newest| newest.damage > self.damage());
        (self.misfits >= 2 && is_above).then_some(self.misfits)
    }

    /// Whether the damage has reached the end of life by more than one estimate: a single one may be an outlier.
    pub(super) fn is_at_its_end(&self) -> bool {
        let is_trend = !self.laws.is_empty() && self.damage() >= self.end_of_life;
        is_trend || self.misfits_at_end >= ESTIMATES_AT_END
    }

    fn best_evidence(&self) -> f64 {
        self.all_laws()
            .map(|law| law.log_evidence)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// The laws, then the lines that begin later.
    pub(super) fn all_laws(&self) -> impl Iterator<Item = &Law> {
        self.laws.iter().chain(&self.later.lines)
    }

    /// Weights of [`Trend::all_laws`], which sum to 1, in their order; of the lines none counts before all of them have some weight.
    pub(super) fn weights(&self) -> Vec<f64> {
        let mut weights = self.relative_weights();
        let total = |weights: &[f64]| weights.iter().sum::<f64>();
        let sum = total(&weights);
        let (_, later) = weights.split_at_mut(self.laws.len());
        if total(later) < later_lines::WEIGHT_MIN * sum {
            later.fill(0.0);
        }
        let sum = total(&weights);
        // Slopes beyond the machine's range have no weight that is a number; then nothing is known.
        let scale = if sum > 0.0 && sum.is_finite() { 1.0 / sum } else { 0.0 };
        for weight in &mut weights {
            *weight = if scale > 0.0 { *weight * scale } else { 0.0 };
        }
        weights
    }

    /// What the weights are to each other: evidence times what is known beforehand.
    ///
    /// Beforehand straight growth over hours, straight growth over work and exponential growth are equally likely, the
    /// life is of any order of magnitude, and rate × life of an exponential is anything up to `RATE_LIFE_MAX`. The filters
    /// begin with a wide normal slope v₀ instead; the difference is a factor 1/v₀, and for exponentials
    /// `(1 − e^−κ) d(ln rate) / κ_max` with κ = rate × life.
    fn relative_weights(&self) -> Vec<f64> {
        let since = self.laws_at.since(&self.first.at);
        let best = self.best_evidence();
        let weigh = |law: &Law| {
            let elapsed = since.by_clock(law.clock);
            if elapsed <= 0.0 {
                return 0.0;
            }
            let slope = law.slope.max(law.slope_sigma()).max(f64::MIN_POSITIVE);
            // Growth of all that has passed at the first slope, so that no unit is left.
            let first_growth = slope * (-law.rate * elapsed).exp() * elapsed;
            let evidence = (law.log_evidence - best).exp() / first_growth;
            if law.rate > 0.0 {
                let left = law.time_to((self.end_of_life - law.damage).max(0.0) / slope);
                let kappa = law.rate * (elapsed + left);
                let possible = (RATE_LIFE_MAX - kappa).min(0.0).exp();
                evidence * possible * -(-kappa).exp_m1() * RATE_STEP.ln() / RATE_LIFE_MAX
            } else {
                evidence
            }
        };
        let evidence = |law: &Law| (law.log_evidence - best).exp();
        let mut weights: Vec<f64> = self.laws.iter().map(weigh).collect();
        // What is known beforehand of the laws counts for the lines as for their mean.
        let prior = weights.iter().sum::<f64>() / self.laws.iter().map(evidence).sum::<f64>();
        weights.extend(self.later.lines.iter().map(|line| prior * evidence(line)));
        weights
    }
}

#[cfg(test)]
mod tests;
