//! The compliance under which the balance of healthy windows leaves least, by a search over three numbers.
//!
//! In: the residual of the windows for a compliance. Out: the compliance that leaves least, and how much. The cost has one minimum (tried
//! from several starts); a simplex needs no derivative of it.

use super::compliance::Compliance;

/// Resonances that are tried first, Hz.
const RESONANCES_HZ: [f64; 4] = [50.0, 90.0, 160.0, 280.0];

/// Range of the search: natural logarithm of the resonance in Hz, damping ratio, load's share of the inertia.
const LOWER: [f64; DIMENSION] = [3.4, 0.0, 0.05];
const UPPER: [f64; DIMENSION] = [6.2, 0.2, 0.5];

/// Where the search starts: damping ratio and load's share.
const USUAL: [f64; 2] = [0.03, 0.23];

/// Sides of the first simplex.
const SIDES: [f64; DIMENSION] = [0.15, 0.03, 0.1];

/// Residual, relative to that of a rigid mass, below which a compliance is found: white errors of the angle, as jittering sample instants
/// make them, look like a resonance that leaves 0.48 of them under the narrow kernel, white errors of the torque 0.8.
const CLEARLY_LESS: f64 = 0.45;

/// Evaluations of the simplex, and the spread of its residuals, relative to the least, at which it has converged.
const MAX_EVALUATIONS: usize = 60;
const CONVERGED: f64 = 1e-3;

const DIMENSION: usize = 3;

type Point = [f64; DIMENSION];

/// The compliance that leaves least.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeastResidual {
    pub(super) compliance: Compliance,
    /// The residual, relative to that of a rigid mass.
    pub(super) share: f64,
}

impl LeastResidual {
    /// Whether the compliance explains clearly more than one rigid mass.
    pub(super) fn is_clearly_less(&self) -> bool {
        self.share < CLEARLY_LESS
    }
}

/// The compliance that leaves least; `None` where no spring does better than one rigid mass.
pub(super) fn find_compliance(residual: impl Fn(&Compliance) -> f64) -> Option<LeastResidual> {
    let rigid = residual(&Compliance::RIGID);
    let cost = |point: Point| {
        let found = residual(&of(point));
        if found.is_finite() { found } else { f64::INFINITY }
    };
    let starts = RESONANCES_HZ.map(|resonance| {
        let point = [libm::log(resonance), USUAL[0], USUAL[1]];
        (cost(point), point)
    });
    let start = starts
        .into_iter()
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(cost, _)| *cost < rigid)?;
    let (least, point) = simplex(start, cost);
    Some(LeastResidual {
        compliance: of(point),
        share: least / rigid,
    })
}

fn of([log_resonance, damping_ratio, load_share]: Point) -> Compliance {
    Compliance::new(libm::exp(log_resonance), damping_ratio, load_share)
}

/// Nelder and Mead's search from a point, within the range.
fn simplex(start: (f64, Point), cost: impl Fn(Point) -> f64) -> (f64, Point) {
    let mut corners = [start; DIMENSION + 1];
    for (axis, corner) in corners[1..].iter_mut().enumerate() {
        corner.1[axis] += SIDES[axis];
        corner.0 = cost(corner.1);
    }
    let mut evaluations = DIMENSION;
    loop {
        corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (best, worst) = (corners[0], corners[DIMENSION]);
        if evaluations >= MAX_EVALUATIONS || worst.0 - best.0 <= CONVERGED * best.0 {
            return best;
        }
        // Mean of all corners but the worst, and a point on the line through it: 1 reflects the worst corner.
        let centre: Point = core::array::from_fn(|axis| {
            corners[..DIMENSION].iter().map(|corner| corner.1[axis]).sum::<f64>() / DIMENSION as f64
        });
        let mut at = |factor: f64| {
            let point = core::array::from_fn(|axis| {
                (centre[axis] + factor * (centre[axis] - worst.1[axis])).clamp(LOWER[axis], UPPER[axis])
            });
            evaluations += 1;
            (cost(point), point)
        };
        let reflected = at(1.0);
        let next = if reflected.0 < best.0 {
            let expanded = at(2.0);
            if expanded.0 < reflected.0 { expanded } else { reflected }
        } else if reflected.0 < corners[DIMENSION - 1].0 {
            reflected
        } else if reflected.0 < worst.0 {
            at(0.5)
        } else {
            at(-0.5)
        };
        if next.0 < worst.0 {
            corners[DIMENSION] = next;
            continue;
        }
        for corner in &mut corners[1..] {
            corner.1 = core::array::from_fn(|axis| 0.5 * (corner.1[axis] + best.1[axis]));
            corner.0 = cost(corner.1);
        }
        evaluations += DIMENSION;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_residual_is_found_and_a_rigid_mass_stays_rigid() {
        let truth = [libm::log(120.0), 0.05, 0.3];
        let residual = |compliance: &Compliance| {
            if compliance.is_rigid() {
                return 1.0;
            }
            let Compliance { locked, free, lag } = of(truth);
            let squared = |a: f64, b: f64| (a / b - 1.0) * (a / b - 1.0);
            let far =
                squared(compliance.locked, locked) + squared(compliance.free, free) + squared(compliance.lag, lag);
            libm::sqrt(0.01 + far)
        };
        let least = find_compliance(residual).expect("a compliance");
        let found = least.compliance;
        assert!(least.is_clearly_less());
        assert!((found.free / of(truth).free - 1.0).abs() < 0.05, "{found:?}");
        let alike = |with_spring: f64| find_compliance(move |of| if of.is_rigid() { 1.0 } else { with_spring });
        assert!(alike(0.6).is_some_and(|least| !least.is_clearly_less()));
        assert!(alike(1.1).is_none());
    }
}
