//! Energy balance with everything on, and the model with effects beside the plain one.

use core::f64::consts::TAU;

use super::rig::{Rig, close};
use ema_models::reference::{DetailedReference, DetailedState, Drive, Effects, Reference, ReferenceState, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample, Setpoint};

const SIGMA: f64 = 0.2;

/// Energies of a window, J, each by its own law.
#[derive(Clone, Copy, Debug, Default)]
struct Energies {
    electric: f64,
    copper: f64,
    magnetic: f64,
    kinetic: f64,
    viscous: f64,
    friction: f64,
    damper: f64,
    elastic: f64,
    load: f64,
    cogging: f64,
}

/// Energies of an actuation of `bench` out and back with all effects that store, convert or dissipate energy.
fn energies(drive: Drive) -> Energies {
    let params = ActuatorParams::bench();
    let (m, t) = (&params.motor, &params.transmission);
    let fault = FaultVector {
        short_a: SIGMA,
        eccentricity: 0.2,
        ..FaultVector::NOMINAL
    };
    let values = [
        ("compliance_hz", 120.0),
        ("compliance_damping", 0.05),
        ("stribeck_nm", 0.15),
        ("mesh_ripple", 0.1),
        ("cogging_nm", 0.2),
        ("unmeasured_load_nm", 15.0),
        ("spring_nm_per_rad", 200.0),
        ("load_drift_nm", 10.0),
        ("load_drift_period_s", 0.3),
        ("emf_5", 0.04),
        ("emf_7", 0.02),
        ("saturation", 0.2),
        ("current_gain_a", 0.01),
        ("current_offset_b_a", 0.05),
        ("resolver_error_1_rad", 0.005),
        ("encoder_eccentricity_rad", 5e-4),
        ("speed_filter_hz", 500.0),
        ("control_delay_periods", 1.0),
        ("link_resistance_ohm", 1.0),
        ("link_ripple_v", 10.0),
        ("short_resistance_ohm", 0.5),
        ("short_coupling", 0.9),
    ];
    let mut effects = super::rig::effects(&values);
    effects.drive = drive;
    let mut rig = Rig::new(&params, &[]);
    rig.plant = DetailedReference::new(&params, &params, &fault, 0.0, 20.0, &effects);
    let reduced = 0.77 * 0.23 * m.j;
    let (stiffness, damping) = ((TAU * 120.0).powi(2) * reduced, 2.0 * 0.05 * TAU * 120.0 * reduced);
    let half_play = 0.5 * t.backlash * t.gear_ratio;
    let strain = |twist: f64| twist - twist.clamp(-half_play, half_play);
    let stored = |s: &DetailedState| {
        let (motor, load) = (s.shaft.omega_m, s.load_speed);
        let kinetic = 0.5 * m.j * (0.77 * motor * motor + 0.23 * load * load);
        let x = strain(s.shaft.theta_m - s.load_angle);
        let cogging = -0.2 / 24.0 * (24.0 * s.shaft.theta_m).cos();
        (kinetic, 0.5 * stiffness * x * x, cogging)
    };
    let dry =
        |omega: f64, angle: f64| (0.15 + 0.15 * (-(omega / 10.0).powi(2)).exp()) * (1.0 + 0.1 * (13.0 * angle).sin());
    let begin = stored(&rig.state);
    let mut e = Energies::default();
    let target = rig.state.shaft.theta_out + 0.2;
    for setpoint in [target, target - 0.25] {
        rig.run(0.25, Setpoint::Position(setpoint), |before, after| {
            let n = [1.0 - SIGMA, 1.0, 1.0];
            for j in 0..3 {
                let (i, di) = (
                    0.5 * (before.shaft.i[j] + after.shaft.i[j]),
                    after.shaft.i[j] - before.shaft.i[j],
                );
                let slope = m.l_s * (1.0 - 0.2 * (before.shaft.i[j] / m.i_max).powi(2).min(1.0));
                e.electric += after.shaft.v[j] * i * 1e-6;
                e.copper += n[j] * m.r_s * i * i * 1e-6;
                e.magnetic += n[j] * n[j] * slope * di * i;
                if j == 0 {
                    let (f, df) = (
                        0.5 * (before.i_short[0] + after.i_short[0]),
                        after.i_short[0] - before.i_short[0],
                    );
                    e.copper += (SIGMA * m.r_s * f * f + 0.5 * (i - f) * (i - f)) * 1e-6;
                    let mutual = 0.9 * n[0] * SIGMA * slope;
                    e.magnetic += mutual * (df * i + di * f) + SIGMA * SIGMA * slope * df * f;
                }
            }
            let turned = after.shaft.theta_m - before.shaft.theta_m;
            let load_turned = after.load_angle - before.load_angle;
            e.viscous += m.c * before.shaft.omega_m * turned;
            e.friction += 0.7 * dry(before.shaft.omega_m, before.shaft.theta_m) * turned.abs()
                + 0.3 * dry(before.load_speed, before.load_angle) * load_turned.abs();
            let time = before.shaft.steps as f64 * 1e-6;
            let travel = before.shaft.theta_out - 0.003;
            let load = (15.0 + 200.0 * travel + 10.0 * (TAU * time / 0.3).sin()) / t.gear_ratio;
            e.load += load * load_turned;
            let lost = if load * load_turned > 0.0 {
                1.0 / t.efficiency_opposing - 1.0
            } else {
                1.0 - t.efficiency_aiding
            };
            e.friction += lost * (load * load_turned).abs();
            let x = strain(before.shaft.theta_m - before.load_angle);
            let rate = before.shaft.omega_m - before.load_speed;
            let torque = stiffness * x + damping * rate;
            let damper = if x.abs() <= 0.0 {
                0.0
            } else if torque * x < 0.0 {
                -stiffness * x
            } else {
                damping * rate
            };
            e.damper += damper * (turned - load_turned);
        });
    }
    let end = stored(&rig.state);
    e.kinetic = end.0 - begin.0;
    e.elastic = end.1 - begin.1;
    e.cogging = end.2 - begin.2;
    e
}

