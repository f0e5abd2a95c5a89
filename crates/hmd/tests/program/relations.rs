//! Units assessed by the relations between their signals, and where these hold.

use serde_json::Value;

use crate::folder::Folder;

/// Records of four windows of a unit that twelve healthy windows commissioned. `unit` are its arguments of `simulate`, `configured` the keys of its
/// actuator and of its type; `worn` is what is new in the four.
fn records(unit: &str, [actuator, of_type]: [&str; 2], worn: &str, settings: &str) -> Vec<Value> {
    let folder = Folder::new();
    let config = |calibration: &str| format!("[[actuator]]\nid = 0\n{actuator}{calibration}{of_type}");
    folder.write("new.toml", config(""));
    folder.write("known.toml", config("calibration = \"unit.toml\"\n"));
    folder.done(&format!("simulate {unit} --windows 12 --seed 1 -o healthy.log"));
    folder.done("calibrate healthy.log -c new.toml -o unit.toml");
    folder.done(&format!("simulate {unit} {worn} --windows 4 --seed 2 -o worn.log"));
    folder.replayed(&format!("worn.log -c known.toml {settings}"))
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_torque_that_nobody_knows_is_not_explained_by_the_noise_of_the_currents() {
    let unit = "--drive vector --with dead_time_s=1.5e-6 --noise 0.05";
    let found = records(unit, [""; 2], "--with cogging_nm=0.2 --with cogging_periods=10", "");
    assert_eq!(found.len(), 4);
    for record in found {
        assert_eq!(record["status"], "unmodelled", "{record}");
    }
}

#[test]
fn a_large_friction_in_few_samples_is_observable() {
    let unit = "--actuator servo28 --drive vector --rate 400 --noise 0.03";
    let configured = ["type = \"servo28\"\n", "[type.servo28.sensors]\nsample_rate_hz = 400\n"];
    let found = records(
        unit,
        configured,
        "--fault friction=0.8",
        "--set identification.method=relations",
    );
    // A share of the damage itself: 15 % at this rate.
    let is_wide = |record: &&Value| record["sigma"][0].as_f64().is_some_and(|sigma| sigma > 0.1);
    let wide: Vec<&Value> = found.iter().filter(is_wide).collect();
    assert!(!wide.is_empty(), "{found:?}");
    for record in wide {
        assert_eq!(record["observable"][0], true, "{record}");
    }
}

#[test]
fn a_slow_actuator_on_its_way_is_not_locked() {
    let folder = Folder::new();
    folder.write(
        "valve.toml",
        "[[actuator]]\nid = 0\ntype = \"valve\"\n[type.valve]\nbased_on = \"bench\"\n\
         transmission = { gear_ratio = 1000 }\ncontroller = { speed_max_rad_s = 40, position_gain_per_s = 25000 }\n",
    );
    folder.done("simulate -c valve.toml --actuator valve --profile step --windows 2 --noise 0.03 -o step.log");
    let lines = folder.done("replay step.log -c valve.toml --json");
    assert_eq!(lines.lines().count(), 2, "{lines}");
    assert!(!lines.contains("does not turn as commanded"), "{lines}");
}

#[test]
fn the_harmonics_of_a_motor_come_out_of_its_commissioning() {
    let folder = Folder::new();
    folder.done(
        "simulate --drive vector --noise 0.01 --windows 12 --with emf_5=0.05 --with emf_7=0.01 --seed 1 -o healthy.log",
    );
    folder.done("calibrate healthy.log -o unit.toml --report unit.html");
    let page = String::from_utf8(folder.read("unit.html")).expect("text");
    let row = page.split("h₅ − h₇").last().expect("the row of the harmonics");
    let shown: Vec<&str> = row.split(['<', '>']).filter(|text| text.contains("0.04")).collect();
    assert!(!shown.is_empty(), "{}", row.chars().take(300).collect::<String>());
}
