//! Physics of the high-fidelity reference: each test compares the model with a value derived in the test.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use core::f64::consts::{PI, TAU};
use ema_models::reference::{Reference, ReferenceState};
use ema_models::{ActuatorParams, FaultVector, Real, Setpoint, dq_from_abc, phase_shapes};

const DT: f64 = 1e-6;

/// One actuator with its state.
struct Plant {
    reference: Reference,
    state: ReferenceState,
    pole_pairs: f64,
}

impl Plant {
    fn new(params: &ActuatorParams, fault: &FaultVector, load_torque: f64) -> Self {
        Self {
            reference: Reference::new(params, params, fault, load_torque),
            state: ReferenceState::at_rest(0.3, 0.3 / params.transmission.gear_ratio),
            pole_pairs: params.motor.pole_pairs,
        }
    }

    /// Runs for `duration` seconds and calls `visit` with the state before and after each step.
    fn run(&mut self, duration: f64, setpoint: Setpoint, mut visit: impl FnMut(&ReferenceState, &ReferenceState)) {
        for _ in 0..(duration / DT).round() as u64 {
            let before = self.state;
            self.reference.step(&mut self.state, setpoint);
            visit(&before, &self.state);
        }
    }

    fn settle(&mut self, duration: f64, setpoint: Setpoint) {
        self.run(duration, setpoint, |_, _| ());
    }

    /// Means of `[i_d, i_q, omega_m]` over `duration` seconds.
    fn mean(&mut self, duration: f64, setpoint: Setpoint) -> [f64; 3] {
        let pole_pairs = self.pole_pairs;
        let (mut sums, mut n) = ([0.0; 3], 0.0);
        self.run(duration, setpoint, |s, _| {
            let [d, q] = dq(s, pole_pairs);
            for (sum, x) in sums.iter_mut().zip([d, q, s.omega_m]) {
                *sum += x;
            }
            n += 1.0;
        });
        sums.map(|sum| sum / n)
    }
}

fn dq(state: &ReferenceState, pole_pairs: f64) -> [f64; 2] {
    dq_from_abc(state.i, (pole_pairs * state.theta_m).sin_cos_poly())
}

fn close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (got - expected).abs() <= tolerance,
        "{what}: {got}, expected {expected} ± {tolerance}"
    );
}

fn worn() -> FaultVector {
    FaultVector::from_array([0.3, 0.2, 0.4, 0.0, 0.1, 0.3, 0.7, 0.6])
}

// ---------------------------------------------------------------------------------------------- rest

#[test]
fn rest_stays_at_rest() {
    for params in [ActuatorParams::bench(), ActuatorParams::servo28()] {
        // A load below the breakaway torque, and the setpoint at the position of the shaft.
        let load = 0.5 * params.transmission.friction_static * params.transmission.gear_ratio;
        for (fault, load) in [
            (FaultVector::NOMINAL, 0.0),
            (worn(), 0.0),
            (FaultVector::NOMINAL, load),
            (FaultVector::NOMINAL, -load),
        ] {
            let mut plant = Plant::new(&params, &fault, load);
            let start = plant.state;
            let lsb = params.sensors.output_lsb();
            let here = (start.theta_out / lsb).floor() * lsb;
            plant.run(0.1, Setpoint::Position(here), |_, s| {
                assert_eq!(s.omega_m.to_bits(), 0.0f64.to_bits(), "{fault:?}, load {load}");
            });
            assert!((plant.state.theta_m - start.theta_m).abs() < 1e-15);
            assert!((plant.state.theta_out - start.theta_out).abs() < 1e-15);
            assert!(plant.state.i_ref.abs() < 1e-9, "{}", plant.state.i_ref);
        }
    }
}

#[test]
fn a_load_that_friction_cannot_hold_moves_the_idle_shaft() {
    // Static friction is 0.30 Nm, and the gear at rest adds (1/0.65 − 1) T_l/n: the shaft rests up to T_l/n (1 − 0.538) = 0.30,
    // which is 65 Nm at the output (0.65 Nm at the motor).
    let params = ActuatorParams::bench();
    for (load, moves) in [(64.0, false), (66.0, true)] {
        let mut plant = Plant::new(&params, &FaultVector::NOMINAL, load);
        plant.settle(0.01, Setpoint::Idle);
        assert_eq!(plant.state.omega_m < 0.0, moves, "{load} Nm: {}", plant.state.omega_m);
    }
}

// -------------------------------------------------------------------------------------------- energy

