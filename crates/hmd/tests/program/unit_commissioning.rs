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

/// In motion one way a load passes for friction: only the reading of the load tells them apart.
#[test]
fn a_unit_that_was_commissioned_by_steps_hides_no_friction_and_accuses_no_load_sensor() {
    let folder = Folder::new();
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done("simulate --noise 0.03 --profile step --windows 10 --seed 9 -o healthy.log");
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert!(
        ended.stderr.contains("friction not shown by these windows"),
        "{}",
        ended.stderr
    );
    for faults in ["--fault friction=0.2", "--fault friction=0.09 --fault backlash=0.06"] {
        folder.done(&format!(
            "simulate --noise 0.03 --profile step --windows 4 --seed 45 {faults} -o worn.log"
        ));
        let lines = folder.done("replay worn.log -c hmd.toml --json");
        let truth = if faults.contains("0.2") { 0.2 } else { 0.09 };
        for line in lines.lines() {
            let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
            assert!(line["status"] != "invalid" && line["suspects"].is_null(), "{line}");
            if let Some(sigma) = line["sigma"][0].as_f64() {
                let found = line["k"][0].as_f64().expect("a number");
                assert!((found - truth).abs() < 4.0 * sigma, "{line}");
            }
        }
    }
}

/// The magnets lose a tenth of a percent of their torque for each kelvin, and gain it in the cold.
#[test]
fn warmth_is_no_short_and_cold_hides_none() {
    let folder = Folder::new();
    let drive = "--drive vector --noise 0.03";
    folder.done(&format!("simulate {drive} --windows 8 --seed 3 -o healthy.log"));
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    let shorts = |options: &str| {
        folder.done(&format!("simulate {drive} --windows 2 {options} -o later.log"));
        let lines = folder.done("replay later.log -c hmd.toml --json");
        assert_eq!(lines.matches("\"status\":\"degraded\"").count(), 2, "{lines}");
        let of = |line: &str| {
            let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
            assert_eq!(line["faults"], serde_json::json!([]), "{options}: {line}");
            [2, 3, 4].map(|n| line["k"][n].as_f64().expect("a number"))
        };
        lines.lines().map(of).collect::<Vec<_>>()
    };
    for rise in [50, -50] {
        for [a, b, c] in shorts(&format!("--with temperature_rise_k={rise} --seed 9")) {
            assert!(a.max(b).max(c) < 0.015, "{rise} K: {a} {b} {c}");
        }
    }
    for [a, b, c] in shorts("--with temperature_rise_k=-50 --fault short_b=0.08 --seed 12") {
        assert!((b - 0.08).abs() < 0.015 && a.max(c) < 0.015, "{a} {b} {c}");
    }
}

/// Between coarse samples the torque is interpolated: what that leaves goes with the rotor's angle, and windows from one angle hide it.
#[test]
fn a_healthy_unit_at_another_rotor_angle_is_not_accused() {
    let folder = Folder::new();
    folder.write(
        "new.toml",
        "[[actuator]]\nid = 0\n[type.bench.drive]\nkind = \"vector\"\n[type.bench.sensors]\nsample_rate_hz = 400\n",
    );
    folder.write(
        "effects.toml",
        "drive = \"vector\"\ndead_time_s = 1.2e-6\ncogging_nm = 0.09\nresolver_error_1_rad = 3e-3\nresolver_error_2_rad = 2e-3\n\
         current_offset_a_a = 0.03\ncurrent_gain_b = 0.01\nback_emf_deviation = 0.025\ninertia_deviation = -0.04\n",
    );
    let drive = "--effects effects.toml --rate 400 --noise 0.03";
    folder.done(&format!("simulate {drive} --windows 10 --seed 11 -o healthy.log"));
    let ended = folder.hmd("calibrate healthy.log -c new.toml -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("record from several positions"),
        "{}",
        ended.stderr
    );
    let known = String::from_utf8(folder.read("new.toml")).expect("text");
    folder.write(
        "known.toml",
        known.replacen("id = 0", "id = 0\ncalibration = \"unit.toml\"", 1),
    );
    for seed in 212..217 {
        folder.done(&format!("simulate {drive} --windows 2 --seed {seed} -o later.log"));
        let lines = folder.done("replay later.log -c known.toml --json");
        assert_eq!(lines.matches("\"faults\":[]").count(), 2, "{seed}: {lines}");
    }
    folder.done(&format!(
        "simulate {drive} --windows 2 --seed 5 --fault friction=0.5 -o worn.log"
    ));
    let lines = folder.done("replay worn.log -c known.toml --json");
    assert!(lines.contains("\"faults\":[\"friction\"]"), "{lines}");
}

