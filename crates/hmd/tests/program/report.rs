//! The report, the summary and the catalogue, as a shell gets them.

use std::fs;
use std::process::{Command, Output};

use tempfile::TempDir;

use crate::folder::record_demo;

fn hmd(folder: &TempDir, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
    let command = command.args(line.split_whitespace()).current_dir(folder.path());
    command.output().expect("hmd starts")
}

fn done(folder: &TempDir, line: &str) -> String {
    let ended = hmd(folder, line);
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(0), "hmd {line}: {stderr}");
    String::from_utf8(ended.stdout).expect("text")
}

fn refused(folder: &TempDir, line: &str, code: i32) -> String {
    let ended = hmd(folder, line);
    assert_eq!(ended.status.code(), Some(code), "hmd {line}");
    String::from_utf8(ended.stderr).expect("text")
}

#[test]
fn a_whole_wear_out_is_one_small_page_and_one_short_line() {
    let folder = tempfile::tempdir().expect("a folder");
    record_demo(folder.path());
    done(&folder, "report life.mcap -o ema0.html --zone UTC");
    let page = fs::read_to_string(folder.path().join("ema0.html")).expect("a page");
    assert!(page.len() < 1 << 20, "{} bytes", page.len());
    // Every part that was promised, and nothing that is fetched or run.
    for expected in [
        "Health report of ema0",
        "<strong>critical</strong>",
        "Measured and fitted quadrature current",
        "Measured and fitted motor speed",
        "Measured and fitted output position",
        "Residual of the output position",
        "Damage by friction over use",
        "Damage by controller gain over use",
        "Repair before the next use: bearings, gear and screw.",
        "no trend: below the watch level",
        "State of health over use",
        "Remaining useful life with its 80\u{a0}% interval",
        "Data quality",
        "config_hash",
        "model_hash",
        "seed",
        "build",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    for forbidden in ["<script", "<link", "http:", "https:", "url(", "NaN", "inf "] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    let drawings = page.matches("<svg ").count();
    assert_eq!(drawings, 2 + 7 + 6 + 1);
    assert_eq!(page.matches("role=\"img\" aria-label=").count(), drawings);
    // The same files make the same page.
    done(&folder, "report life.mcap -o again.html --zone UTC");
    assert_eq!(
        fs::read_to_string(folder.path().join("again.html")).expect("a page"),
        page
    );

    let summary = done(&folder, "inspect life.mcap --summary");
    assert_eq!(summary.lines().count(), 1);
    let line = summary.trim_end();
    assert!(line.len() <= 220 && line.starts_with("HMD1/EMA0/W23/"), "{line}");
    assert!(
        line.contains("/CRITICAL/FRIC 7") && line.contains("/RUL ") && line.ends_with("/BY DAMAGE"),
        "{line}"
    );

    assert!(
        refused(&folder, "report life.mcap -o no.html --actuator ema7", 1)
            .contains("expected one of ema0, found \"ema7\"")
    );
    fs::write(folder.path().join("text.log"), "no log\n").expect("a file");
    assert!(refused(&folder, "report text.log -o no.html", 1).contains("expected records of windows, found none"));
    assert!(refused(&folder, "report missing.mcap -o no.html", 1).contains("missing.mcap"));
    assert!(refused(&folder, "report life.mcap -o no.html --zone Mars/Phobos", 2).contains("found \"Mars/Phobos\""));
    assert!(!folder.path().join("no.html").exists());
}

/// Units in two aircraft have one name; the line of each ends with its serial number, unless it is alone.
#[test]
fn units_of_one_name_are_told_apart_by_their_serial_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    for (n, unit) in ["2031/a", "2032/b"].into_iter().enumerate() {
        let config = format!(
            "[[actuator]]\nid = 0\nname = \"flap\"\nserial_number = \"{unit}\"\n\
             [type.bench.sensors]\nsample_rate_hz = 400\n[identification]\npopulation = 8\ngenerations = 1\n"
        );
        fs::write(folder.path().join(format!("{n}.toml")), config).expect("a file");
        done(
            &folder,
            &format!("simulate -o {n}.log --rate 400 --seed {n} --fault friction=0.{n}"),
        );
        done(&folder, &format!("replay {n}.log -c {n}.toml -o {n}.mcap"));
    }
    let alone = done(&folder, "inspect 0.mcap --summary");
    assert!(alone.starts_with("HMD1/FLAP/W0/") && !alone.contains("/SN "), "{alone}");
    let both = done(&folder, "inspect 0.mcap 1.mcap --summary");
    let lines: Vec<&str> = both.lines().collect();
    assert_eq!(lines.len(), 2, "{both}");
    for (line, unit) in lines.iter().zip(["2031/A", "2032/B"]) {
        assert!(line.starts_with("HMD1/FLAP/W0/"), "{line}");
        assert!(line.ends_with(&format!("/SN {unit}")), "{line}");
    }
    assert_eq!(lines[0], format!("{}/SN 2031/A", alone.trim_end()), "the same window");
}

