//! Friction, shorts and eccentricity of one window from the torque balance of the motor shaft.
//!
//! In: a window and the coefficients that all windows of the unit share. Out: the eight coefficients that may differ in this
//! window (intact turns, eccentricity, scale of friction, load, spring) by one linear least squares. What the gear loses under
//! the load depends on load and spring, so up to four rounds find both; without it every spring would
//! look like friction.

use nalgebra::{SMatrix, SVector};

use super::current_noise::{current_noise, noise_of_columns};
use super::elements::{Element, ElementReadings, Needed, Reading};
use super::jackknife::Groups;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::normal_equations::{NormalEquations, Solution};
use super::output_load::OutputLoad;
use super::overlap::Overlap;
use super::shared::{SHARED_COUNT, SharedMatrix, free_of_shared, is_free, is_worn, shared_columns, spread};
use super::terms::{BalanceShape, TERM_COUNT, Term, balance_rows};
use crate::monitor_fit::RecordedSample;

/// Coefficients of the torque balance that all windows of one unit share, in the order of [`Term`].
///
/// The balance has no absolute scale of torque: `N_A + N_B + N_C = 3`, and J, T_d, C are relative to the type's k. Load and
/// spring are zero, because each window has its own.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct BalanceCoefficients {
    /// The coefficients.
    pub values: [f64; TERM_COUNT],
    /// Constants of the terms.
    pub shape: BalanceShape,
    /// Root-mean-square residual of the windows from which they were learnt, Nm.
    pub residual_rms: f64,
    /// Half width of the kernel, s.
    pub half_width_s: f64,
    /// Whether the errors of the rows are those of the motor angle, as jittering sample instants make them, instead of torques.
    pub angle_errors: bool,
}

impl BalanceCoefficients {
    /// Coefficient of a term.
    #[must_use]
    pub fn of(&self, term: Term) -> f64 {
        self.values[term as usize]
    }
}

/// Terms of friction, which wear together.
const WORN: [Term; 4] = [Term::DryFriction, Term::Stribeck, Term::MeshCos, Term::MeshSin];

/// Terms that are free or stand in a free sum.
const FREE: [Term; 7] = [
    Term::TurnsA,
    Term::TurnsB,
    Term::TurnsC,
    Term::EccentricityCos,
    Term::EccentricitySin,
    Term::Load,
    Term::Spring,
];

/// Rounds in which load and the gear's losses find each other.
pub(super) const LOAD_ROUNDS: usize = 4;

/// Free coefficients of a window: N_A, N_B, N_C, ζ cos φ_e, ζ sin φ_e, scale of friction, load, spring.
const FREE_COUNT: usize = 8;

/// Places of friction and of load and spring among the free coefficients.
const FRICTION: usize = 5;
const LOAD: usize = 6;

/// Torque balance of one window.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueBalance {
    /// Friction scale, turns and eccentricity; the other elements are untouched.
    pub(super) readings: ElementReadings,
    /// Load at the output.
    pub(super) load: OutputLoad,
    /// Root-mean-square residual, Nm.
    pub(super) residual_rms: f64,
    /// Rows used.
    pub(super) rows: usize,
    /// Rows used that share no sample.
    pub(super) independent: f64,
}

/// Fits the free coefficients of a window whose position gain is that of the unit times `gain`; `learnt` is the covariance of what the unit's windows share, once it is known.
pub(super) fn torque_balance<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    unit: &BalanceCoefficients,
    gain: f64,
    learnt: Option<&SharedMatrix>,
) -> TorqueBalance {
    let kernel = Kernel::new(unit.half_width_s, window.params().sensors.sample_rate);
    let mut balance = TorqueBalance {
        readings: ElementReadings::none(),
        load: OutputLoad::default(),
        residual_rms: 0.0,
        rows: 0,
        independent: 0.0,
    };
    let noise = noise_of_columns(current_noise(window), window.params().motor.k, &kernel);
    let mut losing = OutputLoad::default();
    for _ in 0..LOAD_ROUNDS {
        let mut sums = sums(window, unit, &kernel, losing, gain);
        sums.groups.for_each(|group| without_noise(group, &noise));
        let equations = sums.groups.whole();
        balance.rows = equations.rows;
        balance.independent = (balance.rows * kernel.stride) as f64 / kernel.span as f64;
        let enough = balance.independent >= (FREE_COUNT + 1) as f64;
        let Some(solution) = equations.solve().filter(|_| enough) else {
            balance.readings.fail(Element::BALANCE, Needed::LongerMotion);
            return balance;
        };
        balance.residual_rms = solution.residual_rms;
        balance.load = OutputLoad::new(&solution.x.fixed_rows::<2>(LOAD).into_owned());
        let information = equations.symmetric().fixed_view::<2, 2>(LOAD, LOAD).into_owned();
        let found = balance.load.losing(&information, balance.rows, window.params());
        let is_last = found.is_close(&losing);
        let mut covariance = sums.overlap.covariance(&equations, &solution);
        let of_groups = sums.groups.variance(SVector::clone);
        for place in 0..FREE_COUNT {
            covariance[(place, place)] = covariance[(place, place)].max(of_groups[place]);
        }
        if let Some(learnt) = learnt {
            // What fits worse has more of what commissioning does not know.
            let worse = (solution.residual_rms / unit.residual_rms.max(f64::MIN_POSITIVE)).max(1.0);
            let learnt = learnt + SharedMatrix::from_diagonal(&(spread(window.params()) * (worse * worse)));
            let error = error_of_shared(&solution, &sums.with_shared);
            covariance += error * learnt * error.transpose();
        }
        let attenuation = attenuation(&solution, balance.rows);
        for (place, element) in Element::BALANCE.into_iter().enumerate() {
            let reading = Reading {
                value: solution.x[place],
                sigma: libm::hypot(libm::sqrt(covariance[(place, place)].max(0.0)), attenuation[place]),
            };
            balance.readings.set(element, reading);
        }
        if sums.directions.iter().any(|&rows| rows * kernel.stride < kernel.span) {
            // With motion in one direction the load takes the place of friction.
            balance.readings.fail([Element::Friction], Needed::BothDirections);
        }
        if is_last {
            break;
        }
        losing = found;
    }
    balance
}

