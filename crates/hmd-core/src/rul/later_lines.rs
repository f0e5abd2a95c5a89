//! Straight lines that begin later than the trend: growth that began late, or whose speed has changed.
//!
//! The laws of a trend hold from its beginning on. Where growth changes they keep following the one that fits least badly, an exponential
//! that explains a late beginning, and forecast by it. So a line through the newest estimates alone begins now and then, with a small
//! prior probability of a change, and competes with the laws by how well it predicts what follows.

use serde::{Deserialize, Serialize};

use super::estimate::{DISAGREEMENT_SIGMAS, Estimate};
use super::law::{Clock, Law};

/// Estimates from one beginning to the next.
const EVERY: u64 = 8;

/// Newest estimates that a line is fitted to.
pub(super) const FITTED: usize = 6;

/// Probability of a change of growth where a line begins, for each clock: small, as errors of neighbouring windows are not independent and
/// pass for evidence.
const CHANGE: f64 = 1e-4;

/// Most lines; the least probable one makes room.
const LINES_MAX: usize = 8;

/// Weight of all lines together below which none counts: no change has shown.
pub(super) const WEIGHT_MIN: f64 = 0.5;

/// The lines of a trend.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct LaterLines {
    pub(super) lines: Vec<Law>,
    /// Estimates of the trend when the last one began.
    begun: u64,
}

impl LaterLines {
    /// Whether they could have come about: a file may say anything.
    pub(super) fn are_possible(&self) -> bool {
        let is_possible = |line: &Law| {
            let [dd, _, vv] = line.covariance;
            line.rate == 0.0 && dd >= 0.0 && vv >= 0.0
        };
        self.lines.len() <= LINES_MAX && self.lines.iter().all(is_possible)
    }

    /// Whether the next ones are due after so many estimates.
    pub(super) fn are_due(&self, estimates: u64) -> bool {
        estimates >= self.begun + EVERY
    }

    /// Begins a line for each clock through the newest estimates, unless one of them lies apart from it. The evidence is that of the trend's
    /// laws and lines together.
    pub(super) fn begin(&mut self, newest: &[Estimate], estimates: u64, log_evidence: f64) {
        for clock in [Clock::Hours, Clock::Work] {
            let Some(law) = fitted(newest, clock) else {
                continue;
            };
            if self.lines.len() == LINES_MAX {
                let evidence = |n: &usize| self.lines[*n].log_evidence;
                let least = (0..LINES_MAX).min_by(|a, b| evidence(a).total_cmp(&evidence(b)));
                self.lines.remove(least.unwrap_or_default());
            }
            let log_evidence = log_evidence + CHANGE.ln();
            self.lines.push(Law { log_evidence, ..law });
            self.begun = estimates;
        }
    }
}

/// The line through estimates, at the last one, by least squares; `None` if one lies apart, or where its clock stands.
fn fitted(estimates: &[Estimate], clock: Clock) -> Option<Law> {
    let last = estimates.last()?;
    let points = || {
        estimates.iter().map(|estimate| {
            let x = estimate.at.since(&last.at).by_clock(clock);
            (x, estimate.damage, 1.0 / estimate.variance)
        })
    };
    let sum = |of: fn(f64, f64) -> f64| points().map(|(x, d, w)| w * of(x, d)).sum::<f64>();
    let (s, sx, sxx) = (sum(|_, _| 1.0), sum(|x, _| x), sum(|x, _| x * x));
    let (sd, sxd) = (sum(|_, d| d), sum(|x, d| x * d));
    let determinant = s * sxx - sx * sx;
    let (damage, slope) = ((sxx * sd - sx * sxd) / determinant, (s * sxd - sx * sd) / determinant);
    let is_near = |(x, d, w): (f64, f64, f64)| (damage + slope * x - d).powi(2) * w < DISAGREEMENT_SIGMAS.powi(2);
    let covariance = [sxx / determinant, -sx / determinant, s / determinant];
    let are_numbers = covariance.iter().all(|c| c.is_finite()) && damage.is_finite() && slope.is_finite();
    (are_numbers && points().all(is_near)).then(|| Law {
        damage,
        slope,
        covariance,
        ..Law::new(clock, 0.0, damage, covariance[0], 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::super::usage::Odometer;
    use super::*;

    fn estimates(damage: impl Fn(f64) -> f64) -> Vec<Estimate> {
        let of = |n: u32| {
            let hours = f64::from(n);
            Estimate {
                at: Odometer {
                    hours,
                    cycles: hours,
                    work_j: 0.0,
                },
                damage: damage(hours),
                variance: 1e-4,
            }
        };
        (0..FITTED as u32).map(of).collect()
    }

    #[test]
    fn lines_begin_every_so_many_estimates_where_the_newest_lie_on_one() {
        let mut later = LaterLines::default();
        assert!(!later.are_due(EVERY - 1) && later.are_due(EVERY));
        later.begin(&estimates(|hours| 0.1 + 0.02 * hours), 20, -1.0);
        // The work stands: a line over the hours alone.
        let [line] = later.lines.as_slice() else {
            panic!("{later:?}");
        };
        assert!(
            (line.damage - 0.2).abs() < 1e-12 && (line.slope - 0.02).abs() < 1e-12,
            "{line:?}"
        );
        assert!((line.log_evidence - (CHANGE.ln() - 1.0)).abs() < 1e-12, "{line:?}");
        assert!(!later.are_due(19 + EVERY) && later.are_due(20 + EVERY));
        later.begin(&estimates(|hours| if hours < 3.0 { 0.1 } else { 0.4 }), 28, 0.0);
        assert_eq!(later.lines.len(), 1, "they lie on no line");
        assert!(later.are_due(28));
    }
}
