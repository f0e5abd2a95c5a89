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
use crate::signals::{Between, CsvLog, MappedFrames, ParquetLog, SignalLog};

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
    let mut remarks = source.remarks();
    remarks.retain(|remark| remark.contains("interpolated"));
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
fn values_eight_samples_apart_are_neighbours_whatever_their_times_are_rounded_to() {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let rows = text.lines().enumerate().map(|(n, line)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if n > 0 && n % 8 != 1 {
            cells[7] = String::new();
        } else if n % 16 == 1 {
            // The clock is read 20 µs late with every second value.
            let (seconds, micros) = cells[0].split_once('.').expect("a time");
            cells[0] = format!("{seconds}.{:06}", micros.parse::<u32>().expect("microseconds") + 20);
        }
        cells.join(",") + "\n"
    });
    let file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
    std::fs::write(file.path(), rows.collect::<String>()).unwrap();
    let resampled = config(&[], "resample = true");
    let found = windows(file.path().to_str().unwrap(), &resampled);
    let [window] = &found[..] else {
        panic!("{}", found.len())
    };
    assert!(window.window.quality.is_fit(), "{}", window.window.quality);
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
    let forms = "a date and 24 hours, as 2026-11-20T14:00:00.5Z, 2026-11-20 14:00:00.5, 20.11.2026 14:00:00.5 or 2026/11/20 14:00:00.5, or \
                 14:00:00.5 alone";
    let (plain, seconds) = (
        config(&[], ""),
        config(&["time"], "time = { signal = \"t\", unit = \"s\" }"),
    );
    for time in ["11/21/2026 08:00:00", "2026-11-21 08:00:00 AM", "08:00"] {
        let refused = |config: &Config| {
            let log = CsvLog::new(Cursor::new(table(time)), "times.csv").expect("a table");
            let (actuator, map) = config.actuator_of_logs().expect("a fixture");
            let frames = MappedFrames::new(Box::new(log), "times.csv", actuator, map, BusNames::new());
            frames.expect_err(time).to_string()
        };
        let without = refused(&plain);
        assert!(
            without.contains(&format!("; or {forms}, found none of \"t\"")),
            "{without}"
        );
        let expected = format!("expected a number, or {forms}, found \"{time}\" in column \"t\" (time)");
        assert_eq!(refused(&seconds), expected);
    }
}

/// The table of the fixtures with its cells changed by the number of the row, from 0; a row of which nothing is left is left out.
fn changed(change: impl Fn(usize, &mut Vec<String>)) -> tempfile::NamedTempFile {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let mut lines = text.lines();
    let mut out = lines.next().expect("names").to_owned() + "\n";
    for (n, line) in lines.enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        change(n, &mut cells);
        if !cells.is_empty() {
            out += &(cells.join(",") + "\n");
        }
    }
    let file = tempfile::Builder::new()
        .suffix(".csv")
        .tempfile()
        .expect("a temporary file");
    std::fs::write(file.path(), out).expect("a temporary file");
    file
}

/// Columns of that table.
const TIME: usize = 0;
const CURRENT: usize = 3;
const MOTOR: usize = 6;
const COMMAND: usize = 8;
const MODE: usize = 9;

fn number(cell: &str) -> f64 {
    cell.parse().expect("a number")
}

fn windows_of(file: &tempfile::NamedTempFile, config: &Arc<Config>) -> Vec<WindowJob> {
    windows(file.path().to_str().expect("a path"), config)
}

/// What a log is refused with.
fn refused(file: &tempfile::NamedTempFile, config: &Config) -> String {
    let refused = crate::open_mapped(file.path(), BusNames::new(), config).expect_err("a refusal");
    refused.to_string().replace(&file.path().display().to_string(), "F")
}

