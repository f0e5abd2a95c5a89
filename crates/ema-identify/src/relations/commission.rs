//! Learns what a unit's healthy windows share: the coefficients of its torque balance, its play and its position gain.
//!
//! One joint linear least squares over all windows: the shared coefficients, and a load and a spring per window. Those two are
//! eliminated window by window (Schur complement), so the memory does not grow with the unknowns. The healthy windows are then
//! estimated like later ones; mean and scatter of what they show are the unit's baseline.

use std::vec::Vec;

use ema_models::ActuatorParams;
use nalgebra::{SMatrix, SVector};

use super::commissioned::{Baseline, CommissionedRelations, element_readings};
use super::elements::{ELEMENT_COUNT, Element};
use super::measured::MeasuredWindow;
use super::normal_equations::NormalEquations;
use super::output_load::OutputLoad;
use super::terms::{BalanceRow, BalanceShape, TERM_COUNT, Term, balance_rows};
use super::torque_balance::{BalanceCoefficients, LOAD_ROUNDS};
use crate::monitor_fit::RecordedSample;

/// Fewest healthy windows from which a unit is learnt.
const MIN_WINDOWS: usize = 5;

/// Why a unit cannot be learnt from its windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommissionError {
    /// Fewer windows with motion than needed.
    #[error("expected at least {MIN_WINDOWS} healthy windows in which the motor turns, found {found}")]
    TooFewWindows {
        /// Windows with rows in the torque balance.
        found: usize,
    },
    /// Sums that are not finite.
    #[error("the torque balance of the healthy windows has no solution")]
    NoSolution,
}

/// Shared terms besides the turns, whose sum is fixed.
const SHARED: [Term; 19] = [
    Term::EccentricityCos,
    Term::EccentricitySin,
    Term::Inertia,
    Term::DryFriction,
    Term::Stribeck,
    Term::Damping,
    Term::CoggingCos,
    Term::CoggingSin,
    Term::MeshCos,
    Term::MeshSin,
    Term::Resolver1Cos,
    Term::Resolver1Sin,
    Term::Resolver2Cos,
    Term::Resolver2Sin,
    Term::EmfHarmonics,
    Term::OffsetA,
    Term::OffsetB,
    Term::Latency,
    Term::SetpointHold,
];

/// Shared unknowns: `N_B − 1`, `N_C − 1`, the shared terms.
const SHARED_COUNT: usize = 2 + SHARED.len();

/// Unknowns of one window: the shared ones, load and spring.
const WINDOW_COUNT: usize = SHARED_COUNT + 2;

