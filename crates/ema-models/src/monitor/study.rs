//! What a better law of the mean currents would bring: for studies (feature `study`), never shipped.
//!
//! [`Ripple`](super::Ripple) knows the mean currents by the amplitude of the voltage and the turns. A table made for one fault
//! vector also knows them by the voltage's direction, which is more than a law for all vectors does.

use std::sync::OnceLock;

use super::{Monitor, MonitorState, STEPS_PER_CONTROL, three_phase};
use crate::frames::{abc_from_alpha_beta, alpha_beta_from_abc, alpha_beta_from_dq, dq_from_abc, per_phase};
use crate::real::Real;
use crate::samples::{ComparedSample, InitialState};

/// Amplitudes of the voltage at which a table has currents, in shares of half the DC link's; beyond the ends the nearest counts.
pub const TABLE_PLACES: [f64; 14] = [
    0.015, 0.045, 0.075, 0.105, 0.14, 0.18, 0.25, 0.35, 0.5, 0.65, 0.75, 0.85, 0.95, 1.05,
];

/// Harmonics of the voltage's direction that a table has. Even ones cannot be: with the opposite voltage all currents change sign.
pub const TABLE_HARMONICS: [i32; 7] = [-5, -3, -1, 1, 3, 5, 7];

/// What the mean current in the stator frame (α + jβ) is beyond the monitor's own, A, under a voltage `v` of amplitude and
/// direction: `Σ c_h(|v|) (v/|v|)^h` over the harmonics, each `c_h` (real and imaginary part) linear between the places.
#[derive(Clone, Debug, PartialEq)]
pub struct CurrentTable(pub [[[f64; 2]; TABLE_PLACES.len()]; TABLE_HARMONICS.len()]);

static TABLE: OnceLock<CurrentTable> = OnceLock::new();

/// All monitors of this process add the currents of this table from now on; false if they have one already.
pub fn teach(table: CurrentTable) -> bool {
    TABLE.set(table).is_ok()
}

/// Product of two complex numbers.
#[inline(always)]
fn product<R: Real>([a, b]: [R; 2], [c, d]: [R; 2]) -> [R; 2] {
    [a * c - b * d, a * d + b * c]
}

impl CurrentTable {
    #[inline(always)]
    fn at<R: Real>(&self, amplitude: R, direction: [R; 2]) -> [R; 2] {
        let mut sum = [R::zero(); 2];
        // Share of each interval that the amplitude has passed.
        let passed: [R; TABLE_PLACES.len()] = core::array::from_fn(|n| match n {
            0 => R::splat(1.0),
            _ => {
                let (from, to) = (TABLE_PLACES[n - 1], TABLE_PLACES[n]);
                ((amplitude - R::splat(from)) * R::splat(1.0 / (to - from)))
                    .max(R::zero())
                    .min(R::splat(1.0))
            }
        });
        for (values, harmonic) in self.0.iter().zip(TABLE_HARMONICS) {
            let mut c = [R::zero(); 2];
            for part in 0..2 {
                let mut before = 0.0;
                for n in 0..TABLE_PLACES.len() {
                    c[part] = c[part] + passed[n] * R::splat(values[n][part] - before);
                    before = values[n][part];
                }
            }
            let [x, y] = direction;
            let turned = [x, if harmonic < 0 { -y } else { y }];
            for _ in 0..harmonic.unsigned_abs() {
                c = product(c, turned);
            }
            sum = [sum[0] + c[0], sum[1] + c[1]];
        }
        sum
    }
}

/// Mean direct and quadrature currents, A, with those of the table under a voltage, V.
#[inline(always)]
pub(super) fn with_table<R: Real>([d, q]: [R; 2], v: [R; 2], per_half_v_dc: R, sin_cos: (R, R)) -> [R; 2] {
    let Some(table) = TABLE.get() else {
        return [d, q];
    };
    let [x, y] = alpha_beta_from_dq(v, sin_cos);
    // Never zero, which has no direction.
    let length = (x * x + y * y + R::splat(1e-12)).sqrt();
    let current = table.at(length * per_half_v_dc, [x / length, y / length]);
    let [more_d, more_q] = dq_from_abc(abc_from_alpha_beta(current), sin_cos);
    [d + more_d, q + more_q]
}

impl Monitor<f64> {
    /// State at a motor angle, rad, and speed, rad/s, without current, for [`Monitor::period_along`].
    #[must_use]
    pub fn at(&self, (theta_m, omega_m): (f64, f64)) -> MonitorState<f64> {
        let initial = InitialState {
            theta_m,
            omega_m,
            ..InitialState::default()
        };
        self.start(&initial, &ComparedSample::default())
    }

    /// One control period along a given motion, with a reference of the current, A: the voltage (α, β) that carries it at the
    /// start, V, and the mean currents (α, β), A. The motion is motor angle, rad, and speed, rad/s, at both ends and half-way.
    pub fn period_along(
        &self,
        state: &mut MonitorState<f64>,
        i_ref: f64,
        motion: [(f64, f64); STEPS_PER_CONTROL as usize + 1],
    ) -> ([f64; 2], [f64; 2]) {
        let m = &self.derived;
        let turned = |(theta_m, _): (f64, f64)| (m.pole_pairs * theta_m).sin_cos_poly();
        state.sin_cos = turned(motion[0]);
        state.emf_shapes = self.winding.emf_shapes(state.sin_cos);
        state.omega_m = motion[0].1;
        let v = self.carrying_voltage(state, i_ref);
        state.i_ref = self.mean_currents(i_ref, v);
        let voltage = alpha_beta_from_dq(v, state.sin_cos);
        let mut mean = [0.0; 3];
        for (&from, &to) in motion.iter().zip(&motion[1..]) {
            let sin_cos = turned(to);
            let shapes = self.winding.emf_shapes(sin_cos);
            let volts = m.half_back_emf * 0.5 * (from.1 + to.1);
            let emf = per_phase!(|j| (state.emf_shapes[j] + shapes[j]) * volts);
            let target = abc_from_alpha_beta(alpha_beta_from_dq(state.i_ref, sin_cos));
            let before = state.i;
            state.i = three_phase::step(m, before, target, emf);
            state.emf_shapes = shapes;
            mean = per_phase!(|j| mean[j] + 0.5 * (before[j] + state.i[j]) / f64::from(STEPS_PER_CONTROL));
        }
        (voltage, alpha_beta_from_abc(mean))
    }
}
