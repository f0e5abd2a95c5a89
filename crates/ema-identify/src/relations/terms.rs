//! Terms of the torque balance of the motor shaft, each smoothed by the kernel, row by row over a window.
//!
//! With the true coefficients the terms of a row sum to zero: `Σ_j N_j T_j + … − J ω' − C ω − T_d sign ω − … = 0`. Derived
//! here from the equation of motion of the motor shaft, torques at the motor, of one rigid mass.

use core::ops::Range;

use ema_models::{ActuatorParams, phase_shapes};

use super::between_samples::{Interval, instants};
use super::compliance::Compliance;
use super::kernel::Kernel;
use super::measured::{Instant, MeasuredWindow, Quantities};
use super::output_load::OutputLoad;
use super::shorted_loop::LoopTorque;
use super::sliding::Sliding;
use crate::recorded_sample::RecordedSample;

/// A term of the torque balance; its coefficient has the stated unit, coefficient times term is a torque, Nm.
///
/// `s_j = −sin(θ_e − 2πj/3)`; sign ω is that of the measured speed. Derived here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    /// `k s_A i_A`; coefficient N_A.
    TurnsA,
    /// `k s_B i_B`; coefficient N_B.
    TurnsB,
    /// `k s_C i_C`; coefficient N_C.
    TurnsC,
    /// `Σ_j N_j k s_j i_j cos(θ_e + 2πj/3)` with the turns of the last solution; coefficient `ζ cos φ_e`.
    EccentricityCos,
    /// `Σ_j N_j k s_j i_j sin(θ_e + 2πj/3)`; coefficient `ζ sin φ_e`.
    EccentricitySin,
    /// `−θ_m''`; coefficient J, kg·m².
    Inertia,
    /// `−θ_m'`; coefficient C, Nm·s/rad.
    Damping,
    /// `−sign ω`; coefficient T_d, Nm.
    DryFriction,
    /// `−sign ω e^(−(ω/ω_s)²)`; coefficient T_s' − T_d of Stribeck's curve, Nm.
    Stribeck,
    /// `−sign ω cos N_t θ_m`; coefficient of the friction's part once per tooth, Nm.
    MeshCos,
    /// `−sign ω sin N_t θ_m`; coefficient of the friction's part once per tooth, Nm.
    MeshSin,
    /// `cos N_c θ_m`; coefficient of the cogging torque, Nm.
    CoggingCos,
    /// `sin N_c θ_m`; coefficient of the cogging torque, Nm.
    CoggingSin,
    /// `−(cos θ_e)''`; coefficient −J times the resolver's error at the motor shaft, kg·m²·rad.
    Resolver1Cos,
    /// `−(sin θ_e)''`; coefficient as before.
    Resolver1Sin,
    /// `−(cos 2θ_e)''`; coefficient as before.
    Resolver2Cos,
    /// `−(sin 2θ_e)''`; coefficient as before.
    Resolver2Sin,
    /// `−Σ_j k (sin 5θ_j − sin 7θ_j) i_j`, `θ_j = θ_e − 2πj/3`; coefficient: half of the difference h₅ − h₇ of the EMF's 5th and 7th
    /// harmonic. With sinusoidal currents `−I sin θ_j` only the difference shows: their torque is `−1.5 k I (h₅ − h₇) cos 6θ_e`, the sum
    /// `−3 k I cos 6θ_e`.
    EmfHarmonics,
    /// `k (s_A − s_C)`; coefficient: minus the offset of the current of phase A about the mean of the three, A (a common
    /// offset makes no torque).
    OffsetA,
    /// `k (s_B − s_C)`; coefficient: the same of phase B, A.
    OffsetB,
    /// `Σ_j k s_j i_j'`; coefficient: age of the currents against the angle, s.
    Latency,
    /// `K_p Δω_ref`, where neither speed nor torque is at its limit: what each new set point adds to the torque behind the sample with
    /// which it is latched; coefficient: the share of it in the mean torque between two samples, about ½. Without it, a set point
    /// that is held from sample to sample looks like friction.
    SetpointHold,
    /// `K_p G_p (θ_out − θ_m/n)`, less its mean over 17 ms, where neither speed nor torque is at its limit: the count within which
    /// the output stands changes the torque at the sample's instant, but little of its mean between two samples; coefficient: the
    /// share of it in the sampled torque, of the other sign where the current lags.
    CountedOutput,
    /// `−1/n`; coefficient: constant load at the output, Nm.
    Load,
    /// `−(θ_out − θ_out(0))/n`; coefficient: stiffness of a spring load at the output, Nm/rad.
    Spring,
    /// `−sign ω |T_l/n| (1/η_o − 1)` while the load T_l opposes the motion, `(1 − η_a)` while it aids; coefficient 1. T_l is
    /// load and spring as given.
    GearLoss,
}

