//! Tables as a shell gets them: CSV and Parquet hold the same, and what `inspect --json` says.

use std::fs::{self, File};
use std::process::Command;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use tempfile::TempDir;

use crate::folder::record_demo;

fn code_of(folder: &TempDir, line: &str) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
    let ended = command
        .args(line.split_whitespace())
        .current_dir(folder.path())
        .output()
        .expect("hmd starts");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (ended.status.code(), text(ended.stdout), text(ended.stderr))
}

fn done(folder: &TempDir, line: &str) -> String {
    let (code, stdout, stderr) = code_of(folder, line);
    assert_eq!(code, Some(0), "hmd {line}: {stderr}");
    stdout
}

/// Rows of a CSV file, and its head.
fn csv(folder: &TempDir, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(folder.path().join(name)).expect("CSV");
    let words = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<_>>();
    let head = words(reader.headers().expect("a head"));
    (
        head,
        reader.records().map(|record| words(&record.expect("a row"))).collect(),
    )
}

/// Keys and values of a file's metadata.
type Pairs = Vec<(String, Option<String>)>;

/// The same of a Parquet file, each value as CSV spells it, and its metadata.
fn parquet(folder: &TempDir, name: &str) -> (Vec<String>, Vec<Vec<String>>, Pairs) {
    let reader = SerializedFileReader::new(File::open(folder.path().join(name)).expect("a file")).expect("Parquet");
    let metadata = reader.metadata().file_metadata();
    let head = metadata
        .schema()
        .get_fields()
        .iter()
        .map(|field| field.name().to_owned())
        .collect();
    let pairs = metadata.key_value_metadata().expect("metadata").iter();
    let pairs = pairs.map(|pair| (pair.key.clone(), pair.value.clone())).collect();
    let spelt = |field: &Field| match field {
        Field::Null => String::new(),
        Field::Bool(flag) => flag.to_string(),
        Field::Long(n) => n.to_string(),
        Field::Double(x) => hmd_storage::number_cell(*x),
        Field::Str(text) => text.clone(),
        other => panic!("{other:?}"),
    };
    let rows = reader.get_row_iter(None).expect("rows");
    let rows = rows
        .map(|row| {
            row.expect("a row")
                .get_column_iter()
                .map(|(_, field)| spelt(field))
                .collect()
        })
        .collect();
    (head, rows, pairs)
}

