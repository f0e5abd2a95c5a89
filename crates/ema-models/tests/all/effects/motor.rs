//! Back-EMF harmonics, saturation, shorted turns, link.

use core::f64::consts::TAU;

use super::rig::{Rig, close, flywheel, locked, phasor};
use ema_models::{ActuatorParams, FaultVector, Setpoint};

#[test]
fn emf_harmonics_give_a_torque_six_times_per_electrical_turn() {
    // Σ_j sin hθ_j sin θ_j is −3/2 cos 6θ_e for h = 5 and +3/2 cos 6θ_e for h = 7: with currents I s_j,
    // T = 1.5 k I (1 + (h₇ − h₅) cos 6θ_e).
    let omega = TAU * 5.0; // 50 ms for an electrical turn
    let mut rig = Rig::new(&flywheel(), &[("emf_5", 0.05), ("emf_7", 0.02)]);
    rig.state.shaft.theta_m = 0.0;
    rig.state.shaft.omega_m = omega;
    let setpoint = rig.for_current(5.0, omega);
    rig.settle(0.2, setpoint);
    let mut torques = Vec::new();
    rig.run(0.4, setpoint, |_, s| torques.push(s.shaft.torque));
    let [along, across] = phasor(&torques, 8.0 * 6.0);
    let mean = torques.iter().sum::<f64>() / torques.len() as f64;
    println!("mean {mean}, 6th {along} and {across} Nm");
    close(mean, 1.35 * 5.0, 0.01, "mean torque, Nm");
    close(along, -0.03 * 1.35 * 5.0, 0.01, "torque along cos 6θ_e, Nm");
    close(across, 0.0, 0.01, "torque along sin 6θ_e, Nm");
}

#[test]
fn saturation_bends_the_flux_linkage() {
    // L(i) = L (1 − s i²/I²) is the slope of ψ = L (i − s i³/3I²): between two phases ψ_a − ψ_b changes by
    // ∫ v_a − v_b − R (i_a − i_b) dt.
    let params = locked();
    let m = params.motor;
    let mut rig = Rig::new(&params, &[("saturation", 0.2)]);
    let psi = |i: f64| m.l_s * (i - 0.2 * i.powi(3) / (3.0 * m.i_max * m.i_max));
    for amps in [10.0, -6.0, 3.0] {
        let setpoint = rig.for_current(amps, 0.0);
        let begin = rig.state.shaft.i;
        let mut volt_seconds = [0.0; 3];
        rig.run(4e-3, setpoint, |before, after| {
            for j in 0..3 {
                let mean = 0.5 * (before.shaft.i[j] + after.shaft.i[j]);
                volt_seconds[j] += (after.shaft.v[j] - m.r_s * mean) * 1e-6;
            }
        });
        let end = rig.state.shaft.i;
        let change: [f64; 3] = core::array::from_fn(|j| psi(end[j]) - psi(begin[j]));
        for [a, b] in [[0, 1], [1, 2]] {
            let expected = volt_seconds[a] - volt_seconds[b];
            close(change[a] - change[b], expected, 2e-4, "change of the flux linkage, Vs");
        }
        // 20 % of L between 10 A and rest is 0.013 Vs.
    }
}

/// A complex number.
#[derive(Clone, Copy, Debug)]
struct Complex(f64, f64);

impl Complex {
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1)
    }
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.0, self.1 - o.1)
    }
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0 - self.1 * o.1, self.0 * o.1 + self.1 * o.0)
    }
    fn div(self, o: Self) -> Self {
        let square = o.0 * o.0 + o.1 * o.1;
        self.mul(Self(o.0 / square, -o.1 / square))
    }
}

