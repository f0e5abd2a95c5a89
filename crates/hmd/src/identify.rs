//! One window to one estimate: the only place where monitor and search meet.

use ema_ga::{
    Bounds, CmaConfig, ConfigError, Control, DeConfig, GaConfig, LmConfig, Objective, Outcome, Parallel, Residuals,
    Search, cma_es_owned, differential_evolution_owned, evolve_owned, levenberg_marquardt,
};
use ema_models::{
    ActuatorParams, COST_LANES, Calibration, ComparedSample, Comparison, Conditions, Coordinates, FAULT_COUNT,
    FaultVector, Feedback, MOTOR_COORDINATES, MotorKnowledge, NormalEquations, Prior, RANK_LANES, Recording,
    SIGNAL_COUNT, Scale, SensedSample, Signals, UNKNOWN_COUNT, Unknowns, Weights, prepare,
};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use crate::calibration::TypeCalibration;
use crate::turns::align;

/// How the fault vector is searched. `docs/search.md` compares them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The paper's standard genetic algorithm on its own cost (eq. 14), quadrature current only.
    PaperGa(GaConfig),
    /// A population search over all signals.
    Population(Population),
    /// Levenberg–Marquardt from health alone, over all signals.
    LeastSquares,
    /// A short population search, then Levenberg–Marquardt from its best and from health.
    Hybrid(Population),
}

/// A search by many individuals at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Population {
    /// The genetic algorithm.
    Genetic(GaConfig),
    /// Differential evolution.
    Differential(DeConfig),
    /// Evolution strategy with covariance matrix adaptation.
    CmaEs(CmaConfig),
}

impl Method {
    /// The default search: a genetic algorithm of 32 individuals and 5 generations, then refinement.
    #[must_use]
    pub fn hybrid() -> Self {
        let mut config = GaConfig::for_dimension(FAULT_COUNT as u32);
        config.population = 32;
        config.elite_count = 2;
        config.stop.max_generations = 5;
        Self::Hybrid(Population::Genetic(config))
    }

    /// The paper's search with the toolbox's defaults for eight bounded genes.
    #[must_use]
    pub fn paper_ga() -> Self {
        Self::PaperGa(GaConfig::for_dimension(FAULT_COUNT as u32))
    }
}

/// What identification needs to know beside the samples.
#[derive(Clone, Debug)]
pub struct Identifier {
    /// The actuator.
    pub params: ActuatorParams,
    /// The monitor's calibration for its type.
    pub calibration: TypeCalibration,
    /// The search.
    pub method: Method,
    /// How far the motor is off its type, and how well that is known.
    pub motor: MotorKnowledge,
}

/// Fault vector of one window, and how far it can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Best fault vector.
    pub fault: FaultVector,
    /// The same with its companions.
    pub unknowns: Unknowns,
    /// One standard deviation of each component, model error included; `None` where it means nothing (k7 without
    /// eccentricity) or the window does not show it.
    pub sigma: [Option<f64>; FAULT_COUNT],
    /// Whether the window shows the component.
    pub observable: [bool; FAULT_COUNT],
    /// Mean over the samples of half the squared weighted residuals.
    pub cost: f64,
    /// Root-mean-square residual of the quadrature current, A.
    pub residual_rms_a: f64,
    /// Monitor evaluations spent.
    pub evaluations: u64,
}

/// A cost above this says that no fault vector explains the window: weighted residuals of four times their expected
/// size. Good windows of every profile cost 1.0 to 1.5 without sensor noise, 2.0 to 2.7 with 50 mA rms on the currents and
/// 5.5 to 6.3 with 100 mA.
const UNMODELLED_COST: f64 = 15.0;

impl Estimate {
    /// Whether the fit is so bad that the data, though good, are of something the monitor does not know.
    #[must_use]
    pub fn is_unmodelled(&self) -> bool {
        self.cost.is_nan() || self.cost > UNMODELLED_COST
    }

    /// One standard deviation of each damage (see [`FaultVector::damage`]); infinite where the window shows nothing.
    #[must_use]
    pub fn damage_sigma(&self) -> [f64; FAULT_COUNT] {
        let mut sigma = self.sigma.map(|s| s.unwrap_or(f64::INFINITY));
        // The gain's damage is 2 |k8 − ½|.
        sigma[7] *= 2.0;
        sigma
    }
}

