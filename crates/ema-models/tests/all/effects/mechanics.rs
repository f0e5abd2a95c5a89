//! Compliance, friction, cogging and loads.

use core::f64::consts::{PI, TAU};

use super::rig::{Rig, close, coasting, locked, proportional};
use ema_models::reference::{DetailedReference, DetailedState};
use ema_models::{ActuatorParams, FaultVector, Setpoint};

/// Times at which a series with this spacing passes zero upwards, s, by linear interpolation.
fn upward_crossings(series: &[f64], dt: f64) -> Vec<f64> {
    series
        .windows(2)
        .enumerate()
        .filter(|(_, pair)| pair[0] < 0.0 && pair[1] >= 0.0)
        .map(|(n, pair)| dt * (n as f64 - pair[0] / (pair[1] - pair[0])))
        .collect()
}

#[test]
fn two_masses_swing_at_the_free_and_the_locked_resonance() {
    let damping = 0.02f64;
    for resonance in [60.0, 300.0] {
        // Both ends free: f_r √(1 − ζ²), amplitude e^(−2πζ/√(1 − ζ²)) per period.
        let values = [("compliance_hz", resonance), ("compliance_damping", damping)];
        let mut rig = Rig::new(&coasting(), &values);
        rig.state.shaft.omega_m = 1.0;
        let mut twists = Vec::new();
        rig.run(0.2, Setpoint::Idle, |_, s| twists.push(s.shaft.theta_m - s.load_angle));
        let times = upward_crossings(&twists, 1e-6);
        let period = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        let damped = (1.0 - damping * damping).sqrt();
        close(1.0 / period, resonance * damped, 1e-3 * resonance, "free resonance, Hz");
        let samples = (period / 1e-6) as usize;
        let peak = |from: usize| twists[from..from + samples].iter().copied().fold(0.0, f64::max);
        let ratio = peak(4 * samples) / peak(samples);
        close(
            ratio.ln(),
            -3.0 * TAU * damping / damped,
            5e-3,
            "decrement of three periods",
        );

        // Motor at rest: f_r √(J_m / J), J_m = 0.77 J.
        let mut params = coasting();
        params.transmission.friction_static = 1e3;
        let mut rig = Rig::new(&params, &[values[0], values[1], ("load_friction_share", 0.0)]);
        rig.state.load_speed = 1.0;
        let mut twists = Vec::new();
        rig.run(0.2, Setpoint::Idle, |_, s| twists.push(s.shaft.theta_m - s.load_angle));
        assert!((rig.state.shaft.theta_m - 0.3).abs() < 1e-12);
        let times = upward_crossings(&twists, 1e-6);
        let period = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        let locked = resonance * 0.77f64.sqrt();
        close(1.0 / period, locked, 2e-3 * locked, "locked resonance, Hz");
    }
}

#[test]
fn a_locked_load_twists_by_the_torque_over_the_stiffness() {
    let mut params = locked();
    params.transmission.backlash = 0.0;
    let values = [
        ("compliance_hz", 100.0),
        ("load_inertia_share", 0.4),
        ("load_friction_share", 1.0),
        ("compliance_damping", 0.5),
        ("pwm_frequency_hz", 20e3),
    ];
    let mut rig = Rig::new(&params, &values);
    let setpoint = rig.for_current(2.0, 0.0);
    rig.settle(0.3, setpoint);
    let stiffness = (TAU * 100.0).powi(2) * 0.4 * 0.6 * params.motor.j;
    let twist = rig.mean(0.05, setpoint, |s| s.shaft.theta_m - s.load_angle);
    // The speed loop damps nothing at rest; the current is 2 A at 1.35 Nm/A.
    close(twist, 2.0 * 1.35 / stiffness, 0.01 * 2.7 / stiffness, "twist, rad");
}

#[test]
fn play_between_the_masses_transmits_nothing_inside_it() {
    let mut params = coasting();
    params.transmission.backlash = 1e-3;
    let mut rig = Rig::new(&params, &[("compliance_hz", 100.0)]);
    rig.state.shaft.omega_m = 2.0;
    // Half the play of 0.1 rad at the motor, at 2 rad/s.
    let expected = 0.05 / 2.0;
    rig.settle(expected - 2e-6, Setpoint::Idle);
    close(rig.state.load_speed, 0.0, 0.0, "speed of the load inside the play");
    rig.settle(1e-3, Setpoint::Idle);
    assert!(rig.state.load_speed > 1e-3);
    // The momentum is shared: J_m ω_m + J_l ω_l stays.
    rig.settle(0.05, Setpoint::Idle);
    let momentum = 0.77 * rig.state.shaft.omega_m + 0.23 * rig.state.load_speed;
    close(momentum, 0.77 * 2.0, 1e-9, "momentum over J");
}

