//! Names and texts, the places that refusals name, and keys that are misspelt.

use std::path::{Path, PathBuf};

use hmd_core::config::Config;

use super::{checked, file, read, refusal};

#[test]
fn a_name_has_up_to_64_plain_characters_and_begins_with_a_letter_or_digit() {
    let named = |name: &str| checked(&format!("[[actuator]]\nid = 0\nname = \"{name}\""));
    let longest = "x".repeat(64);
    for good in ["a", "7", "_", "Flap-left_2.b", &longest] {
        assert_eq!(named(good).unwrap().actuators()[0].name, good);
    }
    let too_long = "x".repeat(65);
    for bad in ["-a", ".a", "a b", "ä", "a/b", "bus", "hmd", "log", &too_long] {
        let refused = named(bad).unwrap_err();
        assert!(
            refused.contains("actuator[0].name: expected a name of 1 to 64 letters"),
            "{bad}: {refused}"
        );
    }
}

#[test]
fn a_text_has_up_to_256_printable_characters() {
    let part = |text: &str| checked(&format!("[[actuator]]\nid = 0\npart_number = \"{text}\""));
    let longest = "ä".repeat(256);
    assert_eq!(
        part(&longest).unwrap().actuators()[0].part_number.as_ref(),
        Some(&longest)
    );
    for bad in [&"x".repeat(257), "", "  ", "a\\tb"] {
        let refused = part(bad).unwrap_err();
        assert!(
            refused.contains("expected a text of 1 to 256 printable characters"),
            "{bad}: {refused}"
        );
    }
}

#[test]
fn a_key_that_is_a_slip_away_is_offered_and_another_is_not() {
    let unknown = |key: &str| refusal(&format!("[window]\n{key} = 1"));
    let offers = |key: &str| unknown(key).contains("did you mean");
    // A third of the letters may differ, or one of fewer than three; four and more may be the beginning of the key.
    assert!(unknown("rests_ms").ends_with("did you mean rest_ms?"));
    assert!(unknown("rst_mz").ends_with("did you mean rest_ms?"));
    assert!(!offers("rst_zz"));
    assert!(unknown("dura").ends_with("did you mean duration_ms?"));
    assert!(!offers("dur"));
    assert!(unknown("is").ends_with("known here: pre_trigger_ms, duration_ms, rest_ms, trigger_position_rad, trigger_speed_rad_s, max_gap_fraction, longest_gap_ms"));
    assert!(refusal("[[actuator]]\nib = 0").ends_with("did you mean id?"));
    assert!(!refusal("[[actuator]]\nxy = 0").contains("did you mean"));
}

#[test]
fn a_long_or_odd_key_or_value_is_quoted_short_and_on_one_line() {
    let key = "k".repeat(300);
    let refused = refusal(&format!("[window]\n{key} = 1"));
    assert!(
        refused.starts_with(&format!("hmd.toml:2: window.{}…: unknown key", "k".repeat(40))),
        "{refused}"
    );
    let exact = "k".repeat(40);
    assert!(
        refusal(&format!("[window]\n{exact} = 1")).starts_with(&format!("hmd.toml:2: window.{exact}: unknown key"))
    );
    let refused = refusal("[window]\n\"a\\nb\" = 1");
    assert!(
        refused.starts_with("hmd.toml:2: window.\"a\\nb\": unknown key"),
        "{refused}"
    );
    let refused = refusal("\"\" = 1");
    assert!(refused.starts_with("hmd.toml:1: \"\": unknown key"), "{refused}");
    let value = "9".repeat(50);
    let refused = refusal(&format!("[window]\nrest_ms = \"{value}\""));
    assert!(refused.ends_with(&format!("found \"{}…", "9".repeat(39))), "{refused}");
}

/// What texts, in their order, with settings, are refused for.
fn refused_in(files: &[(&str, &str)], settings: &[&str]) -> String {
    let files: Vec<_> = files
        .iter()
        .map(|(name, text)| ((*name).to_owned(), (*text).to_owned()))
        .collect();
    let settings: Vec<_> = settings.iter().map(|setting| (*setting).to_owned()).collect();
    match Config::from_texts(&files, &settings, &file) {
        Ok(_) => panic!("accepted"),
        Err(refused) => refused.to_string(),
    }
}

