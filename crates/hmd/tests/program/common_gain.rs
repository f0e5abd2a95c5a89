//! A gain of all current sensors, or of one of two, that came since commissioning: no shorts, whatever the levels, and no hiding place of one.

use crate::folder::Folder;

/// Shorts of phases A, B, C, each with its sigma.
fn shorts(line: &serde_json::Value) -> [(f64, f64); 3] {
    [2, 3, 4].map(|n| {
        let number = |key: &str| line[key][n].as_f64().expect("a number");
        (number("k"), number("sigma"))
    })
}

#[test]
fn currents_that_all_read_wrong_accuse_no_phase_and_hide_no_short() {
    let folder = Folder::new();
    folder.commission("servo270", "10 --noise 0.02 --seed 11");
    let known = String::from_utf8(folder.read("hmd.toml")).expect("text");
    folder.write(
        "low.toml",
        format!("{known}[health]\nwatch = 0.02\nhysteresis = 0.01\n"),
    );
    let simulate = |options: &str| folder.done(&format!("simulate --actuator servo270 --noise 0.02 {options}"));
    let later = |gain: f64, options: &str| {
        let gains: String = ["a", "b", "c"]
            .iter()
            .map(|phase| format!("--with current_gain_{phase}={gain} "))
            .collect();
        simulate(&format!("--windows 2 --seed 3 {gains}{options} -o later.log"));
    };
    later(0.04, "");
    for line in [
        folder.replayed("later.log -c hmd.toml"),
        folder.replayed("later.log -c low.toml"),
    ]
    .concat()
    {
        assert_eq!(line["faults"], serde_json::json!([]), "{line}");
        let reason = line["reason"].as_str().expect("a reason");
        assert!(
            reason.contains("ambiguous: torque of all phases") && reason.contains("shorts of 0.0"),
            "{line}"
        );
        for (k, sigma) in shorts(&line) {
            assert!(k < 2.0 * sigma && 0.04 - k < 2.5 * sigma, "{line}");
        }
    }
    // What stands in the record does not depend on the levels.
    let estimates = |config: &str| {
        folder
            .replayed(&format!("later.log -c {config}"))
            .iter()
            .map(shorts)
            .collect::<Vec<_>>()
    };
    assert_eq!(estimates("hmd.toml"), estimates("low.toml"));

    for gain in [-0.05, 0.04] {
        later(gain, "--fault short_a=0.15");
        for line in folder.replayed("later.log -c hmd.toml") {
            assert_eq!(
                (&line["faults"], &line["suspects"]),
                (&serde_json::json!(["short_a"]), &serde_json::json!(["current gain"])),
                "{line}"
            );
            let [(k, sigma), ..] = shorts(&line);
            assert!((k - 0.15).abs() < 2.0 * sigma, "{line}");
        }
    }
}

#[test]
fn one_of_two_sensors_that_reads_wrong_accuses_no_phase_and_hides_no_short() {
    let folder = Folder::new();
    let two_sensors = "--noise 0.02 --with two_current_sensors=1";
    folder.commission("servo270", &format!("8 {two_sensors} --seed 6"));
    for (gain, short) in [(0.0, 0.1), (0.06, 0.0), (-0.06, 0.0), (-0.06, 0.1)] {
        let later = format!("--windows 2 --seed 8 --with current_gain_a={gain} --fault short_a={short} -o later.log");
        folder.done(&format!("simulate --actuator servo270 {two_sensors} {later}"));
        for line in folder.replayed("later.log -c hmd.toml") {
            let [(k, sigma), b, c] = shorts(&line);
            assert!((k - short).abs() < 3.0 * sigma, "{gain} {short}: {line}");
            assert!(
                [b, c].iter().all(|(k, sigma)| k < &(3.0 * sigma)),
                "{gain} {short}: {line}"
            );
            let named = if gain == 0.0 { vec!["short_a"] } else { Vec::new() };
            assert_eq!(line["faults"], serde_json::json!(named), "{gain} {short}: {line}");
            assert_eq!(line["suspects"].is_array(), gain != 0.0, "{gain} {short}: {line}");
        }
    }
}
