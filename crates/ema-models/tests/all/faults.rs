//! Effect of each fault on the reference model, in direction and amount, and the exact instants of control and sampling.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use core::f64::consts::{PI, TAU};
use ema_models::reference::{Reference, ReferenceState, Scenario, encoder_count};
use ema_models::{ActuatorParams, FaultVector, Profile, Real, SensedSample, Setpoint, dq_from_abc, phase_shapes};

const DT: f64 = 1e-6;

fn close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (got - expected).abs() <= tolerance,
        "{what}: {got}, expected {expected} ± {tolerance}"
    );
}

fn fault(index: usize, k: f64) -> FaultVector {
    let mut vector = FaultVector::NOMINAL.to_array();
    vector[index] = k;
    FaultVector::from_array(vector)
}

fn start(params: &ActuatorParams, fault: &FaultVector) -> (Reference, ReferenceState) {
    (
        Reference::new(params, params, fault, 0.0),
        ReferenceState::at_rest(0.0, 0.0),
    )
}

fn settle(reference: &Reference, state: &mut ReferenceState, duration: f64, setpoint: Setpoint) {
    for _ in 0..(duration / DT).round() as u64 {
        reference.step(state, setpoint);
    }
}

// ------------------------------------------------------------------------------------ direction, amount

#[test]
fn friction_raises_the_steady_current_by_its_torque_over_the_gain() {
    let params = ActuatorParams::bench();
    let steady = |k1: f64| {
        let (reference, mut state) = start(&params, &fault(0, k1));
        settle(&reference, &mut state, 1.0, Setpoint::Speed(80.0));
        let (mut sum, steps) = (0.0, 100_000);
        for _ in 0..steps {
            reference.step(&mut state, Setpoint::Speed(80.0));
            sum += dq_from_abc(state.i, (4.0 * state.theta_m).sin_cos_poly())[1];
        }
        sum / f64::from(steps)
    };
    let healthy = steady(0.0);
    for k1 in [0.25, 0.5, 1.0] {
        // ΔT_d = 2 k1 · 0.15 Nm at 1.350 Nm/A.
        close(steady(k1) - healthy, 2.0 * k1 * 0.15 / 1.350, 2e-3, "rise of i_q");
    }
}

#[test]
fn friction_holds_the_shaft_up_to_the_static_torque() {
    let params = ActuatorParams::bench();
    for k1 in [0.0, 0.5, 1.0] {
        let limit = 0.30 * (1.0 + 2.0 * k1);
        for (share, moves) in [(0.999, false), (1.001, true)] {
            let (reference, mut state) = start(&params, &fault(0, k1));
            // Phase currents I s_j give exactly 1.5 k I on a healthy winding.
            state.i = phase_shapes((0.0f64).sin_cos_poly()).map(|s| s * share * limit / 1.350);
            reference.step(&mut state, Setpoint::Idle);
            assert_eq!(state.omega_m > 0.0, moves, "k1 = {k1}: {}", state.torque);
        }
    }
}

#[test]
fn the_output_lags_by_the_width_of_the_backlash() {
    let params = ActuatorParams::bench();
    for k2 in [0.0, 0.25, 1.0] {
        let b = 1e-4 * (1.0 + 99.0 * k2);
        let (reference, mut state) = start(&params, &fault(1, k2));
        settle(&reference, &mut state, 0.2, Setpoint::Speed(20.0));
        close(state.theta_m / 100.0 - state.theta_out, 0.5 * b, 1e-12, "lag forwards");
        // After a reversal, the output rests until the motor has crossed the whole backlash.
        let stopped_at = state.theta_out;
        let mut turning_point = f64::MIN;
        let mut crossed = 0.0;
        for _ in 0..1_000_000 {
            reference.step(&mut state, Setpoint::Speed(-20.0));
            turning_point = turning_point.max(state.theta_m / 100.0);
            if state.omega_m < 0.0 && state.theta_out < turning_point - 0.5 * b - 1e-9 {
                crossed = turning_point - state.theta_m / 100.0;
                break;
            }
        }
        assert!(state.theta_out >= stopped_at - 1e-6);
        // Up to the travel of one step, 20 rad/s / 100 · 1 µs.
        close(crossed, b, 3e-7, "way of the motor before the output turns");
        close(
            state.theta_m / 100.0 - state.theta_out,
            -0.5 * b,
            1e-12,
            "lag backwards",
        );
    }
}

/// k_j of the three phases, V·s/rad: the torque of one ampere through each alone, measured on the model at rest.
fn measured_k(params: &ActuatorParams, fault: &FaultVector, theta_e: f64) -> [f64; 3] {
    let reference = Reference::new(params, params, fault, 0.0);
    let torque = |i: [f64; 3]| {
        let mut state = ReferenceState::at_rest(theta_e / params.motor.pole_pairs, 0.0);
        state.i = i;
        reference.step(&mut state, Setpoint::Idle);
        state.torque
    };
    // A star connection cannot carry a single phase current, but T = Σ k_j i_j holds for it.
    [
        torque([1.0, 0.0, 0.0]),
        torque([0.0, 1.0, 0.0]),
        torque([0.0, 0.0, 1.0]),
    ]
}

