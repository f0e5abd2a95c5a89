//! How uncertain each parameter of an optimum is, and what the window does not show at all.

use crate::estimate::OBSERVABLE_SIGMA;
use ema_models::{Coordinates, FAULT_COUNT, SIGNAL_COUNT, Scale, UNKNOWN_COUNT, Weights};
use nalgebra::SMatrix;

use super::competing_optima::differ;
use super::friction_bound::friction_bound;
use super::least_squares::{FINE_STEP, RUNS_PER_LINEARISATION};
use super::locked::is_locked;
use super::variance::variance;
use super::window::MonitoredWindow;
use crate::calibration::Mismatch;
use crate::estimate::Estimate;

/// Monitor runs after the search: those of the last weighing and of [`assess`] without its friction bound.
pub(crate) const RUNS_OF_ASSESSMENT: u64 = RUNS_PER_LINEARISATION + 3;

/// Where a search ended.
pub(crate) struct Optimum {
    pub(crate) at: Coordinates,
    /// Where the last descent has computed it; else it is computed.
    pub(crate) curvature: Option<Curvature>,
    /// Another one that explains the window as well.
    pub(crate) competing: Option<Coordinates>,
}

#[cfg(feature = "std")]
impl Optimum {
    /// The end of a search that knows no other.
    pub(crate) fn uncompared(at: Coordinates) -> Self {
        Self {
            at,
            curvature: None,
            competing: None,
        }
    }
}

/// The estimate of an optimum: what it says, and how uncertain it is. Each parameter is at least as uncertain as the
/// competing optimum is far. Its cost is by the weights `of_cost`.
///
/// `runs_left` are the monitor runs left for the bound on friction; `None` for a search that does not end in an optimum,
/// whose curvature has to do.
pub(crate) fn assess(
    window: &impl MonitoredWindow,
    of_cost: &Weights,
    mismatch: &Mismatch,
    end: Optimum,
    evaluations: u64,
    runs_left: Option<u64>,
) -> Estimate {
    let scale = Scale::new(window.params());
    let unknowns = scale.unknowns(&end.at);
    // The point may lie outside the disc of eccentricities; what is assessed is what is reported.
    let at = scale.coordinates(&unknowns);
    let runs = end.curvature.as_ref().map_or(RUNS_PER_LINEARISATION, |_| 0);
    let curvature = end.curvature.unwrap_or_else(|| Curvature::at(window, &at));
    let fault = unknowns.fault;
    let (squares, count) = window.squared_residuals(&unknowns);
    let n = (count as f64).max(1.0);

    // Correlated residuals are already weighted down, so the weighted ones count as independent of unit size; a
    // worse fit than the calibration's widens the interval.
    let excess = (2.0 * curvature.cost / (n * window.weighted_signals())).max(1.0);
    let mut by_data = curvature.variance.map(|variance| libm::sqrt(excess * variance));
    let bound = runs_left.map(|left| friction_bound(window, &at, curvature.cost, by_data[0], excess, left));
    by_data[0] = bound.as_ref().map_or(by_data[0], |bound| bound.sigma);
    let alone: [f64; FAULT_COUNT] = core::array::from_fn(|p| hypot(by_data[p], mismatch.model_sigma[p]));
    // A parameter that is not observable is open without a competing optimum.
    let competing = end
        .competing
        .filter(|other| differ(other, &at, |p| alone[p] <= OBSERVABLE_SIGMA));
    let total: [f64; FAULT_COUNT] =
        core::array::from_fn(|p| hypot(alone[p], competing.map_or(0.0, |other| other.0[p] - at.0[p])));
    let (sigma, observable) = reported(fault.eccentricity, &total, &total);
    Estimate {
        fault,
        unknowns,
        sigma,
        observable,
        cost: mean_cost(of_cost, &squares, window.sample_count()),
        residual_rms_a: libm::sqrt(squares[QUADRATURE_CURRENT] / n),
        evaluations: evaluations + runs + 1 + bound.as_ref().map_or(0, |bound| bound.spent),
        cut: bound.is_some_and(|bound| bound.cut),
        competing_optimum: competing.map(|other| scale.unknowns(&other).fault),
        share: [0.0; FAULT_COUNT],
        back_emf_off: unknowns.motor.back_emf - window.prior().motor.mean.back_emf,
        other_motor: false,
        locked: is_locked(window),
        #[cfg(feature = "std")]
        deviations: std::vec::Vec::new(),
        #[cfg(feature = "std")]
        inferred: crate::inferred::InferredReadings::default(),
    }
}