#[test]
fn flanks_of_the_play_push_and_never_pull() {
    let mut params = coasting();
    params.transmission.backlash = 1e-3;
    let mut rig = Rig::new(&params, &[("compliance_hz", 100.0), ("compliance_damping", 0.5)]);
    rig.state.shaft.omega_m = 2.0;
    let (mut touched, mut parted) = (0, 0);
    rig.run(0.05, Setpoint::Idle, |before, after| {
        let twist = before.shaft.theta_m - before.load_angle;
        if twist > 0.05 {
            touched += 1;
            parted += i32::from(before.shaft.omega_m < before.load_speed);
            assert!(
                after.load_speed >= before.load_speed,
                "the load is pulled at a twist of {twist} rad"
            );
        }
    });
    assert!(touched > 1000 && parted > 100, "{touched} {parted}");
}

#[test]
fn each_side_has_its_share_of_friction_at_its_own_speed() {
    // The load alone moves inside a wide play: J_l dω/dt = −s (T_d + ΔT e^(−(ω/ω_s)²)).
    let mut params = coasting();
    params.transmission.backlash = 0.01;
    params.transmission.friction_dynamic = 0.2;
    params.transmission.friction_static = 0.4;
    let values = [
        ("compliance_hz", 100.0),
        ("stribeck_nm", 0.2),
        ("load_friction_share", 0.4),
    ];
    let mut rig = Rig::new(&params, &values);
    rig.state.load_speed = 20.0;
    rig.settle(100e-6, Setpoint::Idle);
    let torque = 0.4 * (0.2 + 0.2 * (-4.0f64).exp());
    close(
        rig.state.load_speed - 20.0,
        -torque / 0.23e-3 * 100e-6,
        1e-4,
        "change of speed",
    );
    rig.state.load_speed = 0.0;
    rig.state.shaft.omega_m = 20.0;
    rig.settle(100e-6, Setpoint::Idle);
    let torque = 0.6 * (0.2 + 0.2 * (-4.0f64).exp());
    close(
        rig.state.shaft.omega_m - 20.0,
        -torque / 0.77e-3 * 100e-6,
        1e-4,
        "change of speed",
    );
}

#[test]
fn friction_on_the_load_side_ripples_with_the_angle_of_the_load() {
    // The load alone moves inside a wide play: J_l dω/dt = −s T_d (1 + a sin N θ_l).
    let mut params = coasting();
    params.transmission.backlash = 0.02;
    params.transmission.friction_dynamic = 0.2;
    params.transmission.friction_static = 0.2;
    let values = [
        ("compliance_hz", 100.0),
        ("mesh_ripple", 0.4),
        ("gear_teeth", 11.0),
        ("load_friction_share", 0.5),
    ];
    for angle in [0.1, 0.2, 0.4, 0.5, 0.9] {
        let mut rig = Rig::new(&params, &values);
        rig.state.load_angle = angle;
        rig.state.load_speed = 20.0;
        rig.settle(100e-6, Setpoint::Idle);
        // After half of the way, 1 mrad.
        let torque = 0.5 * 0.2 * (1.0 + 0.4 * (11.0f64 * (angle + 1e-3)).sin());
        let change = rig.state.load_speed - 20.0;
        close(change, -torque / 0.23e-3 * 100e-6, 2e-4, "change of speed");
    }
}

