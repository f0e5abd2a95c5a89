//! `hmd check-config`: every effective parameter with its origin, and what is seldom meant.

use serde_json::Value;

use crate::folder::Folder;

const OWN: &str = "[type.own]\nbased_on = \"bench\"\n[type.own.motor]\ninertia_kg_m2 = 1.1e-3\ninertia_kg_m2_tolerance = 0.02\n\
    [[actuator]]\nid = 0\ntype = \"own\"\n[type.spare]\nbased_on = \"servo28\"\n";

#[test]
fn parameters_have_their_origin_and_what_is_seldom_meant_is_warned_of() {
    let folder = Folder::new();
    folder.write("own.toml", OWN);
    let ended = folder.hmd("check-config -c own.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert_eq!(folder.hmd("check-config own.toml").stdout, ended.stdout);
    for line in [
        "  motor.inertia_kg_m2 0.0011 ± 0.02 of it (own.toml:4, own.toml:5)\n",
        "  motor.phase_resistance_ohm 2.75 ± 0.05 of it (built-in bench, usual)\n",
        "  motor.cogging ± 0.01 (usual)\n",
    ] {
        assert!(ended.stdout.contains(line), "{line} in\n{}", ended.stdout);
    }
    let warnings: Vec<&str> = ended.stderr.lines().collect();
    let [uncalibrated, inherited, unused] = warnings[..] else {
        panic!("{}", ended.stderr)
    };
    assert!(uncalibrated.starts_with("own.toml: warning: type own is not calibrated"));
    assert!(
        inherited.starts_with(
            "own.toml: warning: type own takes 25 values from the built-in type bench: motor.pole_pairs, "
        )
    );
    assert_eq!(unused, "own.toml: warning: type spare: no actuator uses it");

    let ended = folder.hmd("check-config -c own.toml --json");
    let json: Value = serde_json::from_str(&ended.stdout).expect("JSON");
    assert_eq!(json["warnings"].as_array().map(Vec::len), Some(3));
    let parameters = json["parameters"]["own"].as_array().expect("a list");
    let inertia = parameters
        .iter()
        .find(|parameter| parameter["key"] == "motor.inertia_kg_m2")
        .expect("the inertia");
    assert_eq!(
        (&inertia["value"], &inertia["origin"], &inertia["tolerance"]),
        (&1.1e-3.into(), &"own.toml:4".into(), &0.02.into())
    );
}

#[test]
fn the_defaults_warn_of_nothing() {
    let ended = Folder::new().hmd("check-config");
    assert_eq!((ended.code, &*ended.stderr), (0, ""));
}

#[test]
fn a_commissioned_unit_shows_its_own_parameters() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    let text = folder.done("check-config -c hmd.toml");
    let (_, of_unit) = text.split_once("unit ema0:\n").expect("the unit");
    assert!(of_unit.contains("  motor.inertia_kg_m2 "), "{of_unit}");
    assert!(
        of_unit.lines().next().is_some_and(|line| line.ends_with("(unit.toml)")),
        "{of_unit}"
    );
}