/// Number of terms.
pub const TERM_COUNT: usize = 26;

/// Terms of which the kernel takes the second derivative, less the sign; of the damping it takes the first.
const SECOND: [Term; 5] = [
    Term::Inertia,
    Term::Resolver1Cos,
    Term::Resolver1Sin,
    Term::Resolver2Cos,
    Term::Resolver2Sin,
];

/// Terms that change fast with the motor angle: their means around a sample come from angle and currents between the samples.
const FAST: [Term; 12] = [
    Term::TurnsA,
    Term::TurnsB,
    Term::TurnsC,
    Term::EccentricityCos,
    Term::EccentricitySin,
    Term::MeshCos,
    Term::MeshSin,
    Term::CoggingCos,
    Term::CoggingSin,
    Term::EmfHarmonics,
    Term::OffsetA,
    Term::OffsetB,
];

/// Constants of the terms that an actuator type's parameters do not hold.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct BalanceShape {
    /// Stribeck speed ω_s at the motor shaft, rad/s.
    pub stribeck_speed: f64,
    /// Periods of the cogging torque per motor revolution, N_c, a whole number.
    pub cogging_periods: f64,
    /// Teeth of the first gear stage per motor revolution, N_t, a whole number.
    pub teeth: f64,
    /// The transmission behind the motor shaft.
    #[cfg_attr(feature = "std", serde(default))]
    pub compliance: Compliance,
}

impl BalanceShape {
    /// Usual values: 10 rad/s, six cogging periods per pole pair, 13 teeth, a rigid transmission.
    #[must_use]
    pub fn usual(params: &ActuatorParams) -> Self {
        Self {
            stribeck_speed: 10.0,
            cogging_periods: 6.0 * params.motor.pole_pairs,
            teeth: 13.0,
            compliance: Compliance::RIGID,
        }
    }
}

/// One row of the torque balance.
#[derive(Clone, Copy, Debug)]
pub(super) struct BalanceRow {
    /// The terms in the order of [`Term`]. With a shorted loop, that of the turns of its phase has the admittance β as coefficient, and the
    /// rest of the phase's torque stands in the gear loss, whose coefficient is known.
    pub(super) terms: [f64; TERM_COUNT],
    /// Whether the motor turns in the positive direction.
    pub(super) forward: bool,
}

/// The terms under the kernel, 10 KiB. It is the caller's, because an iterator that owned it would be moved, and the controller has no room
/// for the copies.
pub(super) type BalanceRing = Sliding<TERM_COUNT>;

/// What the terms of a window take as known of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WindowState {
    /// Load at the output under which the gear loses torque.
    pub(super) load: OutputLoad,
    /// Factor of the position gain against the healthy unit's.
    pub(super) gain: f64,
    /// Intact turns N_A, N_B, N_C that the eccentricity acts on: turns that carry no current make no torque in a narrow gap either.
    pub(super) turns: [f64; 3],
}

impl WindowState {
    /// Of a unit with all its turns and the position gain of the healthy one.
    pub(super) fn healthy(load: OutputLoad) -> Self {
        Self {
            load,
            gain: 1.0,
            turns: [1.0; 3],
        }
    }
}

/// Smallest speed under the kernel, rad/s: below, friction is no function of the measured speed.
pub(super) const MOVING: f64 = 3.0;

