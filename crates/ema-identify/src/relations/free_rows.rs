//! Rows of the torque balance of one window by its free coefficients.

use super::balance_coefficients::BalanceCoefficients;
use super::between_samples::instants;
use super::free_coefficients::FREE_COUNT;
use super::kept::Kept;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::sample_reading::{SampleReader, SampleReading};
use super::shorted_loop::{LoopTorque, ShortedLoop};
use super::terms::{BalanceRing, BalanceRow, RowMaker, TERM_COUNT, Term, WindowState};
use crate::recorded_sample::RecordedSample;

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

/// A row of a window by its free coefficients.
#[derive(Clone, Copy)]
pub(super) struct FreeRow {
    /// All terms.
    pub(super) all: BalanceRow,
    /// Columns of the free coefficients.
    pub(super) free: [f64; FREE_COUNT],
    /// The right-hand side, Nm.
    pub(super) rest: f64,
}

impl FreeRow {
    /// With these coefficients of the terms that are neither free nor worn; of those they are zero.
    fn new(all: BalanceRow, unit: &BalanceCoefficients, known: &[f64; TERM_COUNT]) -> Self {
        let term = |term: Term| all.terms[term as usize];
        let friction = WORN.iter().map(|&worn| unit.of(worn) * term(worn)).sum();
        let [a, b, c, ecc_cos, ecc_sin, constant, spring] = FREE.map(term);
        let rest: f64 = known.iter().zip(&all.terms).map(|(x, term)| x * term).sum();
        Self {
            all,
            free: [a, b, c, ecc_cos, ecc_sin, friction, constant, spring],
            rest: -rest,
        }
    }
}

/// Makes the rows of a window, through the one ring that a controller has room for.
pub(super) struct FreeRows<'a, S> {
    pub(super) window: &'a MeasuredWindow<'a, S>,
    pub(super) unit: &'a BalanceCoefficients,
    pub(super) kernel: &'a Kernel,
    ring: BalanceRing,
    /// Kept where they are means between the samples.
    samples: Kept<SampleReading>,
    /// The rows of the state and the loop that they were made with.
    rows: Kept<Option<FreeRow>>,
    #[cfg(feature = "std")]
    rows_of: Option<(WindowState, Option<ShortedLoop>)>,
}

impl<'a, S: RecordedSample> FreeRows<'a, S> {
    pub(super) fn new(window: &'a MeasuredWindow<'a, S>, unit: &'a BalanceCoefficients, kernel: &'a Kernel) -> Self {
        Self {
            window,
            unit,
            kernel,
            ring: BalanceRing::new(kernel.span),
            samples: if instants(window.params()) > 0 {
                Kept::new(window.len())
            } else {
                Kept::none()
            },
            rows: Kept::new(window.len()),
            #[cfg(feature = "std")]
            rows_of: None,
        }
    }

    /// Passes the row of each inner sample, with what is known of the window; `shorted` is a loop in place of the turns of its phase.
    pub(super) fn each(
        &mut self,
        state: WindowState,
        shorted: Option<ShortedLoop>,
        mut pass: impl FnMut(Option<&FreeRow>),
    ) {
        #[cfg(feature = "std")]
        if self.rows_of.replace((state, shorted)) != Some((state, shorted)) {
            self.rows.clear();
        }
        let mut known = self.unit.values;
        for term in FREE.into_iter().chain(WORN) {
            known[term as usize] = 0.0;
        }
        let (window, unit, shape) = (self.window, self.unit, &self.unit.shape);
        let of_loop = shorted.map(|shorted| {
            let turns = unit.values[shorted.phase];
            LoopTorque::new(shorted, turns, window.motor(), window.params())
        });
        let mut reader = SampleReader::new(window, shape, state.gain);
        let mut maker = RowMaker::new(window, shape, state, self.kernel, of_loop, &mut self.ring);
        let (samples, rows) = (&mut self.samples, &mut self.rows);
        for (place, n) in window.inner().enumerate() {
            let make = || {
                let row = samples.with(place, || reader.next(n), |sample| maker.next(n, sample));
                row.map(|row| FreeRow::new(row, unit, &known))
            };
            rows.with(place, make, |row| pass(row.as_ref()));
        }
    }
}
