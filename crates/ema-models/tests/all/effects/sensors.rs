//! Currents, angles and the instants at which they are sampled.

use core::f64::consts::TAU;

use super::rig::{Rig, close, effects, flywheel, locked, phasor};
use ema_models::reference::{Drive, EFFECTS, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample, Setpoint};

#[test]
fn the_drive_controls_the_currents_that_its_sensors_show() {
    // In the steady state, measured currents are the references: (1 + g_j) i_j + o_j. A star makes Σ i_j = 0, so the sensors'
    // common part stays as error of the measured currents.
    let params = locked();
    let values = [
        ("current_gain_a", 0.03),
        ("current_offset_b_a", 0.2),
        ("two_current_sensors", 1.0),
        ("pwm_frequency_hz", 20e3),
    ];
    let mut rig = Rig::new(&params, &values);
    let setpoint = rig.for_current(5.0, 0.0);
    rig.settle(0.3, setpoint);
    let seen = rig.plant.sampled_currents(&rig.state);
    close(seen.iter().sum::<f64>(), 0.0, 1e-12, "sum of the measured currents");
    let i = rig.state.shaft.i;
    close(seen[0], 1.03 * i[0], 1e-12, "phase A");
    close(seen[1], i[1] + 0.2, 1e-12, "phase B");
    // With two sensors the measured currents have no common part, so they reach 5 A s_j exactly.
    for (j, seen) in seen.into_iter().enumerate() {
        let expected = -5.0 * (4.0 * 0.3 - TAU / 3.0 * j as f64).sin();
        close(seen, expected, 5e-3, "measured current, A");
    }
}

#[test]
fn the_hysteresis_drive_compares_measured_currents_at_the_measured_angle() {
    // Means over many periods: (1 + g_j) i_j + o_j = I s_j, without common part with two sensors, at the angle that the resolver
    // shows.
    let angle = 4.0 * 0.3f64;
    for (error, values) in [
        (0.0, [("current_gain_a", 0.2), ("current_offset_b_a", 0.5)]),
        (
            0.2 * angle.sin(),
            [("resolver_error_1_rad", 0.2), ("resolver_phase_1_rad", 0.0)],
        ),
    ] {
        let values = [values[0], values[1], ("two_current_sensors", 1.0)];
        let mut rig = Rig::new(&locked(), &values);
        let setpoint = rig.for_current(5.0, 0.0);
        rig.settle(0.05, setpoint);
        let found: [f64; 3] = core::array::from_fn(|j| rig.mean(0.05, setpoint, |s| s.shaft.i[j]));
        let reference = |j: f64| -5.0 * (angle + error - TAU / 3.0 * j).sin();
        let expected = if error > 0.0 {
            [reference(0.0), reference(1.0)]
        } else {
            [reference(0.0) / 1.2, reference(1.0) - 0.5]
        };
        println!("{found:?}, expected {expected:?}");
        for j in 0..2 {
            close(found[j], expected[j], 0.05, "mean current, A");
        }
    }
}

#[test]
fn with_two_sensors_the_noise_of_the_samples_has_no_common_part() {
    let mut scenario = Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 2);
    scenario.sensing.noise_rms = 0.05;
    scenario.actuations.length = 0.05;
    scenario.effects = effects(&[("two_current_sensors", 1.0)]);
    for sample in scenario.run() {
        close(
            sample.currents.iter().sum::<f64>(),
            0.0,
            1e-12,
            "sum of the currents, A",
        );
    }
}

#[test]
fn the_current_filter_attenuates_and_delays_as_one_pole() {
    // A pole at f_c: gain 1/√(1 + (f/f_c)²), phase −atan(f/f_c), at 200 Hz electrical.
    let omega = TAU * 50.0;
    let mut params = flywheel();
    params.controller.hysteresis = 1e6;
    let mut rig = Rig::new(&params, &[("current_filter_hz", 1000.0)]);
    rig.state.shaft.omega_m = omega;
    rig.settle(0.1, Setpoint::Idle);
    let (mut bare, mut seen) = (Vec::new(), Vec::new());
    for _ in 0..20_000 {
        bare.push(rig.state.shaft.i[0]);
        seen.push(rig.plant.sampled_currents(&rig.state)[0]);
        rig.settle(1e-6, Setpoint::Idle);
    }
    let [[a, b], [c, d]] = [phasor(&bare, 4.0), phasor(&seen, 4.0)];
    close(c.hypot(d) / a.hypot(b), 1.0 / 1.04f64.sqrt(), 1e-3, "gain");
    let lag = d.atan2(c) - b.atan2(a);
    close(lag.rem_euclid(TAU), 0.2f64.atan(), 1e-3, "lag, rad");
}

