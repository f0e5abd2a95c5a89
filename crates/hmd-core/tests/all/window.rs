//! Windows out of simulated actuations, on good and on bad links.

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample, Setpoint};
use hmd_core::window::{
    Counter, CutShort, Defect, Degradation, Invalidity, Signal, TimedSample, Window, WindowConfig, WindowQuality,
    Windower,
};
use std::sync::OnceLock;

const T_0: u64 = 1_700_000_000_000_000_000;

/// What the two other sensors' suites call noise: 12-bit converters, 50 mA.
const NOISY: CurrentSensing = CurrentSensing {
    quantised: true,
    noise_rms: 0.05,
};

fn at_rate(mut params: ActuatorParams, rate: f64) -> ActuatorParams {
    params.sensors.sample_rate = rate;
    params
}

pub(crate) fn bench(rate: f64) -> ActuatorParams {
    at_rate(ActuatorParams::bench(), rate)
}

pub(crate) fn timed(sensed: SensedSample, rate: f64) -> TimedSample {
    TimedSample {
        seq: sensed.seq,
        stamp_ns: T_0 + (1e9 * sensed.seq as f64 / rate).round() as u64,
        sensed,
    }
}

/// Samples of a scenario; the series begins 40 ms before the command.
fn simulate(scenario: &Scenario) -> Vec<TimedSample> {
    let rate = scenario.nominal.sensors.sample_rate;
    scenario.run().map(|sensed| timed(sensed, rate)).collect()
}

/// One noisy mixed actuation of the bench at 2 kHz: samples 0…1159, command from sample 80 on.
pub(crate) fn mixed() -> Vec<TimedSample> {
    static SAMPLES: OnceLock<Vec<TimedSample>> = OnceLock::new();
    let make = || {
        simulate(&Scenario {
            sensing: NOISY,
            ..Scenario::new(bench(2000.0), FaultVector::NOMINAL, 7)
        })
    };
    SAMPLES.get_or_init(make).clone()
}

pub(crate) fn windows(params: &ActuatorParams, samples: &[TimedSample]) -> Vec<Window> {
    let mut windower = Windower::new(WindowConfig::default(), params).expect("default settings");
    let mut windows: Vec<Window> = samples.iter().filter_map(|&sample| windower.push(sample)).collect();
    windows.extend(windower.finish());
    windows
}

/// The only window of samples at 2 kHz.
pub(crate) fn only(samples: &[TimedSample]) -> Window {
    let mut all = windows(&bench(2000.0), samples);
    assert_eq!(
        all.len(),
        1,
        "{:?}",
        all.iter().map(|w| w.quality.to_string()).collect::<Vec<_>>()
    );
    all.remove(0)
}

fn invalidity(window: &Window) -> Invalidity {
    match &window.quality {
        WindowQuality::Invalid(why) => *why,
        other => panic!("{other:?}"),
    }
}

fn flawed(window: &Window) -> Defect {
    match invalidity(window) {
        Invalidity::TooManyFlawed { defect, .. } => defect,
        other => panic!("{other:?}"),
    }
}

/// Samples of an actuator that does not move, under the given setpoints.
pub(crate) fn still(setpoints: impl IntoIterator<Item = Setpoint>) -> Vec<TimedSample> {
    let sensed = setpoints.into_iter().enumerate().map(|(seq, setpoint)| SensedSample {
        seq: seq as u64,
        currents: [0.0; 3],
        motor_counts: 0,
        output_counts: 0,
        setpoint,
    });
    sensed.map(|sensed| timed(sensed, 2000.0)).collect()
}

// Good data.

