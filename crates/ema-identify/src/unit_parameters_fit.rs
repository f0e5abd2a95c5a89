//! Parameters of one unit from windows in which it was healthy: one joint least squares of the monitor over all of them.
//!
//! The windows share the deviations of [`UnitParameter`]; each has a load and an integral of its own. The tolerances of the
//! parameters are the prior, and of each window what it knows of its load: motion one way does not tell a load from friction.

use std::vec;
use std::vec::Vec;

use ema_models::{
    ActuatorParams, COST_LANES, Comparison, FaultVector, LOAD_COORDINATE, MonitorVariant, MotorDeviation, SIGNAL_COUNT,
    Scale, ShaftSizes, Tolerances, Unknowns,
};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use crate::unit_calibration::{Deviation, UNIT_PARAMETER_COUNT, UnitParameter, UnitParameters, apply};
use crate::unit_fit::load_share;

/// Unknowns of one window: the shared ones, load and integral in shares of the largest torque.
const WINDOW_COUNT: usize = UNIT_PARAMETER_COUNT + 2;

/// The point and one step of each unknown are the lanes of one evaluation.
const _: () = assert!(WINDOW_COUNT < COST_LANES);

/// Iterations at most.
const ITERATIONS: u32 = 20;

/// Damping of the first step, as a share of the information.
const DAMPING: f64 = 1e-2;

/// Least damping.
const DAMPING_MIN: f64 = 1e-9;

/// Change of the damping after each step.
const DAMPING_FACTOR: f64 = 10.0;

/// A step of the shared unknowns below this share of their tolerances ends the fit.
const TOLERANCE: f64 = 1e-2;

/// Errors of the monitor last as long as the response of the speed loop, s: so many samples tell as much as one with an error of its own.
const ERROR_TIME_S: f64 = 5e-3;

/// Step of the finite differences of load and integral.
const OWN_DIFFERENCE: f64 = 5e-3;

/// Step of the finite differences of a parameter, as a share of its tolerance. Short steps see the unevenness of play and counts, which
/// adds to the information of the flat directions: the fit then creeps along the valley of R, k and J, and states too small a sigma.
const DIFFERENCE_SHARE: f64 = 0.5;

/// Range of the deviations, as shares.
const RANGE: [f64; 2] = [-0.9, 9.0];

/// What a fit found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitParametersFit {
    /// The deviations.
    pub parameters: UnitParameters,
    /// Mean cost of the windows.
    pub cost: f64,
}

type Shared = SVector<f64, UNIT_PARAMETER_COUNT>;
type Own = SVector<f64, 2>;

/// What a window knows of its load and integral beforehand, in shares of the largest torque.
#[derive(Clone, Copy)]
struct OwnPrior {
    expected: Own,
    information: Own,
}

impl OwnPrior {
    /// Of a window whose squares count by `share`; what is known beforehand counts in full.
    fn of(window: &Comparison<'_>, share: f64) -> Self {
        let scale = Scale::new(window.params);
        let coordinates = |load_torque: f64, integral: f64| {
            let x = scale.coordinates(&Unknowns {
                load_torque,
                integral,
                ..window.unknowns_with_fault(FaultVector::NOMINAL)
            });
            Own::new(x.0[LOAD_COORDINATE], x.0[LOAD_COORDINATE + 1])
        };
        let sigma = coordinates(window.prior.load_torque, window.prior.integral);
        Self {
            expected: coordinates(window.conditions.load_torque.unwrap_or(0.0), 0.0),
            information: sigma.map(|sigma| 1.0 / (share * sigma * sigma)),
        }
    }
}