/// One window's fit, sample by sample, for records and plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fit {
    /// Measured quadrature current, A.
    pub i_q_measured: Vec<f32>,
    /// The monitor's, A.
    pub i_q_fitted: Vec<f32>,
    /// Measured motor speed, rad/s.
    pub omega_measured: Vec<f32>,
    /// The monitor's, rad/s.
    pub omega_fitted: Vec<f32>,
    /// Measured output angle relative to the window's first, rad.
    pub theta_out_measured: Vec<f32>,
    /// The monitor's, rad.
    pub theta_out_fitted: Vec<f32>,
}

/// A standard deviation above this says that the window does not show the component.
const OBSERVABLE_SIGMA: f64 = 0.1;

/// Monitor runs of one set of normal equations: the point and one step along each coordinate.
const RUNS_PER_LINEARISATION: u64 = UNKNOWN_COUNT as u64 + 1;

/// A window made ready for comparison, owning its samples.
#[derive(Clone, Debug)]
pub struct Prepared {
    samples: Vec<ComparedSample>,
    initial: ema_models::InitialState,
}

impl Prepared {
    /// Makes a window ready; its first `rest` samples precede the trigger, and those of the indices `filled` were not
    /// measured.
    #[must_use]
    pub fn new(params: &ActuatorParams, window: &[SensedSample], filled: &[usize], rest: usize) -> Self {
        let mut sensed = window.to_vec();
        align(params, &mut sensed);
        let mut samples = vec![ComparedSample::default(); sensed.len()];
        let initial = prepare(params, &sensed, filled, rest, &mut samples);
        Self { samples, initial }
    }

    /// Other samples with the same initial state.
    #[must_use]
    pub fn with_samples(&self, samples: Vec<ComparedSample>) -> Self {
        Self {
            samples,
            initial: self.initial,
        }
    }

    /// The samples and their initial state.
    #[must_use]
    pub fn recording(&self) -> Recording<'_> {
        Recording {
            samples: &self.samples,
            initial: self.initial,
        }
    }
}

impl Identifier {
    /// Estimates the fault vector of one window.
    ///
    /// The same window, settings and seed give the same estimate on any number of threads.
    ///
    /// # Errors
    /// [`ConfigError`] when the settings of the genetic algorithm contradict each other.
    pub fn identify(&self, window: &Prepared, conditions: Conditions, seed: u64) -> Result<Estimate, ConfigError> {
        let coefficients = self.calibration.coefficients();
        let all = self.comparison(window, &coefficients, conditions);
        let scale = Scale::new(&self.params);
        match self.method {
            Method::PaperGa(config) => {
                let alone = Comparison {
                    weights: Weights::CURRENT_ONLY,
                    feedback: Feedback::Simulated,
                    ..all
                };
                let objective = PaperCost::new(alone, &self.params);
                let search = Search {
                    objective: &objective,
                    evaluate: Parallel,
                    seed,
                    initial: &[],
                };
                let found = evolve_owned(&search, &config, |_| Control::Continue)?;
                let best = all.with_fault(FaultVector::from_array(found.genes));
                Ok(self.judge(&all, scale.coordinates(&best), found.evaluations))
            }
            Method::Population(population) => {
                let found = population.search(all, seed)?;
                let best = all.with_fault(FaultVector::from_array(found.genes));
                Ok(self.judge(&all, scale.coordinates(&best), found.evaluations))
            }
            Method::LeastSquares => {
                let (best, spent) = refine(&all, &starts(&all, &scale, &[FaultVector::NOMINAL]));
                Ok(self.finish(&all, best, spent))
            }
            Method::Hybrid(population) => {
                let found = population.search(all, seed)?;
                let faults = [FaultVector::from_array(found.genes), FaultVector::NOMINAL];
                let (best, spent) = refine(&all, &starts(&all, &scale, &faults));
                Ok(self.finish(&all, best, found.evaluations + spent))
            }
        }
    }