#[test]
fn every_profile_and_actuator_gives_one_complete_window_with_an_exact_trigger() {
    for params in [ActuatorParams::bench(), ActuatorParams::servo28()] {
        for rate in [400.0, 2000.0] {
            for (name, profile) in Profile::NAMES {
                let params = at_rate(params, rate);
                let mut scenario = Scenario::new(params, FaultVector::NOMINAL, 11);
                scenario.actuations = Actuations::single(profile);
                let samples = simulate(&scenario);
                let all = windows(&params, &samples);
                assert_eq!(all.len(), 1, "{name} at {rate} Hz");
                let window = &all[0];
                assert_eq!(window.quality, WindowQuality::Complete, "{name} at {rate} Hz");
                // The command begins at 40 ms; a ramp or chirp passes 1 mrad some samples later.
                let change = |n: usize| (profile.commanded_angle(n as f64 / rate - 0.04) * 1e6).round();
                let expected = (0..samples.len()).find(|&n| change(n).abs() > 1000.0).unwrap();
                assert_eq!(
                    window.samples[window.trigger].seq, expected as u64,
                    "{name} at {rate} Hz"
                );
                let first = expected - (0.02 * rate) as usize;
                assert_eq!(window.samples.len(), (0.5 * rate) as usize + 1);
                assert_eq!(window.t_start_ns, samples[first].stamp_ns);
                let sensed = samples[first..].iter().map(|sample| sample.sensed);
                assert!(window.samples.iter().copied().eq(sensed.take(window.samples.len())));
                assert!((window.lost, window.rejected, window.filled.len()) == (0, 0, 0));
            }
        }
    }
}

#[test]
fn no_genuine_dynamics_are_taken_for_bad_data() {
    let vectors = [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5],
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0],
        [0.0, 0.0, 0.8, 0.0, 0.3, 0.0, 0.5, 0.5],
        [0.0, 0.0, 0.0, 0.75, 0.0, 0.9, 0.2, 0.0],
        [0.3, 0.6, 0.2, 0.1, 0.6, 0.5, 0.9, 0.9],
    ];
    for (n, k) in vectors.into_iter().enumerate() {
        for params in [ActuatorParams::bench(), ActuatorParams::servo28()] {
            for rate in [400.0, 2000.0] {
                for load_torque in [-10.0, 10.0] {
                    let params = at_rate(params, rate);
                    let small = params.motor.v_dc < 100.0;
                    let mut scenario = Scenario::new(params, FaultVector::from_array(k), 100 + n as u64);
                    scenario.sensing = NOISY;
                    scenario.load_torque = if small { 0.05 * load_torque } else { load_torque };
                    scenario.actuations.profile = Profile::NAMES[n % 4].1;
                    let all = windows(&params, &simulate(&scenario));
                    assert_eq!(all.len(), 1);
                    assert_eq!(
                        all[0].quality,
                        WindowQuality::Complete,
                        "{k:?} at {rate} Hz, small {small}, {load_torque} Nm"
                    );
                }
            }
        }
    }
}

#[test]
fn speed_mode_has_its_own_threshold() {
    let speeds = |step: f64| {
        let ramp = move |n: usize| Setpoint::Speed(50.0 + step * n.saturating_sub(99) as f64);
        only(&still((0..1300).map(ramp)))
    };
    // 0.25 rad/s more per sample: exactly 1 rad/s is not more than 1 rad/s.
    let window = speeds(0.25);
    assert_eq!(window.samples[window.trigger].seq, 104);
    assert_eq!(speeds(1.001).samples[40].seq, 100);
}

#[test]
fn a_log_without_actuation_gives_no_window() {
    assert!(windows(&bench(2000.0), &[]).is_empty());
    assert!(windows(&bench(2000.0), &still([Setpoint::Idle; 5000])).is_empty());
    // 40 mrad/s is 0.8 mrad in 20 ms: a drift, not an actuation.
    let drift = |n: u32| Setpoint::Position(2e-5 * f64::from(n));
    assert!(windows(&bench(2000.0), &still((0..5000).map(drift))).is_empty());
    // Motion from the first sample on: there was no rest.
    let ramp = |n: u32| Setpoint::Position(3e-4 * f64::from(n));
    assert!(windows(&bench(2000.0), &still((0..5000).map(ramp))).is_empty());
    // Switching on is no actuation, wherever the setpoint stands.
    let switched_on = |n: u32| {
        if n < 2000 {
            Setpoint::Idle
        } else {
            Setpoint::Position(0.3)
        }
    };
    assert!(windows(&bench(2000.0), &still((0..5000).map(switched_on))).is_empty());
}

#[test]
fn rest_of_exactly_20_ms_is_enough() {
    let step = |rest: usize| {
        let position = move |n: usize| Setpoint::Position(if n < rest { 0.0 } else { 0.25 });
        windows(&bench(2000.0), &still((0..1200).map(position)))
    };
    assert_eq!(step(40).len(), 1);
    assert_eq!(step(39).len(), 0);
}

