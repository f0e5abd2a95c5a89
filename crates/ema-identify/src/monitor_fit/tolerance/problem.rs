//! The least-squares problem of a window's unknowns together with the nuisances.

use core::cell::RefCell;
use std::vec;
use std::vec::Vec;

use ema_models::{
    ActuatorParams, COST_LANES, Comparison, Coordinates, GRAM_COLUMNS, GramRow, LaneResiduals, MonitorVariant,
    MotorKnowledge, NormalEquations, SIGNAL_COUNT, Scale, ShaftSizes, Tolerances, UNKNOWN_COUNT, Unknowns, Weights,
    add_gram,
};
use nalgebra::{SMatrix, SVector};

use super::basis::{Basis, CHANGE_COUNT};
use super::nuisance::{
    Action, BACKLASH, DYNAMIC_FRICTION, FRICTION_TEMPERATURE, Hardware, LINK_VOLTAGE, NUISANCE_COUNT, NUISANCES,
    POSITION_GAIN, SPRING, STATIC_FRICTION, sigmas,
};

/// Unknowns of the window, then nuisances in standard deviations.
pub(super) const DIMENSION: usize = UNKNOWN_COUNT + NUISANCE_COUNT;

/// A point of the problem.
pub(super) type Point = [f64; DIMENSION];

/// Nuisances beyond as many standard deviations are none of a tolerance.
pub(super) const NUISANCE_MAX: f64 = 5.0;

/// Step of the finite differences along a nuisance, standard deviations.
const NUISANCE_STEP: f64 = 0.025;

/// The healthy backlash in units of k2: b = b₀ (1 + 99 k2).
const HEALTHY_BACKLASH: f64 = 1.0 / 99.0;

/// Place of the residual in a [`GramRow`].
const RESIDUAL: usize = DIMENSION;
const _: () = assert!(RESIDUAL < GRAM_COLUMNS);

/// One window with its nuisances.
#[derive(Clone, Debug)]
pub(super) struct Problem<'a> {
    comparison: Comparison<'a>,
    /// The actuator whose derivatives count, in fine or in coarse time; the residuals are those of fine time.
    differentiated: &'a ActuatorParams,
    basis: &'a Basis,
    scale: Scale,
    sigma: [f64; NUISANCE_COUNT],
    /// Nuisances that change the signals, and the place of what they change.
    on_signals: [(usize, usize); CHANGE_COUNT],
    /// Step of the finite differences along the unknowns.
    step: f64,
    buffers: &'a RefCell<Buffers>,
}

/// Memory of linearisations, used again by the next one.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    passes: Vec<Vec<LaneResiduals>>,
    rows: Vec<GramRow>,
    residuals: ResidualsAt,
}

/// Unweighted residuals of each sample at a point, zero where it was not measured.
#[derive(Debug, Default)]
struct ResidualsAt {
    at: Option<Point>,
    rows: Vec<[f64; SIGNAL_COUNT]>,
}

/// Weighted derivatives at a point, one row per sample and signal; those along slow coordinates hold near it.
#[derive(Debug)]
pub(super) struct Slopes {
    rows: Vec<GramRow>,
    weights: Weights,
}

impl Slopes {
    /// Those of a problem that was linearised whole.
    pub(super) fn of(linearised: &Linearised, problem: &Problem<'_>) -> Self {
        Self {
            rows: linearised.rows.clone(),
            weights: problem.comparison.weights,
        }
    }
}

/// Derivatives and residuals, weighted, one row per sample and signal.
pub(super) struct Linearised {
    pub(super) rows: Vec<GramRow>,
    /// `Σ row rowᵀ`, lower triangle, without the prior.
    sums_of_rows: [GramRow; GRAM_COLUMNS],
    /// The same with the prior.
    sums: [GramRow; GRAM_COLUMNS],
    /// Number of rows of each sample.
    pub(super) rows_per_sample: usize,
}

