//! Commissioning of a unit by `hmd calibrate`, and what its file does to later windows.

use std::fs;

use crate::folder::Folder;

#[test]
fn a_commissioned_unit_is_assessed_by_its_calibration() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --load 4 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done("check-config -c hmd.toml");
    folder.done("simulate --rate 400 --noise 0.05 --seed 9 --fault short_b=0.2 -o worn.log");
    let lines = folder.done("replay worn.log -c hmd.toml --json");
    assert!(lines.contains("\"faults\":[\"short_b\"]"), "{lines}");

    folder.write(
        "other.toml",
        "[[actuator]]\nid = 0\ntype = \"servo28\"\ncalibration = \"unit.toml\"\n",
    );
    let refused = folder.hmd("check-config -c other.toml");
    assert_eq!(refused.code, 78);
    assert!(
        refused
            .stderr
            .contains("expected a unit of type servo28, found one of type bench"),
        "{}",
        refused.stderr
    );
}

#[test]
fn a_unit_with_a_vector_drive_is_commissioned_by_its_relations() {
    let folder = Folder::new();
    let drive = "--drive vector --with dead_time_s=1.5e-6 --with dynamic_friction_deviation=0.2 --noise 0.03";
    folder.done(&format!("simulate {drive} --windows 6 --seed 3 -o healthy.log"));
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    for expected in [
        "assessed by the relations between measured signals",
        "smallest damage that shows: friction",
    ] {
        assert!(ended.stderr.contains(expected), "{expected} in\n{}", ended.stderr);
    }
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done(&format!("simulate {drive} --windows 3 --seed 9 -o later.log"));
    let lines = folder.done("replay later.log -c hmd.toml --json");
    assert_eq!(lines.matches("\"status\":\"ok\"").count(), 3, "{lines}");
    assert_eq!(lines.matches("\"faults\":[]").count(), 3, "{lines}");
    folder.done(&format!("simulate {drive} --fault friction=0.2 --seed 11 -o worn.log"));
    let lines = folder.done("replay worn.log -c hmd.toml --json");
    assert!(lines.contains("\"faults\":[\"friction\"]"), "{lines}");

    // Other parameters of the type than at commissioning.
    folder.write(
        "changed.toml",
        "[type.bench.motor]\ninertia_kg_m2 = 1.1e-3\n[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n",
    );
    let ended = folder.hmd("check-config -c changed.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let expected = "unit.toml: warning: the parameters of type bench have changed since ema0 was commissioned";
    assert!(ended.stderr.contains(expected), "{}", ended.stderr);
}

/// R, k and J trade against each other in all that an actuator with comparators does: nearly no other torque, voltage or current.
#[test]
fn the_parameters_of_a_unit_come_out_near_what_they_are() {
    let folder = Folder::new();
    for (effect, truth) in [
        ("back_emf_deviation", [0.0, 0.05, 0.0]),
        ("inertia_deviation", [0.0, 0.0, 0.08]),
    ] {
        let size = truth.iter().sum::<f64>();
        folder.done(&format!(
            "simulate --with {effect}={size} --windows 8 --noise 0.03 --seed 2 -o healthy.log"
        ));
        let ended = folder.hmd("calibrate healthy.log -o unit.toml");
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        let written = String::from_utf8(folder.read("unit.toml")).expect("text");
        let unit: toml::Table = written.parse().expect("TOML");
        for ((key, truth), tolerance) in ["resistance", "back_emf", "inertia"]
            .iter()
            .zip(truth)
            .zip([0.05, 0.015, 0.02])
        {
            let found = unit["monitor"]["parameters"][key]["share"]
                .as_float()
                .expect("a number");
            assert!((found - truth).abs() < tolerance, "{effect}: {key} {found}\n{written}");
        }
        fs::remove_file(folder.path("unit.toml")).expect("removable");
    }
}

/// Its direct current looks as that of an offset does, but grows with the speed.
#[test]
fn an_eccentric_rotor_is_no_current_offset() {
    let folder = Folder::new();
    folder.done("simulate --actuator servo270 --windows 6 --noise 0.03 --seed 1 -o healthy.log");
    folder.write("type.toml", "[[actuator]]\nid = 0\ntype = \"servo270\"\n");
    folder.done("calibrate healthy.log -c type.toml -o unit.toml");
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\ntype = \"servo270\"\ncalibration = \"unit.toml\"\n",
    );
    let fault = "--fault eccentricity=0.3 --fault eccentricity_phase=0.2";
    folder.done(&format!(
        "simulate --actuator servo270 {fault} --noise 0.03 --seed 2 -o worn.log"
    ));
    for config in ["type.toml", "hmd.toml"] {
        let lines = folder.done(&format!("replay worn.log -c {config} --json"));
        assert!(lines.contains("\"faults\":[\"eccentricity\"]"), "{config}: {lines}");
        assert!(!lines.contains("suspects"), "{config}: {lines}");
    }
}

