//! The vector drive: voltages, current control, limits.

use core::f64::consts::{FRAC_PI_3, FRAC_PI_6, PI, TAU};

use super::rig::{Rig, close, flywheel, locked, phasor};
use ema_models::{Real, Setpoint, abc_from_alpha_beta, alpha_beta_from_abc, alpha_beta_from_dq, dq_from_abc};

/// PWM period at 20 kHz, µs.
const PERIOD: usize = 50;

/// Mean phase voltages of each PWM period without their common part, and the currents at its beginning.
fn periods(rig: &mut Rig, setpoint: Setpoint, count: usize) -> Vec<([f64; 3], [f64; 3])> {
    (0..count)
        .map(|_| {
            let start = rig.state.shaft.i;
            let mut v = [0.0; 3];
            rig.run(PERIOD as f64 * 1e-6, setpoint, |_, after| {
                for j in 0..3 {
                    v[j] += after.shaft.v[j] / PERIOD as f64;
                }
            });
            let common = v.iter().sum::<f64>() / 3.0;
            (v.map(|v| v - common), start)
        })
        .collect()
}

/// The PI control of the specification, computed from the currents at the beginning of each period, applied one period later.
#[test]
fn voltages_follow_the_pi_law_one_period_late_less_the_dead_time_along_the_currents() {
    let params = locked();
    let (r, l, v_dc) = (params.motor.r_s, params.motor.l_s, params.motor.v_dc);
    for (dead_time, compensation) in [(0.0, 0.0), (2e-6, 0.0), (2e-6, 0.8)] {
        let values = [
            ("current_bandwidth_hz", 100.0),
            ("dead_time_s", dead_time),
            ("dead_time_compensation", compensation),
        ];
        let mut rig = Rig::new(&params, &values);
        let sin_cos = (4.0 * 0.3f64).sin_cos_poly();
        let omega_c = TAU * 100.0;
        let setpoint = rig.for_current(6.0, 0.0);
        let (mut integral, mut next) = ([0.0; 2], [0.0; 3]);
        let mut compared = 0;
        for (n, (v, i)) in periods(&mut rig, setpoint, 300).into_iter().enumerate() {
            let dead = v_dc * dead_time * 20e3 * (1.0 - compensation);
            let moved = i.map(|i| if i > 0.0 { -dead } else { dead });
            let common = moved.iter().sum::<f64>() / 3.0;
            // Near zero the ripple changes the currents' signs within a period.
            if n > 1 && i.iter().all(|i| i.abs() > 0.4) {
                for j in 0..3 {
                    close(v[j], next[j] + moved[j] - common, 0.02, "mean phase voltage");
                }
                compared += 1;
            }
            let [d, q] = dq_from_abc(i, sin_cos);
            let errors = [-d, 6.0 - q];
            let wanted: [f64; 2] = core::array::from_fn(|a| omega_c * l * errors[a] + integral[a]);
            for a in 0..2 {
                integral[a] += omega_c * r * 50e-6 * errors[a];
            }
            next = abc_from_alpha_beta(alpha_beta_from_dq(wanted, sin_cos));
        }
        assert!(compared > 200, "{compared}");
    }
}

#[test]
fn pulses_lie_in_the_middle_of_their_period() {
    let mut rig = Rig::new(&locked(), &[("pwm_frequency_hz", 20e3)]);
    let setpoint = rig.for_current(5.0, 0.0);
    rig.settle(200.0 * PERIOD as f64 * 1e-6, setpoint);
    let mut voltages = Vec::new();
    rig.run(PERIOD as f64 * 1e-6, setpoint, |_, after| voltages.push(after.shaft.v));
    for j in 0..3 {
        close(voltages[0][j], -190.0, 1e-9, "voltage at the beginning, V");
        close(voltages[PERIOD / 2][j], 190.0, 1e-9, "voltage in the middle, V");
        for n in 0..PERIOD {
            close(
                voltages[n][j],
                voltages[PERIOD - 1 - n][j],
                1e-3,
                "voltage mirrored in time, V",
            );
        }
    }
}

