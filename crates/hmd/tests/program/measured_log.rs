//! A log of measured signals, from the first look at it to its records.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::folder::Folder;

fn hmd(folder: &Path, arguments: &[&str]) -> Output {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/measured");
    for file in [
        "samples.log",
        "samples.csv",
        "samples-zstd.parquet",
        "samples-signals.mf4",
    ] {
        fs::copy(fixtures.join(file), folder.join(file)).expect(file);
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
    command
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("hmd starts")
}

#[test]
fn the_configuration_that_map_writes_gives_the_records_of_the_frames() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let frames = hmd(folder.path(), &["replay", "--json", "samples.log"]);
    assert!(!frames.stdout.is_empty());
    for log in ["samples.csv", "samples-zstd.parquet", "samples-signals.mf4"] {
        let map = hmd(folder.path(), &["map", log]);
        assert_eq!(map.status.code(), Some(0), "{log}");
        fs::write(folder.path().join("hmd.toml"), &map.stdout).expect("hmd.toml");
        let replayed = hmd(
            folder.path(),
            &["replay", "--json", log, "-c", "hmd.toml", "-o", "out.mcap"],
        );
        assert_eq!(
            String::from_utf8_lossy(&replayed.stdout),
            String::from_utf8_lossy(&frames.stdout),
            "{log}"
        );
        // The recording holds the samples as frames.
        let again = hmd(folder.path(), &["replay", "--json", "out.mcap", "-c", "hmd.toml"]);
        assert_eq!(again.stdout, frames.stdout, "{log}");
    }
}

#[test]
fn without_set_point_a_window_is_assessed_by_relations_alone() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let map = "[map]\ntime = \"t\"\ncurrents.a = \"I_A\"\ncurrents.b = \"I_B\"\nposition.motor = \"theta_m\"\n";
    fs::write(folder.path().join("hmd.toml"), map).expect("hmd.toml");
    let output = hmd(folder.path(), &["replay", "--json", "samples.csv", "-c", "hmd.toml"]);
    let line = String::from_utf8(output.stdout).expect("hmd prints UTF-8");
    assert!(line.contains("\"status\":\"invalid\""), "{line}");
    let said =
        "no set point: assessed by relations between measured signals alone, of a commissioned unit (hmd calibrate)";
    assert!(line.contains(said), "{line}");
}

#[test]
fn what_is_wrong_with_a_map_is_said() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let sentence = |config: &str, log: &str| {
        fs::write(folder.path().join("hmd.toml"), config).expect("hmd.toml");
        let output = hmd(folder.path(), &["replay", log, "-c", "hmd.toml"]);
        let text = String::from_utf8(output.stderr).expect("hmd prints UTF-8");
        (output.status.code(), text.trim_end().to_owned())
    };
    let map = "[map]\ntime = \"t\"\ncurrents.a = \"I_A\"\ncurrents.b = \"I_B\"\nposition.motor = \"theta_m\"\n";
    let with_phi = format!("{map}command.position = \"phi\"\n");
    let with_voltage = format!("{map}command.position = \"U_dc\"\n");
    let cases = [
        (
            "",
            Some(1),
            "hmd: samples.csv: expected a configuration with a section [map] for a log of measured signals, found none; \
             hmd map writes one",
        ),
        (
            &map.replace("position.motor", "position.output"),
            Some(78),
            "hmd: hmd.toml:1: map: expected a column for position.motor, without which no window can be assessed, found none",
        ),
        (
            &with_phi,
            Some(1),
            "hmd: samples.csv: expected signal \"phi\" (command.position), found t, seq, clock, I_A, I_B, I_C, theta_m, \
             theta_o, phi_set, mode, U_dc, T_w and 1 more",
        ),
        (
            &with_voltage,
            Some(1),
            "hmd: samples.csv: expected a unit of command.position (rad, mrad, urad, deg, rev), in the log or as \
             { signal = …, unit = … }, found \"V\" of \"U_dc\"",
        ),
    ];
    for (config, code, expected) in cases {
        assert_eq!(sentence(config, "samples.csv"), (code, expected.to_owned()));
    }
}

#[test]
fn a_preamble_is_passed_over_and_times_that_rows_share_are_refused() {
    let folder = Folder::new();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/measured");
    let read = |name: &str| fs::read_to_string(fixtures.join(name)).expect("a fixture");
    let (table, map) = (
        read("samples.csv"),
        read("map.toml").replace("\"Position\", speed = \"Speed\"", "1, speed = 2"),
    );
    folder.write("map.toml", &map);
    folder.write("plain.csv", &table);
    let plain = folder.done("replay plain.csv -c map.toml --json");
    for preamble in ["sep=,\n", "Recorder,X\nRate,400\n\n"] {
        folder.write("plain.csv", format!("{preamble}{table}"));
        assert_eq!(folder.done("replay plain.csv -c map.toml --json"), plain, "{preamble}");
    }
    // Steps of 10 ms at 400 Hz.
    let coarse = table.lines().map(|line| match line.split_once(',') {
        Some((time, rest)) if time.ends_with(|last: char| last.is_ascii_digit()) => {
            format!("{}0000,{rest}\n", &time[..time.len() - 4])
        }
        _ => format!("{line}\n"),
    });
    folder.write("coarse.csv", coarse.collect::<String>());
    let numbered: Vec<&str> = map.lines().filter(|line| !line.starts_with("sample.")).collect();
    folder.write("numbered.toml", numbered.join("\n"));
    let refused = folder.hmd("replay coarse.csv -c numbered.toml");
    assert!(
        refused.code != 0 && refused.stderr.contains("the same time in many rows"),
        "{}",
        refused.stderr
    );
}
