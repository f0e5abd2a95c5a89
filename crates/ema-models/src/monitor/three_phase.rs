//! Current loop of the three-phase monitor, averaged over the switching: three unequal phases in star connection.
//!
//! The hysteresis comparators hold each phase at its reference while the inverter's voltage suffices. Otherwise the phases
//! that need the highest and the lowest voltage are at opposite rails, and the third is held at its reference if its voltage
//! suffices (derived here: the sliding modes of three comparators on a star whose deviations sum to zero).

use super::Derived;
use crate::frames::per_phase;
use crate::real::Real;

/// Phase currents one step later, A.
///
/// `target` are the references at the end of the step (zero sum), A; `i` the currents at its start, A; `emf` the back-EMFs at
/// mid-step, V. By the trapezoidal rule for the resistance, a phase reaches its reference at the voltage to the star point
/// `a_j = (L_j/dt + R_j/2) target_j − (L_j/dt − R_j/2) i_j + e_j`.
///
/// The phase voltages are `a_j + n`, limited to the rails; n is the potential of the star point for which the currents sum to
/// zero. If the voltage suffices, any n between the rails is a solution, and every reference is reached. Otherwise the phases
/// with the highest and the lowest a_j are at the rails. With the middle phase unlimited, n is the mean of the differences of
/// these two to their rails, weighted by their conductances; then the middle phase is limited, and n is corrected for it. The
/// same formula holds in both cases, because the mean lies between the rails if the voltage suffices.
#[inline(always)]
pub(super) fn step<R: Real>(m: &Derived<R>, i: [R; 3], target: [R; 3], emf: [R; 3]) -> [R; 3] {
    let needed = per_phase!(|j| (m.ohms[j] * target[j] - m.ohms_before[j] * i[j]) + emf[j]);
    let [a, b, c] = needed;
    let highest = a.max(b).max(c);
    let lowest = a.min(b).min(c);
    let zero = R::zero();
    // With ample voltage, n lies between the rails by far more than rounding, and the general formula adds zero. Two equal
    // extremes are excluded, because n is then at a rail.
    let ample = (highest - lowest).le(R::splat(0.9) * m.v_dc);
    if R::known_true(ample & (a.lt(b) | b.lt(a))) {
        return per_phase!(|j| target[j] + zero);
    }

    // Range of n in which each phase is within the rails.
    let up = per_phase!(|j| m.half_v_dc - needed[j]);
    let down = per_phase!(|j| up[j] - m.v_dc);
    let spare = per_phase!(|j| R::select(highest.le(needed[j]), up[j], down[j]) * m.siemens[j]);
    // The middle phase; of phases with equal a_j, the last.
    let a_extreme = highest.le(a) | a.le(lowest);
    let b_extreme = highest.le(b) | b.le(lowest);
    let sum = R::select(a_extreme, spare[0], zero)
        + R::select(b_extreme, spare[1], zero)
        + R::select(a_extreme & b_extreme, zero, spare[2]);
    let [without_a, without_b, without_c] = m.star_ohms_without;
    let star = sum * R::select(a_extreme, R::select(b_extreme, without_c, without_b), without_a);

    let lacking = per_phase!(|j| star.min(up[j]).max(down[j]) - star);
    let correction = (lacking[0] * m.siemens[0] + lacking[1] * m.siemens[1] + lacking[2] * m.siemens[2]) * m.star_ohms;
    per_phase!(|j| target[j] + (lacking[j] - correction) * m.siemens[j])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Lanes64;
    use crate::monitor::Monitor;
    use crate::params::ActuatorParams;
    use crate::unknowns::{MotorDeviation, Unknowns};
    use crate::{Calibration, FaultVector};

    /// A second lane without ample voltage excludes the shortcut for both lanes.
    #[test]
    fn the_shortcut_of_ample_voltage_gives_the_same_bits() {
        let params = ActuatorParams::bench();
        let levels = [0.0, -0.0, 1e-9, 0.4, -3.0, 10.7];
        for fault in [[0.0; 3], [0.3, 0.0, 0.6], [0.99, 0.5, 0.0]] {
            let [a, b, c] = fault;
            let unknowns = Unknowns {
                fault: FaultVector::from_array([0.0, 0.0, a, b, c, 0.0, 0.5, 0.5]),
                load_torque: 0.0,
                integral: 0.0,
                motor: MotorDeviation::default(),
            };
            let monitor = Monitor::new(&params, &Calibration::default(), params.motor.v_dc, &unknowns);
            let lanes = monitor.map(|x| Lanes64([x; 2]));
            for n in 0..levels.len().pow(4) {
                let level = |place: u32| levels[n / levels.len().pow(place) % levels.len()];
                let i = [level(0), level(1), -level(0) - level(1)];
                let target = [i[0] + 0.01 * level(2), i[1] + 0.01 * level(3), i[2]];
                let emf = [10.0 * level(2), 10.0 * level(3), 10.0 * level(0)];
                let short = step(&monitor.derived, i, target, emf);
                let wide = |x: [f64; 3]| x.map(|x| Lanes64([x; 2]));
                let mut beside = wide(emf);
                beside[0].0[1] = 10.0 * params.motor.v_dc;
                let long = step(&lanes.derived, wide(i), wide(target), beside);
                for j in 0..3 {
                    assert_eq!(
                        short[j].to_bits(),
                        long[j].0[0].to_bits(),
                        "{fault:?} {i:?} {target:?} {emf:?}"
                    );
                }
            }
        }
    }
}