/// Energies of one actuation, J.
#[derive(Clone, Copy, Debug, Default)]
struct Energies {
    electric: f64,
    copper: f64,
    magnetic: f64,
    /// `½ Σ L_j Δi_j²`: magnetic energy that explicit Euler adds in every step.
    scheme: f64,
    /// Electric input and copper loss with the mean currents of each step.
    electric_mean: f64,
    copper_mean: f64,
    shaft: f64,
    /// `T Δθ`, with the mean speed of the step instead of the speed at its beginning.
    work: f64,
    kinetic: f64,
    viscous: f64,
    friction: f64,
    load: f64,
}

fn energies(params: &ActuatorParams, fault: &FaultVector, load_torque: f64) -> Energies {
    let (m, t) = (&params.motor, &params.transmission);
    let turns = [fault.short_a, fault.short_b, fault.short_c].map(|k| 1.0 - k);
    let phi = PI * (2.0 * fault.eccentricity_phase - 1.0);
    let stored = |s: &ReferenceState| {
        let magnetic: f64 = (0..3)
            .map(|j| 0.5 * turns[j] * turns[j] * m.l_s * s.i[j] * s.i[j])
            .sum();
        (magnetic, 0.5 * m.j * s.omega_m * s.omega_m)
    };
    let load = load_torque / t.gear_ratio;
    let dry = t.friction_dynamic * (1.0 + 2.0 * fault.friction);
    let mut plant = Plant::new(params, fault, load_torque);
    let begin = stored(&plant.state);
    let target = plant.state.theta_out + 0.2;
    let mut e = Energies::default();
    // Out and back, so that the load opposes in one direction and aids in the other.
    for setpoint in [target, target - 0.25] {
        plant.run(0.25, Setpoint::Position(setpoint), |before, after| {
            let theta_e = m.pole_pairs * before.theta_m;
            let mut torque = 0.0;
            for j in 0..3 {
                let shift = TAU / 3.0 * j as f64;
                let k_j = m.k
                    * turns[j]
                    * -(theta_e - shift).sin()
                    * (1.0 + fault.eccentricity * (theta_e - phi + shift).cos());
                torque += k_j * before.i[j];
                e.electric += after.v[j] * before.i[j] * DT;
                e.copper += turns[j] * m.r_s * before.i[j] * before.i[j] * DT;
                let di = after.i[j] - before.i[j];
                e.scheme += 0.5 * turns[j] * turns[j] * m.l_s * di * di;
                let mean = before.i[j] + 0.5 * di;
                e.electric_mean += after.v[j] * mean * DT;
                e.copper_mean += turns[j] * m.r_s * mean * mean * DT;
            }
            assert!((torque - after.torque).abs() < 1e-9 * (1.0 + torque.abs()));
            let turned = after.theta_m - before.theta_m;
            e.shaft += torque * before.omega_m * DT;
            e.work += torque * turned;
            e.viscous += m.c * before.omega_m * turned;
            e.load += load * turned;
            let gear = if load * turned > 0.0 {
                (1.0 / t.efficiency_opposing - 1.0) * load.abs()
            } else {
                (1.0 - t.efficiency_aiding) * load.abs()
            };
            e.friction += (dry + gear) * turned.abs();
        });
    }
    let end = stored(&plant.state);
    e.magnetic = end.0 - begin.0;
    e.kinetic = end.1 - begin.1;
    e
}

#[test]
fn power_balances_electrically_and_mechanically() {
    for (params, load) in [(ActuatorParams::bench(), 20.0), (ActuatorParams::servo28(), 0.5)] {
        for (fault, load) in [
            (FaultVector::NOMINAL, 0.0),
            (FaultVector::NOMINAL, load),
            (worn(), -load),
        ] {
            let e = energies(&params, &fault, load);
            println!("{e:?}");
            // Σ v_j i_j dt = change of ½ L i² + copper loss + T ω dt. With all powers at the start of the step, explicit Euler
            // adds exactly ½ Σ L Δi² to the magnetic energy; including this term, only rounding remains.
            let left = e.electric + e.scheme - (e.magnetic + e.copper + e.shaft);
            close(
                left,
                0.0,
                1e-9 * e.electric,
                "electric balance with the term of the integration scheme",
            );
            // With the mean currents of each step, as a wattmeter measures, less than 0.1 % remains at 1 µs.
            let left = e.electric_mean - (e.magnetic + e.copper_mean + e.work);
            println!("left {}", left / e.electric_mean);
            close(left, 0.0, 1e-3 * e.electric_mean, "electric balance");
            // T Δθ = change of ½ J ω² + viscous + dry friction with the gear's loss + load; only the step of a stop differs.
            let left = e.work - (e.kinetic + e.viscous + e.friction + e.load);
            close(left, 0.0, 1e-5 * e.electric, "mechanical balance");
            // Electrical and mechanical power are equal at the shaft, up to ½ T Δω dt of each step.
            close(e.shaft, e.work, 5e-4 * e.electric, "shaft power");
        }
    }
}

