//! Logs of measured signals as a whole: what pandas, pyarrow and asammdf write (`fixtures/measured`), and damaged copies of it.

use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Arc;

use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;

use crate::foreign_tests::read_mutations_of;
use crate::mdf::MdfSignals;
use crate::signals::{CsvLog, MappedFrames, ParquetLog, SignalLog};

const FILES: [&str; 6] = [
    "samples.csv",
    "samples-european.csv",
    "samples-snappy.parquet",
    "samples-zstd.parquet",
    "samples-signals.mf4",
    "samples-signals-transposed.mf4",
];

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/measured")
}

/// The map of the fixtures without the lines that contain one of these, and with more of them.
fn config(without: &[&str], with: &str) -> Arc<Config> {
    let text = std::fs::read_to_string(folder().join("map.toml")).expect("a fixture");
    let lines = text.lines().filter(|line| !without.iter().any(|of| line.contains(of)));
    let text = lines.collect::<Vec<_>>().join("\n") + "\n" + with;
    Arc::new(Config::from_toml_str(&text, "map.toml").expect("a fixture"))
}

fn windows(name: &str, config: &Arc<Config>) -> Vec<WindowJob> {
    let mut source = crate::open_mapped(&folder().join(name), BusNames::new(), config).expect("a fixture");
    let mut pipeline = Pipeline::new(config.clone());
    while let Some(item) = source.next() {
        pipeline.push(&item.expect(name), source.bus_names());
    }
    pipeline.finish();
    pipeline.take_windows()
}

#[test]
fn every_format_gives_the_windows_of_the_frames() {
    let config = config(&[], "");
    let frames = windows("samples.log", &config);
    assert!(frames.len() == 1 && frames[0].window.quality.is_fit());
    for name in FILES {
        let found = windows(name, &config);
        assert_eq!(found.len(), 1, "{name}");
        assert_eq!(found[0].window, frames[0].window, "{name}");
        assert_eq!(found[0].conditions, frames[0].conditions, "{name}");
    }
}

#[test]
fn what_is_missing_is_not_invented() {
    let whole = windows("samples.csv", &config(&[], ""));
    let few = config(
        &[
            "currents.c",
            "position.output",
            "counter",
            "sample.time",
            "winding_temp",
        ],
        "",
    );
    let found = windows("samples-signals.mf4", &few);
    assert_eq!(found[0].conditions.winding_temp_deg_c, None);
    assert_eq!(found[0].conditions.dc_link_v, whole[0].conditions.dc_link_v);
    let gaps: Vec<String> = found[0]
        .actuator
        .log
        .as_ref()
        .unwrap()
        .gaps()
        .map(|gap| gap.to_string())
        .collect();
    assert_eq!(
        gaps,
        [
            "no currents.c: the sum of the currents is not checked",
            "no position.output: the gear is taken as rigid, and backlash is not observable",
        ]
    );
    let jitter = found[0].window.quality.to_string();
    assert_eq!(jitter, "numbered by time, which jitters by 0.0 %");
    // Numbered by time, and the star point closes the sum.
    let (few, whole) = (&found[0].window, &whole[0].window);
    assert_eq!(few.samples.len(), whole.samples.len());
    for (few, whole) in few.samples.iter().zip(&whole.samples) {
        assert_eq!(few.motor_counts, whole.motor_counts);
        assert!((few.currents[2] + whole.currents[0] + whole.currents[1]).abs() < 1e-9);
    }
}

/// Samples lost of the table, numbered by its time, whose last rows come so much later, s.
fn lost_before_later_rows(pause_s: f64) -> u64 {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let mut later = String::new();
    for (n, line) in text.lines().enumerate() {
        match line.split_once(',') {
            Some((time, rest)) if n > 560 => {
                let time: f64 = time.parse().expect("a time");
                later += &format!("{:.6},{rest}\n", time + pause_s);
            }
            _ => later += &(line.to_owned() + "\n"),
        }
    }
    let file = tempfile::Builder::new()
        .suffix(".csv")
        .tempfile()
        .expect("a temporary file");
    std::fs::write(file.path(), later).expect("a temporary file");
    let config = config(&["counter", "sample.time"], "");
    let mut source = crate::open_mapped(file.path(), BusNames::new(), &config).expect("a table");
    let mut pipeline = Pipeline::new(config);
    while let Some(item) = source.next() {
        pipeline.push(&item.expect("a row"), source.bus_names());
    }
    pipeline.finish();
    pipeline.lost_samples().map(|(_, lost)| lost).sum()
}