    /// The comparison of one window, all signals with their weights.
    #[must_use]
    pub fn comparison<'a>(
        &'a self,
        window: &'a Prepared,
        coefficients: &'a Calibration,
        conditions: Conditions,
    ) -> Comparison<'a> {
        comparison(
            window,
            &self.params,
            coefficients,
            conditions,
            self.calibration.weights(self.params.sensors.sample_rate),
            self.motor,
        )
    }

    /// Weighs the signals by what noise this window has, refines once more and states how sure the end is.
    ///
    /// The cost stays that of the calibration's weights: it is what says whether the fit is a good one at all.
    fn finish(&self, comparison: &Comparison<'_>, found: Coordinates, evaluations: u64) -> Estimate {
        let weighed = Comparison {
            weights: self.weights_by_noise(comparison, &found),
            ..*comparison
        };
        let end = descend(&weighed, found);
        let estimate = self.judge(&weighed, end.at, evaluations + end.spent + 2);
        let cost = comparison.least_squares(&estimate.unknowns);
        Estimate { cost, ..estimate }
    }

    /// The calibration's weights, less where a signal is noisier than in the windows it was made from: sensors differ, and
    /// a noisy current says less than a speed that is as good as ever.
    fn weights_by_noise(&self, comparison: &Comparison<'_>, at: &Coordinates) -> Weights {
        let expected = Signals::from(self.calibration.at(self.params.sensors.sample_rate).residual_rms).to_array();
        let unknowns = Scale::new(&self.params).unknowns(at);
        let (mut squares, mut count) = ([0.0; SIGNAL_COUNT], 0.0_f64);
        comparison.residuals(&unknowns, |_, r| {
            for (sum, r) in squares.iter_mut().zip(r.to_array()) {
                *sum += r * r;
            }
            count += 1.0;
        });
        let mut weights = comparison.weights.to_array();
        for signal in 0..SIGNAL_COUNT {
            let found = (squares[signal] / count.max(1.0)).sqrt();
            weights[signal] *= (expected[signal] / found.max(f64::MIN_POSITIVE)).min(1.0);
        }
        Signals::from_array(weights)
    }

    /// States how sure a point is.
    fn judge(&self, comparison: &Comparison<'_>, at: Coordinates, evaluations: u64) -> Estimate {
        let scale = Scale::new(&self.params);
        let unknowns = scale.unknowns(&at);
        // The point may lie outside the disc of eccentricities; what is judged is what is reported.
        let at = scale.coordinates(&unknowns);
        let normal = hold_known_motor(comparison.normal_equations(&at, FINE_STEP), &comparison.prior.motor);
        let fault = unknowns.fault;
        let (mut current, mut n) = (0.0, 0.0_f64);
        comparison.residuals(&unknowns, |_, r| {
            current += r.i_q * r.i_q;
            n += 1.0;
        });
        let n = n.max(1.0);

        // Correlated residuals are already weighted down, so the weighted ones count as independent of unit size; a
        // worse fit than the calibration's widens the interval.
        let signals = comparison.weights.to_array().iter().filter(|w| **w > 0.0).count() as f64;
        let excess = (2.0 * normal.cost / (n * signals)).max(1.0);
        let variance = data_variance(&normal, excess);
        let mut sigma = [None; FAULT_COUNT];
        let mut observable = [false; FAULT_COUNT];
        let model_sigma = self.calibration.at(self.params.sensors.sample_rate).model_sigma;
        let mut total = [f64::INFINITY; FAULT_COUNT];
        for p in 0..FAULT_COUNT {
            total[p] = (variance[p] + model_sigma[p].powi(2)).sqrt();
        }
        for p in [0, 1, 2, 3, 4, 7] {
            observable[p] = total[p] <= OBSERVABLE_SIGMA;
            sigma[p] = observable[p].then_some(total[p]);
        }
        // Amplitude and direction out of the Cartesian pair: along and across the vector; across is an angle only where
        // the vector stands clear of its own uncertainty.
        let amplitude_sigma = total[5].max(total[6]);
        observable[5] = amplitude_sigma <= OBSERVABLE_SIGMA;
        sigma[5] = observable[5].then_some(amplitude_sigma);
        if observable[5] && fault.eccentricity > 3.0 * amplitude_sigma {
            observable[6] = true;
            sigma[6] = Some(amplitude_sigma / fault.eccentricity / std::f64::consts::TAU);
        }
        Estimate {
            fault,
            unknowns,
            sigma,
            observable,
            cost: normal.cost / n,
            residual_rms_a: (current / n).sqrt(),
            evaluations: evaluations + RUNS_PER_LINEARISATION + 1,
        }
    }

    /// The fit of an estimate to a window.
    #[must_use]
    pub fn fit(&self, window: &Prepared, conditions: Conditions, estimate: &Estimate) -> Fit {
        let coefficients = self.calibration.coefficients();
        let mut fit = Fit::default();
        self.comparison(window, &coefficients, conditions)
            .residuals(&estimate.unknowns, |n, r| {
                let sample = &window.samples[n];
                fit.i_q_measured.push(sample.i_q as f32);
                fit.i_q_fitted.push((sample.i_q - r.i_q) as f32);
                fit.omega_measured.push(sample.omega_m as f32);
                fit.omega_fitted.push((sample.omega_m - r.omega_m) as f32);
                fit.theta_out_measured.push(sample.theta_out as f32);
                fit.theta_out_fitted.push((sample.theta_out - r.theta_out) as f32);
            });
        fit
    }
}