/// Rows of a window, one per inner sample; `None` between the kernel's strides, and unless the motor turns in one direction under the kernel that ends there, at
/// 3 rad/s or more, and all of it was measured. A shorted loop takes the place of the turns of its phase.
pub(super) fn balance_rows<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    shape: &BalanceShape,
    state: WindowState,
    kernel: &Kernel,
    mut shorted: Option<LoopTorque>,
    ring: &mut BalanceRing,
) -> impl Iterator<Item = Option<BalanceRow>> {
    let (window, integrands) = (*window, Integrands::new(window, shape, state));
    let (instants, stride) = (instants(window.params()), kernel.stride);
    ring.clear();
    let mut forward = true;
    let mut counting = Counting::new(&window);
    // The sample at which the last interval ended, and what the interval adds to its fast terms.
    let mut ended: Option<(usize, [f64; FAST.len()])> = None;
    window.inner().map(move |n| {
        let now = window.quantities(n);
        let counted = counting.deviation(&window, n);
        let jump = |n, current| integrands.jump(&window, n, current);
        let of_loop = shorted
            .as_mut()
            .map(|shorted| (shorted.phase(), shorted.next(&window, n, jump)));
        if libm::fabs(now.omega_m) < MOVING || !window.is_measured(n) {
            ring.clear();
            return None;
        }
        // At full torque the speed may change its sign between two samples.
        if forward != (now.omega_m > 0.0) {
            forward = !forward;
            ring.clear();
        }
        let fast = if instants > 0 {
            let over = |n| integrands.fast_over(&Interval::new(&window, n, jump), instants);
            let before = match ended {
                Some((at, rising)) if at == n => rising,
                _ => over(n - 1)[1],
            };
            let [falling, rising] = over(n);
            ended = Some((n + 1, rising));
            core::array::from_fn(|place| before[place] + falling[place])
        } else {
            integrands.fast(&now.instant())
        };
        let mut terms = integrands.of(&window, &now, counted, &fast);
        if let Some((phase, [of_admittance, rest])) = of_loop {
            terms[FAST[phase] as usize] = of_admittance;
            terms[Term::GearLoss as usize] += rest;
        }
        ring.push(terms);
        (ring.is_full() && n % stride == 0).then(|| BalanceRow {
            terms: smoothed(ring, kernel, instants > 0, of_loop.is_some()),
            forward,
        })
    })
}

/// Time on either side of a sample over which the mean of the output's counting error is taken, s.
const COUNTING_S: f64 = 8.5e-3;

/// Difference between the counted output angle and the motor angle at the output, less its mean around the sample.
struct Counting {
    half: usize,
    /// Samples of the sum, as many on either side as there are.
    range: Range<usize>,
    sum: f64,
}

impl Counting {
    fn new<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> Self {
        let rate = window.params().sensors.sample_rate;
        Self {
            half: libm::round(COUNTING_S * rate).max(2.0) as usize,
            range: 0..0,
            sum: 0.0,
        }
    }

    /// The deviation at a sample, rad at the output; samples in ascending order.
    fn deviation<S: RecordedSample>(&mut self, window: &MeasuredWindow<'_, S>, n: usize) -> f64 {
        let half = self.half.min(n).min(window.len() - 1 - n);
        while self.range.end <= n + half {
            self.sum += window.behind_gear(self.range.end);
            self.range.end += 1;
        }
        while self.range.start < n - half {
            self.sum -= window.behind_gear(self.range.start);
            self.range.start += 1;
        }
        window.behind_gear(n) - self.sum / self.range.len() as f64
    }
}

