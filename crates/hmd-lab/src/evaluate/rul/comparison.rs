//! Forecasts that another program made of the suite's histories, scored as this monitor's are.

use ema_models::FaultId;
use rayon::prelude::*;
use serde::Serialize;

use super::errors::ErrorTable;
use super::{Growth, History, Scored, Scores, by_oracle, draw, score, score_own};
use hmd_core::seed::mix;

/// Hours left after each window of a history, as equally likely values in rising order: with n of them the m-th, from 0, is
/// the quantile (m + ½)/n. A value of `None` is longer than any, and sorts after all others. A window without a forecast is `None`.
pub type RemainingHoursSamples = Vec<Option<Vec<Option<f64>>>>;

/// Forecasts that do not belong to the histories.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected} forecasts{}, found {found}", .history.map_or_else(String::new, |n| format!(" of history {n}")))]
pub struct ComparisonError {
    /// Number of the history; `None` when their number is wrong.
    pub history: Option<usize>,
    /// Histories, or windows of one.
    pub expected: usize,
    /// Forecasts.
    pub found: usize,
}

/// Scores of this monitor, another program and the oracle on a group of histories.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Fault, law or all.
    pub name: String,
    /// Their number.
    pub histories: usize,
    /// Of this monitor.
    pub own: Scores,
    /// Of the other program.
    pub other: Scores,
    /// Of the oracle.
    pub oracle: Scores,
}

/// One history, scored for each.
struct ScoredAll {
    fault: usize,
    growth: Growth,
    own: Scored,
    other: Scored,
    oracle: Scored,
}

/// The first `n` histories of each fault of the suite, fault by fault.
///
/// # Errors
/// A stored table of errors that cannot be read.
pub fn rul_histories(n: u64, seed: u64) -> Result<Vec<History>, serde_json::Error> {
    let errors = ErrorTable::stored()?;
    let each = |number: u64| draw((number / n) as usize, number % n, &errors, seed);
    Ok((0..FaultId::COUNT as u64 * n).map(each).collect())
}

/// Scores of all, by fault, by law of growth and over all; one entry of `forecasts` for each of [`rul_histories`].
///
/// # Errors
/// Forecasts that are too few or too many.
pub fn compare_forecasts(
    histories: &[History],
    forecasts: &[RemainingHoursSamples],
) -> Result<Vec<Comparison>, ComparisonError> {
    if histories.len() != forecasts.len() {
        return Err(ComparisonError {
            history: None,
            expected: histories.len(),
            found: forecasts.len(),
        });
    }
    let each = histories.len() / FaultId::COUNT;
    let scored: Vec<ScoredAll> = histories
        .par_iter()
        .zip(forecasts)
        .enumerate()
        .map(|(n, (history, samples))| {
            let fault = n / each;
            let other = score_external(history, samples).map_err(|found| ComparisonError {
                history: Some(n),
                expected: history.windows.len(),
                found,
            })?;
            Ok(ScoredAll {
                fault,
                growth: history.growth,
                own: score_own(history, fault),
                other,
                oracle: by_oracle(history, mix(fault as u64, &[8, n as u64])),
            })
        })
        .collect::<Result<_, ComparisonError>>()?;
    let group = |name: &str, belongs: &dyn Fn(&ScoredAll) -> bool| {
        let members: Vec<_> = scored.iter().filter(|member| belongs(member)).collect();
        Comparison {
            name: name.to_owned(),
            histories: members.len(),
            own: Scores::mean_of(members.iter().map(|member| &member.own)),
            other: Scores::mean_of(members.iter().map(|member| &member.other)),
            oracle: Scores::mean_of(members.iter().map(|member| &member.oracle)),
        }
    };
    let mut groups: Vec<Comparison> = (0..FaultId::COUNT)
        .map(|fault| group(FaultId::ALL[fault].name(), &|member| member.fault == fault))
        .collect();
    groups.extend(Growth::ALL.map(|law| group(law.name(), &|member| member.growth == law)));
    groups.push(group("all", &|_| true));
    Ok(groups)
}