#[test]
fn the_shaft_breaks_away_at_the_static_torque_of_its_tooth() {
    let mut params = coasting();
    params.transmission.friction_dynamic = 0.15;
    params.transmission.friction_static = 0.30;
    let moves = |values: &[(&str, f64)], theta_m: f64, torque: f64| {
        let load = ("unmeasured_load_nm", 100.0 * torque);
        let values: Vec<_> = values.iter().copied().chain([load]).collect();
        let mut rig = Rig::with_fault(&params, &FaultVector::NOMINAL, theta_m, &values);
        let mut moved = false;
        rig.run(1e-3, Setpoint::Idle, |_, s| moved |= s.shaft.omega_m.abs() > 0.0);
        moved
    };
    for theta_m in [0.05f64, 0.2, 0.33] {
        let limit = 0.30 * (1.0 + 0.4 * (13.0 * theta_m).sin());
        let values = [("mesh_ripple", 0.4)];
        assert!(!moves(&values, theta_m, 0.99 * limit) && moves(&values, theta_m, 1.01 * limit));
    }
    // A Stribeck part that exceeds T_s − T_d raises the breakaway torque to that of the slowest motion, 0.45 Nm.
    let values = [("stribeck_nm", 0.3)];
    assert!(!moves(&values, 0.3, 0.449) && moves(&values, 0.3, 0.451));
}

/// Mean torque at a constant speed, from the current, Nm.
fn torque_at(params: &ActuatorParams, temperature: f64, omega: f64, values: &[(&str, f64)]) -> f64 {
    let mut rig = Rig::new(params, values);
    rig.plant = DetailedReference::new(
        params,
        params,
        &FaultVector::NOMINAL,
        0.0,
        temperature,
        &super::rig::effects(values),
    );
    let setpoint = Setpoint::Speed(omega);
    rig.settle(1.0, setpoint);
    let pole_pairs = rig.pole_pairs;
    let current = rig.mean(0.2, setpoint, |s| {
        ema_models::dq_from_abc(s.shaft.i, ema_models::Real::sin_cos_poly(pole_pairs * s.shaft.theta_m))[1]
    });
    current * params.motor.torque_gain()
}

#[test]
fn friction_falls_with_the_speed_along_stribecks_curve() {
    let params = ActuatorParams::bench();
    let values = [
        ("stribeck_nm", 0.15),
        ("stribeck_speed_rad_s", 12.0),
        ("pwm_frequency_hz", 20e3),
    ];
    for omega in [3.0, 6.0, 12.0, 24.0, 60.0] {
        let torque = torque_at(&params, 20.0, omega, &values);
        let expected = 0.15 + 0.15 * (-(omega / 12.0).powi(2)).exp() + 1e-3 * omega;
        println!("{omega} rad/s: {torque} Nm, expected {expected}");
        close(torque, expected, 3e-3, "friction, Nm");
    }
}

#[test]
fn friction_follows_the_temperature() {
    let params = ActuatorParams::bench();
    let values = [
        ("viscous_temperature", 3.0),
        ("dry_temperature", 0.5),
        ("pwm_frequency_hz", 20e3),
    ];
    for temperature in [-40.0f64, 20.0, 40.0] {
        let cold = (20.0 - temperature) / 80.0;
        for omega in [40.0, 140.0] {
            let expected = 0.15 * 1.5f64.powf(cold) + 1e-3 * 4f64.powf(cold) * omega;
            let torque = torque_at(&params, temperature, omega, &values);
            close(torque, expected, 3e-3, "friction, Nm");
        }
    }
}

/// Work on a coasting shaft from its speed, J, at each of its angles, rad.
fn coast(mut params: ActuatorParams, omega: f64, values: &[(&str, f64)], visit: impl Fn(f64) -> f64) -> ActuatorParams {
    params.motor.j = 0.02;
    let mut rig = Rig::new(&params, values);
    rig.state.shaft.omega_m = omega;
    let energy = |s: &DetailedState| 0.5 * params.motor.j * s.shaft.omega_m * s.shaft.omega_m;
    let (begin, expected) = (energy(&rig.state), visit(0.3));
    let mut worst = 0.0f64;
    rig.run(0.3, Setpoint::Idle, |_, s| {
        let work = energy(s) - begin;
        worst = worst.max((work - (visit(s.shaft.theta_m) - expected)).abs());
    });
    assert!(rig.state.shaft.theta_m > TAU, "less than a revolution");
    assert!(worst < 2e-3, "worst deviation of the work {worst} J");
    params
}

#[test]
fn cogging_stores_energy_and_does_no_work_over_a_period() {
    // ∫ T_c sin(N θ + φ) dθ = −(T_c/N) cos(N θ + φ), the same after each period.
    let values = [("cogging_nm", 2.0), ("cogging_phase_rad", 0.7)];
    coast(coasting(), 40.0, &values, |theta| {
        -2.0 / 24.0 * (24.0 * theta + 0.7).cos()
    });
    let values = [("cogging_nm", 2.0), ("cogging_periods", 42.0)];
    coast(coasting(), 40.0, &values, |theta| -2.0 / 42.0 * (42.0 * theta).cos());
}

