//! The `rul` suite: forecasts over whole lives, beside an oracle that knows the true law.

mod beside;
mod errors;
mod history;
mod metrics;
mod oracle;

use rayon::prelude::*;
use serde::Serialize;

use errors::ErrorTable;
use history::{END_OF_LIFE, LIFE_H};
use hmd_core::health::{FAULTS, fault_name};
use hmd_core::rul::{Prognosis, Quantiles, quantile};
use hmd_core::seed::mix;
use metrics::{ALPHA, LAMBDAS, Medians, convergence, horizon_fraction};
use oracle::Oracle;

pub use beside::{Beside, BesideError, Lives, rul_beside, rul_histories};
pub use history::{Growth, History, Seen};
pub use metrics::{AtLambda, Scored, Scores};

/// Result of `hmd evaluate rul`.
#[derive(Clone, Debug, Serialize)]
pub struct RulReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// Suite seed.
    pub seed: u64,
    /// Histories of each fault.
    pub histories_per_fault: u64,
    /// Over all.
    #[serde(flatten)]
    pub scores: Scores,
    /// The same of the oracle.
    pub oracle: Scores,
    /// By fault and by law of growth.
    pub groups: Vec<Group>,
}

/// Some of the histories.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Fault or law.
    pub name: String,
    /// Their number.
    pub histories: usize,
    /// Our scores.
    #[serde(flatten)]
    pub scores: Scores,
    /// The oracle's.
    pub oracle: Scores,
}

/// One history and what was said about it.
struct Told {
    fault: usize,
    growth: Growth,
    ours: Scored,
    oracle: Scored,
}

/// The `rul` suite: `n` histories of each fault.
///
/// # Errors
/// A stored table of errors that cannot be read.
pub fn rul(n: u64, seed: u64, done: &(dyn Fn() + Sync)) -> Result<RulReport, serde_json::Error> {
    let errors = ErrorTable::stored()?;
    let told: Vec<Told> = (0..FAULTS as u64 * n)
        .into_par_iter()
        .map(|number| {
            let fault = (number / n) as usize;
            let history = draw(fault, number % n, &errors, seed);
            let told = Told {
                fault,
                growth: history.growth,
                ours: ours(&history, fault),
                oracle: by_oracle(&history, mix(seed, &[8, number])),
            };
            done();
            told
        })
        .collect();
    let group = |name: String, belongs: &dyn Fn(&Told) -> bool| {
        let members: Vec<&Told> = told.iter().filter(|t| belongs(t)).collect();
        Group {
            name,
            histories: members.len(),
            scores: Scores::of(members.iter().map(|t| &t.ours)),
            oracle: Scores::of(members.iter().map(|t| &t.oracle)),
        }
    };
    let mut groups: Vec<Group> = (0..FAULTS)
        .map(|fault| group(fault_name(fault).to_owned(), &|t| t.fault == fault))
        .collect();
    for growth in Growth::ALL {
        groups.push(group(growth.name().to_owned(), &|t| t.growth == growth));
    }
    Ok(RulReport {
        suite: "rul",
        seed,
        histories_per_fault: n,
        scores: Scores::of(told.iter().map(|t| &t.ours)),
        oracle: Scores::of(told.iter().map(|t| &t.oracle)),
        groups,
    })
}

fn draw(fault: usize, n: u64, errors: &ErrorTable, seed: u64) -> History {
    History::draw(fault, errors, mix(seed, &[7, fault as u64, n]))
}

/// A life as the monitor's own filter tells it.
fn ours(history: &History, fault: usize) -> Scored {
    let mut prognosis = Prognosis::new([END_OF_LIFE; FAULTS]);
    score(history, |seen, tell| {
        let mut estimates = [None; FAULTS];
        estimates[fault] = seen.estimate;
        prognosis.update(seen.at, &estimates);
        if let (Ok(life), Ok(remaining)) = (prognosis.forecast(0.0).faults[fault], prognosis.remaining(fault)) {
            let Quantiles { p10, p50, p90 } = life.hours;
            tell([p10, p50, p90].map(Some), &|hours| remaining.probability_within(hours));
        }
    })
}

/// Hours beyond which the oracle is not asked: twice the longest life.
const HOURS_MAX: f64 = 2.0 * LIFE_H[1];

/// A life as the oracle tells it.
fn by_oracle(history: &History, seed: u64) -> Scored {
    let mut oracle = Oracle::new(history);
    let mut n = 0;
    score(history, |seen, tell| {
        oracle.update(seen);
        n += 1;
        let forecast = oracle.remaining(seen, mix(seed, &[n]));
        let within = |hours: f64| forecast.probability_within(hours);
        tell([0.1, 0.5, 0.9].map(|share| quantile(within, share, HOURS_MAX)), &within);
    })
}

/// Takes the quantiles of the hours left, and the probability of failing within some hours.
type Tell<'a> = &'a mut dyn FnMut([Option<f64>; 3], &dyn Fn(f64) -> f64);

/// Walks through a life and scores what is told after each window; nothing told is a forecast missed.
fn score(history: &History, mut after: impl FnMut(&Seen, Tell<'_>)) -> Scored {
    let mut medians = Medians::new();
    let mut at = Vec::new();
    let lambda_windows = LAMBDAS.map(|lambda| {
        let hours = lambda * history.life_h;
        history.windows.partition_point(|w| w.at.hours <= hours).checked_sub(1)
    });
    for (n, seen) in history.windows.iter().enumerate() {
        let truth_h = history.life_h - seen.at.hours;
        let (mut quantiles_h, mut probability_in_bounds) = ([None; 3], 0.0);
        after(seen, &mut |quantiles, probability_within| {
            quantiles_h = quantiles;
            probability_in_bounds =
                probability_within((1.0 + ALPHA) * truth_h) - probability_within((1.0 - ALPHA) * truth_h);
        });
        medians.push((seen.at.hours, quantiles_h[1]));
        for (lambda, _) in LAMBDAS
            .into_iter()
            .zip(lambda_windows)
            .filter(|(_, window)| *window == Some(n))
        {
            at.push(AtLambda {
                lambda,
                truth_h,
                quantiles_h,
                probability_in_bounds,
            });
        }
    }
    Scored {
        horizon_fraction: horizon_fraction(&medians, history.life_h),
        convergence: convergence(&medians, history.life_h),
        at,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_suite_is_near_its_oracle_and_repeats_itself() -> Result<(), Box<dyn std::error::Error>> {
        let report = rul(6, 11, &|| {})?;
        let (ours, oracle) = (&report.scores, &report.oracle);
        assert!(
            ours.alpha_lambda_pass_rate >= 0.9 * oracle.alpha_lambda_pass_rate,
            "{ours:?} {oracle:?}"
        );
        assert!(ours.prognostic_horizon_fraction >= 0.5, "{ours:?}");
        assert!(ours.cra >= 0.85 && ours.cra <= oracle.cra + 0.02, "{ours:?} {oracle:?}");
        assert!((0.65..0.95).contains(&ours.coverage_80), "{ours:?}");
        assert!(oracle.alpha_lambda_pass_rate > 0.8, "{oracle:?}");
        assert_eq!(
            serde_json::to_string(&report)?,
            serde_json::to_string(&rul(6, 11, &|| {})?)?
        );
        Ok(())
    }
}
