//! Terms of the torque balance of the motor shaft, each smoothed by the kernel, row by row over a window.
//!
//! With the true coefficients the terms of a row sum to zero: `Σ_j N_j T_j + … − J ω' − C ω − T_d sign ω − … = 0`. Derived
//! here from the equation of motion of the motor shaft, torques at the motor, of one rigid mass.

use ema_models::phase_shapes;

use super::balance_shape::BalanceShape;
use super::between_samples::instants;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::output_load::OutputLoad;
#[cfg(feature = "std")]
use super::sample_reading::SampleReader;
use super::sample_reading::{FastTerms, SampleReading, sum};
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

/// One row of the torque balance.
#[derive(Clone, Copy, Debug)]
pub(super) struct BalanceRow {
    /// The terms in the order of [`Term`]. With a shorted loop, that of the turns of its phase has the admittance β as coefficient, and the
    /// rest of the phase's torque stands in the gear loss, whose coefficient is known.
    pub(super) terms: [f64; TERM_COUNT],
    /// Whether the motor turns in the positive direction.
    pub(super) forward: bool,
}

/// The terms under the kernel, 10 KiB. It is the caller's: what owned it would be moved, and the controller has no room for the copies.
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

/// Rows of a window, one per inner sample, as [`RowMaker`] makes them.
#[cfg(feature = "std")]
pub(super) fn balance_rows<'a, S: RecordedSample>(
    window: &'a MeasuredWindow<'a, S>,
    shape: &BalanceShape,
    state: WindowState,
    kernel: &'a Kernel,
    ring: &'a mut BalanceRing,
) -> impl Iterator<Item = Option<BalanceRow>> + 'a {
    let mut samples = SampleReader::new(window, shape, state.gain);
    let mut rows = RowMaker::new(window, shape, state, kernel, None, ring);
    window.inner().map(move |n| rows.next(n, &samples.next(n)))
}

/// Makes the rows of a window from its inner samples, in ascending order.
pub(super) struct RowMaker<'a, S> {
    window: &'a MeasuredWindow<'a, S>,
    kernel: &'a Kernel,
    integrands: Integrands,
    /// Takes the place of the turns of its phase.
    shorted: Option<LoopTorque>,
    ring: &'a mut BalanceRing,
    forward: bool,
    /// Whether the fast terms are means around their samples.
    means: bool,
}

impl<'a, S: RecordedSample> RowMaker<'a, S> {
    pub(super) fn new(
        window: &'a MeasuredWindow<'a, S>,
        shape: &BalanceShape,
        state: WindowState,
        kernel: &'a Kernel,
        shorted: Option<LoopTorque>,
        ring: &'a mut BalanceRing,
    ) -> Self {
        ring.clear();
        Self {
            window,
            kernel,
            integrands: Integrands::new(window, shape, state),
            shorted,
            ring,
            forward: true,
            means: instants(window.params()) > 0,
        }
    }

    /// The row that ends with a sample; `None` between the kernel's strides, and unless the motor turns in one direction under the kernel, at
    /// 3 rad/s or more, and all of it was measured.
    pub(super) fn next(&mut self, n: usize, sample: &SampleReading) -> Option<BalanceRow> {
        let of_loop = self
            .shorted
            .as_mut()
            .map(|shorted| (shorted.phase(), shorted.next(sample)));
        if !sample.is_usable {
            self.ring.clear();
            return None;
        }
        // At full torque the speed may change its sign between two samples.
        if self.forward != (sample.now.omega_m > 0.0) {
            self.forward = !self.forward;
            self.ring.clear();
        }
        let mut terms = self.integrands.of(self.window, sample);
        if let Some((phase, [of_admittance, rest])) = of_loop {
            terms[FAST[phase] as usize] = of_admittance;
            terms[Term::GearLoss as usize] += rest;
        }
        self.ring.push(terms);
        (self.ring.is_full() && n.is_multiple_of(self.kernel.stride)).then(|| BalanceRow {
            terms: smoothed(self.ring, self.kernel, self.means, of_loop.is_some()),
            forward: self.forward,
        })
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
            k_p: params.controller.k_p,
            g_p: params.controller.g_p,
            gear_ratio: params.transmission.gear_ratio,
            loss_shares: params.transmission.gear_loss_shares(),
            shape: *shape,
            state,
        }
    }

    fn of(&self, window: &MeasuredWindow<'_, impl RecordedSample>, sample: &SampleReading) -> [f64; TERM_COUNT] {
        let SampleReading { now, counted, fast, .. } = sample;
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
        let FastTerms {
            torque: [a, b, c],
            eccentricity,
            mesh: [mesh_cos, mesh_sin],
            cogging: [cogging_cos, cogging_sin],
            harmonics,
            offsets: [offset_a, offset_b],
        } = *fast;
        let [ecc_cos, ecc_sin] = eccentricity.map(|of_phases| {
            let intact = self.state.turns.iter().zip(of_phases);
            intact.map(|(turns, torque)| turns * torque).sum::<f64>()
        });
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_term_is_the_last_of_the_table() {
        assert_eq!(Term::GearLoss as usize + 1, TERM_COUNT);
    }
}