/// A coordinate whose column is a sum of others.
struct SameDirection {
    of: usize,
    /// Coordinates, and the factor of each.
    as_much_as: Vec<(usize, f64)>,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        comparison: Comparison<'a>,
        differentiated: &'a ActuatorParams,
        basis: &'a Basis,
        tolerances: &Tolerances,
        step: f64,
        buffers: &'a RefCell<Buffers>,
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
        }
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

    /// Whether a coordinate is known exactly.
    fn is_known(&self, p: usize) -> bool {
        match p.checked_sub(UNKNOWN_COUNT) {
            Some(nuisance) => self.sigma[nuisance] <= 0.0,
            None => ema_models::MOTOR_COORDINATES.contains(&p) && self.comparison.prior.motor.information().is_none(),
        }
    }

    /// The monitor at a point whose residuals count.
    fn compared(&self, at: &Point) -> MonitorVariant {
        self.variant(self.comparison.params, at)
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
        let mut buffers = self.buffers.borrow_mut();
        let found = self.residuals_at(&mut buffers.residuals, at);
        for (n, sample) in self.comparison.recording.samples.iter().enumerate() {
            if sample.measured {
                visit(n, found[n]);
            }
        }
    }

    /// The residuals at a point, kept from the last time if that was the same one.
    fn residuals_at<'r>(&self, kept: &'r mut ResidualsAt, at: &Point) -> &'r [[f64; SIGNAL_COUNT]] {
        if kept.at != Some(*at) {
            kept.at = Some(*at);
            kept.rows.clear();
            kept.rows
                .resize(self.comparison.recording.samples.len(), [0.0; SIGNAL_COUNT]);
            self.comparison
                .residuals_of_variant(&self.compared(at), &self.basis.torques, |n, residuals| {
                    let change = self.change(at, n);
                    let residuals = residuals.to_array();
                    kept.rows[n] = core::array::from_fn(|s| residuals[s] - change[s]);
                });
        }
        &kept.rows
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

    /// Derivatives and residuals at a point.
    pub(super) fn linearised(&self, at: &Point) -> Linearised {
        self.linearised_near(at, None)
    }

    /// Derivatives and residuals at a point. Those along the slow coordinates are taken from `nearby`, if there are any.
    pub(super) fn linearised_near(&self, at: &Point, nearby: Option<&Slopes>) -> Linearised {
        let own = coordinates(at).inward_steps(self.step);
        let step = |p: usize| match p.checked_sub(UNKNOWN_COUNT) {
            None => own[p],
            Some(_) => NUISANCE_STEP.copysign(-at[p]),
        };
        let same = self.same_directions(at);
        // Lane 0 is at the point; what changes the signals alone, or as another coordinate does, needs no lane.
        let in_lanes: Vec<usize> = (0..DIMENSION)
            .filter(|&p| {
                let signals = p
                    .checked_sub(UNKNOWN_COUNT)
                    .is_some_and(|n| matches!(NUISANCES[n].action, Action::Signals(_)));
                let derived = signals || same.iter().any(|direction| direction.of == p);
                !derived && !self.is_known(p) && (nearby.is_none() || !is_slow(p))
            })
            .collect();
        let slow: Vec<usize> = (0..DIMENSION).filter(|&p| nearby.is_some() && is_slow(p)).collect();
        let at_point = self.variant(self.differentiated, at);
        let variants: Vec<MonitorVariant> = core::iter::once(at_point)
            .chain(in_lanes.iter().map(|&p| {
                let mut stepped = *at;
                stepped[p] += step(p);
                self.variant(self.differentiated, &stepped)
            }))
            .collect();
        let samples = self.comparison.recording.samples;
        let Buffers {
            passes,
            rows,
            residuals,
        } = &mut *self.buffers.borrow_mut();
        let found = self.residuals_at(residuals, at);
        passes.resize(variants.len().div_ceil(COST_LANES).max(passes.len()), Vec::new());
        for (chunk, residuals) in variants.chunks(COST_LANES).zip(passes.iter_mut()) {
            let lanes = core::array::from_fn(|lane| *chunk.get(lane).unwrap_or(&at_point));
            residuals.resize(samples.len(), [[0.0; COST_LANES]; SIGNAL_COUNT]);
            self.comparison
                .residuals_of_variants(&lanes, &self.basis.torques, residuals);
        }

        let weights = self.comparison.weights.to_array();
        let weighted: Vec<usize> = (0..SIGNAL_COUNT).filter(|&s| weights[s] > 0.0).collect();
        let reweighted = nearby.map_or([1.0; SIGNAL_COUNT], |nearby| {
            let earlier = nearby.weights.to_array();
            core::array::from_fn(|s| if earlier[s] > 0.0 { weights[s] / earlier[s] } else { 0.0 })
        });
        let per_step: Vec<f64> = in_lanes.iter().map(|&p| 1.0 / step(p)).collect();
        let mut rows = core::mem::take(rows);
        rows.clear();
        rows.resize(samples.len() * weighted.len(), [0.0; GRAM_COLUMNS]);
        let mut row = rows.iter_mut().enumerate();
        for (n, sample) in samples.iter().enumerate() {
            for &signal in &weighted {
                let Some((place, row)) = row.next() else { break };
                if !sample.measured {
                    continue;
                }
                let weight = weights[signal] * self.basis.confidence[n][signal];
                let point = passes[0][n][signal][0];
                for (lane, (&p, per_step)) in (1..).zip(in_lanes.iter().zip(&per_step)) {
                    let stepped = passes[lane / COST_LANES][n][signal][lane % COST_LANES];
                    row[p] = (stepped - point) * per_step * weight;
                }
                for (number, place) in self.on_signals {
                    row[UNKNOWN_COUNT + number] -= self.sigma[number] * self.basis.changes[n][place][signal] * weight;
                }
                // The rows nearby are whole: the part that acts on the signals is in them already.
                if let Some(nearby) = nearby.and_then(|slopes| slopes.rows.get(place)) {
                    for &p in &slow {
                        row[p] = nearby[p] * reweighted[signal];
                    }
                }
                for direction in &same {
                    row[direction.of] = direction.as_much_as.iter().map(|&(p, factor)| factor * row[p]).sum();
                }
                row[RESIDUAL] = found[n][signal] * weight;
            }
        }
        let mut sums_of_rows = [[0.0; GRAM_COLUMNS]; GRAM_COLUMNS];
        add_gram(&rows, &mut sums_of_rows);
        let mut sums = sums_of_rows;
        self.add_prior(at, &mut sums);
        Linearised {
            rows,
            sums_of_rows,
            sums,
            rows_per_sample: weighted.len(),
        }
    }

    /// Gives back the memory of rows that are not needed any more.
    pub(super) fn reuse(&self, rows: Vec<GramRow>) {
        self.buffers.borrow_mut().rows = rows;
    }

    /// Puts the residuals of another point beside the derivatives.
    pub(super) fn set_residuals(&self, linearised: &mut Linearised, at: &Point) {
        let Buffers { residuals, .. } = &mut *self.buffers.borrow_mut();
        let found = self.residuals_at(residuals, at);
        let weights = self.comparison.weights.to_array();
        let mut rows = linearised.rows.iter_mut();
        let mut line = [0.0; GRAM_COLUMNS];
        for (n, sample) in self.comparison.recording.samples.iter().enumerate() {
            for signal in (0..SIGNAL_COUNT).filter(|&s| weights[s] > 0.0) {
                let Some(row) = rows.next() else { break };
                if sample.measured {
                    row[RESIDUAL] = found[n][signal] * weights[signal] * self.basis.confidence[n][signal];
                    let residual = row[RESIDUAL];
                    for (sum, along) in line.iter_mut().zip(row) {
                        *sum += residual * *along;
                    }
                }
            }
        }
        linearised.sums_of_rows[RESIDUAL] = line;
        linearised.sums = linearised.sums_of_rows;
        self.add_prior(at, &mut linearised.sums);
    }

    /// Coordinates that change the monitor as others do, so that no roughness of the cost tells them apart.
    fn same_directions(&self, at: &Point) -> Vec<SameDirection> {
        let sigma = |n: usize| self.sigma[n];
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

    fn add_prior(&self, at: &Point, sums: &mut [GramRow; GRAM_COLUMNS]) {
        let mut own = NormalEquations::default();
        self.comparison
            .prior
            .add_to(&mut own, &self.scale, &self.comparison.conditions, &coordinates(at));
        for p in 0..UNKNOWN_COUNT {
            for q in 0..=p {
                sums[p][q] += own.jtj[p][q];
            }
            sums[RESIDUAL][p] += own.jtr[p];
        }
        for p in UNKNOWN_COUNT..DIMENSION {
            sums[p][p] += 1.0;
            sums[RESIDUAL][p] += at[p];
        }
        for p in (0..DIMENSION).filter(|&p| self.is_known(p)) {
            for q in 0..DIMENSION {
                sums[p.max(q)][p.min(q)] = 0.0;
            }
            sums[p][p] = 1.0;
            sums[RESIDUAL][p] = 0.0;
        }
        sums[RESIDUAL][RESIDUAL] += 2.0 * self.prior_cost(at);
    }

    fn sum_with_prior(&self, at: &Point, mean: f64) -> f64 {
        mean * self.comparison.recording.samples.len() as f64 + self.prior_cost(at)
    }
}

