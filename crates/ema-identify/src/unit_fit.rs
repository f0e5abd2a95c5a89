//! Calibration of one motor: how far it is off its type, from windows in which it was healthy.
//!
//! A motor's resistance and back-EMF coefficient differ from the type's by some percent. A weak magnet and three slightly
//! shorted phases look the same in one window, so this has to be learnt while the actuator is known to be healthy.

use std::vec::Vec;

use ema_models::{
    Comparison, Coordinates, FaultVector, MOTOR_COORDINATES, MotorDeviation, MotorKnowledge, RANK_LANES, Scale,
    UNKNOWN_COUNT, Unknowns,
};
use nalgebra::{Matrix2, Vector2};

/// Places of load and integral among the coordinates: what each window has of its own.
const OWN: [usize; 2] = [8, 9];

/// Fewest healthy windows that a unit is calibrated from.
pub const WINDOWS_MIN: usize = 5;

/// Iterations of the joint fit at most; it converges in about six.
const ITERATIONS: u32 = 20;

/// A step of the motor's coordinates below this ends the fit.
const TOLERANCE: f64 = 1e-7;

/// Step of the finite differences.
const DIFFERENCE: f64 = 2e-3;

/// Loads tried as a start where none is measured, in shares of the largest torque: ±8 % in sixteen steps.
const LOAD_SPACING: f64 = 0.01;

/// A fitted motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitFit {
    /// Its deviation, and how well the windows determine it.
    pub motor: MotorKnowledge,
    /// Mean cost of the windows.
    pub cost: f64,
}

/// Fits one motor to several healthy windows of it at once: deviations that they share, a load and an integral that each
/// has of its own. The prior of the first comparison's motor stands for the tolerance of the type.
///
/// Gauss–Newton on the normal equations of all windows, each window's own unknowns eliminated (Schur complement). `None`
/// without windows, or where they do not determine it.
#[must_use]
pub fn fit_motor(windows: &[Comparison<'_>]) -> Option<UnitFit> {
    let first = windows.first()?;
    let prior = first.prior.motor;
    let tolerance = prior
        .information()
        .map_or(Matrix2::zeros(), |p| Matrix2::from_fn(|r, c| p[r][c]));
    let expected = Vector2::new(prior.mean.resistance, prior.mean.back_emf);
    // The windows themselves say nothing of the motor beforehand: the tolerance counts once, not once in each.
    let windows: Vec<Comparison<'_>> = windows.iter().map(without_prior).collect();

    let mut own: Vec<Vector2<f64>> = windows.iter().map(start).collect();
    let mut motor = expected;
    let mut last: Option<(f64, Vector2<f64>, Vec<Vector2<f64>>)> = None;
    for _ in 0..ITERATIONS {
        let blocks: Vec<Block> = windows
            .iter()
            .zip(&own)
            .map(|(window, own)| Block::of(window, &at(own, &motor)))
            .collect();
        let off = motor - expected;
        let cost = blocks.iter().map(|b| b.cost).sum::<f64>() + 0.5 * off.dot(&(tolerance * off));
        if let Some((least, good_motor, good_own)) = &last
            && cost > *least
        {
            // Too far: half the way back.
            motor = 0.5 * (motor + good_motor);
            own = own.iter().zip(good_own).map(|(a, b)| 0.5 * (a + b)).collect();
            if (motor - good_motor).norm() < TOLERANCE {
                break;
            }
            continue;
        }
        last = Some((cost, motor, own.clone()));

        let mut information = tolerance;
        let mut gradient = tolerance * off;
        for block in &blocks {
            information += block.motor - block.mixed.transpose() * block.own_inverse * block.mixed;
            gradient += block.motor_gradient - block.mixed.transpose() * block.own_inverse * block.own_gradient;
        }
        let step = -(information.try_inverse()? * gradient);
        motor += step;
        for (own, block) in own.iter_mut().zip(&blocks) {
            *own -= block.own_inverse * (block.own_gradient + block.mixed * step);
        }
        if step.norm() < TOLERANCE {
            break;
        }
    }

    let (_, motor, own) = last?;
    let mut information = tolerance;
    let (mut cost, mut count) = (0.0, 0.0);
    for (window, own) in windows.iter().zip(&own) {
        let block = Block::of(window, &at(own, &motor));
        information += block.motor - block.mixed.transpose() * block.own_inverse * block.mixed;
        cost += block.cost;
        count += window.recording.samples.len() as f64;
    }
    let signals = first.weights.to_array().iter().filter(|w| **w > 0.0).count() as f64;
    let excess = (2.0 * cost / (count * signals)).max(1.0);
    let covariance = information.try_inverse()? * excess;
    Some(UnitFit {
        motor: MotorKnowledge {
            mean: MotorDeviation {
                resistance: motor[0],
                back_emf: motor[1],
            },
            covariance: [
                [covariance[(0, 0)], covariance[(0, 1)]],
                [covariance[(1, 0)], covariance[(1, 1)]],
            ],
        },
        cost: cost / count.max(1.0),
    })
}

fn without_prior<'a>(window: &Comparison<'a>) -> Comparison<'a> {
    let mut bare = *window;
    bare.prior.motor = MotorKnowledge::default();
    bare
}

