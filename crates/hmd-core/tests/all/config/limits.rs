//! Settings that are possible up to exactly their limits, and those that another one rules out.

use std::time::Duration;

use hmd_core::config::{IdentificationConfig, SearchMethod, SearchObjective};

use super::{read, refusal};

#[test]
fn the_budget_of_the_disk_is_four_segments_at_least() {
    let limits = read("[output]\nsegment_mib = 16\nsegment_age_s = 11\ndisk_budget_mib = 64\ndisk_free_min_mib = 3")
        .output()
        .limits();
    let mib = 1 << 20;
    assert_eq!(
        (limits.segment_bytes, limits.budget_bytes, limits.free_bytes_min),
        (16 * mib, 64 * mib, 3 * mib)
    );
    assert_eq!(limits.segment_age, Duration::from_secs(11));
    let expected = "output.disk_budget_mib: expected at least four times segment_mib = 16, found 63";
    assert!(refusal("[output]\nsegment_mib = 16\ndisk_budget_mib = 63").ends_with(expected));
    let refused = refusal("[output]\nsegment_mib = 513");
    assert!(
        refused.ends_with("four times segment_mib = 513, found 2048 (by default)"),
        "{refused}"
    );
    read("[output]\nsegment_mib = 512");
}

#[test]
fn the_hours_of_critical_are_no_more_than_those_of_warning() {
    let rul = read("[rul]\nwarning_h = 10\ncritical_h = 10");
    assert_eq!(rul.rul().critical_h.to_bits(), f64::to_bits(10.0));
    assert_eq!(
        refusal("[rul]\nwarning_h = 10\ncritical_h = 10.5"),
        "hmd.toml:3: rul.critical_h: expected at most warning_h = 10, found 10.5"
    );
}

#[test]
fn a_search_has_runs_for_one_population_at_least() {
    read("[identification]\npopulation = 40\nevaluations_max = 40");
    assert_eq!(
        refusal("[identification]\npopulation = 40\nevaluations_max = 39"),
        "hmd.toml:3: identification.evaluations_max: expected at least population = 40, found 39"
    );
    let set = read("[identification]\ngenerations = 7\ndeadline_ms = 250");
    assert_eq!(
        (set.identification().generations, set.identification().deadline_ms),
        (7, Some(250))
    );
    assert!(
        refusal("[identification]\npopulation = 5001")
            .ends_with("at least population = 5001, found 5000 (not set here)")
    );
}

#[test]
fn a_method_without_population_has_none_of_its_settings_and_no_other_objective() {
    for (name, method) in SearchMethod::NAMES {
        assert_eq!(method.name(), name);
        let of = IdentificationConfig::for_method(method);
        let has_population = !matches!(method, SearchMethod::LeastSquares | SearchMethod::Relations);
        assert_eq!(of.population > 0, has_population, "{name}");
        let is_searched_alone = matches!(method, SearchMethod::Ga | SearchMethod::De | SearchMethod::Cmaes);
        assert_eq!(method.is_population(), is_searched_alone, "{name}");

        let method = format!("[identification]\nmethod = \"{name}\"\n");
        assert_eq!(*read(&method).identification(), of, "{name}");
        let eq14 = format!("{method}objective = \"eq14\"");
        if is_searched_alone {
            assert_eq!(read(&eq14).identification().objective, SearchObjective::Eq14);
        } else {
            let expected = format!("objective: expected \"residual\" with method = \"{name}\", found \"eq14\"");
            assert!(refusal(&eq14).ends_with(&expected), "{name}");
        }
        read(&format!("{method}objective = \"residual\""));
        for key in ["population", "generations", "evaluations_max"] {
            let set = format!("{method}{key} = 6000");
            if has_population {
                read(&set.replace("population = 6000", "population = 60"));
            } else {
                let expected = format!("{key}: expected none with method = \"{name}\", found 6000");
                assert!(refusal(&set).ends_with(&expected), "{name}");
            }
        }
    }
}