#[test]
fn a_series_of_actuations_gives_a_window_each() {
    let mut scenario = Scenario::new(bench(400.0), FaultVector::NOMINAL, 3);
    scenario.actuations.count = 3;
    let all = windows(&scenario.nominal, &simulate(&scenario));
    assert_eq!(all.iter().map(|w| w.number).collect::<Vec<_>>(), [0, 1, 2]);
    for (n, window) in all.iter().enumerate() {
        assert_eq!(window.quality, WindowQuality::Complete);
        // The step of the mixed profile.
        let [before, at] = [window.trigger - 1, window.trigger].map(|n| match window.samples[n].setpoint {
            Setpoint::Position(angle) => angle,
            other => panic!("{other:?}"),
        });
        assert!((at - before).abs() > 0.2, "{n}");
    }
}

#[test]
fn counters_far_from_zero_and_in_either_direction_are_just_numbers() {
    for offset in [1_i64 << 40, -(1 << 40)] {
        let mut samples = mixed();
        for sample in &mut samples {
            sample.sensed.motor_counts += offset;
            sample.sensed.output_counts += offset;
            sample.seq += 1 << 50;
        }
        assert_eq!(only(&samples).quality, WindowQuality::Complete);
    }
}

// Windows that end before their time, or contain more than one actuation.

#[test]
fn windows_that_are_cut_short_say_why() {
    let cut = |samples: &[TimedSample]| {
        let all = windows(&bench(2000.0), samples);
        (all[0].samples.len(), invalidity(&all[0]), all.len())
    };
    let full = mixed();
    assert_eq!(cut(&full[..600]), (560, Invalidity::CutShort(CutShort::StreamEnded), 1));
    // The last sample of the window completes it although no sample follows.
    assert!(only(&full[..1041]).quality.is_fit());
    assert!(!only(&full[..1040]).quality.is_fit());

    let mut idle = full.clone();
    idle[600..]
        .iter_mut()
        .for_each(|sample| sample.sensed.setpoint = Setpoint::Idle);
    assert_eq!(cut(&idle), (560, Invalidity::CutShort(CutShort::WentIdle), 1));
    let mut speed = full.clone();
    speed[600..]
        .iter_mut()
        .for_each(|sample| sample.sensed.setpoint = Setpoint::Speed(0.0));
    assert_eq!(cut(&speed), (560, Invalidity::ModeChanged, 1));

    // The device restarts and counts from 0 again; the second actuation is complete.
    let restarted = [&full[..600], &full].concat();
    assert_eq!(
        cut(&restarted),
        (560, Invalidity::CutShort(CutShort::CounterWentBack), 2)
    );
    assert_eq!(windows(&bench(2000.0), &restarted)[1].quality, WindowQuality::Complete);
}

#[test]
fn another_actuation_in_the_window_is_named_and_opens_none() {
    let back = |n: usize| Setpoint::Position(if (80..480).contains(&n) { 0.25 } else { 0.0 });
    let window = only(&still((0..2000).map(back)));
    assert_eq!(
        window.quality,
        WindowQuality::Degraded(vec![Degradation::AnotherActuation { at: 440 }])
    );
    // Without rest between them they are one actuation.
    let quick = |n: usize| Setpoint::Position(if (80..110).contains(&n) { 0.25 } else { 0.0 });
    assert_eq!(only(&still((0..2000).map(quick))).quality, WindowQuality::Complete);
}

#[test]
fn a_window_that_starts_mid_motion_is_invalid() {
    let mut scenario = Scenario {
        sensing: NOISY,
        ..Scenario::new(bench(2000.0), FaultVector::NOMINAL, 43)
    };
    scenario.load_torque = 20.0;
    scenario.actuations.length = 1.5;
    let full = simulate(&scenario);
    let mut in_motion = 0;
    for joined in (90..full.len()).step_by(30) {
        for window in windows(&bench(2000.0), &full[joined..]) {
            match &window.quality {
                WindowQuality::Invalid(Invalidity::StartInMotion { turned_rad }) => {
                    assert!(*turned_rad > 0.1);
                    in_motion += 1;
                }
                WindowQuality::Invalid(Invalidity::CutShort(_)) => {}
                other => panic!("joined at {joined}: {other:?}"),
            }
        }
    }
    assert!(in_motion > 5, "{in_motion}");
}

