//! How full a bus is, by the frames that are on it.

use super::{OF_DBC, checked, read};

/// Load of the only bus.
fn load(text: &str) -> f64 {
    match &read(text).bus_loads()[..] {
        [bus] => bus.load,
        others => panic!("{others:?}"),
    }
}

fn assert_load(text: &str, expected: f64) {
    let load = load(text);
    assert!((load - expected).abs() < 1e-9, "{load} instead of {expected}\n{text}");
}

/// Bits of a classic frame of eight bytes with its stuffing, and what a long identifier adds.
const CLASSIC_8: f64 = 120.0;
const LONG: f64 = 22.0;

#[test]
fn a_mapped_actuator_sends_one_frame_of_each_message_and_selection() {
    // Three selections with a phase each; the one with conditions alone is no part of a sample.
    let bits = 3.0 * CLASSIC_8 + (CLASSIC_8 + LONG) + CLASSIC_8;
    assert_load(OF_DBC, 400.0 * bits / 1e6);
    assert_load(&format!("{OF_DBC}[bus]\nbitrate_bit_s = 500000\n"), 400.0 * bits / 5e5);
}

#[test]
fn a_frame_of_more_than_eight_bytes_is_one_of_fd() {
    let dbc = "BU_: A\n\nBO_ 256 S: LENGTH A\n SG_ N : 0|8@1+ (1,0) [0|255] \"\" A\n SG_ A : 8|8@1- (1,0) [0|0] \"A\" A\n \
               SG_ B : 16|8@1- (1,0) [0|0] \"A\" A\n SG_ M : 24|16@1- (1,0) [0|0] \"counts\" A\n \
               SG_ O : 40|8@1- (1,0) [0|0] \"counts\" A\n SG_ C : 48|8@1- (1,0) [0|0] \"rad\" A\n";
    let text = "[[actuator]]\nid = 0\ndbc = \"a.dbc\"\n[actuator.signals]\ncurrents = { a = \"S.A\", b = \"S.B\" }\n\
                position = { motor = \"S.M\", output = \"S.O\" }\ncommand.position = \"S.C\"\nsample.counter = \"S.N\"\n";
    let load = |length: &str| {
        let files = [("hmd.toml".to_owned(), text.to_owned())];
        let of = |_: &std::path::Path| Ok(dbc.replace("LENGTH", length).into_bytes());
        let config = hmd_core::config::Config::from_texts(&files, &[], &of).unwrap();
        config.bus_loads()[0].load
    };
    // At 2 kHz; the data of FD at 5 Mbit/s: 31 bits of arbitration and end, 178 of 16 bytes.
    assert!((load("8") - 2e3 * CLASSIC_8 / 1e6).abs() < 1e-9, "{}", load("8"));
    assert!(
        (load("16") - 2e3 * (31.0 / 1e6 + 178.0 / 5e6)).abs() < 1e-9,
        "{}",
        load("16")
    );
}

fn drive(preset: &str, keys: &str) -> String {
    format!(
        "[[actuator]]\nid = 1\n[actuator.drive]\npreset = \"{preset}\"\n{keys}\n[type.bench]\nsensors.sample_rate_hz = 400\n"
    )
}

#[test]
fn a_drive_sends_its_frames_with_parts_of_a_sample_and_gets_one_command() {
    // Position and current, and the command.
    assert_load(&drive("odrive", ""), 400.0 * 3.0 * CLASSIC_8 / 1e6);
    assert_load(&drive("odrive", "output_encoder = 490"), 400.0 * 4.0 * CLASSIC_8 / 1e6);
    // Current and position have long identifiers.
    assert_load(&drive("vesc", ""), 400.0 * (3.0 * CLASSIC_8 + 2.0 * LONG) / 1e6);
    // One frame of eight registers, of six bytes each, of FD.
    let fast = 5.0 + 8.0 * 42.0;
    let reply = 31.0 / 1e6 + (fast + 34.0 + 32.0) / 5e6;
    assert_load(&drive("moteus", ""), 400.0 * (reply + CLASSIC_8 / 1e6));
}

#[test]
fn samples_in_frames_of_fd_load_a_bus_less() {
    let one = "[[actuator]]\nid = 0\nbus = \"can0\"\n";
    let (classic, fd) = (load(one), load(&format!("{one}[bus]\nfd = true")));
    assert!((classic - 0.7212).abs() < 1e-9, "{classic}");
    assert!(fd < 0.5 * classic, "{fd}");
    let config = read(one);
    assert_eq!(config.bus().load_of_one(2000.0).to_bits(), classic.to_bits());
}

#[test]
fn actuators_without_a_bus_share_one_and_are_told_as_any() {
    let slow = "[type.bench.sensors]\nsample_rate_hz = 400\n[[actuator]]\nid = 0\n[[actuator]]\nid = 1\n\
                [[actuator]]\nid = 2\nbus = \"can0\"\n";
    let config = read(slow);
    let of: Vec<_> = config
        .bus_loads()
        .iter()
        .map(|bus| (bus.name().to_owned(), bus.actuators))
        .collect();
    assert_eq!(of, [("(any)".to_owned(), 2), ("can0".to_owned(), 1)]);
    assert!(read("").bus_loads().is_empty(), "nobody knows how many there are");
}

#[test]
fn a_bus_is_too_full_above_nine_tenths() {
    let text = |actuators: usize| {
        (0..actuators).fold("[type.bench.sensors]\nsample_rate_hz = 1000\n".to_owned(), |text, n| {
            text + &format!("[[actuator]]\nid = {n}\nbus = \"can0\"\n")
        })
    };
    read(&text(2));
    let refused = checked(&text(3)).unwrap_err();
    assert!(
        refused.contains("found 108 % of 1000000 bit/s by 3 actuators"),
        "{refused}"
    );
    let refused = checked("[bus]\nbitrate_bit_s = 500000\n[[actuator]]\nid = 0\nbus = \"can0\"").unwrap_err();
    assert!(
        refused.contains("found 144 % of 500000 bit/s by 1 actuator;"),
        "{refused}"
    );
}