#[test]
fn a_parameter_far_from_the_type_is_named_and_not_written() {
    let folder = Folder::new();
    folder.done("simulate --with inertia_deviation=0.6 --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    let text = folder.refused("calibrate healthy.log -o unit.toml", 1);
    let key = "type.bench.motor.inertia_kg_m2: expected 0.001 within 5 tolerances";
    assert!(text.contains(key), "{text}");
    assert!(!folder.path("unit.toml").exists());

    folder.done("simulate --with inertia_deviation=-0.4 --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    let text = folder.refused("calibrate healthy.log -o unit.toml", 1);
    assert!(text.contains(key), "{text}");

    // Where the monitor does not explain the unit: the relations need no resistance.
    let effects = "--with resistance_deviation=0.6 --with emf_5=0.03 --with stribeck_nm=0.1";
    folder.done(&format!(
        "simulate {effects} --noise 0.03 --windows 5 --seed 3 -o healthy.log"
    ));
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let key = "the monitor is not used: type.bench.motor.phase_resistance_ohm: expected 2.75 within 5 tolerances";
    assert!(ended.stderr.contains(key), "{}", ended.stderr);
    let written = String::from_utf8(folder.read("unit.toml")).expect("text");
    assert!(!written.contains("[monitor]"), "{written}");
}

#[test]
fn calibrations_in_the_wrong_place_are_refused() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("as_type.toml", "[type.bench]\ncalibration = \"unit.toml\"\n");
    let text = folder.refused("check-config -c as_type.toml", 78);
    assert!(
        text.contains("expected a type calibration, found the calibration of a unit"),
        "{text}"
    );
    let of_type = concat!(env!("CARGO_MANIFEST_DIR"), "/../ema-identify/calibration/bench.toml");
    folder.write("type.toml", fs::read(of_type).expect("the shipped calibration"));
    folder.write("as_unit.toml", "[[actuator]]\nid = 0\ncalibration = \"type.toml\"\n");
    let text = folder.refused("check-config -c as_unit.toml", 78);
    assert!(
        text.contains("expected a unit's calibration, found the calibration of a type"),
        "{text}"
    );
}

#[test]
fn a_calibration_from_a_damaged_log_reports_what_was_lost() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 6 --seed 3 -o healthy.log");
    let lines = String::from_utf8(folder.read("healthy.log")).expect("text");
    let mut lines: Vec<&str> = lines.lines().collect();
    lines[100] = "(1.0) rubbish";
    folder.write_lines("damaged.log", &lines);
    let ended = folder.hmd("calibrate damaged.log -o unit.toml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    for expected in [
        "damaged.log:101: expected a stamp",
        "damaged.log: data lost: 1 unreadable lines or frames, ",
        "from 6 windows",
    ] {
        assert!(ended.stderr.contains(expected), "{expected} in\n{}", ended.stderr);
    }
    assert!(folder.path("unit.toml").exists());
    // Too little is left: half of it.
    folder.write_lines("half.log", &lines[..lines.len() / 2]);
    let ended = folder.hmd("calibrate half.log -o none.toml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let last = ended.stderr.lines().last().expect("a sentence");
    assert!(
        last.contains("half.log: expected at least 5 windows that can be assessed, found "),
        "{last}"
    );
    assert!(!folder.path("none.toml").exists());
}

#[test]
fn a_unit_can_be_calibrated_under_the_configuration_that_names_the_result() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --seed 3 -o healthy.log");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done("calibrate healthy.log -c hmd.toml -o unit.toml");
    let first = folder.read("unit.toml");
    folder.done("calibrate healthy.log -c hmd.toml -o unit.toml");
    assert_eq!(folder.read("unit.toml"), first, "not from what was learnt before");
    for line in [
        "calibrate healthy.log -o own.toml --actuator servo28",
        "calibrate healthy.log -o own.toml --monitor paper",
    ] {
        folder.misused(line);
    }
    folder.write("hmd.toml", "[type.bench]\ncalibration = \"bench.toml\"\n");
    folder.write("bench.toml", "read by the calibration of a unit");
    let text = folder.refused("calibrate healthy.log -c hmd.toml -o bench.toml", 2);
    assert!(text.contains("expected another output"), "{text}");
}
