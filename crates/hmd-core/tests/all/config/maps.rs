//! `[map]`: the columns of a log of measured signals.

use ema_models::FaultId;
use hmd_core::dbc::Role;
use hmd_core::log_map::{Gap, LogMap, Quantity, Resampling};

use super::{OF_DBC, read, refusal};

const LEAST: &str = "[map]\ntime = \"t\"\ncurrents.q = \"iq\"\nposition.motor = \"m\"\n";

/// A log with all that a log can have.
const ALL: &str = "[map]\ntime = \"t\"\nclock = \"receiver\"\ncurrents = { a = \"ia\", b = \"ib\", c = \"ic\" }\n\
                   position = { motor = \"m\", output = \"o\" }\ncommand = { position = \"c\", speed = \"v\", mode = \"s\" }\n\
                   sample = { counter = \"n\", time = \"d\" }\nstatus = { dc_link = \"u\", winding_temp = \"w\", load_torque = \"l\" }\n";

fn map(text: &str) -> std::sync::Arc<LogMap> {
    let config = read(text);
    let (_, map) = config.actuator_of_logs().expect("a map");
    map.clone()
}

#[test]
fn every_column_reaches_its_quantity() {
    let all = map(ALL);
    let found: Vec<_> = all
        .columns()
        .iter()
        .map(|of| (of.quantity.key(), of.signal.as_str()))
        .collect();
    let expected = [
        ("time", "t"),
        ("currents.a", "ia"),
        ("currents.b", "ib"),
        ("currents.c", "ic"),
        ("position.motor", "m"),
        ("position.output", "o"),
        ("command.position", "c"),
        ("command.speed", "v"),
        ("command.mode", "s"),
        ("sample.counter", "n"),
        ("sample.time", "d"),
        ("status.dc_link", "u"),
        ("status.winding_temp", "w"),
        ("status.load_torque", "l"),
    ];
    assert_eq!(found, expected);
    assert!(all.has_device_time() && all.gaps().next().is_none());
    assert!(!map(&ALL.replace("sample = { counter = \"n\", time = \"d\" }", "")).has_device_time());
    let rotor = map("[map]\ntime = \"t\"\ncurrents = { d = \"id\", q = \"iq\" }\nposition.motor = \"m\"");
    assert!(rotor.has(Quantity::CurrentD) && rotor.has(Quantity::CurrentQ) && rotor.has_device_time());
}

#[test]
fn what_a_log_lacks_hides_faults() {
    let config = read(LEAST);
    let (actuator, _) = config.actuator_of_logs().unwrap();
    assert!(!actuator.has_set_point() && !actuator.has_output_angle());
    let hidden: Vec<_> = actuator.hidden_faults().collect();
    use FaultId::{Backlash, Gain, ShortA, ShortB, ShortC};
    assert_eq!(hidden, [ShortA, ShortB, ShortC, Backlash, Gain]);
    let config = read(ALL);
    let (actuator, _) = config.actuator_of_logs().unwrap();
    assert!(actuator.has_set_point() && actuator.has_output_angle() && actuator.hidden_faults().next().is_none());
    let config = read(&format!("{LEAST}position.output = \"o\""));
    assert!(config.actuators()[0].has_output_angle(), "whatever else it lacks");
    let config = read("");
    assert!(config.actuator_of_logs().is_none());
    let frames = &config.actuators()[0];
    assert!(frames.has_set_point() && frames.has_output_angle() && frames.hidden_faults().next().is_none());
}

#[test]
fn a_column_may_say_its_unit_scale_offset_and_range() {
    let text = LEAST.replace(
        "\"m\"",
        "{ signal = \"m\", unit = \"deg\", scale = -2, offset = 3.5, wraps_after = 360 }",
    );
    let of_motor = map(&text)
        .columns()
        .iter()
        .find(|of| of.signal == "m")
        .cloned()
        .unwrap();
    assert_eq!(
        (
            of_motor.unit.as_deref(),
            of_motor.scale,
            of_motor.offset,
            of_motor.wraps_after
        ),
        (Some("deg"), -2.0, 3.5, Some(360.0))
    );
    for (keys, expected) in [
        (
            "unit = \"A\"",
            "unit: expected one of the units rad, mrad, urad, deg, rev, counts, found \"A\"",
        ),
        ("scale = 0", "scale: expected a number other than 0, found 0"),
        ("scale = inf", "scale: expected a number other than 0, found inf"),
        ("offset = nan", "offset: expected a number, found nan"),
        ("wraps_after = 0", "wraps_after: expected a number above 0, found 0"),
        ("wraps_after = -1", "wraps_after: expected a number above 0, found -1"),
    ] {
        let text = LEAST.replace("\"m\"", &format!("{{ signal = \"m\", {keys} }}"));
        let refused = refusal(&text);
        assert!(
            refused.ends_with(&format!("map.position.motor.{expected}")),
            "{refused}"
        );
    }
    let refused = refusal(&LEAST.replace("\"m\"", "{ unit = \"deg\" }"));
    assert!(
        refused.contains("map.position.motor.signal: expected the name of a column or channel"),
        "{refused}"
    );
    // A current has no range, a counter no unit.
    let refused = refusal(&LEAST.replace("\"iq\"", "{ signal = \"iq\", wraps_after = 1 }"));
    assert!(refused.contains("currents.q.wraps_after: unknown key"), "{refused}");
    let refused = refusal(&ALL.replace("\"n\"", "{ signal = \"n\", unit = \"1\" }"));
    assert!(refused.contains("sample.counter.unit: unknown key"), "{refused}");
}