/// A history as another program predicted it; the number of forecasts where it is wrong.
fn score_external(history: &History, forecasts: &RemainingHoursSamples) -> Result<Scored, usize> {
    if forecasts.len() != history.windows.len() {
        return Err(forecasts.len());
    }
    let mut forecasts = forecasts.iter();
    Ok(score(history, |_, report| {
        if let Some(Some(samples)) = forecasts.next() {
            let samples: Vec<f64> = samples.iter().map(|hours| hours.unwrap_or(f64::INFINITY)).collect();
            let quantile = |share| Some(quantile_of(&samples, share)).filter(|hours: &f64| hours.is_finite());
            report([0.1, 0.5, 0.9].map(quantile), &|hours| {
                probability_within(&samples, hours)
            });
        }
    }))
}

/// A quantile by straight lines between equally likely values.
fn quantile_of(samples: &[f64], share: f64) -> f64 {
    let place = (share * samples.len() as f64 - 0.5).clamp(0.0, samples.len().saturating_sub(1) as f64);
    let (low, part) = (place.floor() as usize, place.fract());
    let at = |n: usize| samples.get(n).copied().unwrap_or(f64::INFINITY);
    if part > 0.0 {
        at(low) + part * (at(low + 1) - at(low))
    } else {
        at(low)
    }
}

/// Probability that life ends within some hours, by the same lines.
fn probability_within(samples: &[f64], hours: f64) -> f64 {
    let below = samples.partition_point(|&sample| sample <= hours);
    let counted = match (below.checked_sub(1), samples.get(below)) {
        (Some(last), Some(&next)) if next.is_finite() => {
            below as f64 - 0.5 + (hours - samples[last]) / (next - samples[last])
        }
        _ => below as f64,
    };
    counted / samples.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equally_likely_values_are_a_distribution() {
        let samples: Vec<f64> = (0..100).map(|n| f64::from(n) + 0.5).collect();
        for share in [0.1, 0.5, 0.9] {
            let hours = quantile_of(&samples, share);
            assert!((hours - 100.0 * share).abs() < 1e-9, "{hours}");
            assert!((probability_within(&samples, hours) - share).abs() < 1e-9);
        }
        assert!(probability_within(&samples, 0.0).abs() < 1e-12);
        assert!((probability_within(&samples, 200.0) - 1.0).abs() < 1e-12);
        let never = [10.0, f64::INFINITY];
        assert!(quantile_of(&never, 0.9).is_infinite());
        assert!((probability_within(&never, 1e9) - 0.5).abs() < 1e-12);
        assert!(probability_within(&[], 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_truth_scores_best_and_silence_worst() -> Result<(), Box<dyn std::error::Error>> {
        let histories = rul_histories(2, 5)?;
        let forecasts = |of: &dyn Fn(f64) -> Option<Vec<Option<f64>>>| -> Vec<RemainingHoursSamples> {
            let windows = |history: &History| {
                history
                    .windows
                    .iter()
                    .map(|w| of(history.life_h - w.at.hours))
                    .collect()
            };
            histories.iter().map(windows).collect()
        };
        let truth = forecasts(&|left| Some(vec![Some(0.99 * left), Some(1.01 * left)]));
        let all = compare_forecasts(&histories, &truth)?.pop().ok_or("a row for all")?;
        assert_eq!((all.histories, all.other.alpha_lambda_pass_rate), (14, 1.0));
        assert!(all.other.cra > 0.99 && all.own.cra > 0.5);
        let silence = compare_forecasts(&histories, &forecasts(&|_| None))?
            .pop()
            .ok_or("a row for all")?;
        assert_eq!(
            (silence.other.alpha_lambda_pass_rate, silence.other.coverage_80),
            (0.0, 0.0)
        );
        assert!(compare_forecasts(&histories, &truth[1..]).is_err());
        let mut short = truth;
        short[3].pop();
        assert_eq!(
            compare_forecasts(&histories, &short).map(|_| ()).unwrap_err().history,
            Some(3)
        );
        Ok(())
    }
}