#[test]
fn a_pause_of_a_log_that_nothing_counts_is_no_loss_and_a_gap_is() {
    assert_eq!(lost_before_later_rows(0.0), 0);
    assert_eq!(lost_before_later_rows(0.3), 120, "0.3 s at 400 Hz");
    assert_eq!(lost_before_later_rows(19.0), 0);
}

/// The table with only every second value of the motor's angle.
fn several_rates() -> String {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let mut several = String::new();
    for (n, line) in text.lines().enumerate() {
        let mut cells: Vec<&str> = line.split(',').collect();
        if n > 0 && n % 2 == 0 {
            cells[6] = "";
        }
        several += &(cells.join(",") + "\n");
    }
    several
}

#[test]
fn signals_of_several_rates_are_interpolated_and_their_error_is_said() {
    let file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
    std::fs::write(file.path(), several_rates()).unwrap();
    let resampled = config(&[], "resample = true");
    let mut source = crate::open_mapped(file.path(), BusNames::new(), &resampled).unwrap();
    assert!(source.by_ref().all(|item| item.is_ok()));
    let remarks = source.remarks();
    let [remark] = &remarks[..] else { panic!("{remarks:?}") };
    let found = windows(file.path().to_str().unwrap(), &resampled);
    assert_eq!(
        windows("samples-rates.mf4", &resampled)[0].window,
        found[0].window,
        "the same values of another format"
    );
    let whole = windows("samples.csv", &config(&[], ""));
    assert!(
        remark.contains("position.motor: 299 values interpolated, off by up to about "),
        "{remark}"
    );
    let error: f64 = remark
        .split("about ")
        .nth(1)
        .unwrap()
        .split(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    // 14 krad/s² over 5 ms; the rest is rounded.
    assert!((1.0..1000.0).contains(&error), "{remark}");
    for (found, whole) in found[0].window.samples.iter().zip(&whole[0].window.samples) {
        let same_bits = |phase: usize| found.currents[phase].to_bits() == whole.currents[phase].to_bits();
        assert!((0..3).all(same_bits), "{found:?} {whole:?}");
        let difference = (found.motor_counts - whole.motor_counts).unsigned_abs() as f64;
        assert!(difference <= 1.1 * error + 1.0, "{difference} {remark}");
    }
    let gaps = found[0].actuator.log.as_ref().unwrap().gaps();
    let gaps: Vec<String> = gaps.map(|gap| gap.to_string()).collect();
    assert_eq!(
        gaps,
        ["signals of several rates: interpolated at the times of the currents"]
    );
}

#[test]
fn currents_of_the_rotor_frame_become_phases() {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let config_dq = config(
        &["currents."],
        "currents.d = { signal = \"I_d\", unit = \"A\" }\ncurrents.q = { signal = \"I_q\", unit = \"A\" }",
    );
    let motor = Config::default().actuators()[0].params;
    let rad = core::f64::consts::TAU * motor.motor.pole_pairs / motor.sensors.motor_counts_per_rev;
    let mut dq = String::new();
    for (n, line) in text.lines().enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        if n == 0 {
            dq.push_str(&format!("{line},I_d,I_q\n"));
            continue;
        }
        let number = |n: usize| cells[n].parse::<f64>().unwrap();
        let (sin, cos) = (number(6) * rad).sin_cos();
        let (a, b, c) = (number(3), number(4), number(5));
        let (alpha, beta) = ((2.0 * a - b - c) / 3.0, (b - c) / 3f64.sqrt());
        dq.push_str(&format!(
            "{line},{},{}\n",
            cos * alpha + sin * beta,
            cos * beta - sin * alpha
        ));
    }
    let file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
    std::fs::write(file.path(), dq).unwrap();
    let found = windows(file.path().to_str().unwrap(), &config_dq);
    let phases = windows("samples.csv", &config(&[], ""));
    for (found, phases) in found[0].window.samples.iter().zip(&phases[0].window.samples) {
        let common = phases.currents.iter().sum::<f64>() / 3.0;
        for phase in 0..3 {
            // A step of 1 mA, and the sum that d and q do not have.
            assert!((found.currents[phase] - phases.currents[phase] + common).abs() < 0.6e-3);
        }
    }
}

