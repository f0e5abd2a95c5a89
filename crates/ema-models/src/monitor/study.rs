//! Study of a better law of the mean currents (feature `study`, never shipped): a table of currents that all monitors add.
//!
//! [`Ripple`](super::Ripple) gives the mean currents as a function of the voltage's amplitude and the turns ratios. A table
//! made for one fault vector also depends on the voltage's direction, so it shows the best that a law could reach.

use std::sync::OnceLock;

use super::{Monitor, MonitorState, STEPS_PER_CONTROL, three_phase};
use crate::frames::{abc_from_alpha_beta, alpha_beta_from_abc, alpha_beta_from_dq, dq_from_abc, per_phase};
use crate::real::Real;
use crate::samples::{ComparedSample, InitialState};

/// Amplitudes of the voltage at which a table has currents, relative to V_dc/2; beyond the ends the nearest value holds.
pub const TABLE_VOLTAGES: [f64; 14] = [
    0.015, 0.045, 0.075, 0.105, 0.14, 0.18, 0.25, 0.35, 0.5, 0.65, 0.75, 0.85, 0.95, 1.05,
];

/// Harmonics of the voltage's direction in a table. Even harmonics vanish, because the opposite voltage reverses all currents.
pub const TABLE_HARMONICS: [i32; 7] = [-5, -3, -1, 1, 3, 5, 7];

/// Difference of the mean current in the stator frame (α + jβ) to the monitor's, A, under a voltage `v`:
/// `Σ c_h(|v|) (v/|v|)^h` over the harmonics. Each `c_h` (real and imaginary part) is linear between the amplitudes.
#[derive(Clone, Debug, PartialEq)]
pub struct CurrentTable(pub [[[f64; 2]; TABLE_VOLTAGES.len()]; TABLE_HARMONICS.len()]);

static TABLE: OnceLock<CurrentTable> = OnceLock::new();

/// Sets the table for all monitors of this process; false if a table is set already.
pub fn set_current_table(table: CurrentTable) -> bool {
    TABLE.set(table).is_ok()
}

/// Product of two complex numbers.
#[inline(always)]
fn product<R: Real>([a, b]: [R; 2], [c, d]: [R; 2]) -> [R; 2] {
    [a * c - b * d, a * d + b * c]
}

impl CurrentTable {
    #[inline(always)]
    fn current_under<R: Real>(&self, amplitude: R, direction: [R; 2]) -> [R; 2] {
        let mut sum = [R::zero(); 2];
        // Share of each interval that lies below the amplitude.
        let passed: [R; TABLE_VOLTAGES.len()] = core::array::from_fn(|n| match n {
            0 => R::splat(1.0),
            _ => {
                let (from, to) = (TABLE_VOLTAGES[n - 1], TABLE_VOLTAGES[n]);
                ((amplitude - R::splat(from)) * R::splat(1.0 / (to - from)))
                    .max(R::zero())
                    .min(R::splat(1.0))
            }
        });
        for (values, harmonic) in self.0.iter().zip(TABLE_HARMONICS) {
            let mut c = [R::zero(); 2];
            for part in 0..2 {
                let mut before = 0.0;
                for n in 0..TABLE_VOLTAGES.len() {
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

/// Mean direct and quadrature currents plus those of the table under a voltage, V; A.
#[inline(always)]
pub(super) fn with_table<R: Real>([d, q]: [R; 2], v: [R; 2], per_half_v_dc: R, sin_cos: (R, R)) -> [R; 2] {
    let Some(table) = TABLE.get() else {
        return [d, q];
    };
    let [x, y] = alpha_beta_from_dq(v, sin_cos);
    // The offset excludes zero, which has no direction.
    let length = (x * x + y * y + R::splat(1e-12)).sqrt();
    let current = table.current_under(length * per_half_v_dc, [x / length, y / length]);
    let [more_d, more_q] = dq_from_abc(abc_from_alpha_beta(current), sin_cos);
    [d + more_d, q + more_q]
}

impl Monitor<f64> {
    /// State at a motor angle, rad, and speed, rad/s, without current, for [`Monitor::control_period_along`].
    #[must_use]
    pub fn state_at(&self, (theta_m, omega_m): (f64, f64)) -> MonitorState<f64> {
        let initial = InitialState {
            theta_m,
            omega_m,
            ..InitialState::default()
        };
        self.start(&initial, &ComparedSample::default())
    }

    /// One control period along a prescribed motion with a current reference, A: the steady voltage (α, β) at its start, V, and
    /// the mean currents (α, β), A. `motion` has motor angle, rad, and speed, rad/s, at both ends and half-way.
    pub fn control_period_along(
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
        let v = self.steady_voltage(state, i_ref);
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
