//! Friction, shorts and eccentricity of one window from the torque balance of the motor shaft.
//!
//! In: a window and the coefficients that all windows of the unit share. Out: the eight coefficients that may differ in this
//! window (intact turns, eccentricity, scale of friction, load, spring) by one linear least squares. What the gear loses under
//! the load depends on load and spring, so up to four rounds find both; without it every spring would
//! look like friction.

use nalgebra::{SMatrix, SVector};

use super::current_noise::{current_noise, noise_of_columns};
use super::elements::{Element, ElementReadings, Needed, Reading};
use super::jackknife::Jackknife;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::normal_equations::{NormalEquations, Solution};
use super::output_load::OutputLoad;
use super::overlap::Overlap;
use super::shared::{SHARED_COUNT, Shared, free_of_shared, is_free, is_worn, shared_columns, spread};
use super::terms::{BalanceRing, BalanceRow, BalanceShape, TERM_COUNT, Term, balance_rows};
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

    /// The kernel of its rows at a sample rate, Hz.
    pub(super) fn kernel(&self, sample_rate: f64) -> Kernel {
        Kernel::new(self.half_width_s, sample_rate, &self.shape.compliance)
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
    /// Standard deviation of its constant part, Nm, where the motion shows it.
    pub(super) load_sigma: Option<f64>,
    /// Root-mean-square residual, Nm.
    pub(super) residual_rms: f64,
    /// Rows used.
    pub(super) rows: usize,
    /// Rows used that share no sample.
    pub(super) independent: f64,
}