#[test]
fn a_motor_that_is_not_where_its_setpoint_rests_is_a_handicap() {
    let mut samples = mixed();
    samples[..80]
        .iter_mut()
        .for_each(|sample| sample.sensed.motor_counts -= 80 - sample.seq as i64);
    assert_eq!(only(&samples).quality, WindowQuality::Complete);
    for (n, sample) in samples.iter_mut().enumerate().take(80) {
        sample.sensed.motor_counts -= 300 * (80 - n as i64);
    }
    match &only(&samples).quality {
        WindowQuality::Degraded(why) => match why[..] {
            [Degradation::UnsteadyStart { speed_rad_s }] => assert!((speed_rad_s - 57.7).abs() < 0.1),
            _ => panic!("{why:?}"),
        },
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_next_trigger_needs_rest_after_the_window() {
    // The second command comes so long after the window's last sample, 1040.
    for (delay, expected) in [(1, 2), (5, 2), (500, 2)] {
        let position = |n: usize| Setpoint::Position(if n < 80 || n > 1040 + delay { 0.0 } else { 0.25 });
        let all = windows(&bench(2000.0), &still((0..3000).map(position)));
        assert_eq!(all.len(), expected, "{delay}");
    }
    // An actuation that is still moving when its window ends opens no other.
    let long_ramp = |n: usize| Setpoint::Position(3e-4 * n.saturating_sub(80) as f64);
    assert_eq!(windows(&bench(2000.0), &still((0..6000).map(long_ramp))).len(), 1);
}

// Loss.

#[test]
fn a_few_lost_samples_are_filled_close_to_the_truth() {
    let full = mixed();
    let lost = [90_u64, 300, 301, 302, 303, 700, 1000];
    let kept: Vec<TimedSample> = full
        .iter()
        .copied()
        .filter(|sample| !lost.contains(&sample.seq))
        .collect();
    let window = only(&kept);
    assert_eq!(
        window.quality,
        WindowQuality::Degraded(vec![Degradation::Filled { lost: 7, rejected: 0 }])
    );
    assert_eq!(window.filled, lost.map(|seq| seq as usize - 40));
    for (sample, truth) in window.samples.iter().zip(&full[40..]) {
        assert_eq!(sample.seq, truth.seq);
        assert!((sample.motor_counts - truth.sensed.motor_counts).abs() < 200);
        assert!((sample.output_counts - truth.sensed.output_counts).abs() <= 2);
        for (found, expected) in sample.currents.iter().zip(truth.sensed.currents) {
            assert!((found - expected).abs() < 1.0, "{}: {found} {expected}", sample.seq);
        }
    }
}

#[test]
fn too_much_loss_is_a_gap_and_no_fault() {
    let without = |lost: &dyn Fn(u64) -> bool| -> Vec<TimedSample> {
        mixed().into_iter().filter(|sample| !lost(sample.seq)).collect()
    };
    assert!(only(&without(&|n| (500..510).contains(&n))).quality.is_fit());
    // One in eleven, one by one, after the command.
    assert!(only(&without(&|n| n > 100 && n.is_multiple_of(11))).quality.is_fit());
    assert!(only(&without(&|n| n > 100 && n % 50 < 3)).quality.is_fit());
    for lost in [
        &|n: u64| (500..511).contains(&n),
        &|n: u64| n > 100 && n.is_multiple_of(9),
        &|n: u64| n > 100 && n % 50 < 4,
    ] as [&dyn Fn(u64) -> bool; 3]
    {
        let window = only(&without(lost));
        assert_eq!(flawed(&window), Defect::Missing);
        assert!(window.quality.to_string().starts_with("gap"), "{}", window.quality);
    }
    // A silence over the window's end.
    let window = only(&without(&|n| (1000..1100).contains(&n)));
    assert_eq!(
        (flawed(&window), window.lost, window.samples.len()),
        (Defect::Missing, 41, 1001)
    );
    // The command itself is lost: its instant cannot be known.
    let window = only(&without(&|n| n == 80));
    assert_eq!(invalidity(&window), Invalidity::CommandInGap { at: 40 });
    // So long a silence that nothing is known of the rest before: no window begins there. This profile then stays within
    // 1 mrad for 20 ms, which is a rest, but the motor is still on its way.
    let window = only(&without(&|n| (70..120).contains(&n)));
    assert!(window.samples[0].seq >= 120);
    match window.quality.clone() {
        WindowQuality::Invalid(Invalidity::CutShort(CutShort::StreamEnded)) => {}
        other => panic!("{other:?}"),
    }
    // A day of silence is bridged at once.
    let mut samples = mixed();
    samples[600..].iter_mut().for_each(|sample| sample.seq += 2000 * 86_400);
    assert_eq!(flawed(&windows(&bench(2000.0), &samples)[0]), Defect::Missing);
}

#[test]
fn repeated_samples_are_dropped_and_counted() {
    let samples: Vec<TimedSample> = mixed().into_iter().flat_map(|sample| [sample; 2]).collect();
    let window = only(&samples);
    assert_eq!((&window.quality, window.duplicates), (&WindowQuality::Complete, 960));
    // Late copies too, which a rerouted frame is.
    let full = mixed();
    let late: Vec<TimedSample> = full
        .iter()
        .enumerate()
        .flat_map(|(n, &s)| [s, full[n.saturating_sub(3)]])
        .collect();
    assert_eq!(only(&late).samples, window.samples);
}

// Signals that cannot be.

#[test]
fn spikes_are_taken_out_one_by_one() {
    type Spike = fn(&mut SensedSample);
    let spikes: [Spike; 9] = [
        |s| s.currents[0] += 1.024,
        |s| s.currents[1] -= 8.192,
        |s| s.currents[2] = f64::NAN,
        |s| s.currents[0] = 32.0,
        |s| s.output_counts += 50,
        |s| s.output_counts ^= 1 << 20,
        |s| s.motor_counts -= 1024,
        |s| s.motor_counts ^= 1 << 30,
        |s| s.setpoint = Setpoint::Position(0.7),
    ];
    for rate in [400.0, 2000.0] {
        let params = bench(rate);
        let scenario = Scenario {
            sensing: NOISY,
            ..Scenario::new(params, FaultVector::NOMINAL, 5)
        };
        let good = simulate(&scenario);
        let clean = windows(&params, &good).remove(0);
        let trigger = clean.samples[clean.trigger].seq as usize;
        for (n, spike) in spikes.into_iter().enumerate() {
            if n == 6 && rate < 1000.0 {
                continue; // within what the motor can accelerate in 2.5 ms
            }
            for at in [trigger - 3, trigger + 2, trigger + 20, trigger + 90, trigger + 150] {
                let mut samples = good.clone();
                spike(&mut samples[at].sensed);
                let all = windows(&params, &samples);
                assert_eq!(all.len(), 1, "spike {n} at {at}, {rate} Hz");
                let expected = WindowQuality::Degraded(vec![Degradation::Filled { lost: 0, rejected: 1 }]);
                assert_eq!(all[0].quality, expected, "spike {n} at {at}, {rate} Hz");
                assert_eq!(all[0].filled, [at + clean.trigger - trigger], "spike {n}, {rate} Hz");
                let (found, truth) = (all[0].samples[all[0].filled[0]], good[at].sensed);
                assert!(
                    (found.output_counts - truth.output_counts).abs() < 8,
                    "spike {n} at {at}, {rate} Hz"
                );
                assert!(found.currents.iter().all(|i| i.abs() < 14.0));
            }
        }
    }
}

#[test]
fn a_corrupted_command_opens_and_ends_no_window() {
    let mut samples = still([Setpoint::Position(0.1); 500]);
    samples[200].sensed.setpoint = Setpoint::Position(1.1);
    assert!(windows(&bench(2000.0), &samples).is_empty());
    let mut samples = mixed();
    samples[500].sensed.setpoint = Setpoint::Idle;
    assert!(only(&samples).quality.is_fit());
}

#[test]
fn data_of_broken_sensors_are_invalid_with_their_reason() {
    type Break = fn(usize, &mut SensedSample);
    let too_many =
        |defect| move |found: Invalidity| matches!(found, Invalidity::TooManyFlawed { defect: d, .. } if d == defect);
    let cases: [(Break, &dyn Fn(Invalidity) -> bool); 10] = [
        (|_, s| s.currents[0] += 0.9, &too_many(Defect::CurrentSum)),
        (|_, s| s.currents[1] = 0.0, &|found| {
            found == Invalidity::Stuck(Signal::Currents)
        }),
        (|_, s| s.currents[2] = f64::NAN, &too_many(Defect::NotFinite)),
        (|_, s| s.currents = [20.0, -10.0, -10.0], &too_many(Defect::BeyondScale)),
        (
            |n, s| s.currents = if n > 200 { [15.9922, -8.0, -7.9922] } else { s.currents },
            &too_many(Defect::Clipped),
        ),
        (|_, s| s.currents = [1.0, 2.0, -3.0], &|found| {
            found == Invalidity::Stuck(Signal::Currents)
        }),
        (|_, s| s.motor_counts = 77, &|found| {
            found == Invalidity::Stuck(Signal::Motor)
        }),
        (|_, s| s.output_counts = 77, &|found| {
            found == Invalidity::Stuck(Signal::Output)
        }),
        (|n, s| s.output_counts += if n < 600 { 0 } else { 5000 }, &|found| {
            found
                == Invalidity::CounterJumped {
                    counter: Counter::Output,
                    at: 560,
                }
        }),
        (|n, s| s.motor_counts += if n < 600 { 0 } else { 1000 }, &|found| {
            found
                == Invalidity::CounterJumped {
                    counter: Counter::Motor,
                    at: 560,
                }
        }),
    ];
    for (n, (breaks, expected)) in cases.into_iter().enumerate() {
        let mut samples = mixed();
        for (place, sample) in samples.iter_mut().enumerate() {
            breaks(place, &mut sample.sensed);
        }
        let found = invalidity(&only(&samples));
        assert!(expected(found), "case {n}: {found:?}");
    }
    // Stale for a while only.
    let mut samples = mixed();
    let stale = samples[200].sensed.currents;
    samples[200..300]
        .iter_mut()
        .for_each(|sample| sample.sensed.currents = stale);
    assert_eq!(invalidity(&only(&samples)), Invalidity::Stuck(Signal::Currents));
    // A sensor on the wrong shaft.
    let mut samples = mixed();
    samples.iter_mut().for_each(|sample| sample.sensed.output_counts *= -1);
    assert!(matches!(
        invalidity(&only(&samples)),
        Invalidity::CountersDisagree { .. }
    ));
}

// Time.

#[test]
fn a_jump_of_the_clock_is_counted_and_changes_nothing_else() {
    let good = only(&mixed());
    for jump in [3_600_000_000_000_i64, -3_600_000_000_000] {
        let mut samples = mixed();
        samples[500..]
            .iter_mut()
            .for_each(|sample| sample.stamp_ns = sample.stamp_ns.wrapping_add_signed(jump));
        let window = only(&samples);
        assert_eq!(window.clock_jumps, 1);
        assert_eq!(
            Window {
                clock_jumps: 0,
                ..window
            },
            good
        );
    }
}

#[test]
fn another_sample_rate_than_configured_is_found() {
    let mut samples = mixed();
    for sample in &mut samples {
        sample.stamp_ns = T_0 + 1_000_000 * sample.seq;
    }
    match invalidity(&only(&samples)) {
        Invalidity::SampleRate {
            configured_hz,
            by_stamps_hz,
        } => assert!((by_stamps_hz - 1000.0).abs() < 1e-6 && (configured_hz - 2000.0).abs() < 1e-6),
        other => panic!("{other:?}"),
    }
    // Against a rate that the device's own time has shown, stamps have no influence.
    let windower = Windower::new(WindowConfig::default(), &bench(2000.0)).expect("default settings");
    let mut windower = windower.at_device_time();
    let window = samples
        .iter()
        .find_map(|&sample| windower.push(sample))
        .expect("a window");
    assert_eq!(window.quality, WindowQuality::Complete);
    // Stamps that come in bursts of 10 ms are none.
    for sample in &mut samples {
        sample.stamp_ns = T_0 + 500_000 * sample.seq.next_multiple_of(20);
    }
    assert_eq!(only(&samples).quality, WindowQuality::Complete);
}

#[test]
fn an_invalid_window_is_fit_again_once_its_mistake_is_taken_out() {
    let (params, right) = (bench(2000.0), mixed());
    let reverse = |sample: &mut SensedSample| sample.currents[1] = -sample.currents[1];
    let mut wrong = right.clone();
    wrong.iter_mut().for_each(|sample| reverse(&mut sample.sensed));
    let mut window = windows(&params, &wrong).remove(0);
    assert!(!window.quality.is_fit());
    let as_received = window.clone();
    window
        .check_again(&WindowConfig::default(), &params)
        .expect("default settings");
    assert_eq!(window, as_received, "what is wrong stays invalid");
    window.samples.iter_mut().for_each(reverse);
    window
        .check_again(&WindowConfig::default(), &params)
        .expect("default settings");
    let expected = windows(&params, &right).remove(0);
    assert_eq!((window.quality, window.samples), (expected.quality, expected.samples));
}

#[test]
fn a_window_with_missing_samples_is_not_made_fit_again() {
    let params = bench(2000.0);
    let reverse = |sample: &mut SensedSample| sample.currents[1] = -sample.currents[1];
    let mut samples = mixed();
    samples.remove(600);
    samples.iter_mut().for_each(|sample| reverse(&mut sample.sensed));
    let mut window = windows(&params, &samples).remove(0);
    assert_eq!((window.quality.is_fit(), window.lost), (false, 1));
    window.samples.iter_mut().for_each(reverse);
    let before = window.clone();
    window
        .check_again(&WindowConfig::default(), &params)
        .expect("default settings");
    assert_eq!(window, before);
}

#[test]
fn counts_that_turn_out_wrong_are_filled_and_named_beside_what_was_known() {
    let good = only(&mixed());
    let mut window = good.clone();
    let places = [500, 700];
    for place in places {
        window.samples[place].motor_counts += 500;
        window.samples[place].output_counts += 10;
    }
    window.refuse_counts(&[places[1], places[0], places[1]]);
    assert_eq!((window.filled.as_slice(), window.rejected), (places.as_slice(), 3));
    let filled = |lost, rejected| Degradation::Filled { lost, rejected };
    assert_eq!(window.quality, WindowQuality::Degraded(vec![filled(0, 3)]));
    for place in places {
        let off = window.samples[place].motor_counts - good.samples[place].motor_counts;
        assert!(off.abs() < 40, "{off}");
        let off = window.samples[place].output_counts - good.samples[place].output_counts;
        assert!(off.abs() <= 1, "{off}");
    }
    // A handicap that was known stays, one of filled samples is counted on.
    let mut window = good.clone();
    let known = Degradation::AnotherActuation { at: 900 };
    window.quality = WindowQuality::Degraded(vec![known, filled(1, 1)]);
    (window.lost, window.rejected) = (1, 1);
    window.refuse_counts(&[500]);
    assert_eq!(window.quality, WindowQuality::Degraded(vec![filled(1, 2), known]));
    // An invalid window stays as it is.
    let mut window = good;
    window.quality = WindowQuality::Invalid(Invalidity::ModeChanged);
    let before = window.clone();
    window.refuse_counts(&[500]);
    assert_eq!(window, before);
}

#[test]
fn a_window_is_open_from_the_command_to_its_last_sample() {
    let mut windower = Windower::new(WindowConfig::default(), &bench(2000.0)).expect("default settings");
    let samples = mixed();
    let mut open = Vec::new();
    for &sample in &samples {
        windower.push(sample);
        open.push(windower.is_open());
    }
    let first = open.iter().position(|open| *open).expect("a window");
    let last = open.iter().rposition(|open| *open).expect("a window");
    assert!((80..=82).contains(&first) && last < open.len() - 1, "{first} {last}");
    assert!(open[first..=last].iter().all(|open| *open));
    // A counter that goes back is a restart each time.
    for _ in 0..2 {
        for &sample in &samples[..100] {
            windower.push(sample);
        }
    }
    assert_eq!(windower.counts().restarts, 2);
}