#[test]
fn a_short_reduces_the_coefficient_of_its_phase_only() {
    let params = ActuatorParams::bench();
    for phase in 0..3 {
        for k in [0.25, 0.75, 1.0] {
            for n in 0..12 {
                let theta_e = f64::from(n) * 0.55;
                let got = measured_k(&params, &fault(2 + phase, k), theta_e);
                for (j, k_j) in got.iter().enumerate() {
                    // The turns ratio is at least 1 %.
                    let intact = if j == phase { (1.0 - k).max(0.01) } else { 1.0 };
                    let expected = 0.900 * intact * -(theta_e - TAU / 3.0 * j as f64).sin();
                    close(*k_j, expected, 1e-10, "k_j");
                }
            }
        }
    }
}

#[test]
fn eccentricity_modulates_the_torque_by_half_its_amplitude() {
    let params = ActuatorParams::bench();
    for (zeta, k7) in [(0.2, 0.5), (0.6, 0.1), (1.0, 0.85)] {
        let mut vector = fault(5, zeta);
        vector.eccentricity_phase = k7;
        let phi = PI * (2.0 * k7 - 1.0);
        let reference = Reference::new(&params, &params, &vector, 0.0);
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for n in 0..720 {
            let theta_e = f64::from(n) * TAU / 720.0;
            let mut state = ReferenceState::at_rest(theta_e / 4.0, 0.0);
            state.i = phase_shapes(theta_e.sin_cos_poly()).map(|s| 5.0 * s);
            reference.step(&mut state, Setpoint::Idle);
            let shape = state.torque / (1.350 * 5.0);
            close(
                shape,
                1.0 - 0.5 * zeta * (theta_e + phi).cos(),
                1e-10,
                "torque over G_T i_q",
            );
            low = low.min(shape);
            high = high.max(shape);
        }
        close(high - low, zeta, 1e-4, "peak to peak");
    }
}

#[test]
fn gain_scales_the_first_response_and_the_lag_behind_a_ramp() {
    let params = ActuatorParams::bench();
    for k8 in [0.25, 0.5, 0.875] {
        let gain = 2500.0 * (0.5 + k8);
        // First response to eight counts: I_ref = K_p G_p (0.5 + k8) e / G_T, below the speed and current limits.
        let (reference, mut state) = start(&params, &fault(7, k8));
        let e = 8.0 * TAU / 20_000.0;
        reference.step(&mut state, Setpoint::Position(e));
        close(state.i_ref, 0.4 * gain * e / 1.350, 1e-9, "first I_ref");

        // Behind a ramp of 0.4 rad/s the motor runs at 40 rad/s, so ω_ref = G_p (0.5 + k8) e determines the deviation. Counts
        // are rounded down, so the true deviation is half a count smaller on average.
        let (reference, mut state) = start(&params, &fault(7, k8));
        let (mut sum, mut n) = (0.0, 0.0);
        for step in 0..2_000_000u32 {
            let command = 0.4 * f64::from(step - step % 100) * DT;
            reference.step(&mut state, Setpoint::Position(command));
            if step >= 1_600_000 && step % 100 == 0 {
                sum += command - state.theta_out;
                n += 1.0;
            }
        }
        close(sum / n, 40.0 / gain - 0.5 * TAU / 20_000.0, 2e-5, "lag behind the ramp");
    }
}

#[test]
fn a_unit_with_another_k_is_controlled_with_the_nominal_torque_gain() {
    let nominal = ActuatorParams::bench();
    let mut unit = nominal;
    unit.motor.k *= 1.05;
    let reference = Reference::new(&unit, &nominal, &FaultVector::NOMINAL, 0.0);
    let mut state = ReferenceState::at_rest(0.0, 0.0);
    settle(&reference, &mut state, 5e-3, Setpoint::Speed(200.0));
    close(state.i_ref, 10.7, 1e-12, "I_ref at the torque limit");
    let [_, i_q] = dq_from_abc(state.i, (4.0 * state.theta_m).sin_cos_poly());
    close(state.torque / i_q, 1.05 * 1.350, 5e-3, "torque per ampere");
}

// ------------------------------------------------------------------------------------ timing, sampling

