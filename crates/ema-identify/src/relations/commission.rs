//! Learns what a unit's healthy windows share: the coefficients of its torque balance, its play and its position gain.
//!
//! One joint linear least squares over all windows: the shared coefficients, and a load and a spring per window. Those two are
//! eliminated window by window (Schur complement), so the memory does not grow with the unknowns. The healthy windows are then
//! estimated like later ones; mean and scatter of what they show are the unit's baseline.

use std::vec::Vec;

use ema_models::ActuatorParams;
use nalgebra::{SMatrix, SVector};

use super::balance_coefficients::BalanceCoefficients;
use super::balance_shape::BalanceShape;
use super::baseline::Baseline;
use super::commissioned::{Balance, CommissionedRelations};
use super::compliance::Compliance;
use super::compliance_search::find_compliance;
use super::controller::{LawKnowledge, free_scale, gain_ratio};
use super::elements::{ELEMENT_COUNT, Element, Needed, Reading};
use super::kernel::{HALF_WIDTHS_S, Kernel};
use super::measured::MeasuredWindow;
use super::normal_equations::NormalEquations;
use super::output_load::OutputLoad;
use super::residual::{HealthyResidual, RELATION_COUNT, Relation};
use super::setpoint_delay::setpoint_delay;
use super::shared::{INERTIA, SHARED_COUNT, Shared, SharedMatrix, coefficients, priors, shared_columns};
use super::terms::{BalanceRing, BalanceRow, Term, WindowState, balance_rows};
use super::torque_balance::{LOAD_ROUNDS, Turns, torque_balance};
use crate::recorded_sample::RecordedSample;

/// Fewest healthy windows from which coefficients are learnt: one of the five that commissioning needs is left out at a time.
const MIN_WINDOWS: usize = 4;

/// Why a unit cannot be learnt from its windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommissionError {
    /// Fewer windows with motion than needed.
    #[error("expected at least {} healthy windows in which the motor turns, found {found}", MIN_WINDOWS + 1)]
    TooFewWindows {
        /// Windows with rows in the torque balance.
        found: usize,
    },
    /// Sums that are not finite.
    #[error("the torque balance of the healthy windows has no solution")]
    NoSolution,
}

/// Unknowns of one window: the shared ones, load and spring.
const WINDOW_COUNT: usize = SHARED_COUNT + 2;

