//! What the samples of a scenario hold, against the state at the instant at which they are latched.

use core::f64::consts::TAU;

use super::rig::{close, effects};
use ema_models::reference::{ReferenceState, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample};

/// Samples of `bench` with these effects, and the true state at the instant of each.
fn samples(profile: Profile, rate: f64, values: &[(&str, f64)]) -> Vec<(SensedSample, ReferenceState)> {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = rate;
    let mut scenario = Scenario::new(params, FaultVector::NOMINAL, 9);
    scenario.actuations.profile = profile;
    scenario.actuations.length = 0.2;
    scenario.effects = effects(values);
    let mut run = scenario.run();
    let mut samples = Vec::new();
    while let Some(sample) = run.next() {
        samples.push((sample, *run.state()));
    }
    samples
}

/// Counts of an angle, with a slack of one at the border of two.
fn counts(got: i64, angle: f64, lsb: f64, what: &str) {
    close(got as f64 + 0.5, angle / lsb, 0.501, what);
}

#[test]
fn the_samples_hold_currents_with_the_gain_and_offset_of_their_sensors() {
    let values = [
        ("current_gain_a", 0.01),
        ("current_gain_b", -0.02),
        ("current_gain_c", 0.03),
        ("current_offset_a_a", 0.05),
        ("current_offset_b_a", -0.04),
        ("current_offset_c_a", 0.03),
    ];
    let (gains, offsets) = ([1.01, 0.98, 1.03], [0.05, -0.04, 0.03]);
    for (sample, state) in samples(Profile::Mixed, 2000.0, &values) {
        for j in 0..3 {
            let expected = gains[j] * state.i[j] + offsets[j];
            close(sample.currents[j], expected, 1e-12, "sampled current, A");
        }
    }
}

#[test]
fn the_samples_hold_filtered_currents() {
    // dy/dt = ω_c (i − y), exact for currents that are straight from one sample to the next; the drive's ripple is not.
    let (rate, cut_off) = (10e3, 300.0);
    let values = [("current_filter_hz", cut_off), ("pwm_frequency_hz", 20e3)];
    let samples = samples(Profile::Mixed, rate, &values);
    let tau = 1.0 / (TAU * cut_off);
    let kept = (-1.0 / (rate * tau)).exp();
    let (mut y, mut largest) = ([0.0; 3], 0.0f64);
    for pair in samples.windows(2) {
        for j in 0..3 {
            let (from, to) = (pair[0].1.i[j], pair[1].1.i[j]);
            let lag = (to - from) * rate * tau;
            y[j] = to - lag + (y[j] - from + lag) * kept;
            close(pair[1].0.currents[j], y[j], 0.1, "filtered current, A");
            largest = largest.max((y[j] - to).abs());
        }
    }
    assert!(largest > 3.0, "{largest} A between the current and its filtered value");
}

#[test]
fn the_samples_hold_the_angles_that_resolver_and_encoder_see() {
    let values = [
        ("resolver_error_1_rad", 0.02),
        ("resolver_phase_1_rad", 0.4),
        ("resolver_error_2_rad", 0.01),
        ("resolver_phase_2_rad", -0.9),
        ("encoder_eccentricity_rad", 0.02),
        ("encoder_phase_rad", 1.0),
    ];
    let sensors = ActuatorParams::bench().sensors;
    for (sample, state) in samples(Profile::Mixed, 2000.0, &values) {
        let theta_e = 4.0 * state.theta_m;
        let error = 0.02 * (theta_e + 0.4).sin() + 0.01 * (2.0 * theta_e - 0.9).sin();
        counts(
            sample.motor_counts,
            state.theta_m + error / 4.0,
            sensors.motor_lsb(),
            "resolver",
        );
        let seen = state.theta_out + 0.02 * (state.theta_out + 1.0).sin();
        counts(sample.output_counts, seen, sensors.output_lsb(), "output encoder");
    }
}

#[test]
fn currents_and_angles_jitter_together() {
    let sensors = ActuatorParams::bench().sensors;
    let (mut early, mut late) = (0, 0);
    let samples = samples(Profile::Speed, 2000.0, &[("sample_jitter", 0.2)]);
    for (n, (sample, state)) in samples.into_iter().enumerate() {
        for j in 0..3 {
            close(sample.currents[j], state.i[j], 1e-12, "sampled current, A");
        }
        counts(sample.motor_counts, state.theta_m, sensors.motor_lsb(), "resolver");
        counts(
            sample.output_counts,
            state.theta_out,
            sensors.output_lsb(),
            "output encoder",
        );
        let moved = state.steps as i64 - 500 * n as i64;
        early += i32::from(moved < -50);
        late += i32::from(moved > 50);
    }
    assert!(early > 50 && late > 50, "{early} early, {late} late");
}

#[test]
fn a_latency_of_several_periods_is_realised_with_jitter_too() {
    // At 10 kHz; 400 µs are four periods. Jitter moves both instants of a sample alike, so currents are those of a unit whose
    // angles are as old, and angles those of a unit whose currents are.
    let samples = |[current, angle]: [f64; 2], jitter: f64| -> Vec<SensedSample> {
        let values = [
            ("current_latency_s", current),
            ("angle_latency_s", angle),
            ("sample_jitter", jitter),
            ("cogging_nm", 0.05),
        ];
        let samples = samples(Profile::Speed, 10e3, &values);
        samples.into_iter().map(|(sample, _)| sample).collect()
    };
    for jitter in [0.0, 0.3] {
        for ages in [
            [30e-6, 0.0],
            [130e-6, 0.0],
            [400e-6, 0.0],
            [0.0, 400e-6],
            [50e-6, 500e-6],
        ] {
            let found = samples(ages, jitter);
            let [as_currents, as_angles] = ages.map(|age| samples([age; 2], jitter));
            for (n, sample) in found.iter().enumerate() {
                let expected = as_currents[n].currents.map(f64::to_bits);
                assert_eq!(sample.currents.map(f64::to_bits), expected, "{ages:?} {jitter} {n}");
                assert_eq!(sample.motor_counts, as_angles[n].motor_counts, "{ages:?} {jitter} {n}");
                assert_eq!(
                    sample.output_counts, as_angles[n].output_counts,
                    "{ages:?} {jitter} {n}"
                );
            }
        }
    }
    let (prompt, late) = (samples([0.0; 2], 0.0), samples([400e-6, 0.0], 0.0));
    for n in 4..prompt.len() {
        let expected = prompt[n - 4].currents.map(f64::to_bits);
        assert_eq!(late[n].currents.map(f64::to_bits), expected);
        assert_eq!(late[n].motor_counts, prompt[n].motor_counts);
    }
}