/// Standard deviation `total` of each parameter as it is reported, and whether the parameter is observable: `total` up to
/// [`OBSERVABLE_SIGMA`]. A parameter has none where the window tells nothing of it: `excited` beyond the same limit. Both arguments are
/// sigmas of the fault coordinates, with the eccentricity as a Cartesian pair; `excited` leaves out what is not known of the unit.
pub(super) fn reported(
    eccentricity: f64,
    excited: &[f64; FAULT_COUNT],
    total: &[f64; FAULT_COUNT],
) -> ([Option<f64>; FAULT_COUNT], [bool; FAULT_COUNT]) {
    let mut sigma = [None; FAULT_COUNT];
    let mut observable = [false; FAULT_COUNT];
    for p in [0, 1, 2, 3, 4, 7] {
        observable[p] = total[p] <= OBSERVABLE_SIGMA;
        sigma[p] = (excited[p] <= OBSERVABLE_SIGMA).then_some(total[p]);
    }
    // Amplitude and direction out of the Cartesian pair: along and across the vector; across is an angle only where
    // the vector stands clear of its own uncertainty.
    let amplitude_sigma = total[5].max(total[6]);
    observable[5] = amplitude_sigma <= OBSERVABLE_SIGMA;
    sigma[5] = (excited[5].max(excited[6]) <= OBSERVABLE_SIGMA).then_some(amplitude_sigma);
    if observable[5] && eccentricity > 3.0 * amplitude_sigma {
        observable[6] = true;
        sigma[6] = Some(amplitude_sigma / eccentricity / core::f64::consts::TAU);
    }
    (sigma, observable)
}

/// Place of the quadrature current among the signals.
const QUADRATURE_CURRENT: usize = 1;

/// Length of the vector `(x, y)`.
///
/// With `std` the system's function, without it `libm`'s: the two may differ in the last bit.
fn hypot(x: f64, y: f64) -> f64 {
    #[cfg(feature = "std")]
    return x.hypot(y);
    #[cfg(not(feature = "std"))]
    return libm::hypot(x, y);
}

/// Cramér–Rao bound of each coordinate at a point, as a standard deviation: what the weights alone allow, without the
/// monitor's own mismatch.
#[must_use]
pub fn cramer_rao_bound(window: &impl MonitoredWindow, at: &Coordinates) -> [f64; UNKNOWN_COUNT] {
    Curvature::at(window, at).variance.map(libm::sqrt)
}

/// Mean over the samples of half the squared weighted residuals.
fn mean_cost(weights: &Weights, squares: &[f64; SIGNAL_COUNT], samples: usize) -> f64 {
    let weighted = weights
        .to_array()
        .into_iter()
        .zip(squares)
        .map(|(weight, square)| weight * weight * square);
    weighted.sum::<f64>() * (0.5 / samples.max(1) as f64)
}

/// Cost at a point, and what its curvature says of the coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Curvature {
    pub(super) cost: f64,
    /// Of each coordinate.
    pub(super) variance: [f64; UNKNOWN_COUNT],
}

impl Curvature {
    #[inline(never)]
    fn at(window: &impl MonitoredWindow, at: &Coordinates) -> Self {
        let mut normal = window.normal_equations(at, FINE_STEP);
        normal.fix_known_motor(&window.prior().motor);
        Self {
            cost: normal.cost,
            variance: variance(&SMatrix::from_fn(|r, c| normal.jtj[r][c])),
        }
    }
}