#[test]
fn the_resolver_error_reaches_counts_commutation_and_speed() {
    let (first, second) = (0.02f64, 0.01f64);
    let error = |theta_e: f64| first * (theta_e + 0.4).sin() + second * (2.0 * theta_e - 0.9).sin();
    let values = [
        ("resolver_error_1_rad", first),
        ("resolver_phase_1_rad", 0.4),
        ("resolver_error_2_rad", second),
        ("resolver_phase_2_rad", -0.9),
        ("pwm_frequency_hz", 20e3),
    ];
    let lsb = TAU / 65_536.0;
    for n in 0..50 {
        let theta_m = 0.13 * f64::from(n);
        let mut rig = Rig::with_fault(&locked(), &FaultVector::NOMINAL, theta_m, &values);
        let seen = (rig.plant.motor_counts(&rig.state) as f64 + 0.5) * lsb;
        close(
            seen - theta_m,
            error(4.0 * theta_m) / 4.0,
            0.51 * lsb,
            "angle seen, rad",
        );
        if n % 10 == 0 {
            // Currents on the q axis of the angle seen have a d part of −sin(error).
            let setpoint = rig.for_current(5.0, 0.0);
            rig.settle(0.05, setpoint);
            let i_d = rig.dq(&rig.state)[0];
            close(i_d, -5.0 * error(4.0 * theta_m).sin(), 5e-3, "i_d, A");
        }
    }
    // The speed seen is that of the angle seen: ω (1 + d error/dθ_e), which the proportional controller answers.
    let omega = 20.0;
    let params = flywheel();
    let mut rig = Rig::new(&params, &values);
    rig.state.shaft.omega_m = omega;
    let gain = params.controller.k_p / params.motor.torque_gain();
    let pole_pairs = rig.pole_pairs;
    for _ in 0..500 {
        let theta_e = pole_pairs * rig.state.shaft.theta_m;
        let slope = first * (theta_e + 0.4).cos() + 2.0 * second * (2.0 * theta_e - 0.9).cos();
        rig.settle(100e-6, Setpoint::Speed(omega));
        close(
            rig.state.shaft.i_ref,
            -gain * omega * slope,
            1e-4,
            "current reference, A",
        );
    }
}

#[test]
fn the_position_loop_holds_the_angle_that_an_eccentric_encoder_shows() {
    let params = ActuatorParams::bench();
    let values = [("encoder_eccentricity_rad", 0.02), ("encoder_phase_rad", 1.0)];
    let mut rig = Rig::new(&params, &values);
    rig.settle(1.0, Setpoint::Position(0.5));
    let theta = rig.state.shaft.theta_out;
    let seen = rig.plant.output_angle(&rig.state);
    close(seen, theta + 0.02 * (theta + 1.0).sin(), 1e-12, "angle seen, rad");
    close(seen, 0.5, 5e-4, "angle held, rad");
    assert!((theta - 0.5).abs() > 0.015);
}

/// Samples of `bench` in speed mode, with these effects.
fn speed_samples(values: &[(&str, f64)]) -> Vec<SensedSample> {
    let mut scenario = Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 9);
    scenario.actuations.profile = Profile::Speed;
    scenario.effects = effects(values);
    scenario.effects.set("cogging_nm", 1e-9).unwrap();
    scenario.run().collect()
}

#[test]
fn a_latency_of_one_period_shifts_currents_or_angles_by_one_sample() {
    let plain = speed_samples(&[]);
    let late = speed_samples(&[("current_latency_s", 500e-6)]);
    for n in 1..plain.len() {
        assert_eq!(
            late[n].currents.map(f64::to_bits),
            plain[n - 1].currents.map(f64::to_bits)
        );
        assert_eq!(late[n].motor_counts, plain[n].motor_counts);
    }
    let late = speed_samples(&[("angle_latency_s", 500e-6)]);
    for n in 1..plain.len() {
        assert_eq!(late[n].currents.map(f64::to_bits), plain[n].currents.map(f64::to_bits));
        assert_eq!(late[n].motor_counts, plain[n - 1].motor_counts);
        assert_eq!(late[n].output_counts, plain[n - 1].output_counts);
    }
    // 100 µs at about 100 rad/s are 104 of 65 536 counts, a fifth of the way to the sample before.
    let late = speed_samples(&[("angle_latency_s", 100e-6)]);
    for n in 200..1000 {
        let moved = (plain[n].motor_counts - plain[n - 1].motor_counts) as f64;
        let lag = (plain[n].motor_counts - late[n].motor_counts) as f64;
        close(lag, 0.2 * moved, 4.0, "lag, counts");
    }
}

