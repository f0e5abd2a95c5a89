//! From end to end: a simulated actuator's frames, through decoding, windows and identification, to the assessment.
//!
//! Time is virtual throughout, seeds are fixed, one window costs about a second of one core in the dev profile.

mod bad_link;
mod bench;
mod foreign_bus;
mod function;
mod identification;
mod link;
mod new_unit;
mod onboard;
mod one_way;
mod relations;
mod tolerances;
mod unmodelled;

use bench::{frames, unit, watch, watch_all};
use ema_models::FaultVector;
use ema_wire::{ActuatorId, Deframer, SerialPacket};
use hmd_core::assess::AssessedWindow;

/// A nominal vector with one parameter changed.
fn worn(name: &str, k: f64) -> FaultVector {
    let mut vector = FaultVector::NOMINAL.to_array();
    let index = FaultVector::NAMES
        .iter()
        .position(|known| *known == name)
        .expect("a known fault");
    vector[index] = k;
    FaultVector::from_array(vector)
}

/// The records of a window without their time of day.
fn timeless(assessed: &AssessedWindow) -> String {
    let mut assessed = assessed.clone();
    assessed.window.t_start_ns = 0;
    assessed.health.t_start_ns = 0;
    assessed.rul.t_start_ns = 0;
    assessed.sensors.t_start_ns = 0;
    format!("{assessed:?}")
}

#[test]
fn a_healthy_actuator_is_nominal() {
    for seed in [1, 2, 3] {
        let outcome = watch(frames(&unit(FaultVector::NOMINAL, seed), 0));
        let health = &outcome.window().health;
        assert_eq!(
            (health.status.as_str(), health.health.as_str()),
            ("ok", "nominal"),
            "seed {seed}: {health:?}"
        );
        assert_eq!(health.faults, "", "seed {seed}");
        assert_eq!(
            (outcome.lost, outcome.frames.malformed, outcome.frames.filtered),
            (0, 0, 0),
            "seed {seed}"
        );
    }
}

#[test]
fn a_motor_off_its_type_is_healthy_all_the_same() {
    for (seed, resistance, back_emf) in [(4, 0.05, -0.03), (5, -0.05, 0.03), (6, 0.0, -0.03)] {
        let mut scenario = unit(FaultVector::NOMINAL, seed);
        scenario.unit.motor.r_s *= 1.0 + resistance;
        scenario.unit.motor.k *= 1.0 + back_emf;
        let health = watch(frames(&scenario, 0)).window().health.clone();
        assert_eq!(health.health, "nominal", "seed {seed}: {health:?}");
        let estimate = health.estimate().expect("an estimate");
        for p in [0, 1, 2, 3, 4, 5] {
            let sigma = estimate.sigma[p].expect("observable");
            assert!(
                estimate.k[p] < 3.0 * sigma,
                "seed {seed}, k{}: {} ± {sigma}",
                p + 1,
                estimate.k[p]
            );
        }
    }
}

#[test]
fn each_fault_is_named_from_one_window() {
    for (fault, k, seed) in [
        ("friction", 0.25, 11),
        ("backlash", 0.2, 12),
        ("short_a", 0.15, 13),
        ("short_b", 0.15, 14),
        ("short_c", 0.15, 15),
        ("eccentricity", 0.2, 16),
        ("gain", 0.6, 17),
    ] {
        let truth = worn(fault, k);
        let health = watch(frames(&unit(truth, seed), 0)).window().health.clone();
        assert_eq!(
            (health.status.as_str(), health.health.as_str()),
            ("ok", "watch"),
            "{fault}, seed {seed}: {health:?}"
        );
        assert_eq!(health.faults, fault, "seed {seed}");
        let estimate = health.estimate().expect("an estimate");
        let index = FaultVector::NAMES
            .iter()
            .position(|name| *name == fault)
            .expect("a known fault");
        assert!(
            (estimate.k[index] - k).abs() < 0.03,
            "{fault} {k}, seed {seed}: {:?}",
            estimate.k
        );
    }
}

#[test]
fn two_faults_at_once_are_distinguished() {
    let truth = FaultVector {
        backlash: 0.3,
        short_c: 0.2,
        ..FaultVector::NOMINAL
    };
    assert_eq!(watch(frames(&unit(truth, 21), 0)).faults(), ["backlash,short_c"]);
}

#[test]
fn a_wearing_unit_goes_from_nominal_to_critical() {
    let ages = [0.0, 0.15, 0.45, 0.75];
    let sorties = (31..)
        .zip(ages)
        .map(|(seed, k)| frames(&unit(worn("friction", k), seed), 0));
    let outcome = watch_all(sorties);
    let health: Vec<&str> = outcome
        .windows
        .iter()
        .map(|assessed| assessed.health.health.as_str())
        .collect();
    assert_eq!(health, ["nominal", "watch", "warning", "critical"]);
    assert_eq!(outcome.faults(), ["", "friction", "friction", "friction"]);
    assert_eq!(
        outcome
            .windows
            .iter()
            .map(|assessed| assessed.health.window)
            .collect::<Vec<_>>(),
        [0, 1, 2, 3]
    );
}

