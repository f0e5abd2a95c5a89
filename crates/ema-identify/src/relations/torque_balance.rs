//! Friction, shorts and eccentricity of one window from the torque balance of the motor shaft.
//!
//! In: a window and the coefficients that all windows of the unit share. Out: the eight coefficients that may differ in this
//! window (intact turns, eccentricity, scale of friction, load, spring) by one linear least squares. What the gear loses under
//! the load depends on load and spring, and eccentricity acts on the intact turns alone, so up to four rounds find them; without the
//! losses every spring would look like friction.
//!
//! The torque has the products `(N_j − 1) ζ`. With the currents `I s_j` those of phase j are, besides a third harmonic, what a change of
//! the eccentricity by `2/3 (1 − N_j) ζ (cos(φ_e − 2πj/3) − ½ cos φ_e, −sin(φ_e − 2πj/3) − ½ sin φ_e)` would be: left out, they bias ζ by
//! up to `(1 − N_j) ζ`. Derived here.

use nalgebra::{SMatrix, SVector};

use super::balance_coefficients::BalanceCoefficients;
use super::current_noise::{current_noise, noise_of_columns};
use super::elements::{Element, ElementReadings, Needed, Reading};
use super::free_coefficients::{
    ECCENTRICITY, FREE_COUNT, FRICTION, LOAD, attenuation, covariance_by_shared, error_of_shared,
};
use super::free_rows::{FreeRow, FreeRows};
use super::jackknife::Jackknife;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
#[cfg(feature = "std")]
use super::measurement_noise::{NoiseGains, NoiseRise};
use super::normal_equations::{NormalEquations, Solution};
use super::output_load::OutputLoad;
use super::overlap::Overlap;
use super::shared::{SHARED_COUNT, shared_columns, spread};
use super::shorted_loop::ShortedLoop;
use super::terms::WindowState;
use crate::recorded_sample::RecordedSample;

/// Rounds in which load and the gear's losses find each other.
pub(super) const LOAD_ROUNDS: usize = 4;

/// Largest error of the eccentricity by turns that have not settled: half the floor of what the relations leave of it.
const SETTLED: f64 = 1e-3;

/// Residual, relative to that of the healthy windows, from which a shorted loop is looked for. On the suite `robust` at 2 kHz, shorted
/// loops leave 1.5 to 38 without one, other windows seldom more than 1.2.
const SUSPICIOUS: f64 = 1.2;

/// A loop is taken below this residual, relative to that with missing turns and to that of the healthy windows. Same suite: at most 0.54 and
/// 1.4 of shorted loops, at 400 Hz 0.68 and 1.5; of other windows at least 0.95 of the first, at 400 Hz, where both were below in none, 0.36.
const CLEARLY_BETTER: f64 = 0.7;
const EXPLAINED: f64 = 1.5;

/// First and smallest admittance of the search, times the phase resistance; 1 is a bolted short of all turns.
const FIRST_ADMITTANCE: f64 = 0.1;
const LEAST_ADMITTANCE: f64 = 5e-3;

/// Largest factor of the admittance in one step.
const LARGEST_STEP: f64 = 2.5;

/// Steps of each phase, from which the best one is chosen, and further ones of that.
const PHASE_ROUNDS: usize = 3;
const LOOP_ROUNDS: usize = 8;

/// Torque balance of one window.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueBalance {
    /// Friction scale, turns and eccentricity; the other elements are untouched.
    pub(super) readings: ElementReadings,
    /// Load at the output.
    pub(super) load: OutputLoad,
    /// Standard deviation of its constant part, Nm, where the motion shows it.
    pub(super) load_sigma: Option<f64>,
    /// Root-mean-square residual, Nm.
    pub(super) residual_rms: f64,
    /// The same without what noise explains of it beyond that of the healthy windows.
    #[cfg(feature = "std")]
    pub(super) beyond_noise_rms: f64,
    /// What another noise than at commissioning makes of the residual.
    #[cfg(feature = "std")]
    pub(super) rise: NoiseRise,
    /// Rows used.
    pub(super) rows: usize,
    /// Rows used that share no sample.
    pub(super) independent: f64,
    /// Admittance of the shorted loop that explains the window, 1/Ω: its phase, and what was found.
    pub(super) shorted: Option<(usize, Reading)>,
}