/// Learns a unit from windows that are healthy on the operator's word.
///
/// # Errors
/// Fewer than five windows in which the motor turns, or sums that are not finite.
pub fn commission<S: RecordedSample>(
    windows: &[MeasuredWindow<'_, S>],
    shape: &BalanceShape,
) -> Result<CommissionedRelations, CommissionError> {
    let balance = shared_coefficients(windows, shape)?;
    let readings: Vec<_> = windows
        .iter()
        .map(|window| element_readings(window, &balance, None).0)
        .collect();
    let baseline: [Baseline; ELEMENT_COUNT] = Element::ALL.map(|element| {
        let shown: Vec<f64> = readings
            .iter()
            .filter_map(|readings| readings.get(element).ok())
            .map(|reading| reading.value)
            .collect();
        Baseline::of(&shown)
    });
    Ok(CommissionedRelations { balance, baseline })
}

/// The coefficients that all windows share.
fn shared_coefficients<S: RecordedSample>(
    windows: &[MeasuredWindow<'_, S>],
    shape: &BalanceShape,
) -> Result<BalanceCoefficients, CommissionError> {
    let mut loads = std::vec![OutputLoad::default(); windows.len()];
    let mut learnt = Err(CommissionError::NoSolution);
    for _ in 0..LOAD_ROUNDS {
        let sums: Vec<_> = windows
            .iter()
            .zip(&loads)
            .map(|(window, &load)| window_sums(window, shape, load))
            .collect();
        let found = sums.iter().filter(|sums| sums.rows > 0).count();
        if found < MIN_WINDOWS {
            return Err(CommissionError::TooFewWindows { found });
        }
        let mut shared = NormalEquations::<SHARED_COUNT>::new();
        for sums in &sums {
            add_without_own(&mut shared, sums);
        }
        let solution = shared.solve().ok_or(CommissionError::NoSolution)?;
        for ((window, sums), load) in windows.iter().zip(&sums).zip(&mut loads) {
            *load = own_load(sums, &solution.x, window.params());
        }
        learnt = Ok(coefficients(&solution.x, shape, solution.residual_rms));
    }
    learnt
}

/// Coefficients of the terms from the shared unknowns.
fn coefficients(x: &SVector<f64, SHARED_COUNT>, shape: &BalanceShape, residual_rms: f64) -> BalanceCoefficients {
    let mut values = [0.0; TERM_COUNT];
    values[Term::TurnsA as usize] = 1.0 - x[0] - x[1];
    values[Term::TurnsB as usize] = 1.0 + x[0];
    values[Term::TurnsC as usize] = 1.0 + x[1];
    values[Term::GearLoss as usize] = 1.0;
    for (m, term) in SHARED.into_iter().enumerate() {
        values[term as usize] = x[2 + m];
    }
    BalanceCoefficients {
        values,
        shape: *shape,
        residual_rms,
    }
}

/// Normal equations of one window.
fn window_sums<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    shape: &BalanceShape,
    load: OutputLoad,
) -> NormalEquations<WINDOW_COUNT> {
    let mut sums = NormalEquations::new();
    for row in balance_rows(window, shape, load).flatten() {
        let (a, y) = window_row(&row);
        sums.add(&a, y);
    }
    sums
}

/// The row `a · x = y` of the joint least squares.
fn window_row(row: &BalanceRow) -> ([f64; WINDOW_COUNT], f64) {
    let term = |term: Term| row.terms[term as usize];
    let [a, b, c] = [Term::TurnsA, Term::TurnsB, Term::TurnsC].map(term);
    let mut row = [0.0; WINDOW_COUNT];
    (row[0], row[1]) = (a - b, a - c);
    for (slot, shared) in row[2..].iter_mut().zip(SHARED) {
        *slot = -term(shared);
    }
    row[SHARED_COUNT] = -term(Term::Load);
    row[SHARED_COUNT + 1] = -term(Term::Spring);
    (row, a + b + c + term(Term::GearLoss))
}

/// Inverse of the block of load and spring, and its product with the other blocks.
struct Own {
    inverse: SMatrix<f64, 2, 2>,
    coupling: SMatrix<f64, SHARED_COUNT, 2>,
    rhs: SVector<f64, 2>,
}

impl Own {
    fn new(sums: &NormalEquations<WINDOW_COUNT>) -> Self {
        let whole = sums.symmetric();
        let mut block: SMatrix<f64, 2, 2> = whole.fixed_view::<2, 2>(SHARED_COUNT, SHARED_COUNT).into_owned();
        // A window without motion of the output shows no spring.
        for m in 0..2 {
            block[(m, m)] = block[(m, m)] * (1.0 + 1e-10) + f64::MIN_POSITIVE;
        }
        Self {
            inverse: block.try_inverse().unwrap_or_else(SMatrix::zeros),
            coupling: whole.fixed_view::<SHARED_COUNT, 2>(0, SHARED_COUNT).into_owned(),
            rhs: sums.aty.fixed_rows::<2>(SHARED_COUNT).into_owned(),
        }
    }
}

/// Adds a window's sums after elimination of its load and spring.
fn add_without_own(shared: &mut NormalEquations<SHARED_COUNT>, sums: &NormalEquations<WINDOW_COUNT>) {
    let own = Own::new(sums);
    let projected = own.coupling * own.inverse;
    shared.ata += sums.ata.fixed_view::<SHARED_COUNT, SHARED_COUNT>(0, 0) - projected * own.coupling.transpose();
    shared.aty += sums.aty.fixed_rows::<SHARED_COUNT>(0) - projected * own.rhs;
    shared.yy += sums.yy - own.rhs.dot(&(own.inverse * own.rhs));
    shared.rows += sums.rows;
}

/// Load and spring of a window for given shared unknowns, as far as the gear loses torque under them.
fn own_load(
    sums: &NormalEquations<WINDOW_COUNT>,
    shared: &SVector<f64, SHARED_COUNT>,
    params: &ActuatorParams,
) -> OutputLoad {
    let own = Own::new(sums);
    let found = own.inverse * (own.rhs - own.coupling.transpose() * shared);
    let information = sums
        .symmetric()
        .fixed_view::<2, 2>(SHARED_COUNT, SHARED_COUNT)
        .into_owned();
    OutputLoad::new(&found).losing(&information, sums.rows, params)
}