impl Linearised {
    /// Half the sum of the squares.
    pub(super) fn cost(&self) -> f64 {
        0.5 * self.sums[RESIDUAL][RESIDUAL]
    }

    /// `Jᵀr` with the prior.
    pub(super) fn gradient(&self) -> SVector<f64, DIMENSION> {
        SVector::from_fn(|p, _| self.sums[RESIDUAL][p])
    }

    /// `JᵀJ` with the prior.
    pub(super) fn information(&self) -> SMatrix<f64, DIMENSION, DIMENSION> {
        SMatrix::from_fn(|r, c| self.sums[r.max(c)][r.min(c)])
    }
}

/// The window's own coordinates of a point.
pub(super) fn coordinates(at: &Point) -> Coordinates {
    Coordinates(core::array::from_fn(|p| at[p]))
}

/// Whether the derivatives along a coordinate hold for a whole descent: those of all nuisances but the ones that others are derived
/// from, and of a spring, whose loss in the gear depends on the rest of the load. Nuisances stay small, and the monitor is nearly
/// linear in them.
fn is_slow(p: usize) -> bool {
    const QUICK: [usize; 5] = [DYNAMIC_FRICTION, STATIC_FRICTION, BACKLASH, POSITION_GAIN, SPRING];
    p.checked_sub(UNKNOWN_COUNT).is_some_and(|n| !QUICK.contains(&n))
}