#[test]
fn the_current_reference_changes_at_multiples_of_the_control_period() {
    let params = ActuatorParams::bench();
    let (reference, mut state) = start(&params, &FaultVector::NOMINAL);
    let mut changes = 0;
    for step in 0..20_000u64 {
        let before = state.i_ref;
        assert_eq!(state.steps, step);
        reference.step(&mut state, Setpoint::Speed(50.0));
        if before.to_bits() != state.i_ref.to_bits() {
            assert_eq!(step % 100, 0, "i_ref changed at {step} µs");
            changes += 1;
        }
    }
    assert!(changes > 150, "{changes}");
}

#[test]
fn the_phase_references_follow_the_rotor_in_every_step() {
    // The phase references follow the rotor between two control periods. At 160 rad/s the electrical angle changes by 3.7° in
    // 100 µs; references that were constant over this time would cause a direct current of 0.69 A.
    let params = ActuatorParams::bench();
    let (reference, mut state) = start(&params, &FaultVector::NOMINAL);
    settle(&reference, &mut state, 0.0098, Setpoint::Speed(200.0));
    for _ in 0..300 {
        let [d, _] = dq_from_abc(state.i, (4.0 * state.theta_m).sin_cos_poly());
        assert!(d.abs() < 0.25, "{d}");
        reference.step(&mut state, Setpoint::Speed(200.0));
    }
}

#[test]
fn a_sample_is_latched_before_its_step_and_its_setpoint_holds_until_the_next() {
    // The test reproduces the samples of the scenario step by step: all signals at t₀ + seq/f_s, before the step that starts
    // there, counts rounded down, the setpoint in whole microradians and constant over the sample period.
    for rate in [2000.0, 400.0] {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = rate;
        let scenario = Scenario::new(params, fault(1, 0.3), 7);
        let sensed: Vec<SensedSample> = scenario.run().collect();
        let truth = first_state(&scenario);
        let reference = Reference::new(&params, &params, &scenario.fault, 0.0);
        let mut state = truth;
        let per_sample = (1e6 / rate).round() as u64;
        let rest = sensed[0].setpoint;
        let moved = sensed.iter().position(|s| s.setpoint != rest).unwrap();
        assert_eq!(
            moved,
            (0.04 * rate) as usize,
            "the setpoint first changes at the end of the rest"
        );
        for (n, sample) in sensed.iter().enumerate() {
            assert_eq!(sample.seq, n as u64);
            assert_eq!(
                sample.currents.map(f64::to_bits),
                state.i.map(f64::to_bits),
                "sample {n}"
            );
            assert_eq!(
                sample.motor_counts,
                (state.theta_m * 65_536.0 / TAU).floor() as i64,
                "sample {n}"
            );
            assert_eq!(
                sample.output_counts,
                (state.theta_out * 20_000.0 / TAU).floor() as i64,
                "sample {n}"
            );
            let (Setpoint::Position(angle), Setpoint::Position(base)) = (sample.setpoint, rest) else {
                panic!("{:?}", sample.setpoint)
            };
            let micro = angle * 1e6;
            close(micro, micro.round(), 1e-6, "whole microradians");
            let tau = n as f64 / rate - 0.04;
            let profile = Profile::Mixed.commanded_angle(tau.min(0.5));
            close((angle - base).abs(), profile, 1.1e-6, "commanded angle");
            for _ in 0..per_sample {
                reference.step(&mut state, sample.setpoint);
            }
        }
    }
}

/// Initial state of the scenario, which its seed determines.
fn first_state(scenario: &Scenario) -> ReferenceState {
    *scenario.run().state()
}

#[test]
fn seeds_determine_angle_position_in_the_backlash_and_direction() {
    let params = ActuatorParams::bench();
    let (mut directions, mut angles) = ([0; 2], Vec::new());
    for seed in 0..40 {
        let scenario = Scenario::new(params, fault(1, 0.5), seed);
        let state = first_state(&scenario);
        let half = 0.5 * 1e-4 * 50.5;
        assert!((0.0..TAU).contains(&state.theta_m));
        assert!((state.theta_out - state.theta_m / 100.0).abs() <= half + 1e-15);
        angles.push(state.theta_m);
        let samples: Vec<SensedSample> = scenario.run().collect();
        let turned = samples.last().unwrap().output_counts - samples[0].output_counts;
        directions[usize::from(turned > 0)] += 1;
        close((turned as f64 * TAU / 20_000.0).abs(), 0.25, 0.02, "travel");
    }
    assert!(directions[0] > 8 && directions[1] > 8, "{directions:?}");
    angles.sort_by(f64::total_cmp);
    assert!(angles[0] < 0.8 && angles[39] > 5.5, "{angles:?}");
}

#[test]
fn counts_are_rounded_down_on_both_sides_of_zero() {
    let lsb = ActuatorParams::bench().sensors.output_lsb();
    for (angle, expected) in [(0.0, 0), (0.99, 0), (1.01, 1), (-0.01, -1), (-1.0, -1), (-1.01, -2)] {
        assert_eq!(encoder_count(angle * lsb, lsb), expected, "{angle} counts");
    }
}