/// Steady phasors `[i_a, i_b, i_c, i_f]` of a motor with short-circuited terminals at an electrical speed, with σ of phase A
/// shorted through R_f.
fn phasors(params: &ActuatorParams, omega_e: f64, sigma: f64, r_f: f64, coupling: f64) -> [Complex; 4] {
    let m = &params.motor;
    let n = 1.0 - sigma;
    // e_j = −k ω sin(θ_e − 2πj/3) is the real part of j k ω e^(−2πj/3) e^(jθ_e).
    let emf = |phase: f64| {
        let angle = -TAU / 3.0 * phase;
        let amplitude = m.k * omega_e / m.pole_pairs;
        Complex(-amplitude * angle.sin(), amplitude * angle.cos())
    };
    let mutual = Complex(-r_f, omega_e * coupling * n * sigma * m.l_s);
    let own = Complex(sigma * m.r_s + r_f, omega_e * sigma * sigma * m.l_s);
    let full = Complex(m.r_s, omega_e * m.l_s);
    let rest = Complex(n * m.r_s + r_f, omega_e * n * n * m.l_s);
    // Loop: own I_f + mutual I_a + σ E_a = 0; phase A: −V_n = rest I_a + mutual I_f + N E_a.
    let scaled = |x: f64, c: Complex| Complex(x * c.0, x * c.1);
    let ratio = mutual.div(own);
    let z = [rest.sub(ratio.mul(mutual)), full, full];
    let e_a = emf(0.0);
    let e = [scaled(n, e_a).sub(ratio.mul(scaled(sigma, e_a))), emf(1.0), emf(2.0)];
    let one = Complex(1.0, 0.0);
    let (mut weighted, mut weights) = (Complex(0.0, 0.0), Complex(0.0, 0.0));
    for j in 0..3 {
        weighted = weighted.add(e[j].div(z[j]));
        weights = weights.add(one.div(z[j]));
    }
    // Σ I_j = 0: −V_n = Σ e/z ÷ Σ 1/z.
    let star = weighted.div(weights);
    let i: [Complex; 3] = core::array::from_fn(|j| star.sub(e[j]).div(z[j]));
    let i_f = Complex(0.0, 0.0).sub(mutual.mul(i[0]).add(scaled(sigma, e_a))).div(own);
    [i[0], i[1], i[2], i_f]
}

#[test]
fn shorted_turns_carry_the_current_of_their_phasor_equations() {
    let omega = TAU * 25.0; // an electrical turn of 10 ms
    for (sigma, r_f, coupling) in [(0.3, 0.0, 0.9), (0.3, 0.7, 0.9), (0.1, 0.05, 0.98), (0.2, 1e4, 1.0)] {
        let mut params = flywheel();
        params.controller.hysteresis = 1e6;
        let fault = FaultVector {
            short_a: sigma,
            ..FaultVector::NOMINAL
        };
        let values = [("short_resistance_ohm", r_f), ("short_coupling", coupling)];
        let mut rig = Rig::with_fault(&params, &fault, 0.0, &values);
        rig.state.shaft.omega_m = omega;
        rig.settle(0.2, Setpoint::Idle);
        let mut series: [Vec<f64>; 4] = Default::default();
        rig.run(0.02, Setpoint::Idle, |s, _| {
            for j in 0..3 {
                series[j].push(s.shaft.i[j]);
            }
            series[3].push(s.i_short[0]);
        });
        let expected = phasors(&params, 4.0 * omega, sigma, r_f, coupling);
        let scale = expected[3].0.hypot(expected[3].1).max(1.0);
        println!("σ {sigma}, R_f {r_f}, c {coupling}: {expected:?}");
        for (series, expected) in series.iter().zip(expected) {
            let [re, im] = phasor(series, 2.0);
            close(re, expected.0, 2e-3 * scale, "real part, A");
            // x = re cos + im sin is the real part of (re − j im) e^(jωt).
            close(-im, expected.1, 2e-3 * scale, "imaginary part, A");
        }
        if r_f > 1e3 {
            // An open bridge with c = 1 is a healthy winding: all turns of the phase carry one current.
            close(expected[3].0, expected[0].0, 1e-2, "real part of i_f, A");
            close(expected[3].1, expected[0].1, 1e-2, "imaginary part of i_f, A");
        }
    }
}

