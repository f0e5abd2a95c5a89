//! `[actuator.drive]`: which keys each preset has, and their values.

use hmd_core::drive_bus::DriveSettings;

use super::{OF_DBC, read, refusal};

fn drive(preset: &str, keys: &str) -> String {
    format!(
        "[[actuator]]\nid = 3\n[actuator.drive]\npreset = \"{preset}\"\n{keys}\n[type.bench]\nsensors.sample_rate_hz = 400\n"
    )
}

/// Those of the first actuator.
fn settings(text: &str) -> DriveSettings {
    let config = read(text);
    let drive = config.actuators()[0].drive_bus.as_ref();
    drive.expect("a drive").settings().clone()
}

#[test]
fn a_drive_has_the_number_of_its_actuator_unless_it_has_one_of_its_own() {
    for (preset, keys, node) in [
        ("odrive", "", 3),
        ("odrive", "node = 62", 62),
        ("vesc", "node = 254", 254),
        ("moteus", "node = 127", 127),
    ] {
        let settings = settings(&drive(preset, keys));
        assert_eq!((settings.preset.name(), settings.node), (preset, node));
        assert!(settings.uses_commands);
    }
    let at_zero = drive("moteus", "").replace("id = 3", "id = 0");
    assert!(refusal(&at_zero).ends_with("drive.node: expected a number from 1 to 127, found 0 (that of the actuator)"));
    read(&at_zero.replace("moteus", "odrive"));
    assert!(refusal(&drive("odrive", "node = 63")).contains("node: expected a whole number from 0 to 62, found 63"));
}

#[test]
fn numbers_of_a_drive_reach_it_and_impossible_ones_are_refused() {
    let keys = "motor_units_per_rev = 4096\noutput_encoder = 1\noutput_units_per_rev = -8192\nset_point = false\n\
                current_bandwidth_hz = 700";
    let config = read(&drive("moteus", keys));
    let found = settings(&drive("moteus", keys));
    assert_eq!(
        (found.motor_units_per_rev, found.output_units_per_rev),
        (Some(4096.0), Some(-8192.0))
    );
    assert_eq!((found.output_encoder, found.current_bandwidth_hz), (Some(1), Some(700)));
    assert!(!found.uses_commands && !config.actuators()[0].has_set_point());
    for (preset, key, value, expected) in [
        ("odrive", "motor_units_per_rev", "0", "a number above 0"),
        ("odrive", "motor_units_per_rev", "-1", "a number above 0"),
        ("odrive", "motor_units_per_rev", "inf", "a number above 0"),
        ("odrive", "output_units_per_rev", "0", "a number other than 0"),
        ("odrive", "output_units_per_rev", "nan", "a number other than 0"),
        ("damiao", "rated_current_a", "0", "a number above 0"),
        ("damiao", "rated_current_a", "-2", "a number above 0"),
        ("damiao", "position_max_rad", "0", "a number above 0"),
        ("damiao", "position_max_rad", "-2", "a number above 0"),
        ("damiao", "feedback_id", "2048", "a whole number from 0 to 2047"),
        ("moteus", "output_encoder", "3", "a whole number from 0 to 2"),
        (
            "moteus",
            "current_bandwidth_hz",
            "0",
            "a whole number from 1 to 1000000",
        ),
    ] {
        let refused = refusal(&drive(preset, &format!("{key} = {value}")));
        assert!(
            refused.ends_with(&format!("actuator[0].drive.{key}: expected {expected}, found {value}")),
            "{refused}"
        );
    }
    let damiao = drive(
        "damiao",
        "rated_current_a = 10\nposition_max_rad = 1\nfeedback_id = 2047",
    );
    let found = settings(&damiao);
    assert_eq!(
        (found.rated_current_a, found.position_max_rad, found.feedback_id),
        (Some(10.0), Some(1.0), Some(2047))
    );
}