/// Learns a unit from windows that are healthy on the operator's word: with the compliance of the shape, or one that the windows show.
///
/// # Errors
/// Fewer than five windows in which the motor turns, or sums that are not finite.
pub fn commission<S: RecordedSample>(
    windows: &[MeasuredWindow<'_, S>],
    shape: &BalanceShape,
) -> Result<CommissionedRelations, CommissionError> {
    let shown = shown_compliance(windows, shape);
    let compliance = shown.compliance.unwrap_or(shape.compliance);
    let mut learnt = commission_as(windows, &BalanceShape { compliance, ..*shape })?;
    learnt.may_bend = shown.may_bend;
    let moving = windows.iter().filter(|window| learnt.estimate(window).torque_rows > 0);
    match moving.count() {
        found if found <= MIN_WINDOWS => Err(CommissionError::TooFewWindows { found }),
        _ => Ok(learnt),
    }
}

/// Learns a unit as [`commission`] does, with this shape, also when one of the windows was left out.
///
/// # Errors
/// Fewer than four windows in which the motor turns, or sums that are not finite.
pub fn commission_as<S: RecordedSample>(
    windows: &[MeasuredWindow<'_, S>],
    shape: &BalanceShape,
) -> Result<CommissionedRelations, CommissionError> {
    let scale = Scale::of(shape);
    let mut balances = HALF_WIDTHS_S.map(|half_width_s| shared_balance(windows, shape, half_width_s, scale, ROUNDS));
    let residual = |of: &Result<SharedBalance, CommissionError>| of.as_ref().ok().map(|of| of.balance.residual_rms);
    let [narrow, .., wide] = &balances;
    // Motions that are short for the wide one do not tell.
    let angle_errors = residual(narrow)
        .zip(residual(wide))
        .is_some_and(|(narrow, wide)| narrow > ANGLE_ERRORS * wide);
    let mut best: Option<(f64, &SharedBalance)> = None;
    let mut refused = CommissionError::NoSolution;
    for balance in &mut balances {
        match balance {
            Ok(shared) => {
                shared.balance.angle_errors = angle_errors;
                let variance = shared.expected_variance(windows);
                if best.as_ref().is_none_or(|best| variance < CLEARLY_LESS * best.0) {
                    best = Some((variance, shared));
                }
            }
            Err(error) => refused = *error,
        }
    }
    let Some((_, shared)) = best else {
        return Err(refused);
    };
    let torque_scale = torque_scale(windows);
    let setpoint_delay = delay_of(windows, torque_scale);
    let known = LawKnowledge {
        scale: torque_scale,
        delay_s: Some(setpoint_delay.mean),
    };
    let gain_half_width_s = gain_half_width(windows, known);
    let learnt = CommissionedRelations {
        balance: shared.balance,
        covariance: core::array::from_fn(|row| core::array::from_fn(|column| shared.covariance[(row, column)])),
        gain_half_width_s,
        baseline: [Baseline::default(); ELEMENT_COUNT],
        residual: [HealthyResidual::default(); RELATION_COUNT],
        setpoint_delay,
        torque_scale,
        gain_without_delay: true,
        output_load: None,
        load_error: None,
        may_bend: false,
    };
    let readings: Vec<_> = windows.iter().map(|window| learnt.readings(window, None)).collect();
    let baseline: [Baseline; ELEMENT_COUNT] = Element::ALL.map(|element| {
        let shown: Vec<Reading> = readings
            .iter()
            .filter_map(|(readings, _)| readings.get(element).ok())
            .collect();
        Baseline::of(&shown)
    });
    let residual = Relation::ALL
        .map(|relation| HealthyResidual::of(readings.iter().map(|(_, balance)| balance.residuals[relation as usize])));
    // Motion in one direction does not tell a load from friction.
    let told = |(window, (_, balance)): (_, &(_, Balance))| Some((window, balance.load, balance.load_sigma?));
    let loads: Vec<(&MeasuredWindow<'_, S>, OutputLoad, f64)> =
        windows.iter().zip(&readings).filter_map(told).collect();
    let output_load = loads
        .iter()
        .map(|(window, load, _)| load.mean_magnitude(&window.travel()));
    let load_errors = loads.iter().filter_map(|(window, load, sigma)| {
        let difference = libm::fabs(load.constant - window.since().measured_load?);
        Some((difference - CHANCE_SIGMAS * sigma).max(0.0))
    });
    Ok(CommissionedRelations {
        baseline,
        residual,
        output_load: output_load.reduce(f64::max),
        load_error: load_errors.reduce(f64::max),
        ..learnt
    })
}

/// The scale of the torque in the law of the speed loop: 1, as the type has it, unless the windows show clearly another, which then each
/// window has to show by itself.
fn torque_scale<S: RecordedSample>(windows: &[MeasuredWindow<'_, S>]) -> Option<f64> {
    let [.., wide] = HALF_WIDTHS_S;
    let mut shown: Vec<f64> = windows
        .iter()
        .filter_map(|window| free_scale(window, wide, 0.0))
        .collect();
    shown.sort_by(f64::total_cmp);
    let median = shown.get(shown.len() / 2).copied().unwrap_or(1.0);
    SCALES.contains(&median).then_some(1.0)
}

/// Scales that windows of a drive by its type show, drawn towards zero.
const SCALES: core::ops::Range<f64> = 0.6..1.15;

/// What the windows show of the time of the set point, s.
fn delay_of<S: RecordedSample>(windows: &[MeasuredWindow<'_, S>], torque_scale: Option<f64>) -> Baseline {
    let shown: Vec<Reading> = windows
        .iter()
        .filter_map(|window| setpoint_delay(window, torque_scale).map(|found| found.delay_s))
        .collect();
    Baseline::of(&shown)
}

/// What the windows show of a spring behind the motor.
#[derive(Clone, Copy, Debug, Default)]
struct ShownCompliance {
    /// The compliance by which they are explained clearly better than by one rigid mass.
    compliance: Option<Compliance>,
    /// Whether a spring explains some of what a rigid mass leaves, and much of that is left.
    may_bend: bool,
}

/// The compliance by which the windows are explained better than by one rigid mass.
fn shown_compliance<S: RecordedSample>(windows: &[MeasuredWindow<'_, S>], shape: &BalanceShape) -> ShownCompliance {
    let [narrow, middle, _] = HALF_WIDTHS_S;
    let params = windows.first().map(MeasuredWindow::params);
    let params =
        params.filter(|params| shape.compliance.is_rigid() && narrow * params.sensors.sample_rate >= SEARCH_SAMPLES);
    let residual = |half_width_s, &compliance: &Compliance| {
        let shape = BalanceShape { compliance, ..*shape };
        let shared = shared_balance(windows, &shape, half_width_s, Scale::Turns, SEARCH_ROUNDS);
        shared.map_or(f64::NAN, |shared| shared.balance.residual_rms)
    };
    let least = params.and_then(|_| find_compliance(|compliance| residual(narrow, compliance)));
    match (params, least) {
        (Some(_), Some(least)) if least.is_clearly_less() => ShownCompliance {
            compliance: Some(least.compliance),
            may_bend: false,
        },
        (Some(params), Some(least)) if least.share < SOME_LESS => {
            let [rigid, wider] = [narrow, middle].map(|half_width_s| residual(half_width_s, &Compliance::RIGID));
            let is_large = rigid > LARGE_SHARE * params.motor.torque_gain() * params.motor.i_max;
            ShownCompliance {
                compliance: None,
                may_bend: is_large && rigid < ANGLE_ERRORS_NEXT * wider,
            }
        }
        _ => ShownCompliance::default(),
    }
}

/// Residual with a spring, relative to that of a rigid mass, below which the gear may bend: white errors of the torque leave 0.8.
const SOME_LESS: f64 = 0.7;

/// Residual of a rigid mass, as a share of the largest torque, below which a bending gear does no harm; that of any unit is half of it.
const LARGE_SHARE: f64 = 0.01;

/// Residual of the narrow kernel, relative to the next one, of errors of the angle: a kernel twice as wide leaves 1/5.7 of those, and 1/1.6 of
/// a resonance in the band of both.
const ANGLE_ERRORS_NEXT: f64 = 3.0;

/// Samples of a half width from which on the fourth difference of the kernel resolves a resonance.
const SEARCH_SAMPLES: f64 = 5.0;

/// Rounds of the least squares in the search; the priors count from the second on.
const SEARCH_ROUNDS: usize = 2;

/// Rounds in which loads and the gear's losses under them find each other.
const ROUNDS: usize = LOAD_ROUNDS + 1;

/// Residual of the narrow kernel, relative to the wide one, from which the errors are those of the angle: a kernel four times as
/// wide leaves ½ of white errors of the torque, 1/32 of white errors of the angle.
const ANGLE_ERRORS: f64 = 6.0;

/// Standard deviations of a load that chance explains.
const CHANCE_SIGMAS: f64 = 2.0;

/// A wider kernel is taken where it brings the expected variance below this share of that of a narrower one.
const CLEARLY_LESS: f64 = 0.5;

/// The half width, s, with which the windows show the position gain best: a narrower one where it shows it clearly better, as errors of the
/// sampled control deviation repeat with the motion and stand in no scatter.
fn gain_half_width<S: RecordedSample>(windows: &[MeasuredWindow<'_, S>], known: LawKnowledge) -> f64 {
    let [.., wide] = HALF_WIDTHS_S;
    let mut best = (f64::INFINITY, wide);
    for half_width_s in HALF_WIDTHS_S.into_iter().rev() {
        let readings = windows
            .iter()
            .map(|window| gain_ratio(window, half_width_s, known).map(|(gain, _)| gain));
        let variance = expected_variance(readings, 1.0);
        if variance < CLEARLY_LESS * best.0 {
            best = (variance, half_width_s);
        }
    }
    best.1
}

/// Variance with which windows show an element: that of their mean information or their scatter, whichever is larger; 1 where none
/// has a reading. `slope` leads to a damage.
fn expected_variance(readings: impl Iterator<Item = Result<Reading, Needed>>, slope: f64) -> f64 {
    let readings: Vec<_> = readings.collect();
    let shown: Vec<Reading> = readings.iter().filter_map(|reading| reading.ok()).collect();
    let squared = |sigma: f64| (slope * sigma * slope * sigma).max(f64::MIN_POSITIVE);
    let information: f64 = shown.iter().map(|reading| 1.0 / squared(reading.sigma)).sum();
    let windows = readings.len() as f64;
    (windows / (windows + information)).max(squared(Baseline::of(&shown).scatter))
}

/// What the windows share in the torque balance.
struct SharedBalance {
    balance: BalanceCoefficients,
    covariance: SharedMatrix,
}

impl SharedBalance {
    /// Geometric mean over the elements of the balance of the variance of a damage.
    fn expected_variance<S: RecordedSample>(&self, windows: &[MeasuredWindow<'_, S>]) -> f64 {
        let readings: Vec<_> = windows
            .iter()
            .map(|window| {
                torque_balance(
                    window,
                    &self.balance,
                    1.0,
                    Some(&self.covariance.data.0),
                    Turns::Healthy,
                )
                .readings
            })
            .collect();
        let logarithms = Element::BALANCE
            .into_iter()
            .map(|element| {
                let slope = if element == Element::Friction { 0.5 } else { 1.0 };
                libm::log(expected_variance(
                    readings.iter().map(|readings| readings.get(element)),
                    slope,
                ))
            })
            .sum::<f64>();
        libm::exp(logarithms / Element::BALANCE.len() as f64)
    }
}

/// The coefficients that all windows share.
fn shared_balance<S: RecordedSample>(
    windows: &[MeasuredWindow<'_, S>],
    shape: &BalanceShape,
    half_width_s: f64,
    scale: Scale,
    rounds: usize,
) -> Result<SharedBalance, CommissionError> {
    let params = windows
        .first()
        .ok_or(CommissionError::TooFewWindows { found: 0 })?
        .params();
    let kernel = Kernel::new(half_width_s, params.sensors.sample_rate, &shape.compliance);
    // Rows that count as one.
    let squares: f64 = kernel.average.iter().map(|weight| weight * weight).sum();
    let correlated = (1.0 / squares / kernel.stride as f64).max(1.0);
    let priors = priors(params);
    let mut loads = std::vec![OutputLoad::default(); windows.len()];
    // The sums of each window, and the load that they are of.
    let mut sums: Vec<(OutputLoad, NormalEquations<WINDOW_COUNT>)> = Vec::with_capacity(windows.len());
    let mut learnt = Err(CommissionError::NoSolution);
    let (mut error_variance, mut factor) = (0.0, 1.0);
    for _ in 0..rounds {
        for (n, (window, &load)) in windows.iter().zip(&loads).enumerate() {
            let of_load = || (load, window_sums(window, shape, load, &kernel, scale));
            match sums.get_mut(n) {
                None => sums.push(of_load()),
                Some((before, _)) if *before == load => {}
                Some(before) => *before = of_load(),
            }
        }
        let found = sums.iter().filter(|(_, sums)| sums.rows > 0).count();
        if found < MIN_WINDOWS {
            return Err(CommissionError::TooFewWindows { found });
        }
        let mut shared = NormalEquations::<SHARED_COUNT>::new();
        for (_, sums) in &sums {
            add_without_own(&mut shared, sums);
        }
        for (unknown, (value, sigma)) in priors.into_iter().enumerate() {
            // The torque's scale is that of the last round.
            let (value, sigma) = if unknown == INERTIA {
                scale.prior_of_inertia((value, sigma))
            } else {
                (factor * value, factor * sigma)
            };
            let weight = error_variance / (sigma * sigma);
            shared.ata[(unknown, unknown)] += weight;
            shared.aty[unknown] += weight * value;
            shared.yy += weight * value * value;
        }
        let solution = shared.solve().ok_or(CommissionError::NoSolution)?;
        factor = scale.of_torque(&solution.x);
        if factor <= 0.0 {
            return Err(CommissionError::NoSolution);
        }
        for ((window, (_, sums)), load) in windows.iter().zip(&sums).zip(&mut loads) {
            *load = own_load(sums, &solution.x, factor, window.params());
        }
        error_variance = solution.residual_rms * solution.residual_rms * correlated;
        let (x, derivative) = scale.of_fixed_turns(&solution.x, params.motor.j);
        let balance = BalanceCoefficients {
            values: coefficients(&x),
            shape: *shape,
            residual_rms: solution.residual_rms / factor,
            half_width_s,
            angle_errors: false,
        };
        learnt = Ok(SharedBalance {
            balance,
            covariance: derivative * solution.inverse * derivative.transpose() * error_variance,
        });
    }
    learnt
}

/// Normal equations of one window.
fn window_sums<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    shape: &BalanceShape,
    load: OutputLoad,
    kernel: &Kernel,
    scale: Scale,
) -> NormalEquations<WINDOW_COUNT> {
    let mut sums = NormalEquations::new();
    let mut ring = BalanceRing::new(kernel.span);
    for row in balance_rows(window, shape, WindowState::healthy(load), kernel, &mut ring).flatten() {
        let (a, y) = scale.row(&row, window.params().motor.j);
        sums.add(&a, y);
    }
    sums
}

/// What stands on the right of the joint least squares, where errors draw no coefficient towards zero. The search for a compliance compares
/// rigid and compliant masses by one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    /// The turns: J is an unknown.
    Turns,
    /// The inertia, by that of the type, kg·m²: the scale of the torque is an unknown in place of J.
    Inertia,
}

impl Scale {
    /// That of the coefficients of a shape. Errors of the angle, as jittering sample instants make them, are many times those of the
    /// currents; in a column they would draw J towards zero, at 400 Hz to a tenth. Behind a spring the rows within the play are most of
    /// the residual, and they are no errors of the angle.
    fn of(shape: &BalanceShape) -> Self {
        if shape.compliance.is_rigid() {
            Self::Inertia
        } else {
            Self::Turns
        }
    }

    /// The row `a · x = y`; of the inertia's scale all is divided by J over that of the type.
    fn row(self, row: &BalanceRow, inertia: f64) -> ([f64; WINDOW_COUNT], f64) {
        let term = |term: Term| row.terms[term as usize];
        let mut a = [0.0; WINDOW_COUNT];
        a[..SHARED_COUNT].copy_from_slice(&shared_columns(row));
        a[SHARED_COUNT] = -term(Term::Load);
        a[SHARED_COUNT + 1] = -term(Term::Spring);
        let whole = [Term::TurnsA, Term::TurnsB, Term::TurnsC, Term::GearLoss];
        let whole: f64 = whole.into_iter().map(term).sum();
        match self {
            Self::Turns => (a, whole),
            Self::Inertia => {
                a[INERTIA] = -whole;
                (a, inertia * term(Term::Inertia))
            }
        }
    }

    /// What is known of the unknown in place of J, where the prior of J has this value and standard deviation.
    fn prior_of_inertia(self, (value, sigma): (f64, f64)) -> (f64, f64) {
        match self {
            Self::Turns => (value, sigma),
            Self::Inertia => (1.0, sigma / value),
        }
    }

    /// Factor of the torque in a solution.
    fn of_torque(self, x: &Shared) -> f64 {
        match self {
            Self::Turns => 1.0,
            Self::Inertia => x[INERTIA],
        }
    }

    /// The shared unknowns with `N_A + N_B + N_C = 3` of those of a solution, and the derivative.
    fn of_fixed_turns(self, x: &Shared, inertia: f64) -> (Shared, SharedMatrix) {
        if self == Self::Turns {
            return (*x, SharedMatrix::identity());
        }
        let scale = x[INERTIA];
        let mut fixed = x / scale;
        fixed[INERTIA] = inertia / scale;
        let mut derivative = SharedMatrix::identity() / scale;
        derivative.set_column(INERTIA, &(-fixed / scale));
        (fixed, derivative)
    }
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

/// Load and spring of a window for given shared unknowns and factor of the torque, as far as the gear loses torque under them.
fn own_load(
    sums: &NormalEquations<WINDOW_COUNT>,
    shared: &SVector<f64, SHARED_COUNT>,
    factor: f64,
    params: &ActuatorParams,
) -> OutputLoad {
    let own = Own::new(sums);
    let found = own.inverse * (own.rhs - own.coupling.transpose() * shared);
    let information = sums
        .symmetric()
        .fixed_view::<2, 2>(SHARED_COUNT, SHARED_COUNT)
        .into_owned();
    OutputLoad::new(&(found / factor)).losing(&information, sums.rows, params)
}