#[test]
fn data_of_fd_is_no_slower_than_arbitration() {
    assert_eq!(
        read("[bus]\nbitrate_bit_s = 500000\ndata_bitrate_bit_s = 500000")
            .bus()
            .data_bitrate_bit_s,
        500_000
    );
    assert_eq!(
        refusal("[bus]\nbitrate_bit_s = 500000\ndata_bitrate_bit_s = 499999"),
        "hmd.toml:3: bus.data_bitrate_bit_s: expected at least bitrate_bit_s = 500000, found 499999"
    );
}

#[test]
fn each_requirement_alone_is_a_specification() {
    let of = |keys: &str| {
        let config = read(&format!("[type.bench.specification]\nstep_rad = 0.2\n{keys}"));
        config.actuator_type("bench").unwrap().specification
    };
    assert!(!of("load_nm = 3.0").is_set());
    for key in [
        "slew_rate_min_rad_s",
        "response_time_max_s",
        "steady_error_max_rad",
        "stall_load_nm",
    ] {
        assert!(of(&format!("{key} = 0.5")).is_set(), "{key}");
    }
}

#[test]
fn the_step_of_a_specification_takes_ten_seconds_at_most() {
    let config = read("");
    let params = config.actuator_type("bench").unwrap().params;
    // Ten seconds at the largest speed of the motor, behind a gear of ten turns.
    let sized = "[type.slow]\nbased_on = \"bench\"\ntransmission.gear_ratio = 1000\ncontroller.speed_max_rad_s = 100\n";
    let step = |step_rad: f64, keys: &str| format!("{sized}specification = {{ step_rad = {step_rad}{keys} }}");
    let required = ", stall_load_nm = 1";
    let slow = read(&step(0.999, required));
    let slow = slow.actuator_type("slow").unwrap();
    assert!((slow.specification.motion_s(&slow.params) - 9.99).abs() < 1e-9);
    assert!(slow.params.transmission.gear_ratio > params.transmission.gear_ratio);
    let refused = refusal(&step(1.001, required));
    assert!(
        refused.contains(
            "type.slow.specification.step_rad: expected at most 1.000 rad, 10 s of motion at speed_max_rad_s"
        ),
        "{refused}"
    );
    read(&step(1.0, required));
    // Without a requirement nothing is simulated.
    read(&step(1.001, ""));
}

#[test]
fn a_unit_is_learnt_into_a_folder_and_not_calibrated_as_well() {
    let actuator = |keys: &str| format!("[[actuator]]\nid = 3\n{keys}");
    let config = read(&actuator(
        "learn_windows = 5\nlearn_folder = \"units\"\nserial_number = \"A/4 ä-7_x\"",
    ));
    let unit = &config.actuators()[0];
    assert_eq!(unit.learning.as_ref().map(|learning| learning.windows), Some(5));
    let file = config.learnt_file(unit);
    assert_eq!(
        file.as_deref().and_then(|file| file.to_str()),
        Some("units/ema3+A_4__-7_x.unit.toml")
    );
    let without = read(&actuator(""));
    assert_eq!(without.learnt_file(&without.actuators()[0]), None);
    assert_eq!(without.actuators()[0].learnt_file_name(), "ema3.unit.toml");
    for (keys, expected) in [
        ("learn_windows = 5", "learn_windows: expected learn_folder beside it"),
        (
            "learn_folder = \"units\"",
            "learn_folder: expected learn_windows beside it",
        ),
        (
            "learn_windows = 5\nlearn_folder = \"units\"\ncalibration = \"unit.toml\"",
            "learn_windows: expected either calibration or learn_windows",
        ),
        (
            "learn_windows = 4\nlearn_folder = \"units\"",
            "learn_windows: expected a whole number from 5 to 20, found 4",
        ),
    ] {
        assert!(
            refusal(&actuator(keys)).contains(expected),
            "{}",
            refusal(&actuator(keys))
        );
    }
}

#[test]
fn a_default_that_another_setting_rules_out_is_named_where_it_would_stand() {
    let refused = refusal("[type.bench.controller]\nperiod_s = 9e-5");
    let expected = "type.bench.sensors.sample_rate_hz: expected a rate whose sample period is a whole multiple of \
                    controller.period_s = 0.00009, found 2000 (not set here)";
    assert!(refused.ends_with(expected), "{refused}");
}