/// Largest bias of the free coefficients by errors of the sampled torque: as much as if the whole residual were the quadrature
/// current's, whose error stands in the columns of the turns too and draws them towards zero.
///
/// An error ε of `1.5 k i_q` is `ε s_j²/1.5` in the column of phase j; the mean of `s_i² s_j²` is 3/8 or 3/16. Derived here.
fn attenuation(solution: &Solution<FREE_COUNT>, rows: usize) -> SVector<f64, FREE_COUNT> {
    let squares = solution.residual_rms * solution.residual_rms * rows as f64 / 2.25;
    let turns = solution.x.fixed_rows::<3>(0);
    let mut products = SVector::<f64, FREE_COUNT>::zeros();
    for j in 0..3 {
        products[j] = squares * 0.1875 * (turns.sum() + turns[j]);
    }
    solution.inverse * products
}

/// How an error of the shared unknowns changes the *change* of the free coefficients since commissioning.
///
/// With the columns a of the free coefficients and s of the shared ones, `x̂ = N⁻¹ Σ a (… + s c)`; turns and eccentricity are
/// free and compared with the learnt ones. Derived here.
fn error_of_shared(
    solution: &Solution<FREE_COUNT>,
    with_shared: &SMatrix<f64, FREE_COUNT, SHARED_COUNT>,
) -> SMatrix<f64, FREE_COUNT, SHARED_COUNT> {
    let mut error = solution.inverse * with_shared;
    for unknown in 0..SHARED_COUNT {
        if is_free(unknown) {
            error.column_mut(unknown).fill(0.0);
        } else if is_worn(unknown) {
            error.column_mut(unknown).scale_mut(solution.x[FRICTION]);
        }
    }
    for (row, of_shared) in free_of_shared().row_iter().enumerate() {
        for unknown in 0..SHARED_COUNT {
            error[(row, unknown)] -= of_shared[unknown];
        }
    }
    error
}

/// Sums over the rows of a window.
struct Sums {
    groups: Groups<FREE_COUNT>,
    overlap: Overlap<FREE_COUNT>,
    /// Products of the free columns with those of the shared unknowns.
    with_shared: SMatrix<f64, FREE_COUNT, SHARED_COUNT>,
    /// Rows in either direction.
    directions: [usize; 2],
}

/// Subtracts the expected products of the current noise, at most half of a column's own.
fn without_noise(equations: &mut NormalEquations<FREE_COUNT>, noise: &[f64; 5]) {
    for (place, noise) in noise.iter().enumerate() {
        let whole = equations.ata[(place, place)];
        equations.ata[(place, place)] -= (noise * equations.rows as f64).min(0.5 * whole);
    }
}

fn sums<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    unit: &BalanceCoefficients,
    kernel: &Kernel,
    load: OutputLoad,
    gain: f64,
) -> Sums {
    let mut known = unit.values;
    for term in FREE.into_iter().chain(WORN) {
        known[term as usize] = 0.0;
    }
    let mut sums = Sums {
        groups: Groups::new(window.len()),
        overlap: Overlap::new(
            if unit.angle_errors {
                &kernel.second
            } else {
                &kernel.average
            },
            kernel.span,
        ),
        with_shared: SMatrix::zeros(),
        directions: [0; 2],
    };
    for (n, row) in balance_rows(window, &unit.shape, load, kernel, gain).enumerate() {
        let Some(row) = row else {
            sums.overlap.add(None);
            continue;
        };
        let term = |term: Term| row.terms[term as usize];
        let friction = WORN.iter().map(|&worn| unit.of(worn) * term(worn)).sum();
        let [a, b, c, ecc_cos, ecc_sin, constant, spring] = FREE.map(term);
        let rest: f64 = known.iter().zip(&row.terms).map(|(x, term)| x * term).sum();
        let free = [a, b, c, ecc_cos, ecc_sin, friction, constant, spring];
        sums.groups.add(n, &free, -rest);
        sums.overlap.add(Some(&free));
        for (unknown, shared) in shared_columns(&row).into_iter().enumerate() {
            for (place, free) in free.iter().enumerate() {
                sums.with_shared[(place, unknown)] += free * shared;
            }
        }
        sums.directions[usize::from(row.forward)] += 1;
    }
    sums
}

const _: () = assert!(FRICTION + 1 == Element::BALANCE.len());
