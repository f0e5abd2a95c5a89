//! A log without the winding's temperature: friction may be that of a lubricant that is colder, or warmer, than at commissioning.

use crate::folder::Folder;

/// The identifier of the frames that hold the temperature.
const STATUS: &str = " 103#";

#[test]
fn without_a_temperature_a_cold_unit_is_accused_of_no_friction_and_a_worn_one_is() {
    let folder = Folder::new();
    let lubricant = "--drive vector --noise 0.03 --with viscous_temperature=1.5 --with dry_temperature=0.5";
    let simulate = |options: &str, log: &str| folder.done(&format!("simulate {lubricant} {options} -o {log}"));
    simulate("--windows 8 --seed 61 --with temperature_rise_k=0.01", "healthy.log");
    let known = "[[actuator]]\nid = 0\n";
    folder.write("new.toml", known);
    folder.write("unit.toml", format!("{known}calibration = \"unit.calibration.toml\"\n"));
    folder.done("calibrate healthy.log -c new.toml -o unit.calibration.toml");
    for (rise_k, fault, expected) in [(-40.0, "0", "[]"), (0.01, "0.5", "[\"friction\"]")] {
        let later = format!("--windows 2 --seed 62 --with temperature_rise_k={rise_k} --fault friction={fault}");
        simulate(&later, "later.log");
        let later = String::from_utf8(folder.read("later.log")).expect("a log of text");
        let kept: String = later
            .split_inclusive('\n')
            .filter(|line| !line.contains(STATUS))
            .collect();
        assert!(kept.len() < later.len());
        folder.write("later.log", kept);
        for line in folder.replayed("later.log -c unit.toml") {
            assert_eq!(line["faults"].to_string(), expected, "{line}");
            let reason = line["reason"].as_str().expect("a reason");
            assert!(reason.contains("no winding temperature"), "{line}");
        }
    }
}
