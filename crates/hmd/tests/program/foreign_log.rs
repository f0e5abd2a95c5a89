//! What a new user meets with a log of a bus that has a layout of its own: each wrong step says what to do next.

use std::fs;
use std::path::Path;
use std::process::Command;

const MAP: &str = r#"
[[actuator]]
id = 0
name = "rudder"
bus = "can1"
dbc = "rudder.dbc"

[actuator.signals]
currents.a = "RUD_Data.Ia"
currents.b = "RUD_Data.Ib"
position.motor = "RUD_Data.ThetaM"
position.output = "RUD_Data.ThetaR"
command.position = "RUD_Data.Demand"
command.mode = "RUD_Data.Mode"
sample.counter = "RUD_Data.Cycle"
"#;

const RATE: &str = "[type.bench.sensors]\nsample_rate_hz = 400\n";

/// Exit code and stderr of `hmd replay rudder.log` with a configuration, and records in `out.mcap`.
fn replay(config: Option<&str>) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let buses = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/buses");
    for file in ["rudder.dbc", "rudder.log"] {
        fs::copy(buses.join(file), folder.path().join(file)).expect(file);
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
    command.current_dir(folder.path()).args(["replay", "rudder.log"]);
    if let Some(config) = config {
        fs::write(folder.path().join("hmd.toml"), config).expect("hmd.toml");
        command.args(["-c", "hmd.toml"]);
    }
    let output = command.output().expect("hmd starts");
    (
        output.status.code(),
        String::from_utf8(output.stderr).expect("hmd prints UTF-8"),
    )
}

#[test]
fn without_a_map_the_map_is_asked_for() {
    let (code, text) = replay(None);
    assert_eq!(code, Some(1));
    assert_eq!(
        text,
        "hmd: rudder.log: expected frames of an actuator with the identifiers of ema.dbc, or a configuration (-c) that maps the \
         DBC file of this bus, found none (1815 other frames on can1)\n"
    );
}

#[test]
fn on_another_bus_both_buses_and_the_identifiers_are_named() {
    let (code, text) = replay(Some(&MAP.replace("can1", "can0")));
    assert_eq!(code, Some(1));
    assert_eq!(
        text,
        "hmd: rudder.log: expected frames of rudder on can0 (18FF2301), found none (1815 other frames on can1)\n"
    );
}

#[test]
fn without_a_clock_a_wrong_rate_is_doubted_and_a_right_one_is_not() {
    let (_, text) = replay(Some(MAP));
    let doubt = "; by their stamps they come at 400: is sample_rate_hz of type bench right?\n";
    assert!(text.ends_with(doubt), "{text}");
    let (code, text) = replay(Some(&format!("{MAP}{RATE}")));
    assert_eq!(code, Some(0));
    assert_eq!(
        text,
        "rudder: no sample.time is mapped; windows are cut at the nominal 400 samples/s\n"
    );
}

#[test]
fn without_a_command_it_is_reported_what_begins_a_window() {
    let map = MAP.replace("\"RUD_Data.Mode\"", "{ signal = \"RUD_Data.Mode\", position = 3 }");
    let (_, text) = replay(Some(&format!("{map}{RATE}")));
    assert!(
        text.contains("rudder.log: expected an actuation, found none in 600 samples: a setpoint that rests and then moves, in a mode that is not idle"),
        "{text}"
    );
}

#[test]
fn a_folder_or_a_form_that_another_verb_makes_is_refused_with_the_way_to_go() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    fs::create_dir(folder.path().join("records")).expect("a folder");
    let refused = |line: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
        let output = command
            .current_dir(folder.path())
            .args(line.split_whitespace())
            .output()
            .expect("hmd starts");
        assert!(!output.status.success(), "hmd {line}");
        String::from_utf8(output.stderr).expect("hmd prints UTF-8")
    };
    for line in [
        "inspect records",
        "export records -o out.csv",
        "report records -o out.html",
    ] {
        assert_eq!(
            refused(line),
            "hmd: records: expected records (.mcap) in this folder, found none\n",
            "hmd {line}"
        );
    }
    assert_eq!(
        refused("replay any.log -o assessed.csv"),
        "hmd: --output: expected a name that ends in .mcap, found assessed.csv; hmd export and hmd report make other forms of it\n"
    );
    assert!(!folder.path().join("assessed.csv").exists());
}
