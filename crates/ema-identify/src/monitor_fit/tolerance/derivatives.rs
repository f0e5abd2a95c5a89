//! Derivatives of the residuals along all coordinates, by monitors side by side.

use core::cell::RefCell;
use core::mem;
use std::vec;
use std::vec::Vec;

use ema_models::{COST_LANES, GRAM_COLUMNS, Gram, GramRow, MonitorVariant, SIGNAL_COUNT, UNKNOWN_COUNT, add_gram};

use super::nuisance::{
    Action, BACKLASH, DYNAMIC_FRICTION, FRICTION_TEMPERATURE, NUISANCES, POSITION_GAIN, SPRING, STATIC_FRICTION,
};
use super::problem::{DIMENSION, HEALTHY_BACKLASH, Point, Problem, coordinates};

/// Step of the finite differences along a nuisance, standard deviations.
const NUISANCE_STEP: f64 = 0.025;

/// Steps that monitors side by side take, beside the point itself.
const STEPS_AT_ONCE: usize = COST_LANES - 1;

const _: () = assert!(DIMENSION <= GRAM_COLUMNS);

/// Derivatives about a point, with the confidence in each sample but without weights, and their products. Those along slow coordinates are
/// another point's where they were taken from it.
pub(super) struct Derivatives<'a> {
    /// Signal by signal, one row per sample; zero where it was not measured.
    rows: Vec<GramRow>,
    /// Where the rows' memory goes.
    spare: &'a RefCell<Vec<Vec<GramRow>>>,
    /// Of each signal the sum of the products of its rows.
    products: Vec<Gram>,
    /// Place of each coordinate in a row: first those that monitors of their own show, the quick ones before the slow ones.
    columns: [usize; DIMENSION],
}

/// A coordinate whose column is a sum of others.
struct SameDirection {
    of: usize,
    /// Coordinates, and the factor of each.
    as_much_as: Vec<(usize, f64)>,
}

impl<'a> Derivatives<'a> {
    /// Derivatives at a point; those along the slow coordinates are taken from `nearby`, if there are any.
    pub(super) fn at(problem: &Problem<'a>, at: &Point, nearby: Option<&Self>) -> Self {
        let same = same_directions(problem, at);
        let shown = |p: &usize| {
            let on_signals = p
                .checked_sub(UNKNOWN_COUNT)
                .is_some_and(|n| matches!(NUISANCES[n].action, Action::Signals(_)));
            !on_signals && !problem.is_known(*p) && same.iter().all(|direction| direction.of != *p)
        };
        let mut shown: Vec<usize> = (0..DIMENSION).filter(shown).collect();
        shown.sort_by_key(|&p| is_slow(p));
        let others = (0..DIMENSION).filter(|p| !shown.contains(p));
        let mut columns = [0; DIMENSION];
        for (column, p) in shown.iter().copied().chain(others).enumerate() {
            columns[p] = column;
        }
        let nearby = nearby.filter(|nearby| nearby.columns == columns);
        if nearby.is_some() {
            shown.retain(|&p| !is_slow(p));
        }
        let samples = problem.comparison().recording.samples.len();
        let spare = problem.spare();
        let mut rows = spare.borrow_mut().pop().unwrap_or_default();
        rows.clear();
        match nearby {
            Some(nearby) => rows.extend_from_slice(&nearby.rows),
            None => rows.resize(SIGNAL_COUNT * samples, [0.0; GRAM_COLUMNS]),
        }
        let mut found = Self {
            rows,
            spare,
            products: Vec::new(),
            columns,
        };
        found.take_steps(problem, at, &shown);
        if nearby.is_none() {
            found.add_changes_of_signals(problem);
        }
        found.add_same(&same);
        let weights = problem.comparison().weights.to_array();
        found.products = (0..SIGNAL_COUNT)
            .map(|signal| {
                let mut products = [[0.0; GRAM_COLUMNS]; GRAM_COLUMNS];
                if weights[signal] > 0.0 {
                    add_gram(found.of_signal(signal), &mut products);
                }
                products
            })
            .collect();
        found
    }

    /// The rows of a signal, one per sample.
    pub(super) fn of_signal(&self, signal: usize) -> &[GramRow] {
        let samples = self.rows.len() / SIGNAL_COUNT;
        &self.rows[signal * samples..][..samples]
    }

    /// The sum of the products of each signal.
    pub(super) fn products(&self) -> &[Gram] {
        &self.products
    }

    /// Place of each coordinate in a row.
    pub(super) fn columns(&self) -> &[usize; DIMENSION] {
        &self.columns
    }