/// A healthy actuator with its window's own unknowns and the shared motor.
fn at(own: &Vector2<f64>, motor: &Vector2<f64>) -> Coordinates {
    let mut x = [0.0; UNKNOWN_COUNT];
    // The nominal gain; every other fault is nothing.
    x[7] = FaultVector::NOMINAL.gain;
    for (n, p) in OWN.into_iter().enumerate() {
        x[p] = own[n].clamp(Coordinates::LOWER[p], Coordinates::UPPER[p]);
    }
    for (n, p) in MOTOR_COORDINATES.into_iter().enumerate() {
        x[p] = motor[n].clamp(Coordinates::LOWER[p], Coordinates::UPPER[p]);
    }
    Coordinates(x)
}

/// Load at the start of a fit.
fn start(window: &Comparison<'_>) -> Vector2<f64> {
    Vector2::new(load_share(window), 0.0)
}

/// Load as measured, or the one of sixteen that fits best, as a share of the largest torque.
pub(crate) fn load_share(window: &Comparison<'_>) -> f64 {
    match window.conditions.load_torque {
        Some(load) => load / Scale::new(window.params).load_unit(),
        None => best_load(window).0,
    }
}

/// Mean cost of the healthy actuator under the load that was measured, or the one of sixteen that fits best.
#[must_use]
pub fn healthy_cost(window: &Comparison<'_>) -> f64 {
    match window.conditions.load_torque {
        Some(_) => window.least_squares(&window.unknowns_with_fault(FaultVector::NOMINAL)),
        None => best_load(window).1,
    }
}

/// The load of sixteen with which the healthy actuator fits best, as a share of the largest torque, and its mean cost.
fn best_load(window: &Comparison<'_>) -> (f64, f64) {
    let scale = Scale::new(window.params);
    let healthy = window.unknowns_with_fault(FaultVector::NOMINAL);
    let shares: [f64; RANK_LANES] = core::array::from_fn(|n| (n as f64 - 0.5 * (RANK_LANES - 1) as f64) * LOAD_SPACING);
    let costs = window.rank(&shares.map(|share| Unknowns {
        load_torque: share * scale.load_unit(),
        ..healthy
    }));
    let best = (0..RANK_LANES).min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
    best.map_or((0.0, f64::INFINITY), |n| (shares[n], costs[n]))
}

/// The parts of one window's normal equations.
struct Block {
    own_inverse: Matrix2<f64>,
    mixed: Matrix2<f64>,
    motor: Matrix2<f64>,
    own_gradient: Vector2<f64>,
    motor_gradient: Vector2<f64>,
    cost: f64,
}

impl Block {
    fn of(window: &Comparison<'_>, at: &Coordinates) -> Self {
        let normal = window.normal_equations(at, DIFFERENCE);
        let part = |rows: [usize; 2], columns: [usize; 2]| Matrix2::from_fn(|r, c| normal.jtj[rows[r]][columns[c]]);
        let own = part(OWN, OWN) + Matrix2::identity() * 1e-9;
        Self {
            own_inverse: own.try_inverse().unwrap_or(Matrix2::zeros()),
            mixed: part(OWN, MOTOR_COORDINATES),
            motor: part(MOTOR_COORDINATES, MOTOR_COORDINATES),
            own_gradient: Vector2::new(normal.jtr[OWN[0]], normal.jtr[OWN[1]]),
            motor_gradient: Vector2::new(normal.jtr[MOTOR_COORDINATES[0]], normal.jtr[MOTOR_COORDINATES[1]]),
            cost: normal.cost,
        }
    }
}