#[test]
fn energy_is_conserved_with_everything_on() {
    for name in ["hysteresis", "vector"] {
        let e = energies(Drive::from_name(name).unwrap());
        let out =
            e.copper + e.magnetic + e.kinetic + e.viscous + e.friction + e.damper + e.elastic + e.load + e.cogging;
        println!("{name}: {e:?}, left {}", (e.electric - out) / e.electric);
        close(out, e.electric, 5e-4 * e.electric, "energy, J");
        // Each of these terms counts: without it the balance would fail.
        for part in [e.copper, e.magnetic, e.viscous, e.friction, e.load, e.damper] {
            assert!(part.abs() > 8e-4 * e.electric, "{e:?}");
        }
    }
}

#[test]
fn without_effects_the_detailed_model_moves_like_the_plain_one() {
    let params = ActuatorParams::bench();
    let fault = FaultVector::from_array([0.2, 0.1, 0.0, 0.15, 0.0, 0.2, 0.7, 0.6]);
    let plain = Reference::new(&params, &params, &fault, 20.0);
    let detailed = DetailedReference::new(&params, &params, &fault, 20.0, 20.0, &Effects::default());
    let mut state = ReferenceState::at_rest(0.3, 0.003);
    let mut other = DetailedState::at_rest(0.3, 0.003, params.transmission.gear_ratio);
    let (mut speed, mut angle, mut n) = (0.0, 0.0, 0.0);
    for sample in 0..1000 {
        let tau = f64::from(sample) * 500e-6 - 0.02;
        let setpoint = Setpoint::Position(Profile::Mixed.commanded_angle(tau));
        for _ in 0..500 {
            plain.step(&mut state, setpoint);
            detailed.step(&mut other, setpoint);
        }
        speed += (state.omega_m - other.shaft.omega_m).powi(2);
        angle += (state.theta_m - other.shaft.theta_m).powi(2);
        n += 1.0;
    }
    // The bounds of the plain model's own convergence: switching is chaotic.
    let (speed, angle) = ((speed / n).sqrt(), (angle / n).sqrt());
    println!("rms {speed} rad/s, {angle} rad");
    assert!(speed < 0.05 && angle < 6e-4, "{speed} rad/s, {angle} rad");
}

#[test]
fn a_temperature_rise_warms_the_motor_and_the_friction() {
    let samples = |temperature: f64, values: &[(&str, f64)]| -> Vec<SensedSample> {
        let mut scenario = Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 4);
        scenario.winding_temp_deg_c = temperature;
        scenario.effects = super::rig::effects(values);
        scenario.run().collect()
    };
    // The motor alone: R and k at 60 °C, by the plain model's own law.
    assert_eq!(samples(20.0, &[("temperature_rise_k", 40.0)]), samples(60.0, &[]));
    // With the friction.
    let ratio = ("viscous_temperature", 3.0);
    assert_eq!(
        samples(20.0, &[("temperature_rise_k", -40.0), ratio]),
        samples(-20.0, &[ratio])
    );
}