// ----------------------------------------------------------------------------------- steady state

#[test]
fn steady_current_carries_friction_viscous_loss_and_load() {
    for (params, load, speed) in [
        (ActuatorParams::bench(), 40.0, 100.0),
        (ActuatorParams::servo28(), 1.0, 120.0),
    ] {
        let (m, t) = (&params.motor, &params.transmission);
        let at_motor = load / t.gear_ratio;
        for (load, gear_and_load) in [
            (0.0, 0.0),
            // An opposing load needs T_l/n divided by the efficiency; an aiding load gives T_l/n times the efficiency.
            (load, at_motor / t.efficiency_opposing),
            (-load, -at_motor * t.efficiency_aiding),
        ] {
            for direction in [1.0, -1.0] {
                let mut plant = Plant::new(&params, &FaultVector::NOMINAL, direction * load);
                let setpoint = Setpoint::Speed(direction * speed);
                plant.settle(1.0, setpoint);
                let [_, i_q, omega] = plant.mean(0.1, setpoint);
                close(omega, direction * speed, 2e-4 * speed, "speed");
                let expected = (t.friction_dynamic + m.c * speed + gear_and_load) / m.torque_gain();
                close(i_q, direction * expected, 1e-3 * params.motor.i_max, "i_q");
            }
        }
    }
}

#[test]
fn no_load_speed_is_that_of_the_six_step_voltage() {
    // At a setpoint far above the speed that the voltage allows, each leg keeps one level for half an electrical turn. The
    // fundamental is V = 2 V_dc/π. At its zero crossing, the current of the harmonics of order h is −V/(h² ω_e L), in total
    // −0.0966 V/(ω_e L) over h = 5, 7, 11, … (π²/9 − 1). A comparator switches where I_ref s_j − i_j crosses zero, so this
    // current and i_d rotate the voltage by α = (0.0966 V/(ω_e L) + i_d)/I_ref, and −V α = R i_d without torque:
    // ω_e L i_d = −0.0966 (V/I_ref) V / (R + V/I_ref), and k ω₀ = V − ω_e L i_d.
    let mut params = ActuatorParams::bench();
    params.motor.v_dc = 90.0;
    params.motor.c = 0.0;
    params.transmission.friction_dynamic = 0.0;
    params.transmission.friction_static = 0.0;
    params.controller.omega_max = 1000.0;
    let mut plant = Plant::new(&params, &FaultVector::NOMINAL, 0.0);
    plant.settle(1.5, Setpoint::Speed(1000.0));
    let [i_d, i_q, omega] = plant.mean(0.1, Setpoint::Speed(1000.0));
    println!("i_d {i_d}, i_q {i_q}, omega {omega}");
    let v = 2.0 * 90.0 / PI;
    let ohms = v / params.motor.i_max;
    let reactance_voltage = -(PI * PI / 9.0 - 1.0) * ohms * v / (params.motor.r_s + ohms);
    close(omega, (v - reactance_voltage) / 0.900, 0.5, "no-load speed");
    close(
        params.motor.pole_pairs * omega * params.motor.l_s * i_d,
        reactance_voltage,
        0.4,
        "ω_e L i_d",
    );
    close(i_q, 0.0, 0.02, "i_q without load");
}

#[test]
fn speed_is_limited_to_omega_max() {
    let params = ActuatorParams::bench();
    let mut plant = Plant::new(&params, &FaultVector::NOMINAL, 0.0);
    plant.settle(0.8, Setpoint::Position(1e3));
    let [_, _, omega] = plant.mean(0.05, Setpoint::Position(1e3));
    close(omega, 200.0, 0.01, "limited speed");
}

