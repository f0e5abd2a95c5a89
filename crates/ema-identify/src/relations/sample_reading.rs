//! What a sample brings to the torque balance, whatever is known of load, turns and shorted loops.
//!
//! Products that change fast with the motor angle are means around their sample where the samples alone would alias
//! ([`between_samples`](super::between_samples)).

use core::ops::Range;

use ema_models::{Real, phase_shapes};

use super::balance_shape::BalanceShape;
use super::between_samples::{Interval, instants};
use super::measured::{Instant, MOVING, MeasuredWindow, Quantities};
use crate::recorded_sample::RecordedSample;

/// A sample as the terms of the torque balance need it.
#[derive(Clone, Copy)]
pub(super) struct SampleReading {
    pub(super) now: Quantities,
    /// Difference between the counted output angle and the motor angle at the output, less its mean around the sample, rad.
    pub(super) counted: f64,
    /// The fast terms; zero of a sample that is not usable.
    pub(super) fast: FastTerms,
    /// Whether it was measured while the motor turned.
    pub(super) is_usable: bool,
    /// Motor angle since the sample before, rad.
    pub(super) turned: f64,
    /// The interval that begins with the sample, where products are means over it.
    pub(super) interval: Option<Interval>,
}

/// Terms that change fast with the motor angle, Nm but for the sines and cosines.
#[derive(Clone, Copy, Default)]
pub(super) struct FastTerms {
    /// `k s_j i_j` of each phase.
    pub(super) torque: [f64; 3],
    /// Of each phase that times cos, and times sin, of `θ_e + 2πj/3`: what a rotor off its axis changes.
    pub(super) eccentricity: [[f64; 3]; 2],
    /// cos and sin of `N_t θ_m`.
    pub(super) mesh: [f64; 2],
    /// cos and sin of `N_c θ_m`.
    pub(super) cogging: [f64; 2],
    /// `−Σ_j k (sin 5θ_j − sin 7θ_j) i_j`.
    pub(super) harmonics: f64,
    /// `k (s_A − s_C)` and `k (s_B − s_C)`, Nm/A.
    pub(super) offsets: [f64; 2],
}

impl FastTerms {
    fn zip(&mut self, other: &Self, f: impl Fn(&mut f64, f64)) {
        let Self {
            torque,
            eccentricity: [cos, sin],
            mesh,
            cogging,
            harmonics,
            offsets,
        } = self;
        let [other_cos, other_sin] = &other.eccentricity;
        let pairs = (torque.iter_mut().zip(&other.torque))
            .chain(cos.iter_mut().zip(other_cos))
            .chain(sin.iter_mut().zip(other_sin))
            .chain(mesh.iter_mut().zip(&other.mesh))
            .chain(cogging.iter_mut().zip(&other.cogging))
            .chain(core::iter::once((harmonics, &other.harmonics)))
            .chain(offsets.iter_mut().zip(&other.offsets));
        pairs.for_each(|(own, other)| f(own, *other));
    }
}

/// Reads the inner samples of a window, in ascending order.
pub(super) struct SampleReader<'a, S> {
    window: &'a MeasuredWindow<'a, S>,
    k: f64,
    /// What the controller takes for the torque of an ampere, Nm/A.
    torque_gain: f64,
    k_p: f64,
    /// Factor of the position gain.
    gain: f64,
    teeth: f64,
    cogging_periods: f64,
    /// Instants of each interval; 0 where the samples suffice.
    instants: usize,
    counting: Counting,
    /// The sample at which the last interval ended, and what the interval adds to its fast terms.
    ended: Option<(usize, FastTerms)>,
}

impl<'a, S: RecordedSample> SampleReader<'a, S> {
    /// Of a window whose position gain is that of the type times `gain`.
    pub(super) fn new(window: &'a MeasuredWindow<'a, S>, shape: &BalanceShape, gain: f64) -> Self {
        let params = window.params();
        Self {
            window,
            k: window.motor().k,
            torque_gain: params.motor.torque_gain(),
            k_p: params.controller.k_p,
            gain,
            teeth: shape.teeth,
            cogging_periods: shape.cogging_periods,
            instants: instants(params),
            counting: Counting::new(window),
            ended: None,
        }
    }

