//! What a map that is wrong in one thing makes of a good recording: no assessment, or one without the mistake, and the words of the
//! tutorial's table.

use std::fs;
use std::path::Path;
use std::process::Command;

const TUTORIAL: &str = include_str!("../../../../docs/tutorial.md");

/// What is wrong, where in `flap.dbc`, what stands there instead, the window's status, and how its reason begins or what is in it.
const WRONG: [(&str, &str, &str, &str, &str); 11] = [
    ("nothing", "", "", "ok", ""),
    (
        "sign of the motor's angle",
        "@0+ (0.0054",
        "@0+ (-0.0054",
        "degraded",
        "resolver direction",
    ),
    (
        "sign of the output's angle",
        "@0- (0.018",
        "@0- (-0.018",
        "degraded",
        "encoder direction",
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
    (
        "unit of the currents",
        "\"A\"",
        "\"mA\"",
        "invalid",
        "current unit: the motion needs",
    ),
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
        "degraded",
        "current sign",
    ),
    (
        "zero of the motor's angle",
        "0.0054931640625,0)",
        "0.0054931640625,2)",
        "degraded",
        "resolver zero",
    ),
    (
        "unit of the command",
        "[-214748|214748] \"deg\"",
        "[-214748|214748] \"rad\"",
        "invalid",
        "set point unit",
    ),
    (
        "unit of the command in radians",
        " (0.0001,0) [-214748|214748] \"deg\"",
        " (0.00000174533,0) [-214748|214748] \"deg\"",
        "invalid",
        "set point unit: the output follows",
    ),
];

/// The map that the tutorial writes, without its slip of the pen.
fn map() -> String {
    let (_, rest) = TUTORIAL.split_once("<!-- flap.toml -->\n```toml\n").expect("flap.toml");
    let (map, _) = rest.split_once("```").expect("its end");
    map.replace("FCU_Phase.IC", "FCU_Phase.Ic")
}

/// What a replay prints by the map in a folder.
fn replayed(folder: &Path, log: &Path) -> String {
    let replayed = Command::new(env!("CARGO_BIN_EXE_hmd"))
        .args(["replay", "-c", "flap.toml"])
        .arg(log)
        .current_dir(folder)
        .output()
        .expect("hmd starts");
    String::from_utf8(replayed.stdout).expect("hmd prints UTF-8") + &String::from_utf8_lossy(&replayed.stderr)
}

/// The rate is nowhere but in the device's clock, whose steps no real device makes to the microsecond; or to the
/// millisecond, and then the map must do without it.
#[test]
fn a_jittering_clock_shows_the_rate_and_a_coarse_one_is_recognised() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let buses = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/buses");
    fs::copy(buses.join("flap.dbc"), folder.path().join("flap.dbc")).expect("flap.dbc");
    fs::write(folder.path().join("flap.toml"), map()).expect("flap.toml");
    let recorded = fs::read_to_string(buses.join("flap.log")).expect("flap.log");
    let with_clock = |change: &dyn Fn(u64, u16) -> u16| {
        let lines = recorded
            .lines()
            .enumerate()
            .map(|(n, line)| match line.split_once(" 212#") {
                Some((before, data)) => {
                    let clock = u16::from_str_radix(&data[10..14], 16).expect("a clock");
                    let clock = change(n as u64, clock);
                    format!("{before} 212#{}{clock:04X}{}\n", &data[..10], &data[14..])
                }
                None => format!("{line}\n"),
            });
        let log = folder.path().join("own.log");
        fs::write(&log, lines.collect::<String>()).expect("own.log");
        replayed(folder.path(), &log)
    };
    for most in [1, 3, 20] {
        let jitter = |n: u64, clock: u16| clock.wrapping_add((hmd_core::seed::mix(7, &[n]) % (2 * most + 1)) as u16);
        let printed = with_clock(&jitter);
        assert!(
            printed.lines().nth(1).is_some_and(|line| line.ends_with("friction")),
            "{most}: {printed}"
        );
    }
    let printed = with_clock(&|_, clock| clock / 1000 * 1000);
    // Steps of a millisecond in periods of 2.5: the rate is known to 3 %, and the nearest of whole control periods is the right one.
    assert!(printed.contains("expected 2000 samples/s, found 400.0"), "{printed}");
    assert!(
        printed.lines().nth(1).is_some_and(|line| line.ends_with("friction")),
        "{printed}"
    );
    let text = map() + "\n[type.bench.sensors]\nsample_rate_hz = 400\n";
    fs::write(folder.path().join("flap.toml"), text).expect("flap.toml");
    let printed = with_clock(&|_, clock| clock / 1000 * 1000);
    assert!(
        printed.lines().nth(1).is_some_and(|line| line.ends_with("friction")),
        "{printed}"
    );
}

#[test]
fn each_wrong_map_is_reported_as_the_tutorial_lists() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let buses = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/buses");
    let database = fs::read_to_string(buses.join("flap.dbc")).expect("flap.dbc");
    fs::write(folder.path().join("flap.toml"), map()).expect("flap.toml");
    for (wrong, from, to, status, reason) in WRONG {
        assert!(database.contains(from), "{wrong}: {from}");
        fs::write(folder.path().join("flap.dbc"), database.replace(from, to)).expect("flap.dbc");
        let printed = replayed(folder.path(), &buses.join("flap.log"));
        let window = printed.lines().nth(1).unwrap_or_default();
        let found = window.split_whitespace().nth(2);
        assert_eq!(found, Some(status), "{wrong}: {printed}");
        assert!(window.contains(reason), "{wrong}: {printed}");
        let in_tutorial = reason.split_once(": the").map_or(reason, |(named, _)| named);
        assert!(
            TUTORIAL.contains(in_tutorial),
            "docs/tutorial.md: expected {in_tutorial:?}"
        );
        assert_eq!(window.ends_with("friction"), status == "ok", "{wrong}: {printed}");
    }
}
