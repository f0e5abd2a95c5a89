//! The sensors of simulated units over many windows: what drifts is news of its own, what does not raises nothing.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Effects, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use hmd_core::assess::{AssessedWindow, Assessor, Models};
use hmd_core::commissioning::calibrate_unit;
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::health::HealthState;
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_core::record::Record;
use hmd_core::sensor_checks::sensor_readings;
use hmd_core::sensor_health::{SensorHealth, SensorQuantity};
use hmd_lab::simulate::{EPOCH_NS, traffic};

/// One hour, ns.
const HOUR_NS: u64 = 3_600_000_000_000;

pub(super) fn config() -> Arc<Config> {
    let text = "[[actuator]]\nid = 0\n[type.bench.sensors]\nsample_rate_hz = 400\n[rul]\nhours = \"elapsed\"";
    Arc::new(Config::from_toml_str(text, "hmd.toml").unwrap())
}

/// Windows of a unit, an hour apart, under changing loads, whose current sensor of phase A has an offset by the number of the window, A.
pub(super) fn windows(
    config: &Arc<Config>,
    count: u64,
    offset_a: impl Fn(u64) -> f64,
    fault: FaultVector,
) -> Vec<WindowJob> {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let mut pipeline = Pipeline::new(config.clone());
    let mut jobs = Vec::new();
    for number in 0..count {
        let mut effects = Effects::default();
        effects.set("current_offset_a_a", offset_a(number)).unwrap();
        let scenario = Scenario {
            effects,
            load_torque: 10.0 * (2.0 * (number as f64 * 0.618_034).fract() - 1.0),
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: 0.03,
            },
            actuations: Actuations::single(Profile::Mixed),
            ..Scenario::new(params, fault, 100 + number)
        };
        for frame in traffic(&scenario, config.actuators()[0].id, EPOCH_NS + number * HOUR_NS) {
            pipeline.push(&frame, &names);
        }
        pipeline.finish();
        jobs.extend(pipeline.take_windows());
    }
    assert_eq!(jobs.len() as u64, count);
    jobs
}

#[test]
fn a_sound_unit_and_one_that_wears_raise_no_sensor_over_a_hundred_windows() {
    let config = config();
    let worn = FaultVector::from_array([0.3, 0.0, 0.2, 0.0, 0.0, 0.2, 0.5, 0.5]);
    let mut jobs = windows(&config, 100, |_| 0.0, FaultVector::NOMINAL);
    jobs.extend(windows(&config, 20, |_| 0.0, worn));
    let mut health = SensorHealth::default();
    for (n, job) in jobs.iter().enumerate() {
        let readings = sensor_readings(job);
        let states = health.update(n as f64, Some(&readings), &job.params, &job.actuator.tolerances);
        for state in states {
            assert!(state.level <= HealthState::Nominal, "window {n}: {state:?}");
        }
        let sum = states[SensorQuantity::CurrentSum as usize];
        assert!(sum.value.is_some_and(|(_, sigma)| sigma < 0.01), "window {n}: {sum:?}");
    }
}

#[test]
fn a_drifting_current_sensor_raises_its_own_level_and_no_part_also_behind_a_restart() {
    let config = config();
    let offset_a = |number: u64| 6e-3 * number.saturating_sub(10) as f64;
    let mut jobs = windows(&config, 30, offset_a, FaultVector::NOMINAL);
    let later = jobs.split_off(16);
    let assessor = || Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1);
    let assess = |assessor: &mut Assessor, jobs: Vec<WindowJob>| -> Vec<AssessedWindow> {
        jobs.into_iter().map(|job| assessor.assess(job).unwrap()).collect()
    };
    let mut before = assessor();
    let mut assessed = assess(&mut before, jobs);
    let kept = serde_json::to_string(before.histories().get("ema0").unwrap()).unwrap();
    let mut after = assessor();
    after.histories().restore("ema0", serde_json::from_str(&kept).unwrap());
    assessed.extend(assess(&mut after, later));

    for AssessedWindow { health, sensors, .. } in &assessed {
        assert!(
            health.fault_list.is_empty(),
            "window {}: {}",
            health.window,
            health.faults
        );
        assert_eq!((&*sensors.topic(), sensors.window), ("/ema0/sensors", health.window));
    }
    let levels: Vec<&str> = assessed.iter().map(|window| &*window.sensors.level).collect();
    assert!(
        levels[..14].iter().all(|level| ["unknown", "nominal"].contains(level)),
        "{levels:?}"
    );
    let last = &assessed[29].sensors;
    assert_eq!(last.level, "warning", "{levels:?}");
    assert!(
        last.drifting.contains(&"current_sum_a".to_owned()),
        "{:?}",
        last.drifting
    );
    let sum = &last.quantities[SensorQuantity::CurrentSum as usize];
    let (drift, slope) = (sum.drift.unwrap(), sum.trend_per_h.unwrap());
    assert!((drift - offset_a(29)).abs() < 0.01, "{drift}");
    assert!((slope - 6e-3).abs() < 1e-3, "{slope}");
}

/// Its reference would be itself without what commissioning has shown.
#[test]
fn a_sensor_that_fails_before_the_first_window_after_commissioning_is_found() {
    let config = config();
    let mut healthy = windows(&config, 28, |_| 0.0, FaultVector::NOMINAL);
    let sound = healthy.split_off(8);
    let offset_a = |number: u64| if number < 8 { 0.0 } else { 0.08 };
    let failed = windows(&config, 16, offset_a, FaultVector::NOMINAL).split_off(8);
    let assessor = || Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1);
    let levels = config.health().levels();
    let unit = calibrate_unit(&assessor(), levels, &mut healthy, 1, &|_| ())
        .unwrap()
        .calibration;
    let drifting = |jobs: Vec<WindowJob>| -> Vec<Vec<String>> {
        let mut assessor = assessor();
        assessor.set_unit("ema0", unit.clone());
        let assess = |job| assessor.assess(job).unwrap().sensors.drifting;
        jobs.into_iter().map(assess).collect()
    };
    let of_sound = drifting(sound);
    assert!(of_sound.iter().all(Vec::is_empty), "{of_sound:?}");
    let of_failed = drifting(failed);
    let is_told = |window: &Vec<String>| window.iter().any(|name| name == "current_sum_a");
    // Three windows in a row.
    assert_eq!(of_failed.iter().position(is_told), Some(2), "{of_failed:?}");
    assert!(of_failed[2..].iter().all(is_told), "{of_failed:?}");
}

#[test]
fn the_suspects_of_a_window_stand_in_its_record_once_each() {
    let config = config();
    let mut job = windows(&config, 1, |_| 0.0, FaultVector::NOMINAL).remove(0);
    for sample in &mut job.window.samples {
        sample.currents[0] += 0.3;
    }
    let mut assessor = Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1);
    let health = assessor.assess(job).unwrap().health;
    assert_eq!(health.suspects, ["current offset"], "{}", health.reason);
    assert!(health.reason.starts_with("current offset: "), "{}", health.reason);
    assert!(health.fault_list.is_empty(), "{}", health.faults);
}