/// At 400 Hz the motor of this type makes three radians electrical from sample to sample: what the balance leaves of that repeats with the
/// motion, and each motion leaves something else.
#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_healthy_unit_in_another_motion_is_not_accused() {
    let folder = Folder::new();
    let known = "[[actuator]]\nid = 0\ntype = \"servo270\"\ncalibration = \"unit.toml\"\n[type.servo270.sensors]\nsample_rate_hz = 400\n";
    folder.write("known.toml", known);
    folder.write(
        "effects.toml",
        "drive = \"vector\"\ndead_time_s = 1.7e-6\nback_emf_deviation = -0.035\nresistance_deviation = -0.036\n\
         dynamic_friction_deviation = 0.081\nstatic_friction_deviation = -0.163\ninertia_deviation = 0.019\nplay_deviation = -0.194\n",
    );
    let unit = "--actuator servo270 --effects effects.toml --rate 400 --noise 0.02";
    folder.done(&format!("simulate {unit} --windows 10 --seed 657253 -o healthy.log"));
    folder.done("calibrate healthy.log -c known.toml -o unit.toml");
    for (motion, seed, windows) in [("--mode speed", 657_260, 3), ("--profile step", 99, 8), ("", 3, 4)] {
        folder.done(&format!(
            "simulate {unit} {motion} --windows {windows} --seed {seed} -o later.log"
        ));
        let lines = folder.done("replay later.log -c known.toml --json");
        assert_eq!(lines.matches("\"faults\":[]").count(), windows, "{motion}: {lines}");
    }
}

/// What differs in service from the windows of commissioning blurs what depends on it, and accuses no part and no sensor: a load, of which
/// the gear's efficiency is known to a tolerance; a current in which the offsets of the sensors are a large share; coarse samples.
#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_healthy_unit_in_other_conditions_is_not_accused() {
    for (unit, rate, commissioned, later) in [
        (
            "bench --with opposing_efficiency_deviation=-0.1 --with aiding_efficiency_deviation=-0.1",
            2000,
            "--seed 5",
            "--windows 4 --load=109 --seed 77",
        ),
        (
            "servo270 --with current_offset_a_a=-0.0231523 --with current_offset_b_a=-0.0125232 --with current_offset_c_a=0.0123256",
            1000,
            "--profile step --seed 833169",
            "--profile ramp --windows 2 --seed 612515",
        ),
        ("servo270", 400, "--seed 5", "--windows 4 --seed 77"),
    ] {
        let folder = Folder::new();
        let type_name = unit.split(' ').next().unwrap_or_default();
        folder.write(
            "known.toml",
            format!(
                "[[actuator]]\nid = 0\ntype = \"{type_name}\"\ncalibration = \"unit.toml\"\n\
                 [type.{type_name}.sensors]\nsample_rate_hz = {rate}\n"
            ),
        );
        let unit = format!("simulate --actuator {unit} --rate {rate} --noise 0.018");
        folder.done(&format!("{unit} --windows 10 {commissioned} -o healthy.log"));
        folder.done("calibrate healthy.log -c known.toml -o unit.toml");
        folder.done(&format!("{unit} {later} -o later.log"));
        for line in folder.done("replay later.log -c known.toml --json").lines() {
            let record: serde_json::Value = serde_json::from_str(line).expect("a line of JSON");
            assert_eq!(record["faults"], serde_json::json!([]), "{line}");
            assert!(record.get("suspects").is_none(), "{line}");
        }
    }
}