#[test]
fn friction_ripples_with_each_tooth_about_its_mean() {
    // ∫ T_d (1 + a sin N θ) dθ = T_d (θ − (a/N) cos N θ).
    let mut params = coasting();
    params.transmission.friction_dynamic = 0.5;
    params.transmission.friction_static = 0.5;
    let values = [("mesh_ripple", 0.4), ("gear_teeth", 11.0)];
    coast(params, 40.0, &values, |theta| {
        -0.5 * (theta - 0.4 / 11.0 * (11.0 * theta).cos())
    });
}

#[test]
fn a_spring_swings_the_shaft_without_loss() {
    // J ω² = (k_s/n²) θ²: the shaft turns back at ω₀ √(J n²/k_s) and passes its start with the same speed after half a period.
    let params = coasting();
    let stiffness = 500.0 / 100.0f64.powi(2);
    let natural = (stiffness / params.motor.j).sqrt();
    let mut rig = Rig::new(&params, &[("spring_nm_per_rad", 500.0)]);
    rig.state.shaft.omega_m = 30.0;
    let mut farthest = 0.0f64;
    rig.run(PI / natural, Setpoint::Idle, |_, s| {
        farthest = farthest.max(s.shaft.theta_m - 0.3)
    });
    close(farthest, 30.0 / natural, 2e-3 * 30.0 / natural, "amplitude, rad");
    close(rig.state.shaft.omega_m, -30.0, 0.02, "speed after half a period");
    close(rig.state.shaft.theta_m, 0.3, 5e-3, "angle after half a period");
}

#[test]
fn unmeasured_loads_accelerate_the_shaft_by_their_torque() {
    // J dω/dt = −(T_u + T_w sin 2πt/τ)/n.
    let params = coasting();
    let values = [
        ("unmeasured_load_nm", 3.0),
        ("load_drift_nm", 20.0),
        ("load_drift_period_s", 0.2),
    ];
    let mut rig = Rig::new(&params, &values);
    for _ in 0..4 {
        rig.settle(0.06, Setpoint::Idle);
        let t = rig.state.shaft.steps as f64 * 1e-6;
        let impulse = 3.0 * t + 20.0 * 0.2 / TAU * (1.0 - (TAU * t / 0.2).cos());
        close(
            rig.state.shaft.omega_m,
            -impulse / 100.0 / params.motor.j,
            1e-3,
            "speed, rad/s",
        );
    }
}

#[test]
fn each_deviation_scales_one_parameter() {
    let flat = |p: &ActuatorParams| {
        let (m, t, c) = (&p.motor, &p.transmission, &p.controller);
        [
            m.k,
            m.r_s,
            m.l_s,
            m.j,
            m.c,
            t.friction_dynamic,
            t.friction_static,
            t.backlash,
            t.efficiency_opposing,
            t.efficiency_aiding,
            m.v_dc,
            m.i_max,
            c.g_p,
            c.k_p,
            c.k_i,
            c.omega_max,
        ]
    };
    let same = |a: [f64; 16], b: [f64; 16]| a.map(f64::to_bits) == b.map(f64::to_bits);
    let names: Vec<&str> = ema_models::reference::EFFECTS
        .iter()
        .map(|info| info.name)
        .filter(|name| name.ends_with("_deviation"))
        .collect();
    let params = proportional();
    let params = ActuatorParams {
        controller: ActuatorParams::bench().controller,
        ..params
    };
    assert_eq!(names.len(), flat(&params).len());
    for (n, name) in names.iter().enumerate() {
        let deviations = super::rig::effects(&[(name, 0.08)]).deviations;
        // Parameters of the hardware come first, those of the controller from I_max on.
        let found = if n < 11 {
            assert!(same(flat(&deviations.controller(&params)), flat(&params)));
            flat(&deviations.hardware(&params))
        } else {
            assert!(same(flat(&deviations.hardware(&params)), flat(&params)));
            flat(&deviations.controller(&params))
        };
        for (m, (found, before)) in found.into_iter().zip(flat(&params)).enumerate() {
            let expected = if m == n { 1.08 * before } else { before };
            close(found, expected, 1e-12 * before, name);
        }
    }
}