#[test]
fn at_the_voltage_limit_i_q_falls_and_i_d_is_positive_while_motoring() {
    // At 180 rad/s and 10.7 A, ω_e L i_q = 235 V and k ω = 162 V; the inverter has V_dc/√3 = 219 V.
    let params = ActuatorParams::bench();
    let m = &params.motor;
    let needed = [
        m.pole_pairs * 180.0 * m.l_s * m.i_max,
        m.k * 180.0,
        m.v_dc / 3f64.sqrt(),
    ];
    for (got, expected) in needed.iter().zip([235.0, 162.0, 219.0]) {
        close(*got, expected, 0.6, "voltage");
    }
    // A steady state at the limit: the load is too large for the voltage at the commanded 200 rad/s.
    for direction in [1.0, -1.0] {
        let mut plant = Plant::new(&params, &FaultVector::NOMINAL, direction * 750.0);
        let setpoint = Setpoint::Speed(direction * 200.0);
        plant.settle(0.5, setpoint);
        let [i_d, i_q, omega] = plant.mean(0.1, setpoint);
        println!("i_d {i_d}, i_q {i_q}, omega {omega}, i_ref {}", plant.state.i_ref);
        close(plant.state.i_ref, direction * m.i_max, 1e-9, "i_ref");
        assert!(direction * i_q < 0.97 * m.i_max, "{i_q}");
        // v_d = R i_d − ω_e L i_q: i_d = 0 needs v_d = −ω_e L i_q; with a smaller voltage, i_d is positive.
        assert!(i_d > 0.5, "{i_d}");
        assert!(direction * omega > 90.0 && direction * omega < 180.0, "{omega}");
    }
}

// ------------------------------------------------------------------------------------- convergence

const COAST_INERTIA: f64 = 0.02;

/// Coasting with a short-circuited star: no comparator switches, no dry friction, so the right-hand side is smooth.
///
/// The inertia is large enough that the shaft does not reverse, which dry friction would turn into a stop within a step.
fn coast(step: f64, duration: f64) -> ([f64; 2], f64, f64) {
    let mut params = ActuatorParams::bench();
    params.motor.j = COAST_INERTIA;
    params.controller.hysteresis = 1e6;
    params.transmission.friction_dynamic = 0.0;
    params.transmission.friction_static = 0.0;
    let reference = Reference::with_step(&params, &params, &FaultVector::NOMINAL, 0.0, step);
    let mut state = ReferenceState::at_rest(0.1, 0.001);
    state.omega_m = 50.0;
    state.i = phase_shapes((0.4f64).sin_cos_poly()).map(|s| 2.0 * s);
    for _ in 0..(duration / step).round() as u64 {
        reference.step(&mut state, Setpoint::Idle);
    }
    (dq(&state, params.motor.pole_pairs), state.omega_m, state.theta_m)
}

/// The same motion in the rotor frame by the classical fourth-order Runge-Kutta scheme: textbook equations that share only the
/// parameters with the crate.
fn coast_in_dq(duration: f64) -> ([f64; 2], f64, f64) {
    let m = ActuatorParams::bench().motor;
    let slope = |x: [f64; 4]| {
        let [i_d, i_q, omega, _] = x;
        let omega_e = m.pole_pairs * omega;
        [
            (-m.r_s * i_d + omega_e * m.l_s * i_q) / m.l_s,
            (-m.r_s * i_q - omega_e * m.l_s * i_d - m.k * omega) / m.l_s,
            (1.5 * m.k * i_q - m.c * omega) / COAST_INERTIA,
            omega,
        ]
    };
    let along = |x: [f64; 4], k: [f64; 4], h: f64| -> [f64; 4] { core::array::from_fn(|n| x[n] + h * k[n]) };
    // Phase currents 2 s_j(0.4) at rotor angle 4 · 0.1: on the q axis.
    let mut x = [0.0, 2.0, 50.0, 0.1];
    let h = 10e-6;
    for _ in 0..(duration / h).round() as u64 {
        let k1 = slope(x);
        let k2 = slope(along(x, k1, 0.5 * h));
        let k3 = slope(along(x, k2, 0.5 * h));
        let k4 = slope(along(x, k3, h));
        for n in 0..4 {
            x[n] += h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]);
        }
    }
    ([x[0], x[1]], x[2], x[3])
}

#[test]
fn smooth_motion_converges_with_first_order_to_the_dq_equations() {
    let duration = 0.02;
    let ([d, q], omega, theta) = coast_in_dq(duration);
    let deviation = |step: f64| {
        let (i, w, t) = coast(step, duration);
        [i[0] - d, i[1] - q, w - omega, t - theta]
    };
    let (coarse, fine) = (deviation(2e-6), deviation(1e-6));
    println!("{d} {q} {omega} {theta}: {coarse:?} {fine:?}");
    for (n, bound) in [2e-3, 2e-3, 1e-3, 1e-4].into_iter().enumerate() {
        assert!(fine[n].abs() < bound, "signal {n}: {fine:?}");
        close(coarse[n] / fine[n], 2.0, 0.02, "ratio of the deviations, step halved");
    }
}

