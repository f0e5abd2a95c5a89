//! What a map that is wrong in one thing makes of a good recording: no verdict, and the words of the tutorial's table.

use std::fs;
use std::path::Path;
use std::process::Command;

const TUTORIAL: &str = include_str!("../../../docs/tutorial.md");

/// What is wrong, where in `flap.dbc`, what stands there instead, the window's status, and how its reason begins or what is in it.
const WRONG: [(&str, &str, &str, &str, &str); 10] = [
    ("nothing", "", "", "ok", ""),
    (
        "sign of the motor's angle",
        "@0+ (0.0054",
        "@0+ (-0.0054",
        "invalid",
        "counters disagree",
    ),
    (
        "sign of the output's angle",
        "@0- (0.018",
        "@0- (-0.018",
        "invalid",
        "counters disagree",
    ),
    (
        "unit of the output's angle",
        "[-150995|150995] \"deg\"",
        "[-150995|150995] \"rad\"",
        "invalid",
        "encoder spikes",
    ),
    (
        "unit of the motor's angle",
        "[0|360] \"deg\"",
        "[0|360] \"rad\"",
        "invalid",
        "resolver spikes",
    ),
    ("unit of the currents", "\"A\"", "\"mA\"", "invalid", "stuck: currents"),
    (
        "unit of the DC link",
        "(0.1,0) [0|6553.5]",
        "(1,0) [0|6553.5]",
        "invalid",
        "dc_link",
    ),
    (
        "sign of the currents",
        "- (0.001,0)",
        "- (-0.001,0)",
        "unmodelled",
        "no fault vector explains the data",
    ),
    (
        "zero of the motor's angle",
        "0.0054931640625,0)",
        "0.0054931640625,2)",
        "unmodelled",
        "no fault vector explains the data",
    ),
    (
        "unit of the command",
        "[-214748|214748] \"deg\"",
        "[-214748|214748] \"rad\"",
        "unmodelled",
        "the motor does not turn as it is told",
    ),
];

/// The map that the tutorial writes, without its slip of the pen.
fn map() -> String {
    let (_, rest) = TUTORIAL.split_once("<!-- flap.toml -->\n```toml\n").expect("flap.toml");
    let (map, _) = rest.split_once("```").expect("its end");
    map.replace("FCU_Phase.IC", "FCU_Phase.Ic")
}

#[test]
fn each_wrong_thing_is_told_by_what_the_tutorial_says() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let buses = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/buses");
    let database = fs::read_to_string(buses.join("flap.dbc")).expect("flap.dbc");
    fs::write(folder.path().join("flap.toml"), map()).expect("flap.toml");
    for (wrong, from, to, status, reason) in WRONG {
        assert!(database.contains(from), "{wrong}: {from}");
        fs::write(folder.path().join("flap.dbc"), database.replace(from, to)).expect("flap.dbc");
        let replayed = Command::new(env!("CARGO_BIN_EXE_hmd"))
            .args(["replay", "-c", "flap.toml"])
            .arg(buses.join("flap.log"))
            .current_dir(folder.path())
            .output()
            .expect("hmd starts");
        let printed = String::from_utf8(replayed.stdout).expect("hmd prints UTF-8");
        let window = printed.lines().nth(1).unwrap_or_default();
        let found = window.split_whitespace().nth(2);
        assert_eq!(found, Some(status), "{wrong}: {printed}");
        assert!(window.contains(reason), "{wrong}: {printed}");
        assert!(TUTORIAL.contains(reason), "docs/tutorial.md: expected {reason:?}");
        assert_eq!(window.ends_with("friction"), status == "ok", "{wrong}: {printed}");
    }
}