    /// Columns of the coordinates that monitors of their own show, the first ones of a row.
    fn take_steps(&mut self, problem: &Problem<'_>, at: &Point, shown: &[usize]) {
        let own = coordinates(at).inward_steps(problem.step());
        let samples = self.rows.len() / SIGNAL_COUNT;
        let at_point = problem.differentiated_variant(at);
        let confidence = &problem.basis().confidence;
        for (pass, coordinates) in shown.chunks(STEPS_AT_ONCE).enumerate() {
            let (mut lanes, mut per_step): ([MonitorVariant; COST_LANES], _) =
                ([at_point; COST_LANES], [0.0; STEPS_AT_ONCE]);
            for (place, &p) in coordinates.iter().enumerate() {
                let step = own.get(p).copied().unwrap_or(NUISANCE_STEP.copysign(-at[p]));
                let mut stepped = *at;
                stepped[p] += step;
                lanes[place + 1] = problem.differentiated_variant(&stepped);
                per_step[place] = 1.0 / step;
            }
            let columns = pass * STEPS_AT_ONCE..pass * STEPS_AT_ONCE + coordinates.len();
            problem
                .comparison()
                .residuals_of_variants(&lanes, &problem.basis().torques, &mut |n, residuals| {
                    for (signal, [point, stepped @ ..]) in residuals.iter().enumerate() {
                        let row = &mut self.rows[signal * samples + n][columns.clone()];
                        let confidence = confidence[n][signal];
                        for ((slope, stepped), per_step) in row.iter_mut().zip(stepped).zip(per_step) {
                            *slope = ((stepped - point) * per_step * confidence) as f32;
                        }
                    }
                });
        }
    }

    /// What nuisances change in the signals.
    fn add_changes_of_signals(&mut self, problem: &Problem<'_>) {
        let samples = problem.comparison().recording.samples;
        let basis = problem.basis();
        for (number, place) in problem.on_signals() {
            let column = self.columns[UNKNOWN_COUNT + number];
            let sigma = problem.sigma(number);
            for signal in 0..SIGNAL_COUNT {
                let rows = &mut self.rows[signal * samples.len()..];
                for (n, (sample, row)) in samples.iter().zip(rows).enumerate() {
                    if sample.measured {
                        row[column] -= (sigma * basis.changes[n][place][signal] * basis.confidence[n][signal]) as f32;
                    }
                }
            }
        }
    }

    /// Columns that are sums of others.
    fn add_same(&mut self, same: &[SameDirection]) {
        for direction in same {
            let of = self.columns[direction.of];
            let terms: Vec<(usize, f32)> = direction
                .as_much_as
                .iter()
                .map(|&(p, factor)| (self.columns[p], factor as f32))
                .collect();
            for row in &mut self.rows {
                row[of] = terms.iter().map(|&(column, factor)| factor * row[column]).sum();
            }
        }
    }
}

impl Drop for Derivatives<'_> {
    fn drop(&mut self) {
        self.spare.borrow_mut().push(mem::take(&mut self.rows));
    }
}

/// Whether the derivatives along a coordinate hold for a whole descent: those of all nuisances but the ones that others are derived
/// from, and of a spring, whose loss in the gear depends on the rest of the load. Nuisances stay small, and the monitor is nearly
/// linear in them.
pub(super) fn is_slow(p: usize) -> bool {
    const QUICK: [usize; 5] = [DYNAMIC_FRICTION, STATIC_FRICTION, BACKLASH, POSITION_GAIN, SPRING];
    p.checked_sub(UNKNOWN_COUNT).is_some_and(|n| !QUICK.contains(&n))
}

/// Coordinates that change the monitor as others do, so that no roughness of the cost tells them apart.
fn same_directions(problem: &Problem<'_>, at: &Point) -> Vec<SameDirection> {
    let sigma = |n: usize| problem.sigma(n);
    let unknown = |n: usize| sigma(n) > 0.0;
    let mut same = Vec::new();
    // k1 and the temperature scale T_d and T_s by the same share.
    if unknown(DYNAMIC_FRICTION) && unknown(STATIC_FRICTION) {
        let share = |n: usize| 1.0 + sigma(n) * at[UNKNOWN_COUNT + n];
        let both = |factor: f64| {
            [DYNAMIC_FRICTION, STATIC_FRICTION].map(|n| (UNKNOWN_COUNT + n, factor * share(n) / sigma(n)))
        };
        same.push(SameDirection {
            of: 0,
            as_much_as: both(2.0 / (1.0 + 2.0 * at[0])).to_vec(),
        });
        if unknown(FRICTION_TEMPERATURE) {
            let warm = sigma(FRICTION_TEMPERATURE);
            let factor = warm / (1.0 + warm * at[UNKNOWN_COUNT + FRICTION_TEMPERATURE]);
            same.push(SameDirection {
                of: UNKNOWN_COUNT + FRICTION_TEMPERATURE,
                as_much_as: both(factor).to_vec(),
            });
        }
    }
    if unknown(BACKLASH) {
        same.push(SameDirection {
            of: UNKNOWN_COUNT + BACKLASH,
            as_much_as: vec![(1, sigma(BACKLASH) * HEALTHY_BACKLASH)],
        });
    }
    if unknown(POSITION_GAIN) {
        let share = 1.0 + sigma(POSITION_GAIN) * at[UNKNOWN_COUNT + POSITION_GAIN];
        same.push(SameDirection {
            of: UNKNOWN_COUNT + POSITION_GAIN,
            as_much_as: vec![(7, sigma(POSITION_GAIN) / share * (at[7] + 0.5))],
        });
    }
    same
}