/// Signals of one window at 2 kHz under a given step, `[i_q, omega_m, theta_m]`.
fn window(step: f64) -> Vec<[f64; 3]> {
    let params = ActuatorParams::bench();
    let reference = Reference::with_step(&params, &params, &FaultVector::NOMINAL, 0.0, step);
    let mut state = ReferenceState::at_rest(0.3, 0.003);
    let per_sample = (500e-6 / step).round() as u64;
    (0..1000)
        .map(|n| {
            let tau = f64::from(n) * 500e-6 - 0.02;
            for _ in 0..per_sample {
                reference.step(
                    &mut state,
                    Setpoint::Position(ema_models::Profile::Mixed.commanded_angle(tau)),
                );
            }
            [dq(&state, params.motor.pole_pairs)[1], state.omega_m, state.theta_m]
        })
        .collect()
}

#[test]
fn window_signals_are_converged_up_to_the_switching_ripple() {
    // Hysteresis switching is chaotic: a smaller step shifts the switching instants, so i_q differs by the switching ripple.
    // Speed and angle, which integrate the current, agree far better.
    let fine = window(0.25e-6);
    let rms = |step: f64| -> [f64; 3] {
        let coarse = window(step);
        core::array::from_fn(|k| {
            let sum: f64 = coarse.iter().zip(&fine).map(|(a, b)| (a[k] - b[k]).powi(2)).sum();
            (sum / fine.len() as f64).sqrt()
        })
    };
    let (two, one, half) = (rms(2e-6), rms(1e-6), rms(0.5e-6));
    println!("rms against 0.25 µs: 2 µs {two:?}, 1 µs {one:?}, 0.5 µs {half:?}");
    let hysteresis = ActuatorParams::bench().controller.hysteresis;
    for rms in [two, one, half] {
        assert!(rms[0] < 1.2 * hysteresis, "i_q {rms:?}");
        assert!(rms[1] < 0.05, "omega_m {rms:?}");
        assert!(rms[2] < 6e-4, "theta_m {rms:?}");
    }
}

// --------------------------------------------------------------------------------------- hysteresis

#[test]
fn phase_errors_stay_in_the_band_while_the_voltage_suffices() {
    let params = ActuatorParams::bench();
    let (m, h) = (&params.motor, params.controller.hysteresis);
    let mut plant = Plant::new(&params, &FaultVector::NOMINAL, 100.0);
    let setpoint = Setpoint::Speed(60.0);
    plant.settle(0.5, setpoint);
    // A phase has at most 2/3 V_dc of star voltage beside its back-EMF.
    let slew = (2.0 / 3.0 * m.v_dc + m.k * 60.0 + m.r_s * m.i_max) / m.l_s * DT;
    let (mut worst, mut outside, mut steps, mut edges) = (0.0f64, 0u32, 0u32, [0u32; 3]);
    let mut sum_of_squares = 0.0;
    plant.run(0.2, setpoint, |before, after| {
        let shapes = phase_shapes((m.pole_pairs * after.theta_m).sin_cos_poly());
        for j in 0..3 {
            let error = after.i_ref * shapes[j] - after.i[j];
            worst = worst.max(error.abs());
            outside += u32::from(error.abs() > h + slew);
            sum_of_squares += error * error / 3.0;
            edges[j] += u32::from(after.v[j] > before.v[j]);
        }
        steps += 1;
    });
    let share = f64::from(outside) / f64::from(3 * steps);
    let rms = (sum_of_squares / f64::from(steps)).sqrt();
    let frequency = f64::from(edges.iter().sum::<u32>()) / 3.0 / 0.2;
    println!("worst {worst} A, slew {slew} A, outside {share}, rms {rms}, {frequency} Hz");
    // Without a neutral wire the inverter can remain in a zero vector while a deviation leaves the band. The deviation may
    // reach 2h, the known bound of three independent comparators on a star.
    assert!(worst <= 2.0 * h + slew, "{worst}");
    assert!(share < 0.10, "{share}");
    // With a neutral wire a leg would switch at (V² − e²)/(4 h L V), V = V_dc/2: 31 kHz at standstill. The zero vectors of the
    // star and the finite step lower the frequency.
    let with_neutral = 0.5 * m.v_dc / (4.0 * h * m.l_s);
    assert!(
        frequency > 0.2 * with_neutral && frequency < with_neutral,
        "{frequency} Hz beside {with_neutral} Hz"
    );
}