/// Which windows a torque balance is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turns {
    /// Of a healthy unit: all turns carry the current of their phase.
    Healthy,
    /// Of a unit in use: missing turns, or a shorted loop where that explains the window clearly better.
    InUse,
}

/// Fits the free coefficients of a window whose position gain is that of the unit times `gain`; `learnt` is the covariance of what the unit's windows share, once it is known.
#[inline(never)]
pub(super) fn torque_balance<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    unit: &BalanceCoefficients,
    gain: f64,
    learnt: Option<&[[f64; SHARED_COUNT]; SHARED_COUNT]>,
    turns: Turns,
) -> TorqueBalance {
    let kernel = unit.kernel(window.params().sensors.sample_rate);
    let mut balance = TorqueBalance {
        readings: ElementReadings::none(),
        load: OutputLoad::default(),
        load_sigma: None,
        residual_rms: 0.0,
        #[cfg(feature = "std")]
        beyond_noise_rms: 0.0,
        #[cfg(feature = "std")]
        rise: NoiseRise::unknown(unit.residual_rms),
        rows: 0,
        independent: 0.0,
        shorted: None,
    };
    let noise = noise_of_free_columns(window, &kernel);
    let mut fit = BalanceFit::new(window, unit, &kernel, gain);
    let mut equations = NormalEquations::new();
    let fitted = fit.explain(&mut equations, &noise, turns);
    balance.rows = equations.rows;
    balance.independent = fit.independent(&equations);
    let Some((solution, load)) = fitted else {
        balance.readings.fail(Element::BALANCE, Needed::LongerMotion);
        return balance;
    };
    balance.residual_rms = solution.residual_rms;
    #[cfg(feature = "std")]
    {
        (balance.beyond_noise_rms, balance.rise) = (fit.beyond_noise(solution.residual_rms), fit.rise);
    }
    balance.load = load;
    let noise = fit.noise_beside_loop(&noise);
    let (covariance, directions) = fit.covariance(&equations, &solution, &noise, learnt);
    let attenuation = attenuation(&solution, balance.rows, fit.shorted.map(|shorted| shorted.phase));
    for (place, element) in Element::BALANCE.into_iter().enumerate() {
        let reading = Reading {
            value: solution.x[place],
            sigma: libm::hypot(libm::sqrt(covariance[(place, place)].max(0.0)), attenuation[place]),
        };
        balance.readings.set(element, reading);
        if fit.shorted.is_some_and(|shorted| shorted.phase == place) {
            balance.shorted = Some((place, reading));
        }
    }
    if directions.iter().any(|&rows| rows * kernel.stride < kernel.span) {
        // With motion in one direction the load takes the place of friction.
        balance.readings.fail([Element::Friction], Needed::BothDirections);
    } else {
        let sigma = libm::sqrt(covariance[(LOAD, LOAD)].max(0.0));
        balance.load_sigma = Some(libm::hypot(sigma, attenuation[LOAD]));
    }
    balance
}

/// Expected squares of the noise in the columns of the free coefficients.
fn noise_of_free_columns<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    kernel: &Kernel,
) -> SVector<f64, FREE_COUNT> {
    let mut noise = SVector::<f64, FREE_COUNT>::zeros();
    let of_columns = noise_of_columns(current_noise(window), window.motor().k, kernel);
    noise.fixed_rows_mut::<5>(0).copy_from_slice(&of_columns);
    noise
}

/// Turns, eccentricity, scale of friction and load of a window, without their uncertainty.
#[derive(Clone, Copy, Debug)]
pub(super) struct FreeCoefficients {
    /// `N_A, N_B, N_C`.
    pub(super) turns: [f64; 3],
    /// `ζ cos φ_e, ζ sin φ_e`.
    pub(super) eccentricity: [f64; 2],
    /// Relative to that of the balance; `None` of a motion in one direction, where the load takes its place.
    pub(super) friction: Option<f64>,
    /// Load at the output.
    pub(super) load: OutputLoad,
}

