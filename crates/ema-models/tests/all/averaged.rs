//! The averaged equations of the monitor agree numerically with the three-phase equations from which they are derived.

use core::f64::consts::TAU;
use ema_models::reference::{Phases, Reference, ReferenceState};
use ema_models::{
    ActuatorParams, FaultVector, PaperShape, Real, Setpoint, Winding, derived_shape, dq_from_abc, phase_shapes,
};

fn close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (got - expected).abs() <= tolerance,
        "{what}: {got}, expected {expected} ± {tolerance}"
    );
}

/// Fault vectors with unequal phases and eccentricity, each at angles over several electrical turns.
fn cases() -> impl Iterator<Item = (FaultVector, f64)> {
    [
        FaultVector::NOMINAL,
        FaultVector::from_array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5, 0.5]),
        FaultVector::from_array([0.0, 0.0, 0.1, 0.6, 0.0, 0.4, 0.2, 0.5]),
        FaultVector::from_array([0.0, 0.0, 0.3, 0.2, 0.8, 0.9, 0.9, 0.5]),
    ]
    .into_iter()
    .flat_map(|fault| (0..60).map(move |n| (fault, f64::from(n) * 0.21)))
}

#[test]
fn the_q_voltage_follows_from_the_three_phases() {
    // Given i_d = 0, i_q and di_q/dt at a moving rotor, each phase needs v_j = R_j i_j + L_j di_j/dt + k_j ω_m with
    // i_j = i_q s_j. The three-phase equations accept these voltages, and along the current they are
    // v_q = R(θ_e) i + L(θ_e) di/dt + ½ ω_e dL/dθ_e i + k φ ω_m.
    let m = ActuatorParams::bench().motor;
    let (i_q, slope, omega) = (6.0, 4000.0, 150.0);
    let omega_e = m.pole_pairs * omega;
    for (fault, theta_e) in cases() {
        let sin_cos = theta_e.sin_cos_poly();
        let winding = Winding::new(&fault);
        let phases = Phases::new(&m, winding.turns_ratio);
        let s = phase_shapes(sin_cos);
        // ds_j/dθ_e, by the definition of s_j.
        let turning: [f64; 3] = core::array::from_fn(|j| -(theta_e - TAU / 3.0 * j as f64).cos());
        let i = s.map(|s| i_q * s);
        let di: [f64; 3] = core::array::from_fn(|j| slope * s[j] + i_q * omega_e * turning[j]);
        let emf = winding.emf_shapes(sin_cos).map(|shape| m.k * shape * omega);
        let v: [f64; 3] = core::array::from_fn(|j| phases.r[j] * i[j] + phases.l[j] * di[j] + emf[j]);
        // A potential common to all three phases has no effect on the currents.
        let accepted = phases.derivative(v.map(|v| v + 37.0), emf, i);
        for j in 0..3 {
            close(accepted[j], di[j], 1e-4, "di_j/dt of the three-phase equations");
        }
        let shape = derived_shape(&winding, sin_cos);
        let v_q = m.r_s * shape.resistance * i_q
            + m.l_s * shape.inductance * slope
            + 0.5 * omega_e * m.l_s * shape.inductance_slope * i_q
            + m.k * shape.emf * omega;
        close(dq_from_abc(v, sin_cos)[1], v_q, 1e-6, "v_q");
        // Torque over the same shape: power k φ ω i · 3/2.
        let torque: f64 = (0..3).map(|j| emf[j] / omega * i[j]).sum();
        close(torque, 1.5 * m.k * shape.emf * i_q, 1e-9, "torque");
    }
}

#[test]
fn eq_11_with_one_half_is_exact_for_intact_turns() {
    for n in 0..200 {
        let theta_e = f64::from(n) * 0.1;
        let fault = FaultVector::from_array([0.0, 0.0, 0.0, 0.0, 0.0, 0.7, 0.8, 0.5]);
        let winding = Winding::new(&fault);
        let sin_cos = theta_e.sin_cos_poly();
        let expected = 1.0 - 0.35 * (theta_e + fault.eccentricity_angle()).cos();
        close(derived_shape(&winding, sin_cos).emf, expected, 1e-10, "derived");
        close(
            PaperShape { k_fs: 3.0, k_e: 0.5 }.shape(&winding, sin_cos),
            expected,
            1e-10,
            "paper",
        );
    }
}

