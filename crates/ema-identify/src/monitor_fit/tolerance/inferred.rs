//! What a window says of a reading that its own fit takes as prior knowledge: the fit without it, by one Newton step.
//!
//! With the information matrix I and the gradient g of the fit at x, and a reading r of standard deviation s of coordinate p, the fit
//! without the reading is `x − (I − e eᵀ/s²)⁻¹ (g − e (x_p − r)/s²)`, and its variance is the inverse's. Faults and nuisances are free
//! in it, also beyond their limits. Derived here.

use ema_models::{FaultId, LOAD_COORDINATE, Scale, UNKNOWN_COUNT};
use nalgebra::SVector;

use super::linearised::Linearised;
use super::nuisance::LINK_VOLTAGE;
use super::problem::{DIMENSION, Point, Problem};
use crate::inferred::{Inferred, InferredReadings};

/// What a window says of load and link voltage, where they are read; `factor` widens its sigmas.
pub(super) fn inferred(
    problem: &Problem<'_>,
    linearised: &Linearised<'_>,
    at: &Point,
    factor: f64,
) -> InferredReadings {
    let window = problem.comparison();
    let (conditions, unit) = (&window.conditions, Scale::new(window.params).load_unit());
    // Without a reading, the prior stands about zero.
    let read = conditions.load_torque.unwrap_or(0.0);
    let load = |friction: Option<f64>| {
        let prior = (read / unit, window.prior.load_torque / unit);
        let found = without(linearised, at, LOAD_COORDINATE, prior, friction)?;
        Some(Inferred {
            value: unit * found.value,
            sigma: factor * unit * found.sigma,
        })
    };
    let link = problem.link_sigma().and_then(|sigma| {
        let found = without(linearised, at, UNKNOWN_COUNT + LINK_VOLTAGE, (0.0, 1.0), None)?;
        Some(Inferred {
            value: conditions.v_dc * (1.0 + sigma * found.value),
            sigma: factor * conditions.v_dc * sigma * found.sigma,
        })
    });
    InferredReadings {
        load_torque: load(None),
        load_by_friction: load(Some(0.0)).zip(load(Some(1.0))).map(<[Inferred; 2]>::from),
        dc_link: link,
        turns: [None; 3],
        friction: None,
    }
}

/// Coordinate `p` by a fit without the reading of it and its standard deviation, with this friction where one is given; `None` where only
/// the reading tells it.
fn without(
    linearised: &Linearised<'_>,
    at: &Point,
    p: usize,
    (read, sigma): (f64, f64),
    friction: Option<f64>,
) -> Option<Inferred> {
    let of_reading = 1.0 / (sigma * sigma);
    let mut information = linearised.information;
    information[(p, p)] -= of_reading;
    // A coordinate that the window does not show stays where it is, with a large variance.
    for q in 0..DIMENSION {
        information[(q, q)] += LEAST_INFORMATION;
    }
    let mut gradient: SVector<f64, DIMENSION> = linearised.gradient;
    gradient[p] -= of_reading * (at[p] - read);
    if let Some(friction) = friction {
        information[(FRICTION, FRICTION)] += OF_FIXED;
        gradient[FRICTION] += OF_FIXED * (at[FRICTION] - friction);
    }
    let inverse = information.cholesky()?.inverse();
    let step = inverse.row(p).transpose().dot(&gradient);
    let found = Inferred {
        value: at[p] - step,
        sigma: libm::sqrt(inverse[(p, p)]),
    };
    (found.value.is_finite() && found.sigma.is_finite()).then_some(found)
}

/// Coordinate of friction.
const FRICTION: usize = FaultId::Friction.parameter();

/// Information of a friction that is given: a standard deviation of 0.001.
const OF_FIXED: f64 = 1e6;

/// Information that keeps the equations regular.
const LEAST_INFORMATION: f64 = 1e-9;