/// The free coefficients of a window whose turns all carry the current of their phase; `None` where the motion is too short.
#[inline(never)]
pub(super) fn free_coefficients<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    unit: &BalanceCoefficients,
) -> Option<FreeCoefficients> {
    let kernel = unit.kernel(window.params().sensors.sample_rate);
    let noise = noise_of_free_columns(window, &kernel);
    let mut fit = BalanceFit::new(window, unit, &kernel, 1.0);
    let (solution, load) = fit.explain(&mut NormalEquations::new(), &noise, Turns::Healthy)?;
    let mut directions = [0; 2];
    fit.each(|row| {
        if let Some(row) = row {
            directions[usize::from(row.all.forward)] += 1;
        }
    });
    let turns_both_ways = directions.iter().all(|&rows| rows * kernel.stride >= kernel.span);
    let x = &solution.x;
    Some(FreeCoefficients {
        turns: [x[0], x[1], x[2]],
        eccentricity: [x[ECCENTRICITY], x[ECCENTRICITY + 1]],
        friction: turns_both_ways.then_some(x[FRICTION]),
        load,
    })
}

/// The fit of a window: its rows, and what the last solution says of it.
struct BalanceFit<'a, S> {
    rows: FreeRows<'a, S>,
    state: WindowState,
    /// The loop that stands in place of the turns of its phase.
    shorted: Option<ShortedLoop>,
    /// What another noise than at commissioning makes of the residual, by the rows of the first solution.
    #[cfg(feature = "std")]
    rise: NoiseRise,
}

impl<'a, S: RecordedSample> BalanceFit<'a, S> {
    fn new(window: &'a MeasuredWindow<'a, S>, unit: &'a BalanceCoefficients, kernel: &'a Kernel, gain: f64) -> Self {
        Self {
            rows: FreeRows::new(window, unit, kernel),
            state: WindowState {
                gain,
                ..WindowState::healthy(OutputLoad::default())
            },
            shorted: None,
            #[cfg(feature = "std")]
            rise: NoiseRise::unknown(unit.residual_rms),
        }
    }

    /// A residual without what noise explains of it beyond that of the healthy windows; as it is where nothing is known of the noise.
    #[cfg(feature = "std")]
    fn beyond_noise(&self, residual_rms: f64) -> f64 {
        self.rise.beyond(residual_rms)
    }

    #[cfg(not(feature = "std"))]
    fn beyond_noise(&self, residual_rms: f64) -> f64 {
        residual_rms
    }

    /// Takes the noise of the window into account, with the rows of these equations.
    #[cfg(feature = "std")]
    fn count_noise(&mut self, equations: &NormalEquations<FREE_COUNT>) {
        if let Some(noise) = self.rows.window.noise() {
            let gains = NoiseGains::of_torque_balance(self.rows.window, self.rows.kernel);
            self.rise = NoiseRise::new(noise, &gains, self.rows.unit.residual_rms, self.independent(equations));
        }
    }

    /// Rows of the equations that share no sample.
    fn independent(&self, equations: &NormalEquations<FREE_COUNT>) -> f64 {
        (equations.rows * self.rows.kernel.stride) as f64 / self.rows.kernel.span as f64
    }

    /// The solution with missing turns, or with a shorted loop, and its load; `None` with too few rows.
    #[inline(never)]
    fn explain(
        &mut self,
        equations: &mut NormalEquations<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
        turns: Turns,
    ) -> Option<(Solution<FREE_COUNT>, OutputLoad)> {
        let missing = self.fit(equations, noise)?;
        #[cfg(feature = "std")]
        self.count_noise(equations);
        let residual_rms = self.beyond_noise(missing.0.residual_rms);
        if turns == Turns::Healthy || residual_rms <= SUSPICIOUS * self.rows.unit.residual_rms {
            return Some(missing);
        }
        self.fit_loop(equations, noise, residual_rms).or(Some(missing))
    }

