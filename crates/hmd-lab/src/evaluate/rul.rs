//! The `rul` suite: forecasts over whole lifetimes, compared with an oracle that knows the true law.

mod comparison;
mod errors;
mod history;
mod metrics;
mod oracle;

use ema_models::FaultId;
use rayon::prelude::*;
use serde::Serialize;

use errors::ErrorTable;
use history::{END_OF_LIFE, LIFETIME_H};
use hmd_core::rul::{Prognosis, Quantiles, quantile};
use hmd_core::seed::mix;
use metrics::{ALPHA, LAMBDAS, Medians, convergence, horizon_fraction};
use oracle::Oracle;

pub use comparison::{Comparison, ComparisonError, RemainingHoursSamples, compare_forecasts, rul_histories};
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
    /// Scores of this monitor.
    #[serde(flatten)]
    pub scores: Scores,
    /// The oracle's.
    pub oracle: Scores,
}

/// One history and its predictions.
struct Predicted {
    fault: usize,
    growth: Growth,
    own: Scored,
    oracle: Scored,
}

/// The `rul` suite: `n` histories of each fault.
///
/// # Errors
/// A stored table of errors that cannot be read.
pub fn rul(n: u64, seed: u64, done: &(dyn Fn() + Sync)) -> Result<RulReport, serde_json::Error> {
    let errors = ErrorTable::stored()?;
    let predictions: Vec<Predicted> = (0..FaultId::COUNT as u64 * n)
        .into_par_iter()
        .map(|number| {
            let fault = (number / n) as usize;
            let history = draw(fault, number % n, &errors, seed);
            let predicted = Predicted {
                fault,
                growth: history.growth,
                own: score_own(&history, fault),
                oracle: by_oracle(&history, mix(seed, &[8, number])),
            };
            done();
            predicted
        })
        .collect();
    let group = |name: String, belongs: &dyn Fn(&Predicted) -> bool| {
        let members: Vec<&Predicted> = predictions.iter().filter(|t| belongs(t)).collect();
        Group {
            name,
            histories: members.len(),
            scores: Scores::mean_of(members.iter().map(|t| &t.own)),
            oracle: Scores::mean_of(members.iter().map(|t| &t.oracle)),
        }
    };
    let mut groups: Vec<Group> = (0..FaultId::COUNT)
        .map(|fault| group(FaultId::ALL[fault].name().to_owned(), &|t| t.fault == fault))
        .collect();
    for growth in Growth::ALL {
        groups.push(group(growth.name().to_owned(), &|t| t.growth == growth));
    }
    Ok(RulReport {
        suite: "rul",
        seed,
        histories_per_fault: n,
        scores: Scores::mean_of(predictions.iter().map(|t| &t.own)),
        oracle: Scores::mean_of(predictions.iter().map(|t| &t.oracle)),
        groups,
    })
}

fn draw(fault: usize, n: u64, errors: &ErrorTable, seed: u64) -> History {
    History::draw(fault, errors, mix(seed, &[7, fault as u64, n]))
}

/// Prediction of a history by the monitor's own filter.
fn score_own(history: &History, fault: usize) -> Scored {
    let mut prognosis = Prognosis::new([END_OF_LIFE; FaultId::COUNT]);
    score(history, |seen, report| {
        let mut estimates = [None; FaultId::COUNT];
        estimates[fault] = seen.estimate;
        prognosis.update(seen.at, &estimates);
        if let (Ok(forecast), Ok(remaining)) = (
            prognosis.forecast(0.0).faults[fault],
            prognosis.remaining(FaultId::ALL[fault]),
        ) {
            let Quantiles { p10, p50, p90 } = forecast.hours;
            report([p10, p50, p90].map(Some), &|hours| remaining.probability_within(hours));
        }
    })
}

/// Hours beyond which the oracle is not asked: twice the longest life.
const HOURS_MAX: f64 = 2.0 * LIFETIME_H[1];

/// Prediction of a history by the oracle.
fn by_oracle(history: &History, seed: u64) -> Scored {
    let mut oracle = Oracle::new(history);
    let mut n = 0;
    score(history, |seen, report| {
        oracle.update(seen);
        n += 1;
        let forecast = oracle.remaining(seen, mix(seed, &[n]));
        let within = |hours: f64| forecast.probability_within(hours);
        report([0.1, 0.5, 0.9].map(|share| quantile(within, share, HOURS_MAX)), &within);
    })
}

/// Takes the quantiles of the hours left, and the probability of failing within some hours.
type Report<'a> = &'a mut dyn FnMut([Option<f64>; 3], &dyn Fn(f64) -> f64);

/// Scores the prediction after each window of a history; no prediction is a forecast missed.
fn score(history: &History, mut after: impl FnMut(&Seen, Report<'_>)) -> Scored {
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
        let (own, oracle) = (&report.scores, &report.oracle);
        assert!(
            own.alpha_lambda_pass_rate >= 0.9 * oracle.alpha_lambda_pass_rate,
            "{own:?} {oracle:?}"
        );
        assert!(own.prognostic_horizon_fraction >= 0.5, "{own:?}");
        assert!(own.cra >= 0.85 && own.cra <= oracle.cra + 0.02, "{own:?} {oracle:?}");
        assert!((0.65..0.95).contains(&own.coverage_80), "{own:?}");
        assert!(oracle.alpha_lambda_pass_rate > 0.8, "{oracle:?}");
        assert_eq!(
            serde_json::to_string(&report)?,
            serde_json::to_string(&rul(6, 11, &|| {})?)?
        );
        Ok(())
    }
}