#[test]
fn phase_currents_are_turned_by_the_whole_angle_where_its_counter_begins_again() {
    const RANGE: f64 = 50_000.0;
    let counted = ["counter", "sample.time", "position.motor"];
    let of = |motor: &str| config(&counted, &format!("resample_hz = 500\nposition.motor = {motor}"));
    let whole = windows("samples.csv", &of("\"theta_m\""));
    let file = changed(|_, cells| cells[MOTOR] = number(&cells[MOTOR]).rem_euclid(RANGE).to_string());
    let wrapped = windows_of(&file, &of("{ signal = \"theta_m\", wraps_after = 50000 }"));
    assert_eq!(whole.len(), 1);
    assert_eq!(wrapped[0].window, whole[0].window);
}

#[test]
fn commands_that_are_logged_on_change_hold() {
    let named = config(&[], "");
    let whole = windows("samples.csv", &named);
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let commands: Vec<String> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(COMMAND).expect("a cell").to_owned())
        .collect();
    let is_same = |n: usize| n > 0 && commands[n] == commands[n - 1];
    let on_change = changed(|n, cells| {
        if is_same(n) {
            cells[COMMAND].clear();
        }
        // The mode as a text, once.
        cells[MODE] = if n == 0 { "Position".to_owned() } else { String::new() };
    });
    assert_eq!(windows_of(&on_change, &named)[0].window, whole[0].window);
    // Between the rows of the currents, too.
    let between = changed(|n, cells| {
        if n % 2 == 1 {
            cells[CURRENT..CURRENT + 3].iter_mut().for_each(String::clear);
        }
    });
    let every_second = changed(|n, cells| {
        if n % 2 == 1 {
            cells.clear();
        }
    });
    let by_time = config(&["counter", "sample.time"], "");
    let is_same = windows_of(&between, &by_time)[0].window == windows_of(&every_second, &by_time)[0].window;
    assert!(is_same, "rows without the first current are none");
    // Before its first value a command is none, however many rows that are.
    let late = changed(|n, cells| {
        if n < 20 {
            cells[COMMAND].clear();
        }
    });
    let mut source = crate::open_mapped(late.path(), BusNames::new(), &named).expect("a table");
    assert!(source.by_ref().all(|item| item.is_ok()));
    let remarks = source.remarks();
    assert!(
        remarks.len() == 1 && remarks[0].contains("found numbers alone; 1 is taken for position, 2 for speed"),
        "{remarks:?}"
    );
}

#[test]
fn a_log_without_one_current_is_refused_by_its_column() {
    let none = changed(|_, cells| cells[CURRENT].clear());
    let found = refused(&none, &config(&[], ""));
    assert!(
        found.ends_with("expected a number, found none in column \"I_A\" (currents.a) of 600 rows"),
        "{found}"
    );
}

#[test]
fn two_stamps_that_jitter_leave_the_interpolation() {
    let half = |jitter: f64| {
        changed(move |n, cells| {
            if n % 2 == 1 {
                cells[MOTOR].clear();
            }
            if n == 20 {
                cells[TIME] = format!("{:.6}", number(&cells[TIME]) + jitter);
            }
        })
    };
    let config = config(&[], "resample = true");
    let [plain, jittered] = [0.0, 0.0024].map(half);
    let found = windows_of(&jittered, &config);
    assert_eq!(
        found[0].window.samples.len(),
        windows_of(&plain, &config)[0].window.samples.len()
    );
}

#[test]
fn a_row_that_is_written_twice_changes_nothing() {
    let by_time = config(&["counter", "sample.time"], "");
    let whole = windows("samples.csv", &by_time);
    let twice = changed(|n, cells| {
        if n % 100 == 50 {
            let again = cells.join(",");
            cells.last_mut().expect("cells").push_str(&format!("\n{again}"));
        }
    });
    assert_eq!(windows_of(&twice, &by_time)[0].window, whole[0].window);
}