    /// Solves once: the solution, the load that it shows, and the state that follows from them. `None` with too few rows.
    fn solve(
        &mut self,
        equations: &mut NormalEquations<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
    ) -> Option<(Solution<FREE_COUNT>, OutputLoad, WindowState)> {
        self.sum(equations);
        equations.without_noise(noise);
        let enough = self.independent(equations) >= (FREE_COUNT + 1) as f64;
        let solution = equations.solve().filter(|_| enough)?;
        let load = OutputLoad::new(&solution.x.fixed_rows::<2>(LOAD).into_owned());
        let information = equations.symmetric().fixed_view::<2, 2>(LOAD, LOAD).into_owned();
        let mut state = self.state;
        state.load = load.losing(&information, equations.rows, self.rows.window.params());
        let of_loop = self.shorted.map(|shorted| shorted.phase);
        for phase in (0..3).filter(|&phase| of_loop != Some(phase)) {
            state.turns[phase] = solution.x[phase].clamp(0.0, 1.0);
        }
        Some((solution, load, state))
    }

    /// Whether what a solution says of the window is what it was made with.
    fn is_settled(&self, state: &WindowState, solution: &Solution<FREE_COUNT>) -> bool {
        let eccentricity = libm::hypot(solution.x[ECCENTRICITY], solution.x[ECCENTRICITY + 1]);
        let moved = (0..3).map(|phase| libm::fabs(state.turns[phase] - self.state.turns[phase]));
        let error = moved.fold(0.0, f64::max) * eccentricity;
        state.load.is_close(&self.state.load) && error < SETTLED
    }

    /// The solution and its load, when load and gear losses, turns and eccentricity have found each other.
    fn fit(
        &mut self,
        equations: &mut NormalEquations<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
    ) -> Option<(Solution<FREE_COUNT>, OutputLoad)> {
        let mut round = 0;
        loop {
            let (solution, load, state) = self.solve(equations, noise)?;
            round += 1;
            if self.is_settled(&state, &solution) || round == LOAD_ROUNDS {
                return Some((solution, load));
            }
            self.state = state;
        }
    }

    /// The loop that explains the window, which missing turns leave with this residual; `None`, and everything as before, without one.
    #[inline(never)]
    fn fit_loop(
        &mut self,
        equations: &mut NormalEquations<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
        residual_rms: f64,
    ) -> Option<(Solution<FREE_COUNT>, OutputLoad)> {
        let state = self.state;
        let first = FIRST_ADMITTANCE / self.rows.window.params().motor.r_s;
        let mut best: Option<(f64, ShortedLoop)> = None;
        for phase in 0..3 {
            self.state = state;
            self.state.turns[phase] = 1.0;
            let start = ShortedLoop {
                phase,
                admittance: first,
            };
            if let Some((solution, _)) = self.refine_loop(start, PHASE_ROUNDS, equations, noise) {
                let left = self.beyond_noise(solution.residual_rms);
                if best.is_none_or(|(least, _)| left < least) {
                    best = self.shorted.map(|shorted| (left, shorted));
                }
            }
        }
        self.state = state;
        let refined = best.and_then(|(_, shorted)| {
            self.state.turns[shorted.phase] = 1.0;
            self.refine_loop(shorted, LOOP_ROUNDS, equations, noise)
        });
        let limit = (CLEARLY_BETTER * residual_rms).min(EXPLAINED * self.rows.unit.residual_rms);
        if refined.is_some_and(|(solution, _)| self.beyond_noise(solution.residual_rms) < limit) {
            return refined;
        }
        (self.shorted, self.state) = (None, state);
        self.sum(equations);
        equations.without_noise(noise);
        None
    }