#[test]
fn the_catalogue_has_the_levels_of_the_configuration() {
    let folder = tempfile::tempdir().expect("a folder");
    let catalogue = |line: &str| -> serde_json::Value { serde_json::from_str(&done(&folder, line)).expect("JSON") };
    let usual = catalogue("inspect --catalogue");
    assert_eq!(usual["version"], 3);
    assert_eq!(usual["fault_modes"].as_array().map(Vec::len), Some(7));
    assert_eq!(usual["fault_modes"][1]["name"], "backlash");
    assert_eq!(usual["fault_modes"][1]["severity"][1]["damage"], 0.3);
    // The eccentricity's amplitude has two components, so that chance exceeds three sigmas more often.
    assert_eq!(usual["fault_modes"][1]["significance_sigmas"], 3.0);
    assert_eq!(usual["fault_modes"][5]["significance_sigmas"], 3.44);
    fs::write(
        folder.path().join("hmd.toml"),
        "[health]\npersistence = 3\n[health.fault.backlash]\nwarning = 0.25\npersistence = 2\n",
    )
    .expect("a file");
    let own = catalogue("inspect --catalogue -c hmd.toml");
    assert_eq!(own["fault_modes"][1]["severity"][1]["damage"], 0.25);
    assert_eq!(own["fault_modes"][0]["severity"][1]["damage"], 0.3);
    let windows = [0, 1].map(|fault| own["fault_modes"][fault]["persistence_windows"].as_u64());
    assert_eq!(windows, [Some(3), Some(2)]);
    refused(&folder, "inspect", 2);
    refused(&folder, "inspect --catalogue life.mcap", 2);
}

/// Two recordings of one name among each other in time; that which ends last is worn.
#[test]
fn of_recordings_that_overlap_the_newest_window_counts_in_any_order_of_files() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, day, friction) in [("a1", 1, 0.7), ("b", 2, 0.0), ("a2", 3, 0.75)] {
        let start = format!("--start 2026-01-0{day}T08:00Z --seed {day}");
        let line = format!("simulate -o {name}.log --rate 400 --noise 0.03 {start} --fault friction={friction}");
        done(&folder, &line);
    }
    let config =
        "[[actuator]]\nid = 0\nname = \"ail\"\n[type.bench]\ntolerances = \"exact\"\n[rul]\nevents = \"events\"\n";
    fs::write(folder.path().join("hmd.toml"), config).expect("a file");
    done(&folder, "replay a1.log a2.log -c hmd.toml -o a.mcap");
    done(&folder, "replay b.log -c hmd.toml -o b.mcap");
    for files in ["a.mcap b.mcap", "b.mcap a.mcap"] {
        let ended = hmd(&folder, &format!("inspect --summary {files}"));
        let line = String::from_utf8(ended.stdout).expect("text");
        assert!(line.starts_with("HMD1/AIL/W1/20260103T0800Z/CRITICAL/FRIC 7"), "{line}");
        assert!(String::from_utf8_lossy(&ended.stderr).contains("recordings overlap in time"));
        done(&folder, &format!("report {files} -o ail.html --zone UTC"));
        let page = fs::read_to_string(folder.path().join("ail.html")).expect("a page");
        assert!(page.contains("<strong>critical</strong>") && page.contains("Recordings overlap in time"));
        assert!(page.contains("3 windows from 2026-01-01 08:00 UTC to 2026-01-03 08:00 UTC"));
    }
    // What was replaced since is unknown where the configuration says so, as on the page.
    done(
        &folder,
        "event --reset ail --part gearbox --at 2026-01-04T08:00Z -c hmd.toml",
    );
    let line = done(&folder, "inspect --summary a.mcap -c hmd.toml");
    assert!(
        line.starts_with("HMD1/AIL/W1/20260103T0800Z/UNKNOWN/UNKNOWN FRIC BKLSH/NO RUL"),
        "{line}"
    );
    assert!(done(&folder, "inspect --summary a.mcap").contains("/CRITICAL/"));
    // Entries that do not count are told wherever the events are asked.
    let events = fs::read_to_string(folder.path().join("events")).expect("events");
    let misspelt = events.replace("\"ail\"", "\"ale\"");
    fs::write(folder.path().join("events"), format!("{misspelt}{{\"t_ns\":1")).expect("a file");
    for line in [
        "inspect --summary a.mcap -c hmd.toml",
        "report a.mcap -c hmd.toml -o ail.html",
    ] {
        let told = String::from_utf8(hmd(&folder, line).stderr).expect("text");
        for expected in [
            "found \"ale\"; that event is ignored",
            "line 2: never finished and ignored",
        ] {
            assert!(told.contains(expected), "{line}: {told}");
        }
    }
    refused(&folder, "inspect a.mcap -c hmd.toml", 2);
}