#[test]
fn shorted_turns_of_another_phase_are_those_of_phase_a_turned_by_120_degrees() {
    let mut params = flywheel();
    params.controller.hysteresis = 1e6;
    let values = [("short_resistance_ohm", 0.7), ("short_coupling", 0.9)];
    // Currents from phase `j` on, and the current of its shorted turns.
    let run = |j: usize| {
        let mut shorts = [0.0; 3];
        shorts[j] = 0.3;
        let [short_a, short_b, short_c] = shorts;
        let fault = FaultVector {
            short_a,
            short_b,
            short_c,
            ..FaultVector::NOMINAL
        };
        let theta_e = 1.2 + TAU / 3.0 * j as f64;
        let mut rig = Rig::with_fault(&params, &fault, theta_e / 4.0, &values);
        rig.state.shaft.omega_m = TAU * 25.0;
        rig.settle(0.013, Setpoint::Idle);
        let (i, short) = (rig.state.shaft.i, rig.state.i_short);
        close(
            short[(j + 1) % 3] + short[(j + 2) % 3],
            0.0,
            0.0,
            "turns that are not shorted, A",
        );
        [i[j], i[(j + 1) % 3], i[(j + 2) % 3], short[j], rig.state.shaft.torque]
    };
    let of_a = run(0);
    assert!(of_a[3].abs() > 1.0, "{of_a:?}");
    for j in [1, 2] {
        for (got, expected) in run(j).into_iter().zip(of_a) {
            close(got, expected, 1e-6, "current or torque");
        }
    }
}

#[test]
fn the_link_current_is_smoothed_over_a_millisecond() {
    // Without power, what the link lacks decays as e^(−t/1 ms).
    let values = [("link_resistance_ohm", 20.0), ("pwm_frequency_hz", 20e3)];
    let mut rig = Rig::new(&locked(), &values);
    let (loaded, unloaded) = (rig.for_current(8.0, 0.0), rig.for_current(0.0, 0.0));
    rig.settle(0.05, loaded);
    assert!(rig.state.link_voltage < 370.0, "{} V", rig.state.link_voltage);
    rig.settle(2e-3, unloaded);
    let lacking = |rig: &Rig| 380.0 - rig.state.link_voltage;
    let from = lacking(&rig);
    assert!(from.abs() > 0.3, "{from} V");
    for periods in 1..4 {
        rig.settle(500e-6, unloaded);
        let expected = from * (-0.5 * f64::from(periods)).exp();
        close(
            lacking(&rig),
            expected,
            0.03 * from.abs(),
            "voltage that the link lacks, V",
        );
    }
}

#[test]
fn the_link_sags_by_its_power_and_ripples() {
    // V = V_dc − R P/V: V = (V_dc + √(V_dc² − 4 R P))/2.
    let mut params = flywheel();
    params.motor.v_dc = 400.0;
    let omega = 100.0;
    let mut rig = Rig::new(&params, &[("link_resistance_ohm", 5.0), ("pwm_frequency_hz", 20e3)]);
    rig.state.shaft.omega_m = omega;
    let setpoint = rig.for_current(8.0, omega);
    rig.settle(0.1, setpoint);
    let power = rig.mean(0.05, setpoint, |s| (0..3).map(|j| s.shaft.v[j] * s.shaft.i[j]).sum());
    let v = rig.mean(0.05, setpoint, |s| s.link_voltage);
    let expected = 0.5 * (400.0 + (400.0f64 * 400.0 - 4.0 * 5.0 * power).sqrt());
    println!("{power} W, {v} V, expected {expected} V");
    // 1.35 Nm/A at 100 rad/s, and 1.5 R i².
    close(power, 1.35 * 8.0 * omega + 1.5 * 2.75 * 64.0, 15.0, "power, W");
    close(v, expected, 0.3, "link voltage, V");

    let mut rig = Rig::new(&locked(), &[("link_ripple_v", 10.0), ("link_ripple_hz", 300.0)]);
    rig.run(0.01, Setpoint::Idle, |before, after| {
        let t = before.shaft.steps as f64 * 1e-6;
        // Held for at most 4 µs.
        let slack = 10.0 * TAU * 300.0 * 4e-6;
        close(
            after.link_voltage - 380.0,
            10.0 * (TAU * 300.0 * t).sin(),
            slack + 1e-9,
            "ripple, V",
        );
    });
}