    /// Gauss–Newton steps of the admittance from a loop, which becomes that of the last solution.
    fn refine_loop(
        &mut self,
        mut shorted: ShortedLoop,
        rounds: usize,
        equations: &mut NormalEquations<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
    ) -> Option<(Solution<FREE_COUNT>, OutputLoad)> {
        let r = self.rows.window.params().motor.r_s;
        let mut round = 0;
        loop {
            self.shorted = Some(shorted);
            let (solution, load, state) = self.solve(equations, &self.noise_beside_loop(noise))?;
            let found = solution.x[shorted.phase];
            round += 1;
            let is_close = libm::fabs(found - shorted.admittance) < 1e-3 * found && self.is_settled(&state, &solution);
            if is_close || round == rounds {
                return Some((solution, load));
            }
            let near = found.clamp(shorted.admittance / LARGEST_STEP, shorted.admittance * LARGEST_STEP);
            shorted.admittance = near.clamp(LEAST_ADMITTANCE / r, 1.0 / r);
            self.state = state;
        }
    }

    /// Expected squares of the noise in each column; the filtered one of a loop has none to speak of.
    fn noise_beside_loop(&self, noise: &SVector<f64, FREE_COUNT>) -> SVector<f64, FREE_COUNT> {
        let mut noise = *noise;
        if let Some(shorted) = self.shorted {
            noise[shorted.phase] = 0.0;
        }
        noise
    }

    /// Passes the row of each inner sample.
    fn each(&mut self, pass: impl FnMut(Option<&FreeRow>)) {
        self.rows.each(self.state, self.shorted, pass);
    }

    /// Sums the equations of all rows.
    #[inline(never)]
    fn sum(&mut self, equations: &mut NormalEquations<FREE_COUNT>) {
        *equations = NormalEquations::new();
        self.each(|row| {
            if let Some(row) = row {
                equations.add(&row.free, row.rest);
            }
        });
    }

    /// Covariance of a solution, and the number of rows in either direction: by the errors of the rows, each variance at least that of
    /// the groups, and by the uncertainty of what the unit's windows share.
    #[inline(never)]
    fn covariance(
        &mut self,
        equations: &NormalEquations<FREE_COUNT>,
        solution: &Solution<FREE_COUNT>,
        noise: &SVector<f64, FREE_COUNT>,
        learnt: Option<&[[f64; SHARED_COUNT]; SHARED_COUNT]>,
    ) -> (SMatrix<f64, FREE_COUNT, FREE_COUNT>, [usize; 2]) {
        let (kernel, unit, window) = (self.rows.kernel, self.rows.unit, self.rows.window);
        let weights = if unit.angle_errors {
            &kernel.second
        } else {
            &kernel.average
        };
        let mut overlap = Overlap::<FREE_COUNT>::new(weights, kernel.span);
        // Products of the free columns with those of the shared unknowns.
        let mut with_shared = SMatrix::<f64, FREE_COUNT, SHARED_COUNT>::zeros();
        let mut groups = Jackknife::<FREE_COUNT, FREE_COUNT>::new(window.len(), equations, solution, noise);
        let mut directions = [0; 2];
        let mut n = 0;
        self.each(|row| {
            overlap.add(row.map(|row| &row.free));
            if let Some(row) = row {
                for (unknown, shared) in shared_columns(&row.all).into_iter().enumerate() {
                    for (place, free) in row.free.iter().enumerate() {
                        with_shared[(place, unknown)] += free * shared;
                    }
                }
                groups.add(n, (&row.free, row.rest), SVector::clone);
                directions[usize::from(row.all.forward)] += 1;
            }
            n += 1;
        });
        let mut covariance = overlap.covariance(equations, solution);
        let of_groups = groups.variance(SVector::clone);
        for place in 0..FREE_COUNT {
            covariance[(place, place)] = covariance[(place, place)].max(of_groups[place]);
        }
        if let Some(learnt) = learnt {
            // What fits worse has more of what commissioning does not know.
            let worse = (self.beyond_noise(solution.residual_rms) / unit.residual_rms.max(f64::MIN_POSITIVE)).max(1.0);
            let spread = spread(window.params()) * (worse * worse);
            let phase = self.shorted.map(|shorted| shorted.phase);
            covariance += covariance_by_shared(&error_of_shared(solution, &with_shared, phase), learnt, &spread);
        }
        (covariance, directions)
    }
}

const _: () = assert!(FRICTION + 1 == Element::BALANCE.len());