#[test]
fn a_refused_time_is_answered_with_the_forms_that_are_read() {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let rows: Vec<&str> = text.lines().skip(1).collect();
    let names = text.lines().next().expect("names").replace("t [s]", "t");
    let table = |time: &str| {
        let rows = rows.iter().map(|row| {
            let (_, rest) = row.split_once(',').expect("cells");
            format!("{time},{rest}\n")
        });
        format!("{names}\n{}", rows.collect::<String>())
    };
    let forms = "a date and 24 hours, as 2026-11-20T14:00:00.5Z, 2026-11-20 14:00:00.5, 20.11.2026 14:00:00.5 or 2026/11/20 14:00:00.5";
    let (plain, seconds) = (
        config(&[], ""),
        config(&["time"], "time = { signal = \"t\", unit = \"s\" }"),
    );
    for time in ["11/21/2026 08:00:00", "2026-11-21 08:00:00 AM", "08:00:00.000"] {
        let frames = |config: &Config| {
            let log = CsvLog::new(Cursor::new(table(time)), "times.csv").expect("a table");
            let (actuator, map) = config.actuator_of_logs().expect("a fixture");
            MappedFrames::new(Box::new(log), "times.csv", actuator, map, BusNames::new())
        };
        let refused = frames(&plain).expect_err(time).to_string();
        assert!(
            refused.contains(&format!("; or {forms}, found none of \"t\"")),
            "{refused}"
        );
        let damage = frames(&seconds)
            .expect("a unit")
            .next()
            .expect("a row")
            .expect_err(time);
        let expected = format!("times.csv:2: expected a number, or {forms}, found none in column \"t\" (time)");
        assert_eq!(damage.to_string(), expected);
    }
}

/// Reads all of it; how many items there were.
fn items(name: &str, bytes: &[u8], config: &Config) -> usize {
    let log: Box<dyn SignalLog> = if name.ends_with("csv") {
        match CsvLog::new(Cursor::new(bytes.to_vec()), name) {
            Ok(log) => Box::new(log),
            Err(_) => return 1,
        }
    } else if name.ends_with("parquet") {
        match ParquetLog::new(bytes::Bytes::copy_from_slice(bytes), name) {
            Ok(log) => Box::new(log),
            Err(_) => return 1,
        }
    } else {
        match MdfSignals::new(Cursor::new(bytes.to_vec()), name) {
            Ok(log) => Box::new(log),
            Err(_) => return 1,
        }
    };
    let (actuator, map) = config.actuator_of_logs().expect("a fixture");
    let frames = MappedFrames::new(log, name, actuator, map, BusNames::new());
    frames.map_or(1, Iterator::count)
}

/// Reads mutations of every file.
fn read_mutations(of_each_format: usize) {
    let (rows, resampled) = (config(&[], ""), config(&[], "resample = true"));
    for (format, names, config) in [
        ("csv", &FILES[..1], &rows),
        ("parquet", &FILES[2..4], &rows),
        ("mf4", &FILES[4..], &rows),
        ("mf4", &["samples-rates.mf4"][..], &resampled),
    ] {
        let files: Vec<PathBuf> = names.iter().map(|name| folder().join(name)).collect();
        let items = |name: &str, bytes: &[u8]| items(name, bytes, config);
        read_mutations_of(format, &files, of_each_format, items, |bytes| 400 * bytes + 4000);
    }
}

#[test]
fn damaged_files_are_refused_or_read() {
    read_mutations(200);
}

#[test]
#[ignore = "ten thousand of each format; cargo test -p hmd-ingest --features signals --lib -- --ignored --nocapture mutations"]
fn ten_thousand_mutations_of_each_format() {
    read_mutations(10_000);
}
