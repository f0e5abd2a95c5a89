//! Three-phase star-connected motor with unequal phases: \[P\] eqs. 6–8.

use crate::params::MotorParams;

/// Phase resistances and inductances of one motor.
#[derive(Clone, Copy, Debug)]
pub struct Phases {
    /// R_j = N_j R, Ω.
    pub r: [f64; 3],
    /// L_j = N_j² L, H.
    pub l: [f64; 3],
}

impl Phases {
    /// The phases of a motor with these winding turns ratios.
    #[must_use]
    pub fn new(motor: &MotorParams, turns_ratio: [f64; 3]) -> Self {
        Self {
            r: turns_ratio.map(|n| n * motor.r_s),
            l: turns_ratio.map(|n| n * n * motor.l_s),
        }
    }

    /// `di_j/dt = (v_j − v_n − e_j − R_j i_j) / L_j` (\[P\] eq. 7), A/s.
    ///
    /// The potential v_n of the star point follows from `Σ di_j/dt = 0` (\[P\] eq. 6) with the unequal inductances. `v` are
    /// phase voltages, `emf` back-EMFs `k_j ω_m`, V.
    #[must_use]
    pub fn derivative(&self, v: [f64; 3], emf: [f64; 3], i: [f64; 3]) -> [f64; 3] {
        let driving: [f64; 3] = core::array::from_fn(|j| v[j] - emf[j] - self.r[j] * i[j]);
        let (mut weighted, mut weights) = (0.0, 0.0);
        for j in 0..3 {
            weighted += driving[j] / self.l[j];
            weights += 1.0 / self.l[j];
        }
        let v_n = weighted / weights;
        core::array::from_fn(|j| (driving[j] - v_n) / self.l[j])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::ActuatorParams;

    #[test]
    fn currents_stay_balanced_and_decay_with_l_over_r() {
        // No voltage, no speed: i = i0 exp(−t R/L); explicit Euler at 1 µs over one time constant.
        let motor = ActuatorParams::bench().motor;
        let phases = Phases::new(&motor, [1.0; 3]);
        let mut errors = [0.0; 2];
        for (slot, dt) in errors.iter_mut().zip([2e-6, 1e-6]) {
            let mut i = [5.0, -2.0, -3.0];
            let tau = motor.l_s / motor.r_s;
            let steps = (tau / dt) as usize;
            for _ in 0..steps {
                let di = phases.derivative([0.0; 3], [0.0; 3], i);
                for j in 0..3 {
                    i[j] += di[j] * dt;
                }
            }
            assert!(i.iter().sum::<f64>().abs() < 1e-12);
            let exact = 5.0 * (-(steps as f64) * dt / tau).exp();
            *slot = (i[0] - exact).abs();
        }
        assert!(errors[1] < 1e-4, "{errors:?}");
        // First order: halving the step halves the error.
        assert!((errors[0] / errors[1] - 2.0).abs() < 0.05, "{errors:?}");
    }
}