#[test]
fn both_forms_hold_what_was_recorded() {
    let folder = tempfile::tempdir().expect("a folder");
    record_demo(folder.path());
    done(&folder, "export life.mcap -o life.csv");
    done(&folder, "export life.mcap -o life.parquet");
    let (head, rows) = csv(&folder, "life.csv");
    let (parquet_head, parquet_rows, metadata) = parquet(&folder, "life.parquet");
    assert_eq!(head, parquet_head);
    assert_eq!(rows, parquet_rows);
    assert_eq!(rows.len(), 24);

    let column = |name: &str| head.iter().position(|known| known == name).expect("a column");
    let json = done(&folder, "inspect life.mcap --json");
    for (row, line) in rows.iter().zip(json.lines()) {
        let expected: serde_json::Value = serde_json::from_str(line).expect("JSON");
        assert_eq!(row[column("t_start_ns")], expected["t_start_ns"].to_string());
        assert_eq!(row[column("health")], expected["health"].as_str().expect("text"));
        for (name, value) in [
            ("damage_friction", &expected["damage"]["friction"]),
            ("rul_p50_h", &expected["rul_h"]["p50"]),
            ("operating_h", &expected["operating_h"]),
        ] {
            // serde_json reads a number to within its last digit.
            let (found, expected) = (row[column(name)].parse::<f64>().ok(), value.as_f64());
            let close = found
                .zip(expected)
                .is_none_or(|(a, b)| (a - b).abs() <= 1e-12 * b.abs());
            assert!(
                found.is_some() == expected.is_some() && close,
                "{name}: {found:?}, {expected:?}"
            );
        }
    }
    let units = |text: &str| -> serde_json::Value { serde_json::from_str(text).expect("JSON") };
    let beside = units(&fs::read_to_string(folder.path().join("life.csv.metadata.json")).expect("metadata"));
    let inside = metadata
        .iter()
        .find(|(key, _)| key == "units")
        .and_then(|(_, text)| text.clone())
        .expect("units");
    assert_eq!(beside["units"], units(&inside));
    assert_eq!(beside["units"]["residual_rms_a"], "A");
    assert!(beside["sources"]["life.mcap"]["config_hash"].is_string());

    // More samples than a row group holds.
    done(&folder, "export life.mcap --table samples -o samples.parquet");
    done(&folder, "export life.mcap --table samples -o samples.csv");
    let (head, rows) = csv(&folder, "samples.csv");
    let (parquet_head, parquet_rows, _) = parquet(&folder, "samples.parquet");
    assert!(rows.len() > 20_000, "{}", rows.len());
    assert!(head == parquet_head && rows == parquet_rows);
    assert!(rows.is_sorted_by_key(|row| row[0].parse::<u64>().expect("a time")));

    // What cannot be read leaves the table of another day, and a damaged file is reported with its place.
    let before = fs::read(folder.path().join("samples.csv")).expect("a table");
    for (line, message) in [
        ("export missing.mcap -o samples.csv", "missing.mcap: "),
        ("export life.mcap -o none/out.csv", "none/out.csv: "),
    ] {
        let (code, _, stderr) = code_of(&folder, line);
        assert!(code == Some(1) && stderr.contains(message), "{line}: {stderr}");
    }
    assert!(fs::read(folder.path().join("samples.csv")).expect("a table") == before);
    let mut damaged = fs::read(folder.path().join("life.mcap")).expect("a file");
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    fs::write(folder.path().join("damaged.mcap"), damaged).expect("a file");
    for line in [
        "inspect damaged.mcap --csv",
        "export damaged.mcap -o damaged.csv",
        "report damaged.mcap -o damaged.html",
    ] {
        let (code, _, stderr) = code_of(&folder, line);
        assert_eq!(code, Some(3), "{line}: {stderr}");
        for message in ["damaged.mcap: at byte ", "data lost: "] {
            assert!(stderr.contains(message), "{message}, {line}: {stderr}");
        }
    }
    // The build that made it is in a record without a checksum of MCAP's own.
    let mut forged = fs::read(folder.path().join("life.mcap")).expect("a file");
    let at = forged.windows(4).position(|four| four == b"seed").expect("the seed");
    forged[at + 8] ^= 1;
    fs::write(folder.path().join("forged.mcap"), forged).expect("a file");
    for line in ["export forged.mcap -o forged.csv", "report forged.mcap -o forged.html"] {
        let (code, _, stderr) = code_of(&folder, line);
        assert!(
            code == Some(3) && stderr.contains("expected metadata with a checksum"),
            "{line}: {stderr}"
        );
    }
}

/// Each verb that reads records says why a file has none: its own damage, another kind of file, or frames that nothing has assessed.
#[test]
fn a_file_without_records_says_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, content: &[u8]| fs::write(folder.path().join(name), content).expect("a file");
    done(&folder, "simulate -o frames.mcap --rate 400 --seed 3");
    done(&folder, "replay frames.mcap -o whole.mcap");
    let whole = fs::read(folder.path().join("whole.mcap")).expect("a file");
    // Frames come before the first record.
    write("cut.mcap", &whole[..8_000]);
    write("stump.mcap", &whole[..5]);
    write("empty.mcap", b"");
    write("text.mcap", b"hello\nworld\n");
    write("table.mcap", b"t,i_a\n0.0,1.5\n");
    write(
        "random.mcap",
        &whole[4_000..9_000].iter().map(|byte| byte ^ 0x5a).collect::<Vec<_>>(),
    );
    let options = mcap::WriteOptions::new().library("other/1.0");
    let mut foreign = options.create(std::io::Cursor::new(Vec::new())).expect("a writer");
    foreign.finish().expect("a file");
    write("foreign.mcap", foreign.into_inner().get_ref());
    let cut = "found the end of the file: it was cut or never finished";
    let cases = [
        ("cut", cut.to_owned()),
        ("stump", format!("at byte 0: expected a record, {cut}")),
        (
            "empty",
            "at byte 0: expected an MCAP file, found an empty file".to_owned(),
        ),
        (
            "text",
            "at byte 0: expected the start of an MCAP file, found \"hello\\nwo\"".to_owned(),
        ),
        (
            "table",
            "at byte 0: expected the start of an MCAP file, found \"t,i_a\\n0.\"".to_owned(),
        ),
        (
            "random",
            "at byte 0: expected the start of an MCAP file, found \"".to_owned(),
        ),
        ("foreign", "it is a file of another program".to_owned()),
        (
            "frames",
            "it has frames alone, of which hmd replay LOG -o OUT.mcap makes records".to_owned(),
        ),
    ];
    for (name, why) in &cases {
        for verb in [
            "inspect F",
            "export F -o out.csv",
            "export F -o out.parquet",
            "report F -o out.html",
        ] {
            let line = verb.replace('F', &format!("{name}.mcap"));
            let (code, _, stderr) = code_of(&folder, &line);
            assert_eq!(code, Some(1), "{line}: {stderr}");
            let found = format!("{name}.mcap: expected records of windows, found none: ");
            assert!(stderr.contains(&found) && stderr.contains(why), "{line}: {stderr}");
            assert!(!stderr.contains("no actuation"), "{line}: {stderr}");
        }
    }
    for output in ["out.csv", "out.parquet", "out.html"] {
        assert!(!folder.path().join(output).exists(), "{output}");
    }
}