/// Fits the parameters of one unit to healthy windows of it; all comparisons have the type's parameters. The prior of the first
/// one's motor stands for the tolerances of R and k, `of_type` has the others.
///
/// Levenberg–Marquardt; each window's own unknowns are eliminated (Schur complement). `None` without windows, or
/// where sums are not finite.
#[must_use]
pub fn fit_unit_parameters(windows: &[Comparison<'_>], of_type: &Tolerances) -> Option<UnitParametersFit> {
    let first = windows.first()?;
    let of_motor = first.prior.motor;
    let mut prior = SMatrix::<f64, UNIT_PARAMETER_COUNT, UNIT_PARAMETER_COUNT>::from_diagonal(
        &tolerances(of_type).map(|t| 1.0 / (t * t)),
    );
    if let Some(known) = of_motor.information() {
        prior
            .fixed_view_mut::<2, 2>(0, 0)
            .copy_from(&nalgebra::Matrix2::from_fn(|r, c| known[r][c]));
    }
    let mut expected = Shared::zeros();
    (expected[0], expected[1]) = (of_motor.mean.resistance, of_motor.mean.back_emf);

    let own = windows
        .par_iter()
        .map(|window| Own::new(load_share(window), 0.0))
        .collect();
    let cost_of_prior = |shared: &Shared| {
        let off = shared - expected;
        0.5 * off.dot(&(prior * off))
    };
    let share = 1.0 / (ERROR_TIME_S * first.params.sensors.sample_rate).max(1.0);
    let mut best = Point::at(windows, expected, own, share);
    let mut damping = DAMPING;
    for _ in 0..ITERATIONS {
        let (mut information, mut gradient) = (prior, prior * (best.shared - expected));
        for sums in &best.sums {
            let (of_window, along) = sums.without_own();
            information += share * of_window;
            gradient += share * along;
        }
        let damped = information + SMatrix::from_diagonal(&(information.diagonal() * damping));
        let step = -(damped.try_inverse()? * gradient);
        let moved = (best.shared + step).map(|x| x.clamp(RANGE[0], RANGE[1]));
        let step = moved - best.shared;
        let own = best
            .own
            .iter()
            .zip(&best.sums)
            .map(|(own, sums)| own + sums.own_step(&step));
        let next = Point::at(windows, moved, own.collect(), share);
        if share * next.cost() + cost_of_prior(&next.shared) < share * best.cost() + cost_of_prior(&best.shared) {
            best = next;
            damping = (damping / DAMPING_FACTOR).max(DAMPING_MIN);
        } else {
            damping *= DAMPING_FACTOR;
        }
        if is_small(&step) {
            break;
        }
    }

    let Point { shared, sums, .. } = &best;
    let samples: usize = windows.iter().map(|window| window.recording.samples.len()).sum();
    let cost = best.sums.iter().map(|sums| sums.misfit).sum::<f64>() / samples.max(1) as f64;
    let signals = first.weights.to_array().iter().filter(|w| **w > 0.0).count() as f64;
    // What the monitor does not explain is the same in every window of an actuator: more windows average the noise, not this.
    let unexplained = (2.0 * cost / signals - 1.0).max(0.0);
    let variance = 1.0 + unexplained * windows.len() as f64;
    // The prior does not become worse where the windows fit badly.
    let information = sums
        .iter()
        .fold(prior, |sum, sums| sum + sums.without_own().0 * (share / variance));
    let covariance = information.try_inverse()?;
    let deviation = |parameter: UnitParameter| Deviation {
        share: shared[parameter as usize],
        sigma: covariance[(parameter as usize, parameter as usize)].max(0.0).sqrt(),
    };
    let parameters = UnitParameters {
        resistance: deviation(UnitParameter::Resistance),
        back_emf: deviation(UnitParameter::BackEmf),
        inductance: deviation(UnitParameter::Inductance),
        inertia: deviation(UnitParameter::Inertia),
        viscous_damping: deviation(UnitParameter::Damping),
        dry_friction: deviation(UnitParameter::DryFriction),
        position_gain: deviation(UnitParameter::PositionGain),
        speed_gain: deviation(UnitParameter::SpeedGain),
        integral_gain: deviation(UnitParameter::IntegralGain),
        speed_limit: deviation(UnitParameter::SpeedLimit),
        current_limit: deviation(UnitParameter::CurrentLimit),
        resistance_back_emf_correlation: covariance[(0, 1)] / (covariance[(0, 0)] * covariance[(1, 1)]).sqrt(),
    };
    cost.is_finite().then_some(UnitParametersFit { parameters, cost })
}

fn tolerances(of_type: &Tolerances) -> Shared {
    Shared::from_iterator(UnitParameter::ALL.map(|parameter| parameter.tolerance(of_type)))
}

fn is_small(step: &Shared) -> bool {
    step.component_div(&tolerances(&Tolerances::USUAL)).amax() < TOLERANCE
}

/// What the fit has found, and the normal equations of each window there.
struct Point {
    shared: Shared,
    own: Vec<Own>,
    sums: Vec<Sums>,
}

impl Point {
    fn at(windows: &[Comparison<'_>], shared: Shared, own: Vec<Own>, share: f64) -> Self {
        let sums = windows
            .par_iter()
            .zip(&own)
            .map(|(window, own)| Sums::of(window, &shared, own, share))
            .collect();
        Self { shared, own, sums }
    }

    /// Cost of all windows, without the prior of the shared unknowns.
    fn cost(&self) -> f64 {
        self.sums.iter().map(|sums| sums.cost).sum()
    }
}

/// Normal equations of one window.
struct Sums {
    ata: SMatrix<f64, WINDOW_COUNT, WINDOW_COUNT>,
    atr: SVector<f64, WINDOW_COUNT>,
    /// With the prior of load and integral.
    cost: f64,
    /// Without.
    misfit: f64,
}

impl Sums {
    /// By central differences: in the valley of R, k and J the error of one-sided ones leads astray.
    fn of(window: &Comparison<'_>, shared: &Shared, own: &Own, share: f64) -> Self {
        let tolerances = tolerances(&Tolerances::USUAL);
        let step = |place: usize| tolerances.get(place).map_or(OWN_DIFFERENCE, |t| DIFFERENCE_SHARE * t);
        // Lane 0 and the unused lanes are at the point itself.
        let [forward, backward] = [1.0, -1.0].map(|direction| {
            let variants: [MonitorVariant; COST_LANES] = core::array::from_fn(|lane| {
                let (mut shared, mut own) = (*shared, *own);
                match lane.checked_sub(1) {
                    Some(place) if place < UNIT_PARAMETER_COUNT => shared[place] += direction * step(place),
                    Some(place) if place < WINDOW_COUNT => own[place - UNIT_PARAMETER_COUNT] += direction * step(place),
                    _ => {}
                }
                variant(window, &shared, &own)
            });
            let mut residuals = vec![[[0.0; COST_LANES]; SIGNAL_COUNT]; window.recording.samples.len()];
            window.residuals_of_variants(&variants, &[], &mut |n, found| residuals[n] = *found);
            residuals
        });

        let weights = window.weights.to_array();
        let mut sums = Self {
            ata: SMatrix::zeros(),
            atr: SVector::zeros(),
            cost: 0.0,
            misfit: 0.0,
        };
        for (ahead, behind) in forward.iter().zip(&backward) {
            for ((ahead, behind), weight) in ahead.iter().zip(behind).zip(weights) {
                let r = weight * ahead[0];
                let slopes = SVector::<f64, WINDOW_COUNT>::from_fn(|place, _| {
                    weight * (ahead[place + 1] - behind[place + 1]) / (2.0 * step(place))
                });
                sums.ata.syger(1.0, &slopes, &slopes, 1.0);
                sums.atr.axpy(r, &slopes, 1.0);
                sums.misfit += 0.5 * r * r;
            }
        }
        sums.ata.fill_upper_triangle_with_lower_triangle();
        sums.cost = sums.misfit;
        let prior = OwnPrior::of(window, share);
        for n in 0..own.len() {
            let (place, off) = (UNIT_PARAMETER_COUNT + n, own[n] - prior.expected[n]);
            sums.ata[(place, place)] += prior.information[n];
            sums.atr[place] += prior.information[n] * off;
            sums.cost += 0.5 * prior.information[n] * off * off;
        }
        sums
    }

    fn own_inverse(&self) -> SMatrix<f64, 2, 2> {
        let own = self.ata.fixed_view::<2, 2>(UNIT_PARAMETER_COUNT, UNIT_PARAMETER_COUNT);
        let regular = own + SMatrix::<f64, 2, 2>::identity() * 1e-9;
        regular.try_inverse().unwrap_or_else(SMatrix::zeros)
    }

    /// Information and gradient of the shared unknowns.
    fn without_own(&self) -> (SMatrix<f64, UNIT_PARAMETER_COUNT, UNIT_PARAMETER_COUNT>, Shared) {
        let coupling = self.ata.fixed_view::<UNIT_PARAMETER_COUNT, 2>(0, UNIT_PARAMETER_COUNT);
        let projected = coupling * self.own_inverse();
        let shared = self.ata.fixed_view::<UNIT_PARAMETER_COUNT, UNIT_PARAMETER_COUNT>(0, 0);
        let own_gradient = self.atr.fixed_rows::<2>(UNIT_PARAMETER_COUNT);
        (
            shared - projected * coupling.transpose(),
            self.atr.fixed_rows::<UNIT_PARAMETER_COUNT>(0) - projected * own_gradient,
        )
    }

    /// Step of load and integral for a step of the shared unknowns.
    fn own_step(&self, step: &Shared) -> Own {
        let coupling = self.ata.fixed_view::<UNIT_PARAMETER_COUNT, 2>(0, UNIT_PARAMETER_COUNT);
        -(self.own_inverse() * (self.atr.fixed_rows::<2>(UNIT_PARAMETER_COUNT) + coupling.transpose() * step))
    }
}

/// The monitor of a window for these unknowns.
fn variant(window: &Comparison<'_>, shared: &Shared, own: &Own) -> MonitorVariant {
    let mut params: ActuatorParams = *window.params;
    for parameter in UnitParameter::ALL {
        if !matches!(parameter, UnitParameter::Resistance | UnitParameter::BackEmf) {
            apply(parameter, shared[parameter as usize], &mut params);
        }
    }
    let scale = Scale::new(window.params);
    let mut x = scale.coordinates(&window.unknowns_with_fault(FaultVector::NOMINAL));
    (x.0[LOAD_COORDINATE], x.0[LOAD_COORDINATE + 1]) = (own[0], own[1]);
    let unknowns = Unknowns {
        motor: MotorDeviation {
            resistance: shared[0],
            back_emf: shared[1],
        },
        ..scale.unknowns(&x)
    };
    window.variant(&params, window.conditions.v_dc, &unknowns, ShaftSizes::default())
}
