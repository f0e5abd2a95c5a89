//! The problem as a descent sees it: derivatives are computed again only where they no longer foretell the costs.

use core::cell::{Cell, RefCell};
use std::rc::Rc;

use ema_ga::Residuals;
use ema_models::{COST_LANES, UNKNOWN_COUNT};

use super::derivatives::Derivatives;
use super::linearised::Linearised;
use super::problem::{DIMENSION, Gradient, Information, Point, Problem, coordinates};

/// Derivatives that descents leave to the next one.
#[derive(Default)]
pub(super) struct Known<'a> {
    /// Whole ones of the first point.
    first: Option<Rc<Derivatives<'a>>>,
    /// Those of the last descent, and the last point to which they foretold the cost.
    last: Option<(Option<Point>, Rc<Derivatives<'a>>)>,
}

impl Known<'_> {
    /// Whether a further linearisation needs the quick coordinates only.
    pub(super) fn is_whole(&self) -> bool {
        self.first.is_some()
    }
}

/// A problem during one descent: derivatives along slow coordinates are those of the first point, and all derivatives stay as they are after
/// a step that gained what they had promised.
pub(super) struct OnDescent<'p, 'a> {
    problem: &'p Problem<'a>,
    known: RefCell<&'p mut Known<'a>>,
    last: RefCell<Option<Last<'a>>>,
    runs: Cell<u64>,
}

/// The last point that was linearised.
struct Last<'a> {
    at: Point,
    linearised: Linearised<'a>,
    /// The last point to which it foretold the cost, at first its own.
    foretold: Option<Point>,
}

/// Share of the promised decrease of the cost, and its inverse, by which a step may miss it for the derivatives to stay.
const AS_PROMISED: f64 = 0.8;

/// Difference from the promised decrease up to which they stay as well: that of one standard deviation.
const ONE_SIGMA: f64 = 0.5;

impl Last<'_> {
    /// Whether the cost at another point is as the derivatives promised.
    fn foretells(&self, at: &Point, cost: f64) -> bool {
        let step = Gradient::from_fn(|p, _| at[p] - self.at[p]);
        let linear = &self.linearised;
        let promised = -(linear.gradient.dot(&step) + 0.5 * step.dot(&(linear.information * step)));
        let gained = linear.cost - cost;
        let alike = gained > AS_PROMISED * promised && gained * AS_PROMISED < promised;
        promised > 0.0 && (alike || (gained - promised).abs() < ONE_SIGMA)
    }
}

impl<'p, 'a> OnDescent<'p, 'a> {
    pub(super) fn new(problem: &'p Problem<'a>, known: &'p mut Known<'a>) -> Self {
        Self {
            problem,
            known: RefCell::new(known),
            last: RefCell::new(None),
            runs: Cell::new(0),
        }
    }

    /// Leaves the derivatives to the next descent; monitor runs so far.
    pub(super) fn ended(self) -> u64 {
        let last = self.last.into_inner();
        self.known.into_inner().last = last.map(|last| (last.foretold, last.linearised.derivatives));
        self.runs.get()
    }

    fn ran(&self, runs: u64) {
        self.runs.set(self.runs.get() + runs);
    }

    /// The derivatives for a point: those known where they still foretell its cost.
    fn derivatives(&self, at: &Point) -> Rc<Derivatives<'a>> {
        let mut known = self.known.borrow_mut();
        if let Some(last) = self.last.borrow_mut().take() {
            if last.foretold == Some(*at) {
                return last.linearised.derivatives;
            }
        } else if let Some((_, derivatives)) = known.last.take().filter(|(foretold, _)| *foretold == Some(*at)) {
            return derivatives;
        }
        let found = Rc::new(Derivatives::at(self.problem, at, known.first.as_deref()));
        if known.first.is_some() {
            self.ran(COST_LANES as u64);
        } else {
            self.ran(DIMENSION as u64 + 1);
            known.first = Some(found.clone());
        }
        found
    }
}

impl Residuals<DIMENSION> for OnDescent<'_, '_> {
    fn normal_equations(&self, genes: &Point, jtj: &mut Information, jtr: &mut Gradient) -> f64 {
        self.problem.anchor(genes);
        let linearised = Linearised::new(self.problem, self.derivatives(genes), genes);
        jtj.copy_from(&linearised.information);
        jtr.copy_from(&linearised.gradient);
        let cost = linearised.cost;
        *self.last.borrow_mut() = Some(Last {
            at: *genes,
            linearised,
            foretold: Some(*genes),
        });
        cost
    }

    fn cost(&self, genes: &Point) -> f64 {
        self.ran(1);
        let cost = self.problem.cost(genes);
        if let Some(last) = &mut *self.last.borrow_mut()
            && last.foretells(genes, cost)
        {
            last.foretold = Some(*genes);
        }
        cost
    }

    fn project(&self, genes: &mut Point) {
        let projected = coordinates(genes).projected_to_unit_disc().0;
        genes[..UNKNOWN_COUNT].copy_from_slice(&projected);
    }
}
