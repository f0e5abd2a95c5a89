//! The least-squares problem of a window's unknowns together with the nuisances.

use core::cell::RefCell;
use std::vec::Vec;

use ema_models::{
    ActuatorParams, Comparison, Coordinates, GramRow, MonitorVariant, MotorKnowledge, NormalEquations, SIGNAL_COUNT,
    Scale, ShaftSizes, Tolerances, UNKNOWN_COUNT, Unknowns, Weights,
};
use nalgebra::{SMatrix, SVector};

use super::basis::{Basis, CHANGE_COUNT};
use super::nuisance::{Action, Hardware, LINK_VOLTAGE, NUISANCE_COUNT, NUISANCES, sigmas};
use crate::monitor_fit::residuals_at::{ResidualsAt, Rows};

/// Unknowns of the window, then nuisances in standard deviations.
pub(super) const DIMENSION: usize = UNKNOWN_COUNT + NUISANCE_COUNT;

/// A point of the problem.
pub(super) type Point = [f64; DIMENSION];

/// `JᵀJ`.
pub(super) type Information = SMatrix<f64, DIMENSION, DIMENSION>;

/// `Jᵀr`.
pub(super) type Gradient = SVector<f64, DIMENSION>;

/// Nuisances beyond as many standard deviations are none of a tolerance.
pub(super) const NUISANCE_MAX: f64 = 5.0;

/// The healthy backlash in units of k2: b = b₀ (1 + 99 k2).
pub(super) const HEALTHY_BACKLASH: f64 = 1.0 / 99.0;

/// One window with its nuisances.
#[derive(Clone, Debug)]
pub(super) struct Problem<'a> {
    comparison: Comparison<'a>,
    /// The actuator whose derivatives count, in fine or in coarse time.
    differentiated: &'a ActuatorParams,
    basis: &'a Basis,
    scale: Scale,
    sigma: [f64; NUISANCE_COUNT],
    /// Nuisances that change the signals, and the place of what they change.
    on_signals: [(usize, usize); CHANGE_COUNT],
    /// Step of the finite differences along the unknowns.
    step: f64,
    /// Whether the residuals are those of coarse time, corrected at an anchor, not those of fine time.
    is_corrected: bool,
    buffers: &'a Buffers,
}

/// Residuals of the last points, and memory of derivatives, used again by the next ones.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    residuals: RefCell<LastResiduals>,
    rows: RefCell<Vec<Vec<GramRow>>>,
}

/// Residuals of the last points of fine and of coarse time, and what the former have beyond the latter at the anchor.
#[derive(Debug, Default)]
struct LastResiduals {
    fine: ResidualsAt<Point>,
    coarse: ResidualsAt<Point>,
    correction: Rows,
}