#[test]
fn a_key_that_a_preset_does_not_have_is_refused_with_those_that_do() {
    for (preset, key, value, of) in [
        ("odrive", "eds", "\"drive.dcf\"", "cia402"),
        ("vesc", "rated_current_a", "3", "cia402, damiao"),
        ("moteus", "position_max_rad", "3", "damiao"),
        ("cia402", "feedback_id", "3", "damiao"),
        ("damiao", "motor_units_per_rev", "3", "cia402, odrive, moteus, vesc"),
        ("vesc", "output_encoder", "3", "cia402, odrive, moteus"),
        ("vesc", "output_units_per_rev", "3", "cia402, odrive, moteus"),
    ] {
        let refused = refusal(&drive(preset, &format!("{key} = {value}")));
        let expected = format!("drive.{key}: expected no such key, which is of preset {of}, found {value}");
        assert!(refused.ends_with(&expected), "{refused}");
    }
    let without = drive("vesc", "").replace("preset = \"vesc\"\n", "");
    assert!(
        refusal(&without)
            .ends_with("drive.preset: expected one of cia402, odrive, moteus, vesc, damiao, found no such key")
    );
    let unknown = refusal(&drive("servo", ""));
    assert!(
        unknown.contains("drive.preset: expected \"cia402\" or \"odrive\""),
        "{unknown}"
    );
    let both = OF_DBC.replace("[actuator.signals]", "drive.preset = \"vesc\"\n[actuator.signals]");
    assert!(refusal(&both).ends_with("actuator[0].dbc: expected either dbc or drive, found \"foreign.dbc\""));
    let refused = refusal(&drive("damiao", ""));
    assert!(
        refused.contains("actuator[0].drive: expected rated_current_a"),
        "{refused}"
    );
}

#[test]
fn the_file_of_a_drive_of_cia_402_is_its_own_or_that_of_its_bus() {
    let eds = |text: &str| {
        let config = read(text);
        let actuator = &config.actuators()[0];
        let drive = actuator.drive_bus.as_ref().unwrap();
        (actuator.eds.clone(), drive.map().is_ok(), actuator.log.is_some())
    };
    let own = drive("cia402", "node = 1\neds = \"drive.dcf\"");
    assert_eq!(eds(&own), (Some("drive.dcf".into()), true, true));
    let of_bus = drive("cia402", "node = 1") + "[bus]\neds = \"drive.dcf\"\n";
    assert_eq!(eds(&of_bus), (Some("drive.dcf".into()), true, true));
    // Without one it waits for what its master writes.
    assert_eq!(eds(&drive("cia402", "node = 1")), (None, false, false));

    let refused = refusal(&drive("cia402", "eds = \"none.dcf\""));
    assert!(
        refused
            .ends_with("drive.eds: expected an EDS or DCF file that can be read (there is none), found \"none.dcf\""),
        "{refused}"
    );
    let refused = refusal(&(drive("cia402", "") + "[bus]\neds = \"none.dcf\"\n"));
    assert!(
        refused.ends_with("that can be read (there is none), found none.dcf"),
        "{refused}"
    );
    // A file that nobody uses.
    for others in [drive("vesc", ""), String::new(), own] {
        let refused = super::checked(&(others + "[bus]\neds = \"other.dcf\"\n")).unwrap_err();
        assert!(
            refused.contains("bus.eds: expected no such key without an actuator whose drive has preset"),
            "{refused}"
        );
    }
}

#[test]
fn a_drive_or_a_mapped_actuator_is_on_no_serial_line() {
    let line = "[[serial]]\nbus = \"can0\"\ndevice = \"ttyS0\"\n";
    let on_bus = drive("odrive", "").replace("[actuator.drive]", "bus = \"can0\"\n[actuator.drive]");
    for text in [on_bus, OF_DBC.to_owned()] {
        let refused = refusal(&format!("{text}{line}"));
        let expected = "serial[0].bus: expected the bus of actuators without a DBC file or a drive, which are of CAN";
        assert!(refused.contains(expected), "{refused}");
    }
}
