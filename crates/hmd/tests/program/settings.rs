//! `--set KEY=VALUE`: keys of the configuration from the command line, and the searches that are chosen so.

use std::fs;

use serde_json::Value;

use crate::folder::Folder;

#[test]
fn a_setting_holds_over_the_file_and_a_later_one_over_an_earlier_one() {
    let folder = Folder::new();
    folder.write(
        "hmd.toml",
        "[identification]\nmethod = \"ga\"\n[window]\nduration_ms = 300\n",
    );
    let line = "check-config --json -c hmd.toml --set identification.method=de --set window.duration_ms=400 \
                --set identification.method=cmaes --set identification.objective=\"eq14\"";
    let json: Value = serde_json::from_str(&folder.done(line)).expect("JSON");
    let identification = &json["config"]["identification"];
    assert_eq!(identification["method"], "cmaes");
    assert_eq!(identification["objective"], "eq14");
    assert_eq!(identification["population"], 32);
    assert_eq!(json["config"]["window"]["duration_ms"], 400.0);
}

#[test]
fn a_setting_is_checked_as_a_file_is_and_named_by_its_number() {
    let folder = Folder::new();
    folder.write("hmd.toml", "[identification]\npopulation = 40\n");
    for (line, expected) in [
        (
            "--set window.duration_ms=400 --set window.duration_ms=-3",
            "--set:2: window.duration_ms: expected a number from 20 to 10000, found -3",
        ),
        (
            "--set windows.x=1",
            "--set:1: windows: unknown key; did you mean window?",
        ),
        (
            "--set method",
            "--set:1: not valid TOML: expected KEY=VALUE in one line, found \"method\"",
        ),
        (
            "--set identification.objective=eq14",
            "--set:1: identification.objective: expected \"residual\" with method = \"hybrid\", found \"eq14\"",
        ),
        (
            "-c hmd.toml --set identification.method=least-squares",
            "hmd.toml:2: identification.population: expected none with method = \"least-squares\", found 40",
        ),
    ] {
        for verb in ["check-config", "replay none.log"] {
            let ended = folder.hmd(&format!("{verb} {line}"));
            assert_eq!(
                (ended.code, ended.stderr),
                (78, format!("hmd: {expected}\n")),
                "{verb} {line}"
            );
        }
    }
}

#[test]
fn every_method_estimates_a_window() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --fault friction=0.4 --seed 2 -o worn.log");
    for method in ["hybrid", "ga", "de", "cmaes", "least-squares", "relations"] {
        let population = match method {
            "least-squares" | "relations" => "",
            _ => "--set identification.population=8 --set identification.generations=2",
        };
        let line = folder.done(&format!(
            "replay worn.log --json --set identification.method={method} {population}"
        ));
        let line: Value = serde_json::from_str(&line).expect("one window");
        let evaluations = line["evaluations"].as_u64().expect("a number");
        let reason = line["reason"].as_str().unwrap_or_default();
        match method {
            // Three generations of eight, of which the genetic algorithm keeps one, and a linearisation for the sigmas.
            "ga" | "de" | "cmaes" => assert!((22..45).contains(&evaluations), "{line}"),
            "relations" => {}
            _ => assert!(evaluations > 100, "{line}"),
        }
        let is_by_monitor = reason.contains("not commissioned: assessed by the monitor");
        assert_eq!(is_by_monitor, method == "relations", "{line}");
    }
}

#[test]
fn with_the_method_relations_a_commissioned_unit_is_assessed_by_nothing_else() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 6 --seed 5 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    assert!(
        fs::read_to_string(folder.path("unit.toml"))
            .unwrap()
            .contains("estimator = \"monitor\"")
    );
    folder.done("simulate --rate 400 --noise 0.05 --fault short_b=0.3 --seed 4 -o worn.log");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    let evaluations = |set: &str| {
        let line = folder.done(&format!("replay worn.log --json -c hmd.toml {set}"));
        let line: Value = serde_json::from_str(&line).expect("one window");
        line["evaluations"].as_u64().expect("a number")
    };
    assert!(evaluations("") > 0);
    assert_eq!(evaluations("--set identification.method=relations"), 0);
}