#[test]
fn a_mode_is_a_number_or_a_text_of_the_log() {
    let with = |mode: &str| map(&ALL.replace("mode = \"s\"", &format!("mode = {{ signal = \"s\"{mode} }}")));
    let plain = with("");
    assert_eq!((plain.modes().position, plain.modes().speed), (1, 2));
    assert!(!plain.has_mode_names());
    let numbers = with(", position = 5, speed = 0");
    assert_eq!((numbers.modes().position, numbers.modes().speed), (5, 0));
    assert!(!numbers.has_mode_names());
    let texts = with(", position = \"POS\", speed = \"VEL\"");
    let codes = ["POS", "VEL", "OFF", " "].map(|text| texts.mode_code(text));
    assert_eq!(codes, [Some(1.0), Some(2.0), Some(-1.0), None]);
}

#[test]
fn currents_and_angles_are_interpolated_at_those_of_the_currents_or_evenly() {
    assert_eq!(map(LEAST).resampling(), None);
    assert_eq!(map(&format!("{LEAST}resample = false")).resampling(), None);
    assert_eq!(
        map(&format!("{LEAST}resample = true")).resampling(),
        Some(Resampling::AtCurrents)
    );
    let even = map(&format!("{LEAST}resample_hz = 50"));
    assert_eq!(even.resampling(), Some(Resampling::Even(50)));
    assert!(
        refusal(&format!("{LEAST}resample_hz = 49")).ends_with("expected a whole number from 50 to 20000, found 49")
    );
    for sample in ["counter = \"n\"", "time = \"d\""] {
        let refused = refusal(&format!("{LEAST}resample_hz = 50\nsample.{sample}"));
        assert!(
            refused.contains("map.resample_hz: expected neither sample.counter nor sample.time"),
            "{refused}"
        );
    }
    map(&format!("{LEAST}resample = true\nsample.counter = \"n\""));
    let filtered = map(&format!("{LEAST}currents.bandwidth_hz = 300"));
    assert!(filtered.gaps().any(|gap| gap == Gap::FilteredCurrents(300)));
}

#[test]
fn a_map_is_of_one_actuator_whose_frames_have_no_layout_of_their_own() {
    let two = "[[actuator]]\nid = 0\nname = \"a\"\n[[actuator]]\nid = 1\nname = \"b\"\n[type.bench]\nsensors.sample_rate_hz = 400\n";
    let of = |text: &str| read(text).actuator_of_logs().map(|(actuator, _)| actuator.name.clone());
    assert_eq!(of(&format!("{two}{LEAST}")).as_deref(), Some("a"));
    assert_eq!(of(&format!("{two}{LEAST}actuator = \"b\"")).as_deref(), Some("b"));
    assert_eq!(of(LEAST).as_deref(), Some("ema0"), "without any actuator the first");
    let refused = refusal(&format!("{two}{LEAST}actuator = \"c\""));
    assert!(
        refused.ends_with("map.actuator: expected the name of an [[actuator]], found \"c\""),
        "{refused}"
    );
    let refused = refusal(&format!("{OF_DBC}{LEAST}"));
    assert!(
        refused.contains("map.actuator: expected an actuator without dbc"),
        "{refused}"
    );
    let drive = two.replace("name = \"a\"", "name = \"a\"\ndrive.preset = \"odrive\"");
    let refused = refusal(&format!("{drive}{LEAST}"));
    assert!(
        refused.contains("map.actuator: expected an actuator without drive"),
        "{refused}"
    );
    // The columns of a drive are none of a log.
    assert_eq!(of(&drive), None);
    assert_eq!(of(&format!("{drive}{LEAST}actuator = \"b\"")).as_deref(), Some("b"));
}

#[test]
fn a_map_without_what_every_window_needs_is_refused() {
    for (key, expected) in [
        (
            "currents.q = \"iq\"\n",
            "map: expected columns for currents.a and currents.b, or for currents.q, found none",
        ),
        ("position.motor = \"m\"\n", "map: expected a column for position.motor"),
    ] {
        let refused = refusal(&LEAST.replace(key, ""));
        assert!(refused.contains(expected), "{refused}");
    }
    let refused = refusal(&ALL.replace(", mode = \"s\"", ""));
    assert!(
        refused.contains("a column for command.mode beside command.position and command.speed"),
        "{refused}"
    );
    assert!(map(ALL).has(Quantity::Of(Role::Mode)));
}
