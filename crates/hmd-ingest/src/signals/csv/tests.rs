use std::io::Cursor;

use super::*;

/// The rows of some columns, a damage as its sentence.
fn rows(text: &str, columns: &[&str]) -> Result<Vec<Result<Vec<f64>, String>>, String> {
    rows_of(text, columns, Between::Held)
}

/// The same of columns that have this between their values.
fn rows_of(text: &str, columns: &[&str], between: Between) -> Result<Vec<Result<Vec<f64>, String>>, String> {
    let mut log = CsvLog::new(Cursor::new(text.as_bytes().to_vec()), "a.csv").map_err(|error| error.to_string())?;
    let place = |name: &&str| log.signals().iter().position(|of| of.name == **name);
    let places: Vec<_> = columns.iter().filter_map(place).map(|n| (n, between)).collect();
    log.select(&places).map_err(|error| error.to_string())?;
    let mut found = Vec::new();
    let mut row = vec![0.0; columns.len()];
    while let Some(read) = log.next_row(&mut row, &|_, _| None) {
        found.push(read.map(|()| row.clone()).map_err(|damage| damage.to_string()));
    }
    Ok(found)
}

fn good(text: &str, columns: &[&str]) -> Vec<Vec<f64>> {
    rows(text, columns).unwrap().into_iter().map(Result::unwrap).collect()
}

#[test]
fn separators_decimal_commas_and_quotes_are_read() {
    let expected = [vec![1.5, -2.0], vec![2.5, 3e-3]];
    assert_eq!(good("# made today\na,b\n1.5,-2\n2.5,3e-3\n", &["a", "b"]), expected);
    assert_eq!(
        good("\u{feff}\"a\";b\r\n1,5;-2\r\n\"2,5\";3e-3\r\n", &["a", "b"]),
        expected
    );
    assert_eq!(good("b\tx\ta\n-2\t\t1.5\n\n3e-3\tname\t2,5\n", &["a", "b"]), expected);
}

#[test]
fn units_stand_behind_names_or_below_them() {
    let units = |text: &str| {
        let log = CsvLog::new(Cursor::new(text.as_bytes().to_vec()), "a.csv").unwrap();
        let unit = |of: &SignalInfo| (of.name.clone(), of.unit.clone().unwrap_or_default());
        log.signals().iter().map(unit).collect::<Vec<_>>()
    };
    let owned = |(name, unit): (&str, &str)| (name.to_owned(), unit.to_owned());
    let expected = [("t", "s"), ("I (U)", "A"), ("n", "")].map(owned);
    assert_eq!(units("t [s],I (U) [A],n\n1,2,3\n"), expected);
    assert_eq!(units("t,I (U)[A],n\n[s],,\n1,2,3\n"), expected);
    assert_eq!(
        units("t,I,n\ns,A,1\n1,2,3\n"),
        [("t", "s"), ("I", "A"), ("n", "")].map(owned)
    );
    assert_eq!(
        units("t,x,mode\n1,1,on\n2,1,on\n"),
        [("t", ""), ("x", ""), ("mode", "")].map(owned)
    );
    let stamped = units("t,n\n2023-11-14T22:13:20.0005Z,1\n");
    assert_eq!(stamped[0].1, "us");
    let found = good("t,n\n2023-11-14T22:13:20.0005Z,1\n2023-11-14 22:13:21,1\n", &["t"]);
    assert_eq!(found, [[1_700_000_000_000_500.0], [1_700_000_001_000_000.0]]);
    // The day first, as in much of Europe; with slashes only where the year is first.
    let found = good("t,n\n14.11.2023 22:13:20.0005,1\n2023/11/14 22:13:21,1\n", &["t"]);
    assert_eq!(found, [[1_700_000_000_000_500.0], [1_700_000_001_000_000.0]]);
    let found = good("t,n\n14.11.2023 22:13:20,1\n11/14/2023 22:13:21,1\n", &["t"]);
    assert!(found[1][0].is_nan(), "nobody knows which is the month: {found:?}");
}

