//! The problem as a descent sees it: derivatives are computed again only where they no longer foretell the costs.

use core::cell::{Cell, RefCell};

use ema_ga::Residuals;
use ema_models::{COST_LANES, UNKNOWN_COUNT};
use nalgebra::{SMatrix, SVector};

use super::problem::{DIMENSION, Linearised, Point, Problem, Slopes, coordinates};

/// A problem during one descent: derivatives along slow coordinates are those of a point nearby, or of the first one, and all derivatives
/// stay as they are after a step that gained what they had promised.
pub(super) struct OnDescent<'p, 'a> {
    problem: &'p Problem<'a>,
    nearby: RefCell<&'p mut Option<Slopes>>,
    last: RefCell<Option<Last>>,
    runs: Cell<u64>,
}

/// The last point of a descent, with derivatives of it or of an earlier one.
struct Last {
    at: Point,
    linearised: Linearised,
}

/// Share of the promised decrease of the cost, and its inverse, by which a step may miss it for the derivatives to stay.
const AS_PROMISED: f64 = 0.8;

impl Last {
    /// Whether the cost at another point is as the derivatives promised.
    fn foretold(&self, at: &Point, cost: f64) -> bool {
        let step = SVector::<f64, DIMENSION>::from_fn(|p, _| at[p] - self.at[p]);
        let promised =
            -(self.linearised.gradient().dot(&step) + 0.5 * step.dot(&(self.linearised.information() * step)));
        let gained = self.linearised.cost() - cost;
        promised > 0.0 && gained > AS_PROMISED * promised && gained * AS_PROMISED < promised
    }
}

impl<'p, 'a> OnDescent<'p, 'a> {
    /// `nearby` are set at the first point where there are none.
    pub(super) fn new(problem: &'p Problem<'a>, nearby: &'p mut Option<Slopes>) -> Self {
        Self {
            problem,
            nearby: RefCell::new(nearby),
            last: RefCell::new(None),
            runs: Cell::new(0),
        }
    }

    /// Monitor runs so far.
    pub(super) fn runs(&self) -> u64 {
        self.runs.get()
    }

    fn ran(&self, runs: u64) {
        self.runs.set(self.runs.get() + runs);
    }

    /// The linearised problem at a point, by the derivatives that it had where they still foretell its costs.
    fn linearised(&self, at: &Point) -> Linearised {
        let mut last = self.last.borrow_mut();
        if let Some(mut before) = last.take() {
            if before.foretold(at, self.problem.cost(at)) {
                self.problem.set_residuals(&mut before.linearised, at);
                return before.linearised;
            }
            self.problem.reuse(before.linearised.rows);
        }
        let mut nearby = self.nearby.borrow_mut();
        let linearised = self.problem.linearised_near(at, nearby.as_ref());
        self.ran(if nearby.is_some() {
            COST_LANES as u64
        } else {
            DIMENSION as u64 + 1
        });
        if nearby.is_none() {
            **nearby = Some(Slopes::of(&linearised, self.problem));
        }
        linearised
    }
}

impl Residuals<DIMENSION> for OnDescent<'_, '_> {
    fn normal_equations(
        &self,
        genes: &Point,
        jtj: &mut SMatrix<f64, DIMENSION, DIMENSION>,
        jtr: &mut SVector<f64, DIMENSION>,
    ) -> f64 {
        let linearised = self.linearised(genes);
        jtj.copy_from(&linearised.information());
        jtr.copy_from(&linearised.gradient());
        let cost = linearised.cost();
        *self.last.borrow_mut() = Some(Last { at: *genes, linearised });
        cost
    }

    fn cost(&self, genes: &Point) -> f64 {
        self.ran(1);
        self.problem.cost(genes)
    }

    fn project(&self, genes: &mut Point) {
        let projected = coordinates(genes).projected_to_unit_disc().0;
        genes[..UNKNOWN_COUNT].copy_from_slice(&projected);
    }
}