impl Population {
    /// The best of all individuals, one of the first being health.
    fn search(&self, comparison: Comparison<'_>, seed: u64) -> Result<Outcome<FAULT_COUNT>, ConfigError> {
        let objective = LeastSquares {
            comparison,
            bounds: unit_box(),
        };
        let nominal = [FaultVector::NOMINAL.to_array()];
        let search = Search {
            objective: &objective,
            evaluate: Parallel,
            seed,
            initial: &nominal,
        };
        match self {
            Self::Genetic(config) => evolve_owned(&search, config, |_| Control::Continue),
            Self::Differential(config) => differential_evolution_owned(&search, config, |_| Control::Continue),
            Self::CmaEs(config) => cma_es_owned(&search, config, |_| Control::Continue),
        }
    }
}

/// What the status frame's load may be off by, Nm: its last digit is 0.1.
const LOAD_SIGMA_NM: f64 = 0.03;

/// What a load that nobody measures may be, in shares of the largest one the motor could hold without losses.
const LOAD_SIGMA_SHARE: f64 = 0.1;

/// Loads from which a refinement starts where the load is not measured, in the same shares: the gear's losses bend at
/// zero, so both sides are tried.
const LOAD_STARTS: [f64; 2] = [-0.01, 0.01];

/// What the first currents leave open of the speed loop's integral, in shares of the largest torque.
const INTEGRAL_SIGMA_SHARE: f64 = 0.01;

/// The comparison of one window with a monitor, by the measured angles.
#[must_use]
pub fn comparison<'a>(
    window: &'a Prepared,
    params: &'a ActuatorParams,
    calibration: &'a Calibration,
    conditions: Conditions,
    weights: Weights,
    motor: MotorKnowledge,
) -> Comparison<'a> {
    Comparison {
        recording: window.recording(),
        params,
        calibration,
        conditions,
        weights,
        feedback: Feedback::Measured,
        prior: Prior {
            load_torque: match conditions.load_torque {
                Some(_) => LOAD_SIGMA_NM,
                None => LOAD_SIGMA_SHARE * Scale::new(params).load(),
            },
            integral: INTEGRAL_SIGMA_SHARE * params.motor.torque_gain() * params.motor.i_max,
            motor,
        },
    }
}

/// Where refinements start: each fault vector, with the load as measured or else on both sides of none.
fn starts(comparison: &Comparison<'_>, scale: &Scale, faults: &[FaultVector]) -> Vec<Coordinates> {
    let mut starts = Vec::new();
    for &fault in faults {
        let unknowns = comparison.with_fault(fault);
        match comparison.conditions.load_torque {
            Some(_) => starts.push(scale.coordinates(&unknowns)),
            None => starts.extend(LOAD_STARTS.map(|share| {
                scale.coordinates(&Unknowns {
                    load_torque: share * scale.load(),
                    ..unknowns
                })
            })),
        }
    }
    starts
}

/// Steps of the finite differences: far from the solution, and near it.
const COARSE_STEP: f64 = 2e-2;
const FINE_STEP: f64 = 2e-3;

/// Where a refinement ended: cost, place, and the monitor runs spent.
struct End {
    cost: f64,
    at: Coordinates,
    spent: u64,
}

