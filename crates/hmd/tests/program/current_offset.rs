//! The offset of one current sensor of a drive that controls its currents by it: named by its phase, and taken out.

use crate::folder::Folder;

#[test]
fn an_offset_that_the_direct_current_does_not_show_is_named_by_its_phase() {
    let folder = Folder::new();
    let unit = "[[actuator]]\nid = 0\ntype = \"servo28\"\n";
    let drive = "[type.servo28.drive]\nkind = \"vector\"\n";
    folder.write("new.toml", format!("{unit}{drive}"));
    folder.write("hmd.toml", format!("{unit}calibration = \"unit.toml\"\n{drive}"));
    let simulate = |options: &str| {
        folder.done(&format!(
            "simulate -c new.toml --actuator servo28 --noise 0.03 {options}"
        ));
    };
    simulate("--windows 6 --seed 11 -o healthy.log");
    folder.done("calibrate healthy.log -c new.toml -o unit.toml");
    for (phase, amperes, profile) in [("a", 0.25, "mixed"), ("b", 0.12, "mixed"), ("c", 0.16, "step")] {
        simulate(&format!(
            "--windows 2 --seed 3 --profile {profile} --with current_offset_{phase}_a={amperes} -o later.log"
        ));
        let lines = folder.done("replay later.log -c hmd.toml --json");
        for line in lines.lines() {
            let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
            assert_eq!(line["suspects"], serde_json::json!(["current offset"]), "{line}");
            let reason = line["reason"].as_str().expect("a reason");
            let zeros = reason.matches(" +0 mA").count();
            assert!(zeros == 2 && !reason.contains(&format!("{phase} +0 mA")), "{line}");
            assert_eq!(
                (&line["status"], &line["faults"]),
                (&"degraded".into(), &serde_json::json!([])),
                "{line}"
            );
        }
    }
}

#[test]
fn an_offset_of_one_of_two_sensors_that_no_sum_shows_is_named_by_the_torque_and_taken_out() {
    let folder = Folder::new();
    let two_sensors = "--drive vector --noise 0.03 --with two_current_sensors=1";
    folder.commission("bench", &format!("8 {two_sensors} --seed 11"));
    for (fault, faults) in [("", vec![]), ("--fault short_b=0.2", vec!["short_b"])] {
        let later = format!("--windows 2 --seed 3 --with current_offset_a_a=0.15 {fault} -o later.log");
        folder.done(&format!("simulate {two_sensors} {later}"));
        for line in folder.replayed("later.log -c hmd.toml") {
            assert_eq!(line["suspects"], serde_json::json!(["current offset"]), "{line}");
            assert_eq!(
                (&line["status"], &line["faults"]),
                (&"degraded".into(), &serde_json::json!(faults)),
                "{line}"
            );
        }
    }
}