impl Problem<'_> {
    /// Half the sum of the squares at a point, the prior included.
    pub(super) fn cost(&self, at: &Point) -> f64 {
        self.sum_with_prior(at, self.mean_cost(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::{
        ActuatorParams, Calibration, ComparedSample, Conditions, FaultVector, Feedback, InitialState, Prior, Recording,
        Setpoint,
    };

    const SAMPLES: usize = 80;

    #[test]
    fn slow_slopes_of_the_same_point_are_those_of_a_whole_linearisation() {
        let params = ActuatorParams::bench();
        let calibration = Calibration::default();
        let samples: [ComparedSample; SAMPLES] = core::array::from_fn(|n| {
            let t = n as f64 / params.sensors.sample_rate;
            ComparedSample {
                setpoint: Setpoint::Position(0.05),
                measured: true,
                i_d: 0.1,
                i_q: 3.0 - 40.0 * t,
                theta_m: 800.0 * t * t,
                omega_m: 1600.0 * t,
                theta_out: 800.0 * t * t / params.transmission.gear_ratio,
                ..ComparedSample::default()
            }
        });
        let comparison = Comparison {
            recording: Recording {
                samples: &samples,
                drive: &samples,
                initial: InitialState::default(),
            },
            params: &params,
            calibration: &calibration,
            conditions: Conditions {
                load_torque: None,
                v_dc: params.motor.v_dc,
                winding_temp_deg_c: None,
            },
            weights: Weights {
                i_d: 10.0,
                i_q: 10.0,
                theta_m: 100.0,
                omega_m: 1.0,
                theta_out: 1000.0,
            },
            feedback: Feedback::Measured,
            prior: Prior {
                load_torque: 1.0,
                integral: 1.0,
                motor: MotorKnowledge::default(),
            },
        };
        let tolerances = Tolerances::USUAL;
        let basis = Basis::new(&comparison, &tolerances);
        let buffers = RefCell::default();
        let problem = Problem::new(comparison, &params, &basis, &tolerances, 1e-3, &buffers);
        let start = problem
            .scale
            .coordinates(&comparison.unknowns_with_fault(FaultVector::NOMINAL));
        let mut at: Point = core::array::from_fn(|p| start.0.get(p).copied().unwrap_or(0.3));
        at[0] = 0.2;
        let whole = problem.linearised(&at);
        let slopes = Slopes::of(&whole, &problem);
        let near = problem.linearised_near(&at, Some(&slopes));
        let shown = |p: usize| whole.rows.iter().any(|row| row[p].abs() > 0.0);
        assert!((UNKNOWN_COUNT..DIMENSION).filter(|&p| is_slow(p) && shown(p)).count() > 20);
        for (n, (whole, near)) in whole.rows.iter().zip(&near.rows).enumerate() {
            for p in 0..DIMENSION {
                assert_eq!(whole[p].to_bits(), near[p].to_bits(), "row {n}, coordinate {p}");
            }
        }
    }
}
