//! Resolver counts that do not fit their neighbours, found with the residual of the fitted monitor.
//!
//! The windower refuses counts that no actuator could show. At 400 Hz that lets an error of 1 800 resolver counts pass,
//! because the motor may speed up that much in one sample. The residual of the fitted monitor is
//! smooth from sample to sample, even where the fit itself is poor, because the monitor's errors add up over time.
//! A single wrong count sticks out of that by its full size.

use ema_ga::ConfigError;
use ema_models::Conditions;

use crate::window::Window;
use ema_identify::effort::{Effort, Request, Stage};
use ema_identify::{Estimate, Fit, Identifier, Prepared, Residuals};

/// Distance of a residual from its neighbours', in multiples of what half of all neighbours differ by.
const FACTOR: f64 = 20.0;

/// The same in counts: what rounding can make of a good one.
const COUNTS: f64 = 3.0;

/// Share of a window that may be found wrong this way; where more sticks out, the monitor is wrong and not the sensor.
const SHARE_MAX: f64 = 0.02;

/// Times a window is identified again; a large outlier may have hidden a small one.
const PASSES: usize = 2;

/// Identifies a window, and shows how well the estimate fits; refuses counts that stick out from the fit and identifies it once more without
/// them.
///
/// None where not even one estimate is granted; where a further one is not, that with the outliers stands.
///
/// # Errors
/// Those of [`Identifier::identify`].
pub fn identify_without_outliers(
    identifier: &Identifier,
    window: &mut Window,
    conditions: Conditions,
    seed: u64,
    effort: &Effort<'_>,
) -> Result<Option<(Fit, Estimate)>, ConfigError> {
    let mut evaluations = 0;
    let mut last = None;
    let identify = |_: &Window, prepared: &Prepared| {
        let window_s = length_s(prepared.recording().samples.len(), identifier);
        let again = last
            .as_ref()
            .is_none_or(|last: &Estimate| grants_runs(effort, last.evaluations, window_s));
        let found = if again {
            identifier.identify_within(prepared, conditions, seed, effort)?
        } else {
            None
        };
        if let Some(estimate) = found {
            evaluations += estimate.evaluations + 1;
            last = Some(estimate);
        }
        Ok(last.clone())
    };
    let (fit, found) = estimate_without_outliers(identifier, window, conditions, identify, Option::as_ref)?;
    Ok(found.map(|mut estimate| {
        estimate.evaluations = evaluations;
        (fit, estimate)
    }))
}

fn length_s(samples: usize, identifier: &Identifier) -> f64 {
    samples as f64 / identifier.params.sensors.sample_rate
}

/// Whether the work of a further estimate is granted, by what the last one took.
pub(crate) fn grants_runs(effort: &Effort<'_>, runs: u64, window_s: f64) -> bool {
    effort.grants_all(&Request {
        stage: Stage::Conclusion,
        window_s,
        runs,
        reserved: 0,
    })
}

/// Estimates a window; refuses counts that stick out from the monitor with the estimate `of` what was found, and estimates once
/// more without them. Nothing is refused where `of` has no estimate.
///
/// # Errors
/// Those of the estimate.
pub fn estimate_without_outliers<T, E>(
    identifier: &Identifier,
    window: &mut Window,
    conditions: Conditions,
    mut estimate: impl FnMut(&Window, &Prepared) -> Result<T, E>,
    of: impl Fn(&T) -> Option<&Estimate>,
) -> Result<(Fit, T), E> {
    let mut passes_left = PASSES;
    loop {
        let prepared = window.prepared(&identifier.params);
        let found = estimate(window, &prepared)?;
        let residuals = of(&found).map_or_else(Residuals::new, |of| identifier.residuals(&prepared, conditions, of));
        let outliers = outliers(identifier, &residuals);
        if passes_left == 0 || outliers.is_empty() || outliers.len() as f64 > SHARE_MAX * window.samples.len() as f64 {
            return Ok((Fit::new(&prepared, &residuals), found));
        }
        window.refuse_counts(&outliers);
        passes_left -= 1;
    }
}

/// Indices of samples whose resolver or encoder count sticks out, in rising order.
fn outliers(identifier: &Identifier, residuals: &Residuals) -> Vec<usize> {
    let sensors = &identifier.params.sensors;
    let (mut motor, mut output) = (Vec::new(), Vec::new());
    for (n, r) in residuals {
        motor.push((*n, r.theta_m / sensors.motor_lsb()));
        output.push((*n, r.theta_out / sensors.output_lsb()));
    }
    let mut found = sticking_out(&motor);
    found.extend(sticking_out(&output));
    found.sort_unstable();
    found.dedup();
    found
}

/// Indices of residuals, in counts, that stick out from both their neighbours'.
fn sticking_out(residuals: &[(usize, f64)]) -> Vec<usize> {
    let off: Vec<f64> = residuals
        .windows(3)
        .map(|r| {
            let (left, right) = (r[1].1 - r[0].1, r[1].1 - r[2].1);
            // On the same side of both, by the nearer one.
            if left * right > 0.0 {
                left.abs().min(right.abs())
            } else {
                0.0
            }
        })
        .collect();
    let mut sorted: Vec<f64> = residuals.windows(2).map(|r| (r[1].1 - r[0].1).abs()).collect();
    if sorted.is_empty() {
        return Vec::new();
    }
    let middle = sorted.len() / 2;
    let (_, median, _) = sorted.select_nth_unstable_by(middle, f64::total_cmp);
    let allowed = (FACTOR * *median).max(COUNTS);
    let inner = residuals.get(1..).unwrap_or_default();
    inner
        .iter()
        .zip(&off)
        .filter(|(_, off)| **off > allowed)
        .map(|(&(n, _), _)| n)
        .collect()
}