#[test]
fn a_few_lost_frames_degrade_a_window_and_raise_no_alarm() {
    let seed = 41;
    let lossy = link::drop_frames(frames(&unit(FaultVector::NOMINAL, seed), 0), 0.004, seed);
    let outcome = watch(lossy);
    let health = &outcome.window().health;
    assert!(outcome.lost > 0, "the link lost nothing");
    assert_eq!(
        (health.status.as_str(), health.health.as_str()),
        ("degraded", "nominal"),
        "{health:?}"
    );
    assert!(health.reason.contains("lost"), "{}", health.reason);
}

#[test]
fn a_sample_lost_or_garbled_at_the_command_is_no_fault() {
    // At 400 Hz the motor is at full acceleration in these: a chord between its neighbours is 500 counts off.
    let (seed, trigger) = (3, 24);
    let sound = frames(&unit(FaultVector::NOMINAL, seed), 0);
    for after in 1..=6 {
        let lost = link::lose_sample(sound.clone(), trigger + after);
        let health = watch(lost).window().health.clone();
        assert_eq!(
            (health.status.as_str(), health.health.as_str()),
            ("degraded", "nominal"),
            "{after}: {health:?}"
        );
        assert_eq!(health.faults, "", "trigger + {after}");
        // 64, 512 and 1 024 resolver counts; what the windower alone lets pass ends at 1 891.
        for bit in [6, 9, 10] {
            let garbled = link::flip_position_bit(sound.clone(), trigger + after, bit);
            let health = watch(garbled).window().health.clone();
            assert_eq!(health.faults, "", "trigger + {after}, bit {bit}: {health:?}");
            assert_eq!(
                (health.status.as_str(), health.health.as_str()),
                ("degraded", "nominal"),
                "{after}, bit {bit}"
            );
        }
    }
}

#[test]
fn absurd_supply_or_load_is_invalid() {
    for (byte, what) in [(1, "dc_link"), (5, "load_torque")] {
        let garbled = link::set_status_byte(frames(&unit(FaultVector::NOMINAL, 44), 0), byte, 0x7F);
        let health = watch(garbled).window().health.clone();
        assert_eq!(
            (health.status.as_str(), health.estimate()),
            ("invalid", None),
            "{health:?}"
        );
        assert!(health.reason.starts_with(what), "{}", health.reason);
    }
}

#[test]
fn many_lost_frames_make_a_window_invalid_and_never_a_fault() {
    for (truth, seed) in [(FaultVector::NOMINAL, 42), (worn("friction", 0.5), 43)] {
        let lossy = link::drop_frames(frames(&unit(truth, seed), 0), 0.1, seed);
        let outcome = watch(lossy);
        let health = &outcome.window().health;
        assert_eq!(
            (health.status.as_str(), health.health.as_str()),
            ("invalid", "unknown"),
            "seed {seed}: {health:?}"
        );
        assert_eq!((health.faults.as_str(), health.estimate()), ("", None), "seed {seed}");
        assert!(!health.reason.is_empty(), "seed {seed}");
    }
}

#[test]
fn repeated_frames_and_the_receivers_clock_change_nothing() {
    let seed = 51;
    let clean = frames(&unit(worn("short_b", 0.2), seed), 0);
    let expected = timeless(watch(clean.clone()).window());
    let repeated = link::repeat_frames(clean.clone(), 0.2, seed);
    assert!(repeated.len() > clean.len());
    assert_eq!(timeless(watch(repeated).window()), expected);
    let drifted = link::drift(clean, 200.0, 400_000, seed);
    assert_eq!(timeless(watch(drifted).window()), expected);
}

#[test]
fn actuators_on_one_bus_do_not_see_each_other() {
    let (left, right) = (
        frames(&unit(FaultVector::NOMINAL, 61), 0),
        frames(&unit(worn("backlash", 0.3), 62), 5),
    );
    let alone = [left.clone(), right.clone()].map(|frames| timeless(watch(frames).window()));
    let together = watch(link::merge(left, right));
    assert_eq!(
        together
            .windows
            .iter()
            .map(|w| w.health.actuator.as_str())
            .collect::<Vec<_>>(),
        ["ema0", "ema5"]
    );
    assert_eq!(together.faults(), ["", "backlash"]);
    assert_eq!(together.windows.iter().map(timeless).collect::<Vec<_>>(), alone);
}

#[test]
fn the_serial_line_carries_the_same_samples_as_the_bus() {
    let scenario = unit(worn("eccentricity", 0.3), 71);
    let actuator = ActuatorId::new(0).expect("0 to 15");
    let mut line = Vec::new();
    firmware_sim::write_stream(&scenario, actuator, &mut line).expect("a Vec takes everything");

    let mut deframer = Deframer::new();
    let mut frames_of_line: Vec<(u32, Vec<u8>)> = Vec::new();
    for packet in deframer.push_slice(&line) {
        let frames = match packet {
            SerialPacket::Sample(sample) => sample.to_frames().to_vec(),
            SerialPacket::Status { status, .. } => vec![ema_wire::Frame::Status(status)],
        };
        for frame in frames {
            let mut bytes = [0; 64];
            frames_of_line.push((frame.message().id(actuator).into(), frame.emit(&mut bytes).to_vec()));
        }
    }
    assert_eq!(deframer.stats().dropped(), 0);

    let on_bus = frames(&scenario, 0);
    let on_bus: Vec<(u32, Vec<u8>)> = on_bus.iter().map(|frame| (frame.id(), frame.data().to_vec())).collect();
    assert_eq!(frames_of_line, on_bus);
}
