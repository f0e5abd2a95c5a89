//! Metrics of prognosis, after Saxena et al. (2010).

use serde::Serialize;

/// Share of the life that is left by which a forecast may be off; for the horizon, share of the whole life.
pub(super) const ALPHA: f64 = 0.2;

/// Probability that a forecast must put between the bounds of [`ALPHA`].
pub(super) const BETA: f64 = 0.5;

/// Shares of life at which forecasts are looked at.
pub(super) const LAMBDAS: [f64; 8] = [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];

/// Share of life from which on they are scored; of earlier ones the intervals alone are.
const SCORED_FROM: f64 = 0.5;

/// A forecast at one λ, beside the truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtLambda {
    /// Share of life.
    pub lambda: f64,
    /// Hours left in truth.
    pub truth_h: f64,
    /// Quantiles of the hours left; `None` where the forecast has none.
    pub quantiles_h: [Option<f64>; 3],
    /// Probability between (1 ± α) × truth.
    pub probability_in_bounds: f64,
}

impl AtLambda {
    /// α-λ with β: enough of the forecast is between the bounds.
    pub(super) fn passes(&self) -> bool {
        self.probability_in_bounds >= BETA
    }

    /// Relative accuracy of the median, 1 − |error| / truth; 0 for an error larger than the truth or no median.
    pub(super) fn relative_accuracy(&self) -> f64 {
        self.quantiles_h[1].map_or(0.0, |median| {
            (1.0 - (median - self.truth_h).abs() / self.truth_h).max(0.0)
        })
    }

    /// Whether the truth is between the 10 % and the 90 % quantile. A 90 % quantile beyond what is computed is no bound;
    /// without a median there is no interval.
    pub(super) fn covers(&self) -> bool {
        let [low, median, high] = self.quantiles_h;
        median.is_some() && low.is_some_and(|low| low <= self.truth_h) && high.is_none_or(|high| self.truth_h <= high)
    }
}

/// The median after every window of a life: hours since the beginning, and hours left by it.
pub(super) type Medians = Vec<(f64, Option<f64>)>;

/// Share of the life during whose last part the median stays inside ±α of the life.
pub(super) fn horizon_fraction(medians: &Medians, life_h: f64) -> f64 {
    let mut begins = life_h;
    for &(at, median) in medians.iter().rev() {
        if median.is_none_or(|median| (at + median - life_h).abs() > ALPHA * life_h) {
            break;
        }
        begins = at;
    }
    (life_h - begins) / life_h
}

/// How soon the error falls: distance of the centre of mass of |error| over time from the first forecast, both as shares
/// of what follows it and of the life. Smaller is faster; `None` with fewer than two forecasts.
pub(super) fn convergence(medians: &Medians, life_h: f64) -> Option<f64> {
    let errors: Vec<(f64, f64)> = medians
        .iter()
        .filter_map(|&(at, median)| Some((at, (at + median? - life_h).abs())))
        .collect();
    let first = errors.first()?.0;
    let (mut area, mut x, mut y) = (0.0, 0.0, 0.0);
    for pair in errors.windows(2) {
        let (width, height) = (pair[1].0 - pair[0].0, pair[0].1);
        area += width * height;
        x += 0.5 * (pair[1].0 * pair[1].0 - pair[0].0 * pair[0].0) * height;
        y += 0.5 * width * height * height;
    }
    (area > 0.0).then(|| ((x / area - first) / (life_h - first)).hypot(y / area / life_h))
}

/// Figures of a group of forecasts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// α-λ with β, over histories and λ.
    pub alpha_lambda_pass_rate: f64,
    /// Prognostic horizon as a share of life, median over histories.
    pub prognostic_horizon_fraction: f64,
    /// Cumulative relative accuracy: mean over histories and λ.
    pub cra: f64,
    /// Share of 80 % intervals that hold the truth.
    pub coverage_80: f64,
    /// The same before half of the life, of the forecasts that there are.
    pub coverage_80_early: f64,
    /// Convergence, median over histories.
    pub convergence: f64,
}