#[test]
fn times_on_a_grid_give_the_rate_or_are_refused() {
    let by_time = config(&["counter", "sample.time"], "");
    let on_grid = |step_us: u64| {
        changed(move |n, cells| {
            let us = 2500 * n as u64 / step_us * step_us;
            cells[TIME] = format!("1700000{:03}.{:06}", us / 1_000_000, us % 1_000_000);
        })
    };
    let whole = windows("samples.csv", &by_time);
    let in_ms = windows_of(&on_grid(1000), &by_time);
    assert_eq!(in_ms[0].window.lost, 0);
    assert!(in_ms[0].window.expected.abs_diff(whole[0].window.expected) <= 10);
    let found = refused(&on_grid(2000), &by_time);
    let expected =
        "F: expected times in even steps, or a column for sample.counter, found 15 of the first 63 steps twice as long";
    assert!(found.starts_with(expected), "{found}");
    let found = refused(&on_grid(3000), &by_time);
    assert!(found.contains("found the same time in many rows"), "{found}");
    // A counter numbers the rows, whatever their times are.
    let counted = config(&[], "");
    assert_eq!(windows_of(&on_grid(2000), &counted).len(), 1);
}

#[test]
fn a_rate_far_above_the_log_s_own_is_refused() {
    let file = changed(|_, _| {});
    let at = |hz: u32| config(&["counter", "sample.time"], &format!("resample_hz = {hz}"));
    for hz in [3200, 4000] {
        assert_eq!(
            refused(&file, &at(hz)),
            format!(
                "F: expected resample_hz below 8 times the rate of \"I_A\" (currents.a), found {hz}, where it has 400.0 Hz"
            )
        );
    }
    assert_eq!(windows_of(&file, &at(1000)).len(), 1);
}

#[test]
fn phase_currents_are_turned_by_an_angle_of_other_times() {
    // The angle in rows of its own, 0.1 ms later; it is off by what it moves until then.
    let apart = changed(|_, cells| {
        let mut angle = vec![String::new(); cells.len()];
        angle[TIME] = format!("{:.6}", number(&cells[TIME]) + 1e-4);
        std::mem::swap(&mut angle[MOTOR], &mut cells[MOTOR]);
        cells
            .last_mut()
            .expect("cells")
            .push_str(&format!("\n{}", angle.join(",")));
    });
    let even = config(&["counter", "sample.time"], "resample_hz = 500");
    let mut source = crate::open_mapped(apart.path(), BusNames::new(), &even).expect("a table");
    assert!(source.by_ref().all(|item| item.is_ok()));
    let remarks = source.remarks();
    assert!(
        remarks[0].contains(": i_d: ") && remarks[1].contains(": i_q: "),
        "{remarks:?}"
    );
    let (found, whole) = (windows_of(&apart, &even), windows("samples.csv", &even));
    assert!(found[0].window.samples.len().abs_diff(whole[0].window.samples.len()) < 3);
}

#[test]
fn a_long_text_before_a_table_leaves_it_a_table() {
    let text = std::fs::read_to_string(folder().join("samples.csv")).expect("a fixture");
    let words = "# the rig, the day, and everything else that is known of it\n".repeat(300);
    let file = tempfile::Builder::new().suffix(".csv").tempfile().expect("a file");
    std::fs::write(file.path(), words + &text).expect("a file");
    assert_eq!(windows_of(&file, &config(&[], "")).len(), 1);
}

/// Address of what a channel of an MF4 file says of itself, behind its links.
fn channel(bytes: &[u8], name: &str) -> usize {
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes")) as usize;
    let blocks = (0..bytes.len() - 24).filter(|&at| bytes[at..].starts_with(b"##CN"));
    let is_named = |at: &usize| bytes[word(at + 24 + 16) + 24..].starts_with(&[name.as_bytes(), b"\0"].concat());
    let mut found = blocks.filter(is_named);
    let at = found.next().expect("a channel");
    at + 24 + 8 * word(at + 16)
}

/// Rows and damages of a file.
fn rows_of_mf4(bytes: &[u8], config: &Config) -> (usize, Vec<String>) {
    let log = MdfSignals::new(Cursor::new(bytes.to_vec()), "a.mf4").expect("a file");
    let (actuator, map) = config.actuator_of_logs().expect("a fixture");
    let frames = MappedFrames::new(Box::new(log), "a.mf4", actuator, map, BusNames::new()).expect("signals");
    let (good, bad): (Vec<_>, Vec<_>) = frames.partition(Result::is_ok);
    let losses = bad.into_iter().filter_map(Result::err).map(|damage| damage.to_string());
    (good.len(), losses.collect())
}