#[test]
fn voltages_are_decoupled_and_turned_to_the_middle_of_their_period() {
    // v_d = PI − ω_e L i_q, v_q = PI + ω_e L i_d + k ω, applied at the angle of the middle of the next period, θ_e + 1.5 T_p ω_e.
    let (params, omega) = (flywheel(), 100.0);
    let m = params.motor;
    let mut rig = Rig::new(&params, &[("current_bandwidth_hz", 200.0)]);
    rig.state.shaft.omega_m = omega;
    let setpoint = rig.for_current(2.0, omega);
    let omega_c = TAU * 200.0;
    let (mut integral, mut next) = ([0.0; 2], [0.0; 3]);
    for n in 0..300 {
        let theta_e = m.pole_pairs * rig.state.shaft.theta_m;
        let (v, i) = periods(&mut rig, setpoint, 1)[0];
        for j in 0..3 {
            if n > 1 {
                close(v[j], next[j], 0.05, "mean phase voltage");
            }
        }
        let [d, q] = dq_from_abc(i, theta_e.sin_cos_poly());
        let errors = [-d, 2.0 - q];
        let omega_e = m.pole_pairs * omega;
        let decoupling = [-omega_e * m.l_s * q, omega_e * m.l_s * d + m.k * omega];
        let wanted: [f64; 2] = core::array::from_fn(|a| omega_c * m.l_s * errors[a] + integral[a] + decoupling[a]);
        for a in 0..2 {
            integral[a] += omega_c * m.r_s * 50e-6 * errors[a];
        }
        let middle = theta_e + 1.5 * 50e-6 * omega_e;
        next = abc_from_alpha_beta(alpha_beta_from_dq(wanted, middle.sin_cos_poly()));
    }
}

#[test]
fn the_current_loop_has_its_bandwidth_and_phase_margin() {
    // With the pole of the winding cancelled, the open loop is (ω_c/jω) e^(−1.5 jω T_p): gain 1 at the bandwidth, with a phase
    // margin of 90° − 1.5 ω_c T_p.
    for (bandwidth, pwm) in [(400.0, 20e3), (800.0, 20e3), (800.0, 10e3)] {
        let params = locked();
        let mut rig = Rig::new(
            &params,
            &[("current_bandwidth_hz", bandwidth), ("pwm_frequency_hz", pwm)],
        );
        let period = (1e6 / pwm).round() as usize;
        let (mut errors, mut currents) = (Vec::new(), Vec::new());
        let controls = 1000;
        for n in 0..controls + 200 {
            let i_ref = 5.0 + (TAU * bandwidth * 100e-6 * f64::from(n)).sin();
            let setpoint = rig.for_current(i_ref, 0.0);
            for _ in 0..100 / period {
                let i_q = rig.dq(&rig.state)[1];
                if n >= 200 {
                    currents.push(i_q);
                    errors.push(i_ref - i_q);
                }
                rig.settle(period as f64 * 1e-6, setpoint);
            }
        }
        let cycles = bandwidth * f64::from(controls) * 100e-6;
        let [[er, ei], [ir, ii]] = [&errors, &currents].map(|series| phasor(series, cycles));
        // x = re cos + im sin is the real part of (re − j im) e^(jωt).
        let gain = ir.hypot(ii) / er.hypot(ei);
        let phase = ((-ii).atan2(ir) - (-ei).atan2(er)).rem_euclid(TAU) - TAU;
        let margin = (PI + phase).to_degrees();
        let expected = 90.0 - (1.5 * TAU * bandwidth / pwm).to_degrees();
        println!("{bandwidth} Hz at {pwm} Hz: gain {gain}, margin {margin}°, expected {expected}°");
        close(gain, 1.0, 0.02, "gain at the bandwidth");
        close(margin, expected, 1.5, "phase margin, degrees");
    }
}