/// Fits the free coefficients of a window whose position gain is that of the unit times `gain`; `learnt` is the covariance of what the unit's windows share, once it is known.
#[inline(never)]
pub(super) fn torque_balance<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    unit: &BalanceCoefficients,
    gain: f64,
    learnt: Option<&[[f64; SHARED_COUNT]; SHARED_COUNT]>,
) -> TorqueBalance {
    let kernel = unit.kernel(window.params().sensors.sample_rate);
    let mut balance = TorqueBalance {
        readings: ElementReadings::none(),
        load: OutputLoad::default(),
        load_sigma: None,
        residual_rms: 0.0,
        rows: 0,
        independent: 0.0,
    };
    let mut noise = SVector::<f64, FREE_COUNT>::zeros();
    let of_columns = noise_of_columns(current_noise(window), window.params().motor.k, &kernel);
    noise.fixed_rows_mut::<5>(0).copy_from_slice(&of_columns);
    let mut rows = Rows::new(window, unit, &kernel, gain);
    let mut equations = NormalEquations::new();
    let mut round = 0;
    let solution = loop {
        rows.sum(&mut equations);
        equations.without_noise(&noise);
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
        round += 1;
        if found.is_close(&rows.losing) || round == LOAD_ROUNDS {
            break solution;
        }
        rows.losing = found;
    };
    let (covariance, directions) = rows.covariance(&equations, &solution, &noise, learnt);
    let attenuation = attenuation(&solution, balance.rows);
    for (place, element) in Element::BALANCE.into_iter().enumerate() {
        let reading = Reading {
            value: solution.x[place],
            sigma: libm::hypot(libm::sqrt(covariance[(place, place)].max(0.0)), attenuation[place]),
        };
        balance.readings.set(element, reading);
    }
    if directions.iter().any(|&rows| rows * kernel.stride < kernel.span) {
        // With motion in one direction the load takes the place of friction.
        balance.readings.fail([Element::Friction], Needed::BothDirections);
    } else {
        balance.load_sigma = Some(libm::sqrt(covariance[(LOAD, LOAD)].max(0.0)));
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
#[inline(never)]
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

/// `E (P + D) Eᵀ` with the covariance P of the shared unknowns and a diagonal D, row by row: the controller has no room for a
/// second matrix of their size.
#[inline(never)]
fn covariance_by_shared(
    error: &SMatrix<f64, FREE_COUNT, SHARED_COUNT>,
    learnt: &[[f64; SHARED_COUNT]; SHARED_COUNT],
    spread: &Shared,
) -> SMatrix<f64, FREE_COUNT, FREE_COUNT> {
    let mut covariance = SMatrix::zeros();
    for unknown in 0..SHARED_COUNT {
        for place in 0..FREE_COUNT {
            let along: f64 = (0..SHARED_COUNT)
                .map(|other| error[(place, other)] * learnt[other][unknown])
                .sum();
            let weighted = along + error[(place, unknown)] * spread[unknown];
            for other in 0..FREE_COUNT {
                covariance[(place, other)] += weighted * error[(other, unknown)];
            }
        }
    }
    covariance
}

/// Rows of a window by its free coefficients, with the ring that they are made through: the controller has room for one.
struct Rows<'a, S> {
    window: &'a MeasuredWindow<'a, S>,
    unit: &'a BalanceCoefficients,
    kernel: &'a Kernel,
    gain: f64,
    ring: BalanceRing,
    /// Load under which the gear loses torque.
    losing: OutputLoad,
}

impl<'a, S: RecordedSample> Rows<'a, S> {
    fn new(window: &'a MeasuredWindow<'a, S>, unit: &'a BalanceCoefficients, kernel: &'a Kernel, gain: f64) -> Self {
        Self {
            window,
            unit,
            kernel,
            gain,
            ring: BalanceRing::new(kernel.span),
            losing: OutputLoad::default(),
        }
    }

    /// Passes the row of each inner sample: its terms, the columns of the free coefficients and the right-hand side.
    fn each(&mut self, mut pass: impl FnMut(Option<(&BalanceRow, &[f64; FREE_COUNT], f64)>)) {
        let mut known = self.unit.values;
        for term in FREE.into_iter().chain(WORN) {
            known[term as usize] = 0.0;
        }
        let (shape, ring) = (&self.unit.shape, &mut self.ring);
        for row in balance_rows(self.window, shape, self.losing, self.kernel, self.gain, ring) {
            let Some(row) = row else {
                pass(None);
                continue;
            };
            let term = |term: Term| row.terms[term as usize];
            let friction = WORN.iter().map(|&worn| self.unit.of(worn) * term(worn)).sum();
            let [a, b, c, ecc_cos, ecc_sin, constant, spring] = FREE.map(term);
            let rest: f64 = known.iter().zip(&row.terms).map(|(x, term)| x * term).sum();
            let free = [a, b, c, ecc_cos, ecc_sin, friction, constant, spring];
            pass(Some((&row, &free, -rest)));
        }
    }

    /// Sums the equations of all rows.
    #[inline(never)]
    fn sum(&mut self, equations: &mut NormalEquations<FREE_COUNT>) {
        *equations = NormalEquations::new();
        self.each(|row| {
            if let Some((_, free, rest)) = row {
                equations.add(free, rest);
            }
        });
    }

    /// Covariance of a solution, and the number of rows in either direction: by the errors of the rows, each variance at least that of
    /// the groups, and by the uncertainty of what the unit's windows share.
    #[inline(never)]
    fn covariance(
        &mut self,
        equations: &NormalEquations<FREE_COUNT>,
        solution: &Solution<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
        learnt: Option<&[[f64; SHARED_COUNT]; SHARED_COUNT]>,
    ) -> (SMatrix<f64, FREE_COUNT, FREE_COUNT>, [usize; 2]) {
        let (kernel, unit, window) = (self.kernel, self.unit, self.window);
        let weights = if unit.angle_errors {
            &kernel.second
        } else {
            &kernel.average
        };
        let mut overlap = Overlap::<FREE_COUNT>::new(weights, kernel.span);
        // Products of the free columns with those of the shared unknowns.
        let mut with_shared = SMatrix::<f64, FREE_COUNT, SHARED_COUNT>::zeros();
        let mut groups = Jackknife::<FREE_COUNT, FREE_COUNT>::new(window.len(), equations, solution, noise);
        let mut directions = [0; 2];
        let mut n = 0;
        self.each(|row| {
            overlap.add(row.map(|(_, free, _)| free));
            if let Some((row, free, rest)) = row {
                for (unknown, shared) in shared_columns(row).into_iter().enumerate() {
                    for (place, free) in free.iter().enumerate() {
                        with_shared[(place, unknown)] += free * shared;
                    }
                }
                groups.add(n, (free, rest), SVector::clone);
                directions[usize::from(row.forward)] += 1;
            }
            n += 1;
        });
        let mut covariance = overlap.covariance(equations, solution);
        let of_groups = groups.variance(SVector::clone);
        for place in 0..FREE_COUNT {
            covariance[(place, place)] = covariance[(place, place)].max(of_groups[place]);
        }
        if let Some(learnt) = learnt {
            // What fits worse has more of what commissioning does not know.
            let worse = (solution.residual_rms / unit.residual_rms.max(f64::MIN_POSITIVE)).max(1.0);
            let spread = spread(window.params()) * (worse * worse);
            covariance += covariance_by_shared(&error_of_shared(solution, &with_shared), learnt, &spread);
        }
        (covariance, directions)
    }
}

const _: () = assert!(FRICTION + 1 == Element::BALANCE.len());