/// The terms of the row that ends with the last sample of the ring; `means`: the fast terms are means around their samples, with a loop
/// the gear loss too.
fn smoothed(ring: &BalanceRing, kernel: &Kernel, means: bool, with_loop: bool) -> [f64; TERM_COUNT] {
    let mut terms = ring.sums(&kernel.average);
    if means {
        let fast = ring.sums_of(FAST.map(|term| term as usize), &kernel.smooth);
        for (term, fast) in FAST.into_iter().zip(fast) {
            terms[term as usize] = fast;
        }
    }
    if means && with_loop {
        let [rest] = ring.sums_of([Term::GearLoss as usize], &kernel.smooth);
        terms[Term::GearLoss as usize] = rest;
    }
    let [damping] = ring.sums_of([Term::Damping as usize], &kernel.first);
    terms[Term::Damping as usize] = -damping;
    let second = ring.sums_of(SECOND.map(|term| term as usize), &kernel.second);
    for (term, second) in SECOND.into_iter().zip(second) {
        terms[term as usize] = -second;
    }
    terms
}

/// What the terms are made of before the kernel.
#[derive(Clone, Copy)]
struct Integrands {
    k: f64,
    /// Torque of the motor for that which the controller demands: it is the type's at commissioning alone.
    made: f64,
    /// What the controller takes for the torque of an ampere, Nm/A.
    torque_gain: f64,
    k_p: f64,
    g_p: f64,
    gear_ratio: f64,
    loss_shares: [f64; 2],
    shape: BalanceShape,
    state: WindowState,
}

impl Integrands {
    fn new<S: RecordedSample>(window: &MeasuredWindow<'_, S>, shape: &BalanceShape, state: WindowState) -> Self {
        let (params, k) = (window.params(), window.motor().k);
        Self {
            k,
            made: k / params.motor.k,
            torque_gain: params.motor.torque_gain(),
            k_p: params.controller.k_p,
            g_p: params.controller.g_p,
            gear_ratio: params.transmission.gear_ratio,
            loss_shares: params.transmission.gear_loss_shares(),
            shape: *shape,
            state,
        }
    }

    fn of(
        &self,
        window: &MeasuredWindow<'_, impl RecordedSample>,
        now: &Quantities,
        counted: f64,
        fast: &[f64; FAST.len()],
    ) -> [f64; TERM_COUNT] {
        let e = now.sin_cos_e;
        let double = sum(e, e);
        let s = phase_shapes(e);
        let torque: f64 = (0..3).map(|j| self.k * s[j] * now.i[j]).sum();
        let is_limited =
            now.speed_reference * self.state.gain >= 1.0 || window.is_current_limited(torque / (1.5 * self.k));
        // Under a commanded speed the controller does not use the output angle.
        let is_output_unused = is_limited || !now.is_position;
        let sign = libm::copysign(1.0, now.omega_m);
        let ratio = now.omega_m / self.shape.stribeck_speed;
        let load_torque = (self.state.load.constant + self.state.load.spring * now.travel) / self.gear_ratio;
        let [opposing, aiding] = self.loss_shares;
        let loss_share = if load_torque * sign >= 0.0 { opposing } else { aiding };
        let [
            a,
            b,
            c,
            ecc_cos,
            ecc_sin,
            mesh_cos,
            mesh_sin,
            cogging_cos,
            cogging_sin,
            harmonics,
            offset_a,
            offset_b,
        ] = *fast;
        [
            a,
            b,
            c,
            ecc_cos,
            ecc_sin,
            now.theta_m,
            now.theta_m,
            -sign,
            -sign * stribeck_share(ratio),
            -sign * mesh_cos,
            -sign * mesh_sin,
            cogging_cos,
            cogging_sin,
            e.1,
            e.0,
            double.1,
            double.0,
            harmonics,
            offset_a,
            offset_b,
            (0..3).map(|j| self.k * s[j] * now.di[j]).sum(),
            if is_limited {
                0.0
            } else {
                self.made * self.state.gain * self.k_p * now.reference_step
            },
            if is_output_unused {
                0.0
            } else {
                self.made * self.state.gain * self.k_p * self.g_p * counted
            },
            -1.0 / self.gear_ratio,
            -now.travel / self.gear_ratio,
            -sign * libm::fabs(load_torque) * loss_share,
        ]
    }

    /// Step of the quadrature current behind a sample, A, where neither speed nor torque is at its limit.
    fn jump(&self, window: &MeasuredWindow<'_, impl RecordedSample>, n: usize, [_, quadrature]: [f64; 2]) -> f64 {
        if window.is_current_limited(quadrature) {
            0.0
        } else {
            self.k_p * window.reference_change(n, self.state.gain) / self.torque_gain
        }
    }