#[test]
fn the_voltage_is_limited_to_the_hexagon_along_its_direction_without_windup() {
    // In the direction of an angle φ from the middle of a side, the hexagon reaches (V_dc/√3)/cos φ.
    for theta_m in [0.0, 0.05, 0.1, 0.2, 0.3] {
        let params = locked();
        let mut rig = Rig::with_fault(
            &params,
            &ema_models::FaultVector::NOMINAL,
            theta_m,
            &[("current_bandwidth_hz", 800.0)],
        );
        let setpoint = rig.for_current(10.0, 0.0);
        let voltages = periods(&mut rig, setpoint, 3);
        let [alpha, beta] = alpha_beta_from_abc(voltages[2].0);
        let angle = beta.atan2(alpha);
        let along_q = 4.0 * theta_m + 3.0 * FRAC_PI_6;
        close((angle - along_q + PI).rem_euclid(TAU) - PI, 0.0, 1e-3, "direction");
        let phi = angle.rem_euclid(FRAC_PI_3) - FRAC_PI_6;
        close(alpha.hypot(beta), 380.0 / 3f64.sqrt() / phi.cos(), 0.1, "length");
        let mut largest = 0.0f64;
        for _ in 0..200 {
            rig.settle(50e-6, setpoint);
            largest = largest.max(rig.dq(&rig.state)[1]);
        }
        let left = rig.dq(&rig.state)[1] - 10.0;
        println!("{theta_m}: largest {largest}, left {left}");
        assert!(largest < 11.5 && left.abs() < 0.1, "{largest} A, {left} A");
    }
}

#[test]
fn decoupling_keeps_i_d_from_following_i_q() {
    // Without decoupling, L di_d/dt + R i_d = v_d + ω_e L i_q and the PI control give, after a step of i_q,
    // i_d = (ω_e/ω_c) Δi e^(−Rt/L) once the loop of i_q has settled.
    let (omega, step) = (100.0, 4.0);
    let run = |decoupling: f64| {
        let mut rig = Rig::new(
            &flywheel(),
            &[("current_bandwidth_hz", 400.0), ("decoupling", decoupling)],
        );
        rig.state.shaft.omega_m = omega;
        let setpoint = rig.for_current(0.0, omega);
        rig.settle(0.05, setpoint);
        let setpoint = rig.for_current(step, omega);
        rig.settle(3.5e-3, setpoint);
        rig.dq(&rig.state)[0]
    };
    let m = flywheel().motor;
    let expected = 4.0 * omega / (TAU * 400.0) * step * (-m.r_s * 3.5e-3 / m.l_s).exp();
    let (without, with) = (run(0.0), run(1.0));
    println!("i_d {without} and {with} A, expected {expected} A");
    close(without, expected, 0.1 * expected, "i_d without decoupling");
    assert!(with.abs() < 0.15 * expected, "{with}");
}

#[test]
fn field_weakening_holds_the_voltage_at_its_limit() {
    // (R i_d − ω_e L i_q)² + (R i_q + ω_e L i_d + k ω)² = (0.95 V_dc/√3)².
    let (omega, i_q) = (200.0, 4.0);
    let m = flywheel().motor;
    let omega_e = m.pole_pairs * omega;
    let voltage =
        |i_d: f64| (m.r_s * i_d - omega_e * m.l_s * i_q).hypot(m.r_s * i_q + omega_e * m.l_s * i_d + m.k * omega);
    let (mut low, mut high) = (-5.0, 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if voltage(middle) > 0.95 * m.v_dc / 3f64.sqrt() {
            high = middle;
        } else {
            low = middle;
        }
    }
    let mut rig = Rig::new(&flywheel(), &[("field_weakening_a", 5.0)]);
    rig.state.shaft.omega_m = omega;
    let setpoint = rig.for_current(i_q, omega);
    rig.settle(0.3, setpoint);
    let (mut sums, mut n) = ([0.0; 2], 0.0);
    for _ in 0..1000 {
        rig.settle(50e-6, setpoint);
        let dq = rig.dq(&rig.state);
        sums = [sums[0] + dq[0], sums[1] + dq[1]];
        n += 1.0;
    }
    println!("i_d {}, i_q {}, expected {low}", sums[0] / n, sums[1] / n);
    close(sums[0] / n, low, 0.05, "i_d");
    close(sums[1] / n, i_q, 0.02, "i_q");

    // At the current limit, the direct current takes its share of I_max.
    let setpoint = rig.for_current(m.i_max, 150.0);
    rig.state.shaft.omega_m = 150.0;
    rig.settle(0.2, setpoint);
    let [i_d, i_q] = rig.dq(&rig.state);
    println!("i_d {i_d}, i_q {i_q} at the limit");
    close(i_d.hypot(i_q), m.i_max, 0.02 * m.i_max, "current at the limit");
    assert!(i_d < -2.0, "{i_d}");
}