/// Refines from several starts, side by side; the best end and the monitor runs spent.
///
/// Each start is refined with coarse differences and then with fine ones: what a fine slope takes for a valley's floor, a
/// coarse one often walks out of.
fn refine(comparison: &Comparison<'_>, starts: &[Coordinates]) -> (Coordinates, u64) {
    let ends: Vec<End> = starts.par_iter().map(|&start| descend(comparison, start)).collect();
    let spent = ends.iter().map(|end| end.spent).sum();
    // Of equal ends the first, whichever thread was quicker.
    let better = |best: End, end: End| if end.cost < best.cost { end } else { best };
    let nowhere = End {
        cost: f64::INFINITY,
        at: starts[0],
        spent: 0,
    };
    (ends.into_iter().fold(nowhere, better).at, spent)
}

/// One descent, coarse and then fine; the better of both ends.
fn descend(comparison: &Comparison<'_>, start: Coordinates) -> End {
    let bounds = box_of(Coordinates::LOWER, Coordinates::UPPER);
    let config = LmConfig {
        max_iterations: 25,
        max_evaluations: 60,
        step_tolerance: 2e-5,
        cost_tolerance: 1e-6,
        ..LmConfig::default()
    };
    let mut from = start.0;
    let mut end = End {
        cost: f64::INFINITY,
        at: start,
        spent: 0,
    };
    for step in [COARSE_STEP, FINE_STEP] {
        let found = levenberg_marquardt(&Refinement { comparison, step }, &bounds, from, &config);
        end.spent +=
            u64::from(found.iterations) * RUNS_PER_LINEARISATION + u64::from(found.evaluations - found.iterations);
        from = found.genes;
        if found.cost < end.cost {
            (end.cost, end.at) = (found.cost, Coordinates(from));
        }
    }
    end
}

/// Where a refinement that starts at a point ends.
#[must_use]
pub fn refine_from(comparison: &Comparison<'_>, start: Coordinates) -> Coordinates {
    descend(comparison, start).at
}

/// Distance from the truth, in fault coordinates, to where a refinement started there ends: the pull of whatever the
/// monitor gets wrong.
#[must_use]
pub fn pull_from(comparison: &Comparison<'_>, truth: &FaultVector) -> [f64; FAULT_COUNT] {
    let start = Scale::new(comparison.params).coordinates(&comparison.with_fault(*truth));
    let (end, _) = refine(comparison, &[start]);
    std::array::from_fn(|p| end.0[p] - start.0[p])
}

/// Takes a motor that is known exactly out of the equations: its coordinates stay where they are and make nothing uncertain.
fn hold_known_motor(mut normal: NormalEquations, motor: &MotorKnowledge) -> NormalEquations {
    if motor.information().is_none() {
        for p in MOTOR_COORDINATES {
            for q in 0..UNKNOWN_COUNT {
                normal.jtj[p][q] = 0.0;
                normal.jtj[q][p] = 0.0;
            }
            normal.jtj[p][p] = 1.0;
            normal.jtr[p] = 0.0;
        }
    }
    normal
}

/// Cramér–Rao bound of each coordinate at a point, as a standard deviation: what the weights alone allow, with no model
/// error.
#[must_use]
pub fn bound(comparison: &Comparison<'_>, at: &Coordinates) -> [f64; UNKNOWN_COUNT] {
    let normal = hold_known_motor(comparison.normal_equations(at, FINE_STEP), &comparison.prior.motor);
    data_variance(&normal, 1.0).map(f64::sqrt)
}

/// Diagonal of `(JᵀJ)⁻¹`, times `scale`; infinite where the data say nothing.
fn data_variance(normal: &NormalEquations, scale: f64) -> [f64; UNKNOWN_COUNT] {
    let mut matrix = SMatrix::<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>::from_fn(|r, c| normal.jtj[r][c]);
    for p in 0..UNKNOWN_COUNT {
        // A coordinate without influence gets a vanishing information, so that the others can be inverted.
        matrix[(p, p)] += 1e-9;
    }
    match matrix.cholesky() {
        Some(factor) => {
            let inverse = factor.inverse();
            std::array::from_fn(|p| scale * inverse[(p, p)])
        }
        None => [f64::INFINITY; UNKNOWN_COUNT],
    }
}

