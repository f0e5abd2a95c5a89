//! The host's window whose monitors can run in coarse time.

use core::cell::RefCell;
use core::mem;

use ema_models::{
    ActuatorParams, COST_LANES, Comparison, Conditions, Coordinates, MotorKnowledge, NormalEquations, Prior,
    SIGNAL_COUNT, Scale, Setpoint, UNKNOWN_COUNT, Unknowns, Weights,
};

use super::coarse_time::Time;
use super::residuals_at::{ResidualsAt, Rows};
use super::window::{InTime, MonitoredWindow};

/// A comparison and the actuator in coarse time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Timed<'a> {
    fine: Comparison<'a>,
    coarse: &'a ActuatorParams,
    time: Time,
    kept: &'a RefCell<FineResiduals>,
}

/// Residuals of fine time at the last two points: a descent linearises where it has just computed a cost, and ends at one of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct FineResiduals {
    last: ResidualsAt<Unknowns>,
    before: ResidualsAt<Unknowns>,
}

impl FineResiduals {
    /// Those of a window at a point.
    pub(super) fn at(&mut self, window: &Comparison<'_>, unknowns: &Unknowns) -> &Rows {
        if self.last.at != Some(*unknowns) {
            mem::swap(&mut self.last, &mut self.before);
        }
        self.last.of(unknowns, window.sample_count(), |rows| {
            window.residuals(unknowns, |n, r| rows[n] = r.to_array());
        })
    }

    /// The part of a point's cost that is no noise: by products of neighbouring residuals, of either sign. A mean over the samples.
    pub(crate) fn systematic_cost(&mut self, window: &Comparison<'_>, unknowns: &Unknowns) -> f64 {
        let weights = window.weights.to_array();
        let (mut before, mut sums) = ([0.0; SIGNAL_COUNT], [0.0; SIGNAL_COUNT]);
        let samples = window.recording.samples;
        for (now, _) in self
            .at(window, unknowns)
            .iter()
            .zip(samples)
            .filter(|(_, s)| s.measured)
        {
            for (signal, sum) in sums.iter_mut().enumerate() {
                *sum += 0.5 * weights[signal] * weights[signal] * before[signal] * now[signal];
            }
            before = *now;
        }
        sums.iter().map(|sum| sum.abs()).sum::<f64>() / samples.len().max(1) as f64
    }
}

impl<'a> Timed<'a> {
    /// In fine time; `coarse` is [`coarse_in_time`](super::coarse_in_time).
    pub(crate) fn new(fine: Comparison<'a>, coarse: &'a ActuatorParams, kept: &'a RefCell<FineResiduals>) -> Self {
        Self {
            fine,
            coarse,
            time: Time::Fine,
            kept,
        }
    }

    fn in_coarse_time(&self) -> Comparison<'a> {
        Comparison {
            params: self.coarse,
            ..self.fine
        }
    }

    /// The comparison whose costs and residuals count.
    fn compared(&self) -> Comparison<'a> {
        match self.time {
            Time::Fine | Time::Both => self.fine,
            Time::Coarse => self.in_coarse_time(),
        }
    }
}

impl InTime for Timed<'_> {
    fn in_time(self, time: Time) -> Self {
        Self { time, ..self }
    }
}

impl MonitoredWindow for Timed<'_> {
    fn params(&self) -> &ActuatorParams {
        self.fine.params
    }

    fn conditions(&self) -> &Conditions {
        &self.fine.conditions
    }

    fn weights(&self) -> &Weights {
        &self.fine.weights
    }

    fn prior(&self) -> &Prior {
        &self.fine.prior
    }

    fn with_weights(mut self, weights: Weights) -> Self {
        self.fine.weights = weights;
        self
    }

    fn with_motor(mut self, motor: MotorKnowledge) -> Self {
        self.fine.prior.motor = motor;
        self
    }

    fn sample_count(&self) -> usize {
        self.fine.sample_count()
    }

    fn setpoints_and_angles(&self) -> impl Iterator<Item = (Setpoint, f64)> {
        self.fine.setpoints_and_angles()
    }

    fn mean_cost(&self, unknowns: &Unknowns) -> f64 {
        self.compared().mean_cost(unknowns)
    }

    fn squared_residuals(&self, unknowns: &Unknowns) -> ([f64; SIGNAL_COUNT], usize) {
        if self.time != Time::Both {
            return self.compared().squared_residuals(unknowns);
        }
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0);
        let mut kept = self.kept.borrow_mut();
        let rows = kept.at(&self.fine, unknowns);
        for (row, _) in rows.iter().zip(self.fine.recording.samples).filter(|(_, s)| s.measured) {
            for (sum, r) in squares.iter_mut().zip(row) {
                *sum += r * r;
            }
            count += 1;
        }
        (squares, count)
    }

    fn normal_equations(&self, at: &Coordinates, step: f64) -> NormalEquations {
        if self.time != Time::Both {
            return self.compared().normal_equations(at, step);
        }
        let mut kept = self.kept.borrow_mut();
        let unknowns = Scale::new(self.fine.params).unknowns(at);
        self.in_coarse_time()
            .normal_equations_with(at, step, kept.at(&self.fine, &unknowns))
    }

    fn cost(&self, at: &Coordinates) -> f64 {
        if self.time != Time::Both {
            return self.compared().cost(at);
        }
        // The bits of the comparison's own cost.
        let mut kept = self.kept.borrow_mut();
        let weights = self.fine.weights.to_array();
        let mut sum = 0.0;
        let scale = Scale::new(self.fine.params);
        for row in kept.at(&self.fine, &scale.unknowns(at)) {
            for (residual, weight) in row.iter().zip(weights) {
                let weighted = weight * residual;
                sum += weighted * weighted;
            }
        }
        let count = self.fine.sample_count();
        let mean = sum * (0.5 / count.max(1) as f64);
        let known = self.fine.prior.cost(&scale, &self.fine.conditions, at);
        mean * count as f64 + known
    }

    const SIDE_BY_SIDE: usize = COST_LANES;

    fn costs(&self, points: &[[f64; UNKNOWN_COUNT]], costs: &mut [f64]) {
        MonitoredWindow::costs(&self.compared(), points, costs);
    }
}