impl Buffers {
    /// With the residuals of fine time at a point.
    pub(super) fn with_residuals(at: Point, rows: Rows) -> Self {
        let fine = ResidualsAt { at: Some(at), rows };
        Self {
            residuals: RefCell::new(LastResiduals {
                fine,
                ..LastResiduals::default()
            }),
            ..Self::default()
        }
    }
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        comparison: Comparison<'a>,
        differentiated: &'a ActuatorParams,
        basis: &'a Basis,
        tolerances: &Tolerances,
        step: f64,
        buffers: &'a Buffers,
    ) -> Self {
        let mut on_signals = [(0, 0); CHANGE_COUNT];
        for (number, nuisance) in NUISANCES.iter().enumerate() {
            if let Action::Signals(place) | Action::TorqueAndSignals(_, place) = nuisance.action {
                on_signals[place] = (number, place);
            }
        }
        Self {
            on_signals,
            buffers,
            scale: Scale::new(comparison.params),
            sigma: sigmas(tolerances, comparison.params, &comparison.conditions),
            comparison,
            differentiated,
            basis,
            step,
            is_corrected: false,
        }
    }

    /// The same problem with residuals of coarse time, to which those are added that fine time has beyond them at the
    /// [anchor](Problem::anchor): near it they are those of fine time for a fifth of the work.
    pub(super) fn corrected(&self) -> Self {
        let is_coarse = self.differentiated.controller.period > self.comparison.params.controller.period;
        Self {
            is_corrected: is_coarse,
            ..self.clone()
        }
    }

    /// Corrects residuals at this point, where they are those of fine time from now on.
    pub(super) fn anchor(&self, at: &Point) {
        if !self.is_corrected {
            return;
        }
        let mut last = self.buffers.residuals.borrow_mut();
        let LastResiduals {
            fine,
            coarse,
            correction,
        } = &mut *last;
        let beyond = |(fine, coarse): (&[f64; SIGNAL_COUNT], &[f64; SIGNAL_COUNT])| -> [f64; SIGNAL_COUNT] {
            core::array::from_fn(|s| fine[s] - coarse[s])
        };
        let pairs = self
            .run(fine, self.comparison.params, at)
            .iter()
            .zip(self.run(coarse, self.differentiated, at));
        correction.clear();
        correction.extend(pairs.map(beyond));
    }

    pub(super) fn with_weights(&self, weights: Weights) -> Self {
        let mut weighed = self.clone();
        weighed.comparison.weights = weights;
        weighed
    }

    pub(super) fn with_motor(&self, motor: MotorKnowledge) -> Self {
        let mut other = self.clone();
        other.comparison.prior.motor = motor;
        other
    }

    pub(super) fn comparison(&self) -> &Comparison<'a> {
        &self.comparison
    }

    /// The window's own unknowns at a point.
    pub(super) fn unknowns(&self, at: &Point) -> Unknowns {
        self.scale.unknowns(&coordinates(at))
    }

    /// Step of the finite differences along the unknowns.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// What the nuisances do to each sample.
    pub(super) fn basis(&self) -> &'a Basis {
        self.basis
    }

    /// Memory for rows of derivatives.
    pub(super) fn spare(&self) -> &'a RefCell<Vec<Vec<GramRow>>> {
        &self.buffers.rows
    }

    /// Standard deviation of a nuisance.
    pub(super) fn sigma(&self, number: usize) -> f64 {
        self.sigma[number]
    }

    /// Nuisances that change the signals, and the place of what they change.
    pub(super) fn on_signals(&self) -> [(usize, usize); CHANGE_COUNT] {
        self.on_signals
    }

    /// Whether a coordinate is known exactly.
    pub(super) fn is_known(&self, p: usize) -> bool {
        match p.checked_sub(UNKNOWN_COUNT) {
            Some(nuisance) => self.sigma[nuisance] <= 0.0,
            None => ema_models::MOTOR_COORDINATES.contains(&p) && self.comparison.prior.motor.information().is_none(),
        }
    }

    /// The monitor at a point whose derivatives count.
    pub(super) fn differentiated_variant(&self, at: &Point) -> MonitorVariant {
        self.variant(self.differentiated, at)
    }

    /// The monitor of an actuator at a point.
    fn variant(&self, params: &ActuatorParams, at: &Point) -> MonitorVariant {
        let mut hardware = Hardware {
            params: *params,
            v_dc: self.comparison.conditions.v_dc,
        };
        let mut sizes = ShaftSizes::default();
        let mut unknowns = self.unknowns(at);
        for ((nuisance, sigma), size) in NUISANCES.iter().zip(self.sigma).zip(&at[UNKNOWN_COUNT..]) {
            match nuisance.action {
                Action::Parameter(apply) => apply(&mut hardware, sigma * size),
                Action::Backlash => unknowns.fault.backlash += (sigma * size).max(-1.0) * HEALTHY_BACKLASH,
                Action::Torque(place) | Action::TorqueAndSignals(place, _) => sizes.disturbances[place] = sigma * size,
                Action::Load(place) => sizes.load_changes[place] = sigma * size,
                Action::Signals(_) => {}
            }
        }
        self.comparison
            .variant(&hardware.params, hardware.v_dc, &unknowns, sizes)
    }

    /// What the nuisances of a point add to the signals of a sample.
    fn change(&self, at: &Point, n: usize) -> [f64; SIGNAL_COUNT] {
        let mut change = [0.0; SIGNAL_COUNT];
        for (number, place) in self.on_signals {
            let size = self.sigma[number] * at[UNKNOWN_COUNT + number];
            for (sum, per_unit) in change.iter_mut().zip(self.basis.changes[n][place]) {
                *sum += size * per_unit;
            }
        }
        change
    }

    /// Standard deviation of the read link voltage as a share; `None` where it is exact.
    pub(super) fn link_sigma(&self) -> Option<f64> {
        Some(self.sigma[LINK_VOLTAGE]).filter(|&sigma| sigma > 0.0)
    }

    /// Cost of the prior at a point.
    fn prior_cost(&self, at: &Point) -> f64 {
        let known = self
            .comparison
            .prior
            .cost(&self.scale, &self.comparison.conditions, &coordinates(at));
        known + 0.5 * at[UNKNOWN_COUNT..].iter().map(|size| size * size).sum::<f64>()
    }

    /// Squared residuals at a point, by the confidence in each sample, summed for each signal, and their number.
    pub(super) fn squared_residuals(&self, at: &Point) -> ([f64; SIGNAL_COUNT], usize) {
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0);
        self.residuals(at, |n, residuals| {
            for (signal, sum) in squares.iter_mut().enumerate() {
                let residual = self.basis.confidence[n][signal] * residuals[signal];
                *sum += residual * residual;
            }
            count += 1;
        });
        (squares, count)
    }

    /// Calls `visit` with index and unweighted residuals of each measured sample.
    pub(super) fn residuals(&self, at: &Point, mut visit: impl FnMut(usize, [f64; SIGNAL_COUNT])) {
        let mut last = self.buffers.residuals.borrow_mut();
        let LastResiduals {
            fine,
            coarse,
            correction,
        } = &mut *last;
        let found = if self.is_corrected {
            self.run(coarse, self.differentiated, at)
        } else {
            self.run(fine, self.comparison.params, at)
        };
        for (n, sample) in self.comparison.recording.samples.iter().enumerate() {
            if sample.measured {
                let beyond = if self.is_corrected {
                    correction[n]
                } else {
                    [0.0; SIGNAL_COUNT]
                };
                visit(n, core::array::from_fn(|s| found[n][s] + beyond[s]));
            }
        }
    }

    /// Residuals of the monitor of an actuator at a point, unless they are there.
    fn run<'r>(&self, residuals: &'r mut ResidualsAt<Point>, params: &ActuatorParams, at: &Point) -> &'r Rows {
        residuals.of(at, self.comparison.recording.samples.len(), |rows| {
            let variant = self.variant(params, at);
            self.comparison
                .residuals_of_variant(&variant, &self.basis.torques, |n, residuals| {
                    let change = self.change(at, n);
                    let residuals = residuals.to_array();
                    rows[n] = core::array::from_fn(|s| residuals[s] - change[s]);
                });
        })
    }

    /// Mean over the samples of half the squared weighted residuals, without the prior.
    pub(super) fn mean_cost(&self, at: &Point) -> f64 {
        let weights = self.comparison.weights.to_array();
        let mut sum = 0.0;
        self.residuals(at, |n, residuals| {
            for signal in 0..SIGNAL_COUNT {
                let weighted = weights[signal] * self.basis.confidence[n][signal] * residuals[signal];
                sum += 0.5 * weighted * weighted;
            }
        });
        sum / self.comparison.recording.samples.len().max(1) as f64
    }

    /// Adds what is known beforehand to the information and the gradient at a point; a coordinate that is known exactly stays.
    pub(super) fn add_prior(&self, at: &Point, information: &mut Information, gradient: &mut Gradient) {
        let mut own = NormalEquations::default();
        self.comparison
            .prior
            .add_to(&mut own, &self.scale, &self.comparison.conditions, &coordinates(at));
        for p in 0..UNKNOWN_COUNT {
            for q in 0..UNKNOWN_COUNT {
                information[(p, q)] += own.jtj[p.max(q)][p.min(q)];
            }
            gradient[p] += own.jtr[p];
        }
        for p in UNKNOWN_COUNT..DIMENSION {
            information[(p, p)] += 1.0;
            gradient[p] += at[p];
        }
        for p in (0..DIMENSION).filter(|&p| self.is_known(p)) {
            information.row_mut(p).fill(0.0);
            information.column_mut(p).fill(0.0);
            information[(p, p)] = 1.0;
            gradient[p] = 0.0;
        }
    }

    /// Half the sum of the squares at a point, the prior included.
    pub(super) fn cost(&self, at: &Point) -> f64 {
        let mean = self.mean_cost(at);
        mean * self.comparison.recording.samples.len() as f64 + self.prior_cost(at)
    }
}

/// The window's own coordinates of a point.
pub(super) fn coordinates(at: &Point) -> Coordinates {
    Coordinates(core::array::from_fn(|p| at[p]))
}