#[test]
fn jitter_is_uniform_about_the_nominal_instant() {
    let (plain, moved) = (speed_samples(&[]), speed_samples(&[("sample_jitter", 0.2)]));
    let mut instants = Vec::new();
    for n in 200..1000 {
        let per_period = 0.5 * (plain[n + 1].motor_counts - plain[n - 1].motor_counts) as f64;
        instants.push((moved[n].motor_counts - plain[n].motor_counts) as f64 / per_period);
    }
    let n = instants.len() as f64;
    let mean = instants.iter().sum::<f64>() / n;
    let deviation = (instants.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n).sqrt();
    let largest = instants.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    // A uniform distribution of half width 0.2 has a standard deviation of 0.2/√3.
    println!("mean {mean}, deviation {deviation}, largest {largest}");
    close(mean, 0.0, 4.0 * 0.1155 / n.sqrt(), "mean, periods");
    close(deviation, 0.2 / 3f64.sqrt(), 0.006, "standard deviation, periods");
    close(largest, 0.2, 0.01, "largest deviation, periods");
}

#[test]
fn every_effect_alone_and_all_together_give_finite_samples_in_both_modes() {
    for params in [ActuatorParams::bench(), ActuatorParams::servo28()] {
        let mut everything = Vec::new();
        for info in EFFECTS {
            let (_, max) = info.usual_on(&params);
            let max = if info.whole { max.round() } else { max };
            everything.push((info.name, max));
        }
        let mut sets: Vec<_> = everything.iter().map(|one| effects(&[*one])).collect();
        sets.push(effects(&everything));
        let mut hysteresis = effects(&everything);
        hysteresis.drive = Drive::Hysteresis;
        sets.push(hysteresis);
        for set in sets {
            for profile in [Profile::Mixed, Profile::Speed] {
                let fault = FaultVector {
                    short_b: 0.2,
                    ..FaultVector::NOMINAL
                };
                let mut scenario = Scenario::new(params, fault, 3);
                scenario.actuations.profile = profile;
                scenario.actuations.length = 0.2;
                scenario.effects = set;
                let names: Vec<_> = set.active().map(|(name, _)| name).collect();
                let (mut largest, mut count) = (0.0f64, 0);
                for sample in scenario.run() {
                    assert!(sample.currents.iter().all(|i| i.is_finite()), "{names:?}");
                    largest = sample.currents.iter().fold(largest, |a, b| a.max(b.abs()));
                    count += 1;
                }
                assert_eq!(count, 560, "{names:?}");
                assert!(largest < 1.7 * params.motor.i_max, "{names:?}: {largest} A");
                assert!(largest > 0.05 * params.motor.i_max, "{names:?}: {largest} A");
            }
        }
    }
}

#[test]
fn values_at_their_limits_stay_finite() {
    for name in ActuatorParams::BUILT_IN {
        let params = ActuatorParams::built_in(name).unwrap();
        for info in EFFECTS {
            let limits = [info.limits.0, info.limits.1];
            for (value, drive) in limits
                .into_iter()
                .flat_map(|value| [(value, "hysteresis"), (value, "vector")])
            {
                let mut set = effects(&[(info.name, value)]);
                if set.drive == Drive::Hysteresis {
                    set.drive = Drive::from_name(drive).unwrap();
                }
                // The effect whose parameter it is, at its usual value.
                if let Some(part_of) = EFFECTS.iter().find(|other| Some(other.name) == info.part_of) {
                    set.set(part_of.name, part_of.usual_on(&params).1).unwrap();
                }
                // One or two windings with hardly any turn left, whose currents no drive controls.
                for short in [0.0, 1.0] {
                    let fault = FaultVector {
                        short_a: short,
                        short_b: short,
                        short_c: 1.0 - short,
                        ..FaultVector::NOMINAL
                    };
                    let mut scenario = Scenario::new(params, fault, 3);
                    scenario.actuations.length = 0.05;
                    scenario.actuations.rest = 0.02;
                    scenario.effects = set;
                    let mut run = scenario.run();
                    run.by_ref().for_each(drop);
                    assert!(
                        run.diverged().is_none(),
                        "{name}: {} = {value}, {drive}, {short}",
                        info.name
                    );
                }
            }
        }
    }
}

#[test]
fn a_simulation_that_diverges_ends_and_says_so() {
    // A winding without inductance: the current of one step is beyond every number after some.
    for values in [&[][..], &[("cogging_nm", 0.05)]] {
        let mut scenario = Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 3);
        scenario.effects = effects(values);
        let mut healthy = scenario.run();
        let samples = healthy.by_ref().count();
        assert!(healthy.diverged().is_none());
        scenario.unit.motor.j = 1e-12;
        scenario.unit.motor.l_s = 1e-12;
        let mut run = scenario.run();
        let mut count = 0_usize;
        for sample in run.by_ref() {
            assert!(sample.currents.iter().all(|i| i.is_finite()));
            count += 1;
        }
        assert!(count < samples, "{count}");
        let diverged = run.diverged().unwrap();
        close(diverged, count as f64 / 2000.0, 1e-12, "time, s");
        assert!(run.next().is_none());
    }
}