    /// The next inner sample.
    pub(super) fn next(&mut self, n: usize) -> SampleReading {
        let window = self.window;
        let now = window.quantities(n);
        let is_usable = libm::fabs(now.omega_m) >= MOVING && window.is_measured(n);
        let interval = (self.instants > 0).then(|| self.interval(n));
        let fast = match &interval {
            _ if !is_usable => FastTerms::default(),
            None => self.fast(&now.instant()),
            Some(interval) => {
                let mut around = match self.ended {
                    Some((at, rising)) if at == n => rising,
                    _ => self.fast_over(&self.interval(n - 1))[1],
                };
                let [falling, rising] = self.fast_over(interval);
                self.ended = Some((n + 1, rising));
                around.zip(&falling, |sum, falling| *sum += falling);
                around
            }
        };
        let turned = window.sensed(n).motor_counts - window.sensed(n - 1).motor_counts;
        SampleReading {
            now,
            counted: self.counting.deviation(window, n),
            fast,
            is_usable,
            turned: turned as f64 * window.params().sensors.motor_lsb(),
            interval,
        }
    }

    fn interval(&self, n: usize) -> Interval {
        Interval::new(self.window, n, |n, dq| self.jump(n, dq))
    }

    /// Step of the quadrature current behind a sample, A, where neither speed nor torque is at its limit.
    fn jump(&self, n: usize, [_, quadrature]: [f64; 2]) -> f64 {
        if self.window.is_current_limited(quadrature) {
            0.0
        } else {
            self.k_p * self.window.reference_change(n, self.gain) / self.torque_gain
        }
    }

    /// The fast terms of an instant.
    fn fast(&self, now: &Instant) -> FastTerms {
        let e = now.sin_cos_e;
        let double = sum(e, e);
        let fourth = sum(double, double);
        let (fifth, seventh) = (sum(fourth, e), sum(sum(fourth, double), e));
        let s = phase_shapes(e);
        let torque: [f64; 3] = core::array::from_fn(|j| self.k * s[j] * now.i[j]);
        let (mesh_sin, mesh_cos) = (self.teeth * now.angle_in_turn).sin_cos_poly();
        let (cogging_sin, cogging_cos) = (self.cogging_periods * now.angle_in_turn).sin_cos_poly();
        // 5 θ_j = 5 θ_e + 2πj/3 and 7 θ_j = 7 θ_e − 2πj/3, up to whole turns.
        let harmonics = |j: usize| ahead(fifth, j).0 - ahead(seventh, (3 - j) % 3).0;
        FastTerms {
            torque,
            eccentricity: [
                core::array::from_fn(|j| torque[j] * ahead(e, j).1),
                core::array::from_fn(|j| torque[j] * ahead(e, j).0),
            ],
            mesh: [mesh_cos, mesh_sin],
            cogging: [cogging_cos, cogging_sin],
            harmonics: -(0..3).map(|j| self.k * harmonics(j) * now.i[j]).sum::<f64>(),
            offsets: [self.k * (s[0] - s[2]), self.k * (s[1] - s[2])],
        }
    }

    /// Sums of the fast terms over an interval whose weights fall towards its end, and whose weights rise; each weight sums to ½.
    fn fast_over(&self, interval: &Interval) -> [FastTerms; 2] {
        let mut sums = [FastTerms::default(); 2];
        let instants = self.instants as f64;
        for m in 0..self.instants {
            let share = (m as f64 + 0.5) / instants;
            let terms = self.fast(&interval.at(share));
            let [falling, rising] = &mut sums;
            falling.zip(&terms, |sum, term| *sum += (1.0 - share) * term / instants);
            rising.zip(&terms, |sum, term| *sum += share * term / instants);
        }
        sums
    }
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

/// Sine and cosine of the sum of two angles.
pub(super) fn sum((sin_a, cos_a): (f64, f64), (sin_b, cos_b): (f64, f64)) -> (f64, f64) {
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

    #[test]
    fn angles_ahead_by_thirds_of_a_turn() {
        for j in 0..3 {
            let (sin, cos) = ahead(0.3f64.sin_cos_poly(), j);
            let angle = 0.3 + core::f64::consts::TAU * j as f64 / 3.0;
            assert!((sin - libm::sin(angle)).abs() < 1e-11 && (cos - libm::cos(angle)).abs() < 1e-11);
        }
    }
}