#[test]
fn a_refusal_names_the_file_and_the_line_in_it() {
    let one = ("a.toml", "# one\n[window]\nrest_ms = 20\n");
    for (files, settings, expected) in [
        (
            &[one, ("b.toml", "[health]\n\nwatch = 7")][..],
            &[][..],
            "b.toml:3: health.watch",
        ),
        (
            &[("b.toml", "[health]\n\nwatch = 7\n"), one],
            &[],
            "b.toml:3: health.watch",
        ),
        (
            &[("b.toml", "window.rest_ms = 0"), one, ("c.toml", "window.rest_ms = 0")],
            &[],
            "c.toml:1: window.rest_ms",
        ),
        (
            &[one],
            &["window.duration_ms=400", "health.watch=7"],
            "--set:2: health.watch",
        ),
        (
            &[one],
            &["window.duration_ms"],
            "--set:1: not valid TOML: expected KEY=VALUE in one line",
        ),
        (
            &[one],
            &["a=1", "=3"],
            "--set:2: not valid TOML: expected KEY=VALUE in one line, found \"=3\"",
        ),
        (
            &[one],
            &["identification.method=ga\nb"],
            "--set:1: not valid TOML: expected KEY=VALUE",
        ),
        (&[one, ("b.toml", "\n= 3")], &[], "b.toml:2: not valid TOML"),
    ] {
        let refused = refused_in(files, settings);
        assert!(refused.starts_with(expected), "{refused}");
    }
}

#[test]
fn settings_hold_over_files_the_last_one_most_and_words_need_no_quotes() {
    let files = [("hmd.toml".to_owned(), "window.rest_ms = 30\n".to_owned())];
    let settings = ["window.rest_ms=40", "window.rest_ms = 50", "identification.method=de"].map(str::to_owned);
    let config = Config::from_texts(&files, &settings, &file).unwrap();
    assert_eq!(config.window().rest_ms.to_bits(), f64::to_bits(50.0));
    assert_eq!(config.identification().method.name(), "de");
}

#[test]
fn every_file_of_a_run_is_named_once_from_the_folder_of_the_first() {
    let text = "[rul]\nevents = \"events.jsonl\"\n[type.bench]\ncalibration = \"type.toml\"\n[[actuator]]\nid = 1\n\
                calibration = \"unit.toml\"\n[actuator.drive]\npreset = \"cia402\"\neds = \"drive.dcf\"\n";
    let files = [("/etc/hmd/hmd.toml".to_owned(), text.to_owned())];
    let at_root = |path: &Path| file(Path::new(path.file_name().unwrap_or_default()));
    let config = Config::from_texts(&files, &[], &at_root).unwrap();
    let expected = ["hmd.toml", "type.toml", "unit.toml", "drive.dcf", "events.jsonl"];
    assert_eq!(config.files(), expected.map(|name| Path::new("/etc/hmd").join(name)));
    assert_eq!(config.resolve(Path::new("/var/x")), PathBuf::from("/var/x"));
    // A text that is no file is none that a run reads.
    assert!(Config::from_toml_str("", "hmd.toml").unwrap().files().is_empty());
    let of_dbc = read(super::OF_DBC);
    assert_eq!(of_dbc.files(), ["hmd.toml", "foreign.dbc"].map(PathBuf::from));
}

#[test]
fn the_interfaces_of_a_live_run_are_those_of_its_actuators() {
    let two = "[[actuator]]\nid = 0\nbus = \"can1\"\ntype = \"slow\"\n[[actuator]]\nid = 1\nbus = \"can0\"\ntype = \"slow\"\n\
               [type.slow]\nbased_on = \"bench\"\nsensors.sample_rate_hz = 400\n";
    let names = read(two).interfaces("hmd.toml").unwrap();
    assert_eq!(names.iter().collect::<Vec<_>>(), ["can1", "can0"]);
    let refused = |text: &str| read(text).interfaces("hmd.toml").unwrap_err().to_string();
    assert!(refused("").contains("expected an [[actuator]] with its bus to watch live, found none"));
    assert!(refused(&two.replace("bus = \"can0\"\n", "")).contains("found none for ema1"));
    let refused = refusal(&two.replace("can0", "a name that is too long"));
    assert!(
        refused.starts_with("hmd.toml: bus \"a name that is too long\": "),
        "{refused}"
    );
}