#[test]
fn a_file_of_channels_with_doubtful_times_is_read() {
    let config = config(&[], "");
    let bytes = std::fs::read(folder().join("samples-signals.mf4")).expect("a fixture");
    let (whole, losses) = rows_of_mf4(&bytes, &config);
    assert!(whole > 600 && losses.is_empty(), "{losses:?}");
    // The first channel of a time lies beyond the record, another does not.
    let mut two = bytes.clone();
    let (time, clock) = (channel(&two, "time"), channel(&two, "clock"));
    two[time + 4..time + 8].copy_from_slice(&1000_u32.to_le_bytes());
    two[clock..clock + 2].copy_from_slice(&[2, 1]);
    let mut log = MdfSignals::new(Cursor::new(two), "a.mf4").expect("a file");
    let mut row = vec![0.0; 2];
    let places: Vec<_> = (0..2).map(|n| (n, Between::Unknown)).collect();
    log.select(&places).expect("channels");
    assert!(log.next_row(&mut row, &|_, _| None).is_some_and(|read| read.is_ok()));
    // A record without a time in the group of the conditions: it is reported, and the rows stay.
    let mut untimed = bytes.clone();
    let conditions = 0xbc90 + 24;
    untimed[conditions..conditions + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    let (rows, losses) = rows_of_mf4(&untimed, &config);
    assert_eq!(rows, 600, "no status: {losses:?}");
    assert!(
        losses.len() == 1 && losses[0].contains("expected a record with a time"),
        "{losses:?}"
    );
    // A file that was not finalised, whose structure lies behind its records.
    let mut open = bytes;
    open[..8].copy_from_slice(b"UnFinMF ");
    open[60] |= 4;
    assert_eq!(rows_of_mf4(&open, &config), (whole, Vec::new()));
}

/// A block of an MF4 file.
fn block(id: &[u8; 4], links: &[u64], data: &[u8]) -> Vec<u8> {
    let mut bytes = id.to_vec();
    bytes.extend([0; 4]);
    bytes.extend((24 + 8 * links.len() as u64 + data.len() as u64).to_le_bytes());
    bytes.extend((links.len() as u64).to_le_bytes());
    for link in links {
        bytes.extend(link.to_le_bytes());
    }
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

#[test]
fn a_mode_of_an_mf4_file_has_the_names_of_its_conversion() {
    let named = config(
        &["mode"],
        "command.mode = { signal = \"mode\", position = \"Closed loop\" }",
    );
    let mut bytes = std::fs::read(folder().join("samples-signals.mf4")).expect("a fixture");
    // Code 1 is "Closed loop" there, as it could be 7.
    let text = bytes.len() as u64;
    bytes.extend(block(b"##TX", &[], b"Closed loop\0"));
    let conversion = bytes.len() as u64;
    let mut table = vec![7, 0, 0, 0, 1, 0, 1, 0];
    table.extend([0; 16]);
    table.extend(1.0_f64.to_le_bytes());
    bytes.extend(block(b"##CC", &[0, 0, 0, 0, text], &table));
    let mode = channel(&bytes, "mode");
    let links = mode - 8 * 8;
    bytes[links + 32..links + 40].copy_from_slice(&conversion.to_le_bytes());
    let file = tempfile::Builder::new().suffix(".mf4").tempfile().expect("a file");
    std::fs::write(file.path(), &bytes).expect("a file");
    let found = windows_of(&file, &named);
    assert_eq!(found[0].window, windows("samples.csv", &config(&[], ""))[0].window);
    let other = config(&["mode"], "command.mode = { signal = \"mode\", position = \"Hold\" }");
    assert_eq!(windows_of(&file, &other).len(), 0, "idle by its name");
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