#[test]
fn the_paper_s_short_shape_approaches_the_derived_one_for_large_k_fs() {
    // φ_SC = Σ N_j (1 + k_FS s_j²) / (3 + 1.5 k_FS) → 2/3 Σ N_j s_j²; the difference falls with 1/k_FS.
    let fault = FaultVector::from_array([0.0, 0.0, 0.6, 0.1, 0.0, 0.0, 0.5, 0.5]);
    let winding = Winding::new(&fault);
    let worst = |k_fs: f64| {
        (0..100).fold(0.0f64, |worst, n| {
            let sin_cos = (f64::from(n) * 0.063).sin_cos_poly();
            let difference =
                PaperShape { k_fs, k_e: 0.5 }.shape(&winding, sin_cos) - derived_shape(&winding, sin_cos).emf;
            worst.max(difference.abs())
        })
    };
    assert!(worst(100.0) < 7e-3, "{}", worst(100.0));
    close(worst(100.0) / worst(1000.0), 10.0, 0.2, "fall with k_FS");
}

#[test]
fn the_inductance_term_reaches_59_volts() {
    // k3 = 0.5, 180 rad/s, 10.7 A: ½ ω_e L · 4/3 (1 − ¼) · ½ |sin 2θ_e| i at most.
    let m = ActuatorParams::bench().motor;
    let winding = Winding::new(&FaultVector::from_array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5, 0.5]));
    let largest = (0..6283)
        .map(|n| {
            derived_shape(&winding, (f64::from(n) * 1e-3).sin_cos_poly())
                .inductance_slope
                .abs()
        })
        .fold(0.0, f64::max);
    let volts = 0.5 * m.pole_pairs * 180.0 * m.l_s * largest * m.i_max;
    close(volts, 0.25 * 720.0 * 30.5e-3 * 10.7, 1e-3, "third term");
    close(volts, 59.0, 0.5, "third term");
}

#[test]
fn the_inverter_has_v_dc_over_three_times_the_sum_of_shapes_along_the_current() {
    // Largest 2/3 Σ v_j s_j over the eight switching states; between V_dc/√3 = 219 V and 2/3 V_dc = 253 V.
    let v_dc = 380.0;
    let (mut low, mut high) = (f64::MAX, f64::MIN);
    for n in 0..6283 {
        let sin_cos = (f64::from(n) * 1e-3).sin_cos_poly();
        let s = phase_shapes(sin_cos);
        let largest = (0..8)
            .map(|state| {
                let v = core::array::from_fn(|j| if state >> j & 1 == 1 { 0.5 * v_dc } else { -0.5 * v_dc });
                dq_from_abc(v, sin_cos)[1]
            })
            .fold(f64::MIN, f64::max);
        close(
            largest,
            v_dc / 3.0 * s.iter().map(|s| s.abs()).sum::<f64>(),
            1e-9,
            "limit",
        );
        low = low.min(largest);
        high = high.max(largest);
    }
    close(low, v_dc / 3f64.sqrt(), 0.01, "least");
    close(high, 2.0 / 3.0 * v_dc, 0.01, "most");
}

#[test]
fn the_switched_reference_keeps_the_averaged_voltage_equation() {
    // Mean v_q and v_d of the switched phases over whole electrical turns in a steady state with a shorted phase
    // and eccentricity, against the averaged equations with the mean currents: the switching averages out.
    let params = ActuatorParams::bench();
    let m = &params.motor;
    for fault in [
        FaultVector::NOMINAL,
        FaultVector::from_array([0.0, 0.0, 0.5, 0.0, 0.0, 0.3, 0.7, 0.5]),
    ] {
        let winding = Winding::new(&fault);
        let reference = Reference::new(&params, &params, &fault, 150.0);
        let mut state = ReferenceState::at_rest(0.0, 0.0);
        for _ in 0..400_000 {
            reference.step(&mut state, Setpoint::Speed(90.0));
        }
        let begin = m.pole_pairs * state.theta_m;
        let (mut measured, mut expected, mut n) = (0.0, 0.0, 0.0);
        while m.pole_pairs * state.theta_m < begin + 8.0 * TAU {
            let before = state;
            reference.step(&mut state, Setpoint::Speed(90.0));
            let sin_cos = (m.pole_pairs * before.theta_m).sin_cos_poly();
            let [_, i_q] = dq_from_abc(before.i, sin_cos);
            let shape = derived_shape(&winding, sin_cos);
            let omega = before.omega_m;
            let after = dq_from_abc(state.i, (m.pole_pairs * state.theta_m).sin_cos_poly());
            let slope = (after[1] - i_q) / 1e-6;
            measured += dq_from_abc(state.v, sin_cos)[1];
            expected += m.r_s * shape.resistance * i_q
                + m.l_s * shape.inductance * slope
                + 0.5 * m.pole_pairs * omega * m.l_s * shape.inductance_slope * i_q
                + m.k * shape.emf * omega;
            n += 1.0;
        }
        println!("v_q {} V, by the averaged equation {} V", measured / n, expected / n);
        close(measured / n, expected / n, 0.05, "mean v_q");
    }
}
