//! `[actuator.signals]`: signals of a DBC file as the quantities of an actuator.

use std::path::Path;

use hmd_core::config::Config;
use hmd_core::dbc::{Binding, Role, SignalMap};

use super::{DBC, OF_DBC, read, refusal};

fn map(text: &str) -> SignalMap {
    let config = read(text);
    let mut all = config.mapped_actuators("can0");
    let (id, map, rate_hz) = all.next().expect("a map");
    assert_eq!((id.index(), rate_hz.round() as u32), (0, 400));
    assert!(all.next().is_none() && config.mapped_actuators("can1").next().is_none());
    SignalMap::clone(map)
}

fn binding(map: &SignalMap, role: Role) -> Binding {
    let mut all = map.messages.iter().flat_map(|message| &message.bindings);
    all.find(|of| of.role == role).cloned().expect("mapped")
}

/// The example with another value for a key.
fn with(key: &str, value: &str) -> String {
    let line = OF_DBC
        .lines()
        .find(|line| line.starts_with(&format!("{key} = ")))
        .expect("a key of the example");
    OF_DBC.replace(line, &format!("{key} = {value}"))
}

#[test]
fn every_key_of_the_example_is_mapped() {
    let map = map(OF_DBC);
    let messages: Vec<_> = map
        .messages
        .iter()
        .map(|of| (of.name.as_str(), of.bindings.len(), of.counters.len()))
        .collect();
    assert_eq!(
        messages,
        [("ACE1_Phase", 6, 1), ("ACE1_Angles", 2, 1), ("ACE1_Demand", 3, 0)]
    );
    assert_eq!((map.modes.position, map.modes.speed), (5, 6));
    assert_eq!(map.counter_bits, (6, 8));
    for role in [
        Role::CurrentC,
        Role::Time,
        Role::DcLink,
        Role::WindingTemp,
        Role::LoadTorque,
        Role::Mode,
    ] {
        assert!(map.has(role), "{role:?}");
    }
    assert!(!map.has(Role::CommandSpeed));
}

#[test]
fn an_angle_begins_again_where_its_signal_does_or_where_it_is_said() {
    let example = map(OF_DBC);
    // 32 bits of steps that are counts, of 65 536 in a turn; currents never begin again.
    let wraps = |map: &SignalMap, role| binding(map, role).wraps_after;
    assert!((wraps(&example, Role::MotorPosition).unwrap() - 4_294_967_296.0).abs() < 1.0);
    assert_eq!(wraps(&example, Role::CurrentA), None);
    assert_eq!(wraps(&example, Role::CommandPosition), None);
    let turn = map(&with(
        "position.motor",
        "{ signal = \"ACE1_Angles.Theta_M\", wraps_after = 360 }",
    ));
    assert!((wraps(&turn, Role::MotorPosition).unwrap() - 65_536.0).abs() < 1e-6);
    for value in ["0", "-1", "inf", "nan"] {
        let text = with(
            "position.motor",
            &format!("{{ signal = \"ACE1_Angles.Theta_M\", wraps_after = {value} }}"),
        );
        let expected = format!("position.motor.wraps_after: expected a number above 0, found {value}");
        assert!(refusal(&text).ends_with(&expected), "{}", refusal(&text));
    }
}

#[test]
fn a_unit_that_is_said_holds_over_that_of_the_file() {
    let plain = binding(&map(OF_DBC), Role::CurrentA);
    assert_eq!(plain.unit.scale.to_bits(), f64::to_bits(1.0));
    let milli = map(&with("currents.a", "{ signal = \"ACE1_Phase.I_A\", unit = \"mA\" }"));
    assert!((binding(&milli, Role::CurrentA).unit.scale - 1e-3).abs() < 1e-12);
    let refused = refusal(&with("currents.a", "{ signal = \"ACE1_Phase.I_A\", unit = \"V\" }"));
    assert!(
        refused.ends_with("signals.currents.a.unit: expected one of the units A, mA, found \"V\""),
        "{refused}"
    );
    let refused = refusal(&with("currents.a", "\"ACE1_Phase.U_dc\""));
    assert!(
        refused.contains(
            "signals.currents.a: expected a signal in one of the units A, mA, or { signal = …, unit = … } (foreign.dbc says \"V\")"
        ),
        "{refused}"
    );
    let refused = refusal(&with("currents.a", "{ unit = \"A\" }"));
    assert!(
        refused.contains("currents.a.signal: expected a signal as \"MESSAGE.SIGNAL\""),
        "{refused}"
    );
    let refused = refusal(&with("currents.a", "{ signal = \"ACE1_Phase.I_A\", wraps_after = 1 }"));
    assert!(refused.contains("currents.a.wraps_after: unknown key"), "{refused}");
}