/// What a unit has when it is commissioned would count as its health.
#[test]
#[ignore = "long form: cargo xtask robust"]
fn windows_of_a_worn_unit_commission_nothing() {
    let folder = Folder::new();
    for (fault, said) in [
        (
            "backlash=0.5",
            "type.bench.transmission.backlash_rad: expected 0.0001 within 5 tolerances",
        ),
        (
            "short_a=0.4",
            "expected windows in health, found inter-turn short, phase A of 0.4",
        ),
    ] {
        folder.done(&format!(
            "simulate --noise 0.03 --windows 6 --seed 5 --fault {fault} -o worn.log"
        ));
        let text = folder.refused("calibrate worn.log -o unit.toml", 1);
        assert!(text.contains(said), "{text}");
        assert!(!folder.path("unit.toml").exists());
    }
    folder.done("simulate --noise 0.03 --windows 6 --seed 5 --fault short_a=0.25 -o visible.log");
    let ended = folder.hmd("calibrate visible.log -o unit.toml");
    assert!(
        ended.stderr.contains("what it has now will count as health"),
        "{}",
        ended.stderr
    );
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

/// A log of the built-in frames as if the motor had stood whole turns further, and the encoder been mounted so many counts off.
fn with_other_zeros(log: &[u8], motor_turns: i32, output_counts: i32) -> String {
    /// `(stamp) bus ID#DATA`.
    fn moved(line: &str, motor_turns: i32, output_counts: i32) -> Option<String> {
        let (head, data) = line.split_once('#')?;
        let byte = |n: usize| u8::from_str_radix(&data[2 * n..2 * n + 2], 16).expect("hexadecimal");
        let i32_at_start = || i32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]);
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02X}")).collect::<String>();
        if head.ends_with(" 101") {
            let output = i32::from_le_bytes([0, byte(4), byte(5), byte(6)]) >> 8;
            let motor = hex(&(i32_at_start() + 65_536 * motor_turns).to_le_bytes());
            let output = hex(&(output + output_counts).to_le_bytes()[..3]);
            return Some(format!("{head}#{motor}{output}{}", &data[14..]));
        }
        let is_command = head.ends_with(" 102") && byte(4) == 1;
        // 20 000 counts are a turn.
        let set_point = f64::from(output_counts) * std::f64::consts::TAU / 20_000.0 * 1e6;
        let set_point = i32_at_start() + set_point.round() as i32;
        is_command.then(|| format!("{head}#{}{}", hex(&set_point.to_le_bytes()), &data[8..]))
    }
    let text = std::str::from_utf8(log).expect("text");
    let lines = text
        .lines()
        .map(|line| moved(line, motor_turns, output_counts).unwrap_or_else(|| line.to_owned()) + "\n");
    lines.collect()
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn where_the_zeros_of_motor_and_output_lie_changes_nothing() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.03 --windows 6 --seed 6 -o healthy.log");
    let fault = "--fault friction=0.4 --fault backlash=0.15 --fault short_b=0.1";
    folder.done(&format!(
        "simulate --rate 400 --noise 0.03 {fault} --seed 7 -o worn.log"
    ));
    let [healthy, worn] = ["healthy.log", "worn.log"].map(|log| folder.read(log));
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    let damages = |motor_turns: [i32; 2], output_counts: i32| -> Vec<f64> {
        folder.write("moved.log", with_other_zeros(&healthy, motor_turns[0], output_counts));
        let ended = folder.hmd("calibrate moved.log -o unit.toml");
        assert!(ended.stderr.contains("assessed by the monitor"), "{}", ended.stderr);
        folder.write("moved.log", with_other_zeros(&worn, motor_turns[1], output_counts));
        let line = folder.done("replay moved.log -c hmd.toml --json");
        fs::remove_file(folder.path("unit.toml")).expect("removable");
        let window: serde_json::Value = serde_json::from_str(line.trim()).expect("one line");
        let k = window["k"].as_array().expect("eight").iter().take(5);
        k.map(|k| k.as_f64().expect("a number")).collect()
    };
    let as_simulated = damages([0, 0], 0);
    assert!((as_simulated[0] - 0.4).abs() < 0.03, "{as_simulated:?}");
    // After another start the motor's counter may stand elsewhere.
    for (motor_turns, output_counts) in [([3, 3], 0), ([1, -4], 0), ([0, 2], 37)] {
        let moved = damages(motor_turns, output_counts);
        let off = moved
            .iter()
            .zip(&as_simulated)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(
            off < 0.01,
            "{motor_turns:?}, {output_counts}: {moved:?} for {as_simulated:?}"
        );
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
#[ignore = "long form: cargo xtask robust"]
fn a_parameter_far_from_the_type_is_named_and_not_written() {
    let folder = Folder::new();
    folder.done("simulate --with inertia_deviation=0.6 --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    let text = folder.refused("calibrate healthy.log -o unit.toml", 1);
    let key = "type.bench.motor.inertia_kg_m2: expected 0.001 within 5 tolerances";
    assert!(text.contains(key), "{text}");
    assert!(!folder.path("unit.toml").exists());

    folder.done("simulate --with inertia_deviation=-0.4 --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    // A motor so far off may have a sensor doubted first.
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert!([1, 2].contains(&ended.code), "{}", ended.stderr);
    assert!(ended.stderr.contains(key), "{}", ended.stderr);

    // Where the monitor does not explain the unit: the relations need no resistance.
    let effects = "--with resistance_deviation=0.6 --with emf_5=0.03 --with stribeck_nm=0.1";
    folder.done(&format!(
        "simulate {effects} --noise 0.03 --windows 5 --seed 3 -o healthy.log"
    ));
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let key = "the monitor is not used: it follows these windows only with type.bench.motor.phase_resistance_ohm: expected 2.75 within 5 tolerances";
    assert!(ended.stderr.contains(key), "{}", ended.stderr);
    let written = String::from_utf8(folder.read("unit.toml")).expect("text");
    assert!(!written.contains("[monitor]"), "{written}");
}

#[test]
fn calibrations_in_the_wrong_place_are_refused() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    let unit = String::from_utf8(folder.read("unit.toml")).expect("text");
    folder.write(
        "of_s1.toml",
        unit.replacen("[seen]", "serial_number = \"S1\"\n[seen]", 1),
    );
    folder.write(
        "s2.toml",
        "[[actuator]]\nid = 0\nserial_number = \"S2\"\ncalibration = \"of_s1.toml\"\n",
    );
    for verb in ["check-config -c s2.toml", "replay healthy.log -c s2.toml"] {
        let text = folder.refused(verb, 78);
        assert!(
            text.contains("of_s1.toml") && text.contains("S2") && text.contains("S1"),
            "{text}"
        );
    }
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
        "damaged.log: data lost: 1 unreadable line or frame",
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

/// A lubricant is thinner when it is warm: friction beyond the temperatures of commissioning has a sigma that says so.
#[test]
fn friction_at_other_temperatures_is_neither_denied_nor_accused() {
    let folder = Folder::new();
    folder.write(
        "new.toml",
        "[[actuator]]\nid = 0\n[type.bench.drive]\nkind = \"vector\"\n",
    );
    folder.write(
        "unit.toml",
        "[[actuator]]\nid = 0\ncalibration = \"unit.calibration.toml\"\n[type.bench.drive]\nkind = \"vector\"\n",
    );
    let drive = "--drive vector --noise 0.03 --with viscous_deviation=0.4";
    folder.done(&format!("simulate -o healthy.log {drive} --windows 8 --seed 11"));
    folder.done("calibrate healthy.log -c new.toml -o unit.calibration.toml");
    let effects = format!("{drive} --windows 3 --seed 23 --with dry_temperature=0.6 --with viscous_temperature=2");
    folder.done(&format!(
        "simulate -o warm.log {effects} --with temperature_rise_k=40 --fault friction=0.4"
    ));
    let warm = folder.done("replay warm.log -c unit.toml --json");
    assert!(!warm.contains("\"friction\":\"nominal\""), "{warm}");
    // What the lubricant takes from the friction at speed looks like a load.
    assert!(!warm.contains("load sensor"), "{warm}");
    folder.done(&format!("simulate -o cold.log {effects} --with temperature_rise_k=-25"));
    let cold = folder.done("replay cold.log -c unit.toml --json");
    assert_eq!(cold.matches("\"faults\":[]").count(), 3, "{cold}");
}

#[test]
fn windows_of_several_rates_are_refused_and_a_type_without_friction_is_not() {
    let folder = Folder::new();
    folder.write(
        "own.toml",
        "[[actuator]]\nid = 0\ntype = \"own\"\n[type.own]\nbased_on = \"bench\"\n[type.own.motor]\nviscous_damping_nm_s_per_rad = 0\n\
         [type.own.transmission]\ndynamic_friction_nm = 0\nstatic_friction_nm = 0\n[type.own.drive]\nkind = \"vector\"\n",
    );
    let simulate = "simulate -c own.toml --actuator own --drive vector --noise 0.03 --windows 5";
    folder.done(&format!("{simulate} --seed 3 -o fast.log"));
    folder.done(&format!(
        "{simulate} --seed 4 --rate 400 -o slow.log --start 2026-01-01T00:00Z"
    ));
    let ended = folder.hmd("calibrate fast.log slow.log -c own.toml -o unit.toml");
    let sentence = "one sampling rate, found 2000.0 and 400.0";
    assert!(ended.code == 1 && ended.stderr.contains(sentence), "{}", ended.stderr);
    let ended = folder.hmd("calibrate fast.log -c own.toml -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(ended.stderr.contains("by the relations"), "{}", ended.stderr);
}

/// A misspelt unit is no lack of windows; and what all logs have in common is said once.
#[test]
fn a_unit_that_the_logs_do_not_hold_is_named_with_those_that_they_do() {
    let folder = Folder::new();
    for seed in 1..=3 {
        folder.done(&format!(
            "simulate --rate 400 --noise 0.03 --windows 2 --seed {seed} -o h{seed}.log"
        ));
    }
    let said = |line: &str, code: i32| {
        let ended = folder.hmd(line);
        assert_eq!(ended.code, code, "hmd {line}: {}", ended.stderr);
        assert_eq!(
            ended.stderr.matches("expected 2000 samples/s").count(),
            1,
            "{}",
            ended.stderr
        );
        ended.stderr
    };
    let refused = said("calibrate h1.log h2.log h3.log -o unit.toml --name zz", 1);
    assert!(
        refused.contains("--name: expected one of ema0, found \"zz\""),
        "{refused}"
    );
    said("calibrate h1.log h2.log h3.log -o unit.toml --name ema0", 0);
}
