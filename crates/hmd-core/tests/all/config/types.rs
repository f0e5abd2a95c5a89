//! Types of actuators and units of them: which are the same, and what is said of their parameters.

use ema_identify::relations::ELEMENT_COUNT;
use ema_identify::unit_calibration::{
    Deviation, ElementStatistics, Seen, UNIT_VERSION, UnitCalibration, UnitEstimator, UnitMonitor, UnitParameters,
};
use ema_models::ActuatorParams;
use hmd_core::config::{EffectiveParameter, Origin, parameters_of_unit, write_parameters};

use super::read;

#[test]
fn two_types_are_the_same_with_the_same_parameters_and_drive_at_any_rate() {
    let config = read(
        "[type.slow]\nbased_on = \"servo270\"\nsensors.sample_rate_hz = 400\n[type.heavy]\nbased_on = \"servo270\"\n\
         motor.inertia_kg_m2 = 1e-3\n[type.late]\nbased_on = \"servo270\"\ndrive.dead_time_s = 1e-6\n\
         [[actuator]]\nid = 0\ntype = \"slow\"\n",
    );
    let text = |name: &str| config.actuator_type(name).unwrap().parameters_as_text();
    assert_eq!(text("slow"), text("servo270"));
    assert_eq!(text("slow"), config.actuators()[0].parameters_as_text());
    for other in ["heavy", "late", "bench"] {
        assert_ne!(text(other), text("servo270"), "{other}");
    }
}

#[test]
fn a_type_inherits_what_it_does_not_set_unless_it_is_the_built_in_one() {
    let inherited = |text: &str, name: &str| {
        let config = read(text);
        config.actuator_type(name).unwrap().inherited(name)
    };
    assert!(inherited("", "bench").is_empty());
    assert!(inherited("[type.bench.sensors]\nsample_rate_hz = 400", "bench").is_empty());
    let own = inherited("[type.own]\nbased_on = \"bench\"", "own");
    assert_eq!(own.len(), 26, "a name of its own: {own:?}");
    let changed = inherited("[type.bench.motor]\ninertia_kg_m2 = 2e-3", "bench");
    assert_eq!(changed.len(), 25, "{changed:?}");
    assert!(!changed.iter().any(|key| key == "motor.inertia_kg_m2"));
}

/// A unit whose deviations of resistance and inertia are known.
fn unit(estimator: UnitEstimator) -> UnitCalibration {
    let parameters = UnitParameters {
        resistance: Deviation {
            share: 0.1,
            sigma: 0.022,
        },
        inertia: Deviation {
            share: -0.5,
            sigma: 0.05,
        },
        ..UnitParameters::default()
    };
    UnitCalibration {
        version: UNIT_VERSION,
        made_by: "hmd".to_owned(),
        actuator_type: "bench".to_owned(),
        parameters_hash: "00".to_owned(),
        part_number: None,
        serial_number: None,
        windows: 12,
        estimator,
        estimator_reason: String::new(),
        output_zero_rad: None,
        seen: Seen::default(),
        smallest_damage: [].into(),
        monitor: Some(UnitMonitor {
            cost: 2.0,
            parameters,
            current_time_constant_s: 0.0,
            baseline: [ElementStatistics::default(); ELEMENT_COUNT],
        }),
        relations: None,
        sensors: None,
    }
}

#[test]
fn the_monitor_of_a_unit_puts_values_in_the_place_of_its_types() {
    let bench = ActuatorParams::bench();
    for estimator in [UnitEstimator::Monitor, UnitEstimator::Both] {
        let found = parameters_of_unit(&bench, &unit(estimator), "unit.toml");
        let of = |key: &str| found.iter().find(|of| of.key == key).cloned().unwrap();
        for (key, value, tolerance) in [
            ("motor.phase_resistance_ohm", 1.1 * bench.motor.r_s, 0.02),
            ("motor.inertia_kg_m2", 0.5 * bench.motor.j, 0.1),
            ("motor.phase_inductance_h", bench.motor.l_s, 0.0),
        ] {
            let of = of(key);
            assert!(
                (of.value.unwrap() - value).abs() < 1e-9 * value,
                "{key}: {:?}",
                of.value
            );
            assert!(
                (of.tolerance.unwrap() - tolerance).abs() < 1e-9,
                "{key}: {:?}",
                of.tolerance
            );
            assert_eq!(of.origin, Some(Origin::File("unit.toml".to_owned())));
        }
    }
    assert!(parameters_of_unit(&bench, &unit(UnitEstimator::Relations), "unit.toml").is_empty());
}

#[test]
fn a_value_is_written_in_full_where_it_is_whole_and_to_six_digits_where_not() {
    let written = |value: f64| {
        let parameter = EffectiveParameter {
            key: "motor.x".to_owned(),
            value: Some(value),
            origin: None,
            tolerance: None,
            tolerance_origin: None,
        };
        let mut text = String::new();
        write_parameters(&mut text, &[parameter]).unwrap();
        text.trim()
            .trim_start_matches("motor.x ")
            .trim_end_matches(" ()")
            .to_owned()
    };
    for (value, expected) in [
        (0.0, "0"),
        (-65_536.0, "-65536"),
        (123_456_789.0, "123456789"),
        (999_999_999.0, "999999999"),
        (1e9, "1e9"),
        (2_500_000_000.0, "2.5e9"),
        (1_234.567_89, "1234.57"),
        (-0.001_234_567_89, "-0.00123457"),
        (0.001, "0.001"),
        (0.000_999_999_9, "0.001"),
        (0.000_999_9, "9.999e-4"),
        (999_999.4, "999999"),
        (999_999.6, "1e6"),
        (1e-7, "1e-7"),
    ] {
        assert_eq!(written(value), expected);
    }
}