#[test]
fn modes_are_those_of_the_built_in_dictionary_unless_they_are_said() {
    let map = map(&with("command.mode", "\"ACE1_Demand.State\""));
    assert_eq!((map.modes.position, map.modes.speed), (1, 2));
}

#[test]
fn an_unknown_signal_is_refused_with_the_closest_ones() {
    for name in ["ace1_phase.i_a", "ACE1_Phase.I_X", "ACE1_Phase"] {
        let refused = refusal(&with("currents.a", &format!("\"{name}\"")));
        assert!(
            refused.contains("currents.a: expected a signal of foreign.dbc, the closest being ACE1_Phase.I_A, "),
            "{refused}"
        );
        assert_eq!(
            refused.matches("ACE1_").count(),
            3 + usize::from(name.starts_with("ACE1")),
            "three: {refused}"
        );
    }
    let refused = refusal(&with("sample.counter", "[\"ACE1_Phase.Cycle\", \"ACE1_Angles.Alife\"]"));
    assert!(
        refused.contains("sample.counter: expected a signal of foreign.dbc, the closest being ACE1_Angles.Alive"),
        "{refused}"
    );
    let refused = refusal(&with("sample.counter", "\"ACE1_Phase.U_dc\""));
    assert!(
        refused.contains("sample.counter: expected a counter: a whole number"),
        "{refused}"
    );
    let refused = refusal(&with("sample.counter", "[3]"));
    assert!(
        refused.contains("sample.counter: expected a text in quotes, or an array of them, found an array"),
        "{refused}"
    );
}

#[test]
fn signals_need_a_file_that_can_be_read() {
    let refused = refusal(&OF_DBC.replace("dbc = \"foreign.dbc\"\n", ""));
    assert!(
        refused.contains("actuator[0].dbc: expected the DBC file of the signals, found no such key"),
        "{refused}"
    );
    let refused = refusal(&OF_DBC.replace("\"foreign.dbc\"", "\"other.dbc\""));
    assert!(
        refused.contains("actuator[0].dbc: expected a DBC file of at most 16 MiB that can be read (there is none)"),
        "{refused}"
    );
    let refused = refusal(&OF_DBC.replace("currents.b = \"ACE1_Phase.I_B\"\n", ""));
    assert!(
        refused.contains("actuator[0].signals: expected a signal for currents.b"),
        "{refused}"
    );
    assert!(read("[[actuator]]\nid = 0").actuators()[0].map.is_none());
}

#[test]
fn a_file_is_read_once_whatever_the_code_page_of_its_units() {
    let second = OF_DBC
        .split("[type.")
        .next()
        .unwrap()
        .replace("id = 0", "id = 1")
        .replace("ema0", "ema1");
    let text = format!("{OF_DBC}{second}");
    let reads = std::cell::Cell::new(0);
    let western: Vec<u8> = format!("\u{feff}{DBC}").replace("\"degC\"", "\"°C\"").into_bytes();
    let without_mark = DBC.replace("\"degC\"", "\"°C\"").chars().map(|c| c as u8).collect();
    for bytes in [western, without_mark] {
        reads.set(0);
        let file = |path: &Path| {
            assert_eq!(path, Path::new("/etc/hmd/foreign.dbc"));
            reads.set(reads.get() + 1);
            Ok(bytes.clone())
        };
        let files = [("/etc/hmd/hmd.toml".to_owned(), text.clone())];
        let config = Config::from_texts(&files, &[], &file).unwrap();
        assert_eq!((config.mapped_actuators("can0").count(), reads.get()), (2, 1));
    }
}