/// Scores of one history.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scored {
    /// Forecasts at each λ.
    pub at: Vec<AtLambda>,
    /// Prognostic horizon as a share of life.
    pub horizon_fraction: f64,
    /// Convergence.
    pub convergence: Option<f64>,
}

impl Scores {
    /// Of some histories.
    pub(super) fn mean_of<'a>(scored: impl Iterator<Item = &'a Scored> + Clone) -> Self {
        let all = || scored.clone().flat_map(|s| &s.at);
        let mean_over = |counts: &dyn Fn(&AtLambda) -> bool, of: &dyn Fn(&AtLambda) -> f64| {
            let (sum, count) = all()
                .filter(|at| counts(at))
                .fold((0.0, 0_u32), |(sum, n), at| (sum + of(at), n + 1));
            sum / f64::from(count.max(1))
        };
        let mean = |of: &dyn Fn(&AtLambda) -> f64| mean_over(&|at| at.lambda >= SCORED_FROM, of);
        let is_early_forecast = |at: &AtLambda| at.lambda < SCORED_FROM && at.quantiles_h[1].is_some();
        let covers = |at: &AtLambda| f64::from(u8::from(at.covers()));
        Self {
            alpha_lambda_pass_rate: mean(&|at| f64::from(u8::from(at.passes()))),
            prognostic_horizon_fraction: super::super::percentile(scored.clone().map(|s| s.horizon_fraction), 0.5),
            cra: mean(&AtLambda::relative_accuracy),
            coverage_80: mean(&covers),
            coverage_80_early: mean_over(&is_early_forecast, &covers),
            convergence: super::super::percentile(scored.clone().filter_map(|s| s.convergence), 0.5),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score_at(truth_h: f64, quantiles_h: [Option<f64>; 3], probability_in_bounds: f64) -> AtLambda {
        AtLambda {
            lambda: 0.5,
            truth_h,
            quantiles_h,
            probability_in_bounds,
        }
    }

    #[test]
    fn a_forecast_is_scored_by_its_definition() {
        let good = score_at(100.0, [Some(80.0), Some(110.0), Some(130.0)], 0.6);
        assert!(good.passes() && good.covers() && (good.relative_accuracy() - 0.9).abs() < 1e-12);
        let bad = score_at(100.0, [Some(110.0), Some(350.0), Some(400.0)], 0.4);
        assert!(!bad.passes() && !bad.covers() && bad.relative_accuracy().abs() < 1e-12);
        let none = score_at(100.0, [None; 3], 0.0);
        assert!(!none.passes() && !none.covers() && none.relative_accuracy().abs() < 1e-12);
    }

    #[test]
    fn the_horizon_begins_where_the_estimate_comes_to_stay() {
        // Life 100 h, bounds ±20 h of the end.
        let medians: Medians = vec![
            (10.0, None),
            (20.0, Some(85.0)),
            (30.0, Some(100.0)),
            (40.0, Some(75.0)),
            (90.0, Some(10.0)),
        ];
        assert!((horizon_fraction(&medians, 100.0) - 0.6).abs() < 1e-12);
        assert!(horizon_fraction(&vec![(90.0, None)], 100.0).abs() < 1e-12);
        // An error that stays is slower than one that goes.
        let stays = convergence(&(0..10).map(|n| (f64::from(n), Some(110.0))).collect(), 100.0);
        let goes = convergence(
            &(0..10)
                .map(|n| {
                    (
                        f64::from(n),
                        Some(100.0 - f64::from(n) + if n < 2 { 10.0 } else { 0.0 }),
                    )
                })
                .collect(),
            100.0,
        );
        assert!(goes < stays && goes.is_some(), "{goes:?} {stays:?}");
        assert_eq!(convergence(&vec![(1.0, None)], 100.0), None);
    }
}