#[test]
fn a_time_without_a_date_counts_from_midnight() {
    let text =
        "t;n\n22:13:20.000500;1\n22:13:21,5;1\n0:00:01;1\n100:00:00;1\n22:13;1\n22:61:00;1\n22:13:20 PM;1\n22:13:x;1\n";
    let log = CsvLog::new(Cursor::new(text.as_bytes().to_vec()), "a.csv").unwrap();
    assert_eq!(log.signals()[0].unit.as_deref(), Some("us"));
    let found: Vec<f64> = good(text, &["t"]).concat();
    assert_eq!(found[..4], [80_000_000_500.0, 80_001_500_000.0, 1e6, 360e9]);
    assert!(found[4..].iter().all(|time| time.is_nan()), "{found:?}");
}

#[test]
fn what_cannot_be_read_is_said_with_its_line() {
    let found = rows("a,b\n1,2\n1\n3,4\n5", &["b"]).unwrap();
    assert_eq!(found[0], Ok(vec![2.0]));
    assert_eq!(
        found[1],
        Err("a.csv:3: expected a cell for each name, found 1 cells, where there are 2 names".to_owned())
    );
    assert_eq!(found[2], Ok(vec![4.0]));
    assert!(
        found[3]
            .as_ref()
            .unwrap_err()
            .starts_with("a.csv:5: expected a line end")
    );
    assert_eq!(
        rows("1,2\n3,4\n", &[]).unwrap_err(),
        "expected names of columns in the first line, found numbers alone: \"1,2\""
    );
    let long = format!("a,b\n1,{}\n2,3\n", "0".repeat(70_000));
    let found = rows(&long, &["a"]);
    assert!(found.is_ok_and(|rows| rows.last() == Some(&Ok(vec![2.0]))));
}

#[test]
fn a_spoilt_number_of_a_sample_is_said_with_its_line_and_a_word_for_none_is_not() {
    let text = "t,a,b\n1,2,3\n2,-23x0,3x0\n3,null,n/a\n4,,-\n5,NaN,4\n";
    let found = rows_of(text, &["a", "b"], Between::Unknown).unwrap();
    assert_eq!(
        found[1],
        Err("a.csv:3: expected a number, found \"-23x0\" in column \"a\"".to_owned())
    );
    let is_read: Vec<bool> = found.iter().map(Result::is_ok).collect();
    assert_eq!(is_read, [true, false, true, true, true]);
    // A command may be a text, and a condition has its last value.
    assert!(rows(text, &["a", "b"]).unwrap().iter().all(Result::is_ok));
}

#[test]
fn words_about_the_recording_before_the_names_are_passed_over() {
    let table = "t;a;b\n1,5;2;3\n2,5;3;4\n";
    let expected = [vec![2.0, 3.0], vec![3.0, 4.0]];
    for preamble in [
        "sep=;\n",
        "Recorder X\nRate;2000\n\n",
        "Recorder;X\nRate;2000\nDate;20.11.2026 14:00:00\n",
        "# a\nsep=;\n",
        "Recorder X\n# made by; someone; else\n",
    ] {
        assert_eq!(good(&format!("{preamble}{table}"), &["a", "b"]), expected, "{preamble}");
    }
}

#[test]
fn names_and_units_in_latin_1_are_read() {
    let text = b"t;\xb5-torque;angle [\xb0]\n1;2;3\n2;3;4\n".to_vec();
    let log = CsvLog::new(Cursor::new(text), "a.csv").unwrap();
    let found: Vec<_> = log
        .signals()
        .iter()
        .map(|of| (of.name.as_str(), of.unit.as_deref()))
        .collect();
    assert_eq!(found, [("t", None), ("\u{b5}-torque", None), ("angle", Some("\u{b0}"))]);
}