    /// The fast terms of an instant; those of the mesh without the sign of the speed.
    fn fast(&self, now: &Instant) -> [f64; FAST.len()] {
        use ema_models::Real;
        let e = now.sin_cos_e;
        let double = sum(e, e);
        let fourth = sum(double, double);
        let (fifth, seventh) = (sum(fourth, e), sum(sum(fourth, double), e));
        let s = phase_shapes(e);
        let torque: [f64; 3] = core::array::from_fn(|j| self.k * s[j] * now.i[j]);
        let intact: [f64; 3] = core::array::from_fn(|j| self.state.turns[j] * torque[j]);
        let (mesh_sin, mesh_cos) = (self.shape.teeth * now.angle_in_turn).sin_cos_poly();
        let (cogging_sin, cogging_cos) = (self.shape.cogging_periods * now.angle_in_turn).sin_cos_poly();
        // 5 θ_j = 5 θ_e + 2πj/3 and 7 θ_j = 7 θ_e − 2πj/3, up to whole turns.
        let harmonics = |j: usize| ahead(fifth, j).0 - ahead(seventh, (3 - j) % 3).0;
        [
            torque[0],
            torque[1],
            torque[2],
            (0..3).map(|j| intact[j] * ahead(e, j).1).sum(),
            (0..3).map(|j| intact[j] * ahead(e, j).0).sum(),
            mesh_cos,
            mesh_sin,
            cogging_cos,
            cogging_sin,
            -(0..3).map(|j| self.k * harmonics(j) * now.i[j]).sum::<f64>(),
            self.k * (s[0] - s[2]),
            self.k * (s[1] - s[2]),
        ]
    }

    /// Sums of the fast terms over an interval whose weights fall towards its end, and whose weights rise; each weight sums to ½.
    fn fast_over(&self, interval: &Interval, instants: usize) -> [[f64; FAST.len()]; 2] {
        let mut sums = [[0.0; FAST.len()]; 2];
        for m in 0..instants {
            let share = (m as f64 + 0.5) / instants as f64;
            let terms = self.fast(&interval.at(share));
            for (place, term) in terms.into_iter().enumerate() {
                sums[0][place] += (1.0 - share) * term / instants as f64;
                sums[1][place] += share * term / instants as f64;
            }
        }
        sums
    }
}

/// `e^(−x²)`, far out 0 without the work.
fn stribeck_share(x: f64) -> f64 {
    const NONE_LEFT: f64 = 28.0;
    if libm::fabs(x) > NONE_LEFT {
        0.0
    } else {
        libm::exp(-x * x)
    }
}

/// Sine and cosine of the sum of two angles.
fn sum((sin_a, cos_a): (f64, f64), (sin_b, cos_b): (f64, f64)) -> (f64, f64) {
    (sin_a * cos_b + cos_a * sin_b, cos_a * cos_b - sin_a * sin_b)
}

/// Sine and cosine of an angle plus `2πj/3`.
fn ahead(angle: (f64, f64), j: usize) -> (f64, f64) {
    const SQRT3_2: f64 = 0.866_025_403_784_438_6;
    const THIRDS: [(f64, f64); 3] = [(0.0, 1.0), (SQRT3_2, -0.5), (-SQRT3_2, -0.5)];
    sum(angle, THIRDS[j])
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::Real;

    #[test]
    fn angles_ahead_by_thirds_of_a_turn() {
        for j in 0..3 {
            let (sin, cos) = ahead(0.3f64.sin_cos_poly(), j);
            let angle = 0.3 + core::f64::consts::TAU * j as f64 / 3.0;
            assert!((sin - libm::sin(angle)).abs() < 1e-11 && (cos - libm::cos(angle)).abs() < 1e-11);
        }
    }

    #[test]
    fn the_last_term_is_the_last_of_the_table() {
        assert_eq!(Term::GearLoss as usize + 1, TERM_COUNT);
    }
}
