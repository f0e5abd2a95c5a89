//! Jumps of the damage between one estimate and the next, without any law of growth.

use super::estimate::{DISAGREEMENT_SIGMAS, Estimate};

/// Whether the last `after` of these estimates lie on another level than the `before` ones in front of them. Damage does not fall; and growth
/// that is steady, or ever faster, does not come from far below the straight line of the newest estimates.
pub(super) fn lies_between(estimates: &[Estimate], before: usize, after: usize) -> bool {
    if estimates.len() < before + after {
        return false;
    }
    let (before, after) = estimates[estimates.len() - before - after..].split_at(before);
    let is_above = |over: f64, variance: f64| over > DISAGREEMENT_SIGMAS * variance.sqrt();
    let has_fallen = before.iter().all(|old| {
        let mut after = after.iter();
        after.all(|new| is_above(old.damage - new.damage, old.variance + new.variance))
    });
    let line = Line::through(after);
    let has_risen = before.iter().all(|old| {
        let (damage, variance) = line.at(old);
        is_above(damage - old.damage, variance + old.variance)
    });
    let is_straight = after.iter().all(|new| {
        let (damage, _) = line.at(new);
        !is_above((damage - new.damage).abs(), new.variance)
    });
    has_fallen || (has_risen && is_straight)
}

/// Straight line over operating hours, by least squares.
struct Line {
    hours: f64,
    damage: f64,
    slope: f64,
    /// Variance of the damage in the middle, and of the slope.
    variances: [f64; 2],
}

impl Line {
    fn through(estimates: &[Estimate]) -> Self {
        let weights = estimates.iter().map(|estimate| 1.0 / estimate.variance);
        let sum: f64 = weights.clone().sum();
        let mean = |of: fn(&Estimate) -> f64| {
            let all = estimates.iter().zip(weights.clone());
            all.map(|(estimate, weight)| weight * of(estimate)).sum::<f64>() / sum
        };
        let (hours, damage) = (mean(|of| of.at.hours), mean(|of| of.damage));
        let all = estimates.iter().zip(weights);
        let (mut spread, mut product) = (0.0, 0.0);
        for (estimate, weight) in all {
            let off = estimate.at.hours - hours;
            spread += weight * off * off;
            product += weight * off * (estimate.damage - damage);
        }
        Self {
            hours,
            damage,
            slope: product / spread,
            variances: [1.0 / sum, 1.0 / spread],
        }
    }

    /// Damage at the hours of an estimate, and its variance.
    fn at(&self, estimate: &Estimate) -> (f64, f64) {
        let off = estimate.at.hours - self.hours;
        let [middle, slope] = self.variances;
        (self.damage + self.slope * off, middle + slope * off * off)
    }
}

#[cfg(test)]
mod tests {
    use super::super::usage::Odometer;
    use super::*;

    fn is_jump(damages: &[f64]) -> bool {
        let estimate = |(n, damage): (usize, &f64)| Estimate {
            at: Odometer {
                hours: 10.0 * n as f64,
                ..Odometer::default()
            },
            damage: *damage,
            variance: 1e-4,
        };
        let estimates: Vec<Estimate> = damages.iter().enumerate().map(estimate).collect();
        lies_between(&estimates, 2, 4)
    }

    #[test]
    fn a_jump_is_another_level_for_four_estimates() {
        assert!(is_jump(&[0.6, 0.65, 0.0, 0.01, 0.03, 0.05]), "down");
        assert!(is_jump(&[0.0, 0.01, 0.3, 0.31, 0.3, 0.32]), "up");
        assert!(is_jump(&[0.0, 0.01, 0.3, 0.34, 0.38, 0.43]), "up, and growing");
        for (name, damages) in [
            ("three", [0.6, 0.0, 0.01, 0.0, 0.01, 0.02]),
            ("too few", [0.6, 0.65, 0.0, 0.01, 0.0, f64::NAN]),
            ("one outlier before", [0.0, 0.9, 0.01, 0.02, 0.03, 0.04]),
            ("one low before", [0.3, 0.0, 0.32, 0.33, 0.34, 0.35]),
            ("small", [0.1, 0.1, 0.06, 0.06, 0.06, 0.06]),
            ("steady", [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
            ("ever faster", [0.0, 0.01, 0.03, 0.1, 0.3, 0.9]),
            ("slower now", [0.0, 0.1, 0.2, 0.24, 0.28, 0.32]),
            ("scattered", [0.0, 0.0, 0.3, 0.9, 0.1, 0.7]),
        ] {
            assert!(!is_jump(&damages), "{name}");
        }
        assert!(!is_jump(&[0.6, 0.0, 0.0, 0.0, 0.0]));
    }
}