#[test]
fn a_recording_without_an_actuation_is_a_table_without_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    done(&folder, "simulate -o worn.log --rate 400 --seed 3");
    let log = fs::read_to_string(folder.path().join("worn.log")).expect("a log");
    let idle: Vec<&str> = log.lines().take(400).collect();
    fs::write(folder.path().join("idle.log"), idle.join("\n") + "\n").expect("a file");
    for name in ["worn", "idle"] {
        let (code, _, stderr) = code_of(&folder, &format!("replay {name}.log -o {name}.mcap"));
        assert_eq!(code, Some(0), "{stderr}");
    }
    for kind in ["health", "samples"] {
        let export = |name: &str, extension: &str| {
            let line = format!("export {name}.mcap -o {name}.{extension} --table {kind}");
            let (code, _, stderr) = code_of(&folder, &line);
            assert_eq!(code, Some(0), "{line}: {stderr}");
            stderr
        };
        assert_eq!(export("worn", "csv"), "");
        assert!(export("idle", "csv").contains("a table without rows: no actuation was recorded"));
        export("idle", "parquet");
        let ((head, rows), (wanted, _)) = (csv(&folder, "idle.csv"), csv(&folder, "worn.csv"));
        assert_eq!((head, rows.len()), (wanted.clone(), 0));
        let (head, rows, _) = parquet(&folder, "idle.parquet");
        assert_eq!((head, rows.len()), (wanted, 0));
    }
    let (code, _, stderr) = code_of(&folder, "inspect idle.mcap");
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("found none: no actuation was recorded"), "{stderr}");
}

/// Whether a window can show a parameter is known of no window that was not assessed.
#[test]
fn a_window_without_an_estimate_has_no_observable_in_any_form() {
    let folder = tempfile::tempdir().expect("a folder");
    done(&folder, "simulate -o worn.log --rate 400 --seed 3");
    let log = fs::read_to_string(folder.path().join("worn.log")).expect("a log");
    // A gap in the actuation.
    let lines: Vec<&str> = log.lines().collect();
    let (before, after) = (lines.len() / 2, lines.len() / 2 + 200);
    let torn = [&lines[..before], &lines[after..]].concat().join("\n") + "\n";
    fs::write(folder.path().join("torn.log"), torn).expect("a file");
    let (_, json, _) = code_of(&folder, "replay torn.log --json -o torn.mcap");
    let window: serde_json::Value = serde_json::from_str(json.lines().next().expect("a window")).expect("JSON");
    assert_eq!(window["status"], "invalid", "{window}");
    assert!(window["observable"].is_null());
    done(&folder, "export torn.mcap -o torn.csv");
    done(&folder, "export torn.mcap -o torn.parquet");
    let (head, rows) = csv(&folder, "torn.csv");
    let (_, same, _) = parquet(&folder, "torn.parquet");
    for (n, name) in head
        .iter()
        .enumerate()
        .filter(|(_, name)| name.ends_with("_observable"))
    {
        assert_eq!((rows[0][n].as_str(), same[0][n].as_str()), ("", ""), "{name}");
    }
}

#[test]
fn what_cannot_be_a_table_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("text.log"), "no log\n").expect("a file");
    for (line, code, message) in [
        (
            "export text.log -o out.xlsx",
            2,
            "expected a name that ends in .csv or .parquet, found out.xlsx",
        ),
        (
            "export text.log -o out.csv",
            1,
            "text.log: expected records of windows, found none",
        ),
        ("export missing.mcap -o out.csv", 1, "missing.mcap"),
    ] {
        let (found, _, stderr) = code_of(&folder, line);
        assert_eq!(found, Some(code), "{line}: {stderr}");
        assert!(stderr.contains(message), "{line}: {stderr}");
        assert!(!folder.path().join("out.csv").exists(), "{line}: a table of nothing");
    }
}
