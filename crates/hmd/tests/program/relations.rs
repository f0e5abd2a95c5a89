//! Units assessed by the relations between their signals, and where these hold.

use serde_json::Value;

use crate::folder::Folder;

/// Records of `other.log` of the unit that is commissioned by `healthy.log`; both are of this unit, and `other` beside.
fn records(unit: &str, healthy: &str, other: &str, settings: &str) -> Vec<Value> {
    let folder = Folder::new();
    folder.done(&format!(
        "simulate {unit} {healthy} --windows 12 --seed 1 -o healthy.log"
    ));
    let typed = unit.split_whitespace().skip_while(|word| *word != "--actuator").nth(1);
    let typed = typed.map_or_else(String::new, |of_type| format!("type = \"{of_type}\"\n"));
    let rate = unit.split_whitespace().skip_while(|word| *word != "--rate").nth(1);
    let rate = rate.map_or_else(String::new, |rate| {
        let of_type = typed.split('"').nth(1).unwrap_or("bench");
        format!("[type.{of_type}.sensors]\nsample_rate_hz = {rate}\n")
    });
    folder.write("type.toml", format!("[[actuator]]\nid = 0\n{typed}{rate}"));
    folder.done("calibrate healthy.log -c type.toml -o unit.calibration.toml");
    folder.write(
        "unit.toml",
        format!("[[actuator]]\nid = 0\n{typed}calibration = \"unit.calibration.toml\"\n{rate}"),
    );
    folder.done(&format!("simulate {unit} {other} --windows 4 --seed 2 -o other.log"));
    let lines = folder.done(&format!("replay other.log -c unit.toml --json {settings}"));
    let parsed = lines.lines().map(|line| serde_json::from_str(line).ok());
    parsed.map(Option::unwrap_or_default).collect()
}

#[test]
fn a_torque_that_nobody_knows_is_not_explained_by_the_noise_of_the_currents() {
    let unit = "--drive vector --with dead_time_s=1.5e-6 --noise 0.05";
    let found = records(unit, "", "--with cogging_nm=0.2 --with cogging_periods=10", "");
    assert_eq!(found.len(), 4);
    for record in found {
        assert_eq!(record["status"], "unmodelled", "{record}");
    }
}

#[test]
fn a_large_friction_in_few_samples_is_observable() {
    let unit = "--actuator servo28 --drive vector --rate 400 --noise 0.03";
    let by_relations = "--set identification.method=relations";
    let found = records(unit, "", "--fault friction=0.8", by_relations);
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