/// [0, 1] in every component of the fault vector.
fn unit_box() -> Bounds<FAULT_COUNT> {
    box_of([0.0; FAULT_COUNT], [1.0; FAULT_COUNT])
}

fn box_of<const D: usize>(lower: [f64; D], upper: [f64; D]) -> Bounds<D> {
    #[expect(clippy::expect_used, reason = "the bounds are constants of the program")]
    Bounds::new(lower, upper).expect("constant bounds ascend")
}

struct LeastSquares<'a> {
    comparison: Comparison<'a>,
    bounds: Bounds<FAULT_COUNT>,
}

impl Objective<FAULT_COUNT> for LeastSquares<'_> {
    fn bounds(&self) -> &Bounds<FAULT_COUNT> {
        &self.bounds
    }

    fn cost(&self, genes: &[f64; FAULT_COUNT]) -> f64 {
        let mut cost = [0.0];
        self.cost_batch(&[*genes], &mut cost);
        cost[0]
    }

    fn cost_batch(&self, genes: &[[f64; FAULT_COUNT]], costs: &mut [f64]) {
        // Lanes that a short last batch leaves over run the first individual again.
        let of = |lane: usize| genes.get(lane).or(genes.first()).copied().unwrap_or([0.0; FAULT_COUNT]);
        let unknowns = std::array::from_fn(|lane| self.comparison.with_fault(FaultVector::from_array(of(lane))));
        for (slot, cost) in costs.iter_mut().zip(self.comparison.rank(&unknowns)) {
            *slot = cost;
        }
    }

    fn batch_size(&self) -> usize {
        RANK_LANES
    }
}

/// The paper's fitness function.
struct PaperCost<'a> {
    comparison: Comparison<'a>,
    bounds: Bounds<FAULT_COUNT>,
    time_scale: f64,
}

impl<'a> PaperCost<'a> {
    /// The derivative is made dimensionless by the electrical time constant over the rated current.
    fn new(comparison: Comparison<'a>, params: &ActuatorParams) -> Self {
        let time_scale = params.motor.l_s / params.motor.r_s / params.motor.i_max;
        Self {
            comparison,
            bounds: unit_box(),
            time_scale,
        }
    }
}

impl Objective<FAULT_COUNT> for PaperCost<'_> {
    fn bounds(&self) -> &Bounds<FAULT_COUNT> {
        &self.bounds
    }

    fn cost(&self, genes: &[f64; FAULT_COUNT]) -> f64 {
        let unknowns = self.comparison.with_fault(FaultVector::from_array(*genes));
        self.comparison.modified_total_least_squares(&unknowns, self.time_scale)
    }
}

struct Refinement<'a, 'b> {
    comparison: &'a Comparison<'b>,
    step: f64,
}

impl Residuals<UNKNOWN_COUNT> for Refinement<'_, '_> {
    fn normal_equations(
        &self,
        genes: &[f64; UNKNOWN_COUNT],
        jtj: &mut SMatrix<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>,
        jtr: &mut SVector<f64, UNKNOWN_COUNT>,
    ) -> f64 {
        let normal = hold_known_motor(
            self.comparison.normal_equations(&Coordinates(*genes), self.step),
            &self.comparison.prior.motor,
        );
        for p in 0..UNKNOWN_COUNT {
            jtr[p] = normal.jtr[p];
            for q in 0..UNKNOWN_COUNT {
                jtj[(p, q)] = normal.jtj[p][q];
            }
        }
        normal.cost
    }

    fn cost(&self, genes: &[f64; UNKNOWN_COUNT]) -> f64 {
        self.comparison.cost(&Coordinates(*genes))
    }

    const SIDE_BY_SIDE: usize = COST_LANES;

    fn costs(&self, points: &[[f64; UNKNOWN_COUNT]], costs: &mut [f64]) {
        // Lanes that few points leave over run the first again.
        let of = |lane: usize| {
            points
                .get(lane)
                .or(points.first())
                .copied()
                .unwrap_or([0.0; UNKNOWN_COUNT])
        };
        let all = self
            .comparison
            .costs(&std::array::from_fn(|lane| Coordinates(of(lane))));
        for (slot, cost) in costs.iter_mut().zip(all) {
            *slot = cost;
        }
    }
}
