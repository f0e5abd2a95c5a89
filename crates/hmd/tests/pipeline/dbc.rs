//! A map of another bus: what fits, what is refused and in which words, and how samples come together.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ema_wire::{Mode, Sample};
use hmd_core::config::Config;
use hmd_core::dbc::{Joiner, SignalMap};

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures")
}

/// `fixtures/foreign.toml` with some text replaced.
fn changed(from: &str, to: &str) -> Result<Config, String> {
    let text = std::fs::read_to_string(fixtures().join("foreign.toml")).unwrap();
    assert!(text.contains(from), "{from}");
    let name = fixtures().join("foreign.toml");
    let text = text.replace(from, to);
    let shown = format!("{}:", name.display());
    hmd_storage::config_file::config_from_text(&text, &name.display().to_string())
        .map_err(|e| e.to_string().replace(&shown, ""))
}

#[test]
fn a_map_that_does_not_fit_is_refused_with_what_comes_closest() {
    let cases = [
        (
            ("ACE1_Phase.I_B", "ACE1_Phase.i_q"),
            "11: actuator[0].signals.currents.b: expected a signal of foreign.dbc, the closest being ACE1_Phase.I_A, \
             ACE1_Phase.I_B, ACE1_Phase.I_C, found \"ACE1_Phase.i_q\"",
        ),
        (
            ("\"ACE1_Demand.Clock\"", "\"ACE2_Demand.clock\""),
            "the closest being ACE1_Demand.Clock, ",
        ),
        (
            ("\"foreign.dbc\"", "\"nowhere.dbc\""),
            "dbc: expected a DBC file of at most 16 MiB that can be read (No such",
        ),
        (("\"foreign.dbc\"", "\"foreign.toml\""), "(no valid DBC: line 1)"),
        (
            ("dbc = \"foreign.dbc\"\n", ""),
            "dbc: expected the DBC file of the signals, found no such key",
        ),
        (("currents.b =", "currents.d ="), "unknown key"),
        (
            ("currents.b = \"ACE1_Phase.I_B\"\n", ""),
            "expected a signal for currents.b, without which no window can be assessed",
        ),
        (
            ("position.output = \"ACE1_Angles.Theta_O\"\n", ""),
            "expected a signal for position.output, without which",
        ),
        (
            ("command.position = \"ACE1_Demand.Angle\"\n", ""),
            "expected a signal for command.position or command.speed",
        ),
        (
            ("sample.counter = [\"ACE1_Phase.Cycle\", \"ACE1_Angles.Alive\"]\n", ""),
            "expected a signal for sample.counter, without which lost samples go unseen",
        ),
        (
            ("\"ACE1_Angles.Alive\"", "\"ACE1_Angles.Theta_O\""),
            "sample.counter: expected a counter: a whole number of at least 2 bits, with factor 1 and offset 0",
        ),
        (
            ("currents.b = \"ACE1_Phase.I_B\"", "currents.b = \"ACE1_Phase.I_A\""),
            "expected a signal of its own for each quantity, where currents.a and currents.b have the same",
        ),
        (
            ("\"ACE1_Phase.I_A\"", "\"ACE1_Phase.U_dc\""),
            "expected a signal in one of the units A, mA, or { signal = …, unit = … } (foreign.dbc says \"V\")",
        ),
        (
            ("\"ACE1_Phase.I_A\"", "{ signal = \"ACE1_Phase.I_A\", unit = \"deg\" }"),
            "signals.currents.a.unit: expected one of the units A, mA, found \"deg\"",
        ),
        (
            (
                "\"ACE1_Angles.Theta_M\"",
                "{ signal = \"ACE1_Angles.Theta_M\", wraps_after = 0 }",
            ),
            "wraps_after: expected a number above 0, found 0",
        ),
        (
            ("sample_rate_hz = 400", "sample_rate_hz = 2000"),
            "expected a load of at most 90 %, found 124 %",
        ),
    ];
    for ((from, to), expected) in cases {
        let found = changed(from, to).expect_err(to);
        assert!(found.contains(expected), "expected {expected}\nfound {found}");
    }
}

#[test]
fn missing_signals_of_a_map_are_reported() {
    let lacking = [
        "currents.c = \"ACE1_Phase.I_C\"\n",
        "sample.time = \"ACE1_Demand.Clock\"\nstatus.dc_link = \"ACE1_Phase.U_dc\"\n",
    ];
    let text = changed(lacking[0], "").unwrap().describe();
    assert!(
        text.contains("    no currents.c: it is what the other two leave\n"),
        "{text}"
    );
    let text = changed(lacking[1], "").unwrap().describe();
    for line in [
        "    mapped by foreign.dbc:\n",
        "    ACE1_Phase 2C0: currents.a currents.b currents.c status.winding_temp status.load_torque \
         sample.counter of 6 bits\n",
        "    ACE1_Angles 18FEF100: position.motor position.output sample.counter of 8 bits\n",
        "    ACE1_Demand has no counter: its frames join a sample by their stamps, at most 1.25 ms apart\n",
        "    no sample.time: the rate is taken to be 400 Hz\n",
        "    no status.dc_link: the nominal voltage of the type holds\n",
    ] {
        assert!(text.contains(line), "expected {line}\nfound {text}");
    }
}

#[test]
fn the_hash_follows_what_the_signals_mean() {
    let same = changed("ACE1_Phase.I_A", "ACE1_Phase.I_A").unwrap().hash();
    assert_ne!(changed("position = 5", "position = 4").unwrap().hash(), same);
    assert_ne!(
        changed("\"ACE1_Phase.I_A\"", "{ signal = \"ACE1_Phase.I_A\", unit = \"mA\" }")
            .unwrap()
            .hash(),
        same
    );
}

const PERIOD_NS: u64 = 2_500_000;

/// Frames of sample n: the message of the map, and its data.
fn frames(n: u32) -> [(usize, [u8; 8]); 5] {
    let phase = |branch: u8, amperes: f32| {
        let mut data = [0; 8];
        data[0] = (branch << 6) | (n % 64) as u8;
        data[1..5].copy_from_slice(&amperes.to_be_bytes());
        (0, data)
    };
    let mut angles = [0; 8];
    angles[..4].copy_from_slice(&(100 * n).to_be_bytes());
    angles[4..7].copy_from_slice(&n.to_be_bytes()[1..]);
    angles[7] = n as u8;
    let mut demand = [5, 0, 0, 0, 0, 0, 0, 0];
    demand[2..4].copy_from_slice(&((2500 * n) as u16).to_be_bytes());
    demand[4..].copy_from_slice(&n.to_le_bytes());
    [
        phase(0, 1.0),
        phase(1, n as f32 / 1e3),
        phase(2, -1.0),
        (1, angles),
        (2, demand),
    ]
}

fn joiner() -> Joiner {
    let config = hmd_storage::config_file::load_config(fixtures().join("foreign.toml")).unwrap();
    let actuator = &config.actuators()[0];
    let map: Arc<SignalMap> = actuator.map.clone().unwrap();
    Joiner::new(actuator.id, map, 400.0)
}

/// Samples of a stretch of frames, of which `lost` (sample, place) do not come.
fn joined(samples: impl Iterator<Item = u32>, lost: &[(u32, usize)]) -> Vec<Sample> {
    let mut joiner = joiner();
    let mut found = Vec::new();
    for n in samples {
        for (place, (message, data)) in frames(n).into_iter().enumerate() {
            let stamp_ns = u64::from(n) * PERIOD_NS + place as u64 * 120_000;
            if !lost.contains(&(n, place)) {
                found.extend(
                    joiner
                        .push(message, &data, stamp_ns)
                        .unwrap()
                        .sample
                        .map(|(sample, _)| sample),
                );
            }
        }
    }
    found
}

/// Every part of a sample is of the same instant.
fn assert_unmixed(sample: &Sample) {
    let n = sample.setpoint;
    assert_eq!(i32::from(sample.i_b_ma), n, "{sample:?}");
    assert_eq!((sample.motor_counts, sample.output_counts), (100 * n, n), "{sample:?}");
    assert_eq!((sample.seq, sample.mode), (n as u16, Mode::Position), "{sample:?}");
    assert_eq!(sample.time_us, (2500 * n) as u16, "{sample:?}");
}

#[test]
fn a_lost_frame_costs_its_sample_and_parts_never_mix() {
    for place in 0..5 {
        let found = joined(0..300, &[(7, place), (9, (place + 1) % 5)]);
        found.iter().for_each(assert_unmixed);
        let numbers: Vec<u16> = found.iter().map(|sample| sample.seq).collect();
        let expected: Vec<u16> = (0..300).filter(|n| ![7, 9].contains(n)).collect();
        assert_eq!(numbers, expected, "place {place}");
    }
}

#[test]
fn a_narrow_counter_goes_on_over_a_gap_of_several_rounds() {
    // 8 bits are the widest here: a round of 640 ms.
    let found = joined((0..10).chain(1_000..1_010), &[]);
    found.iter().for_each(assert_unmixed);
    assert_eq!(found.len(), 20);
}

#[test]
fn a_frame_that_cannot_be_is_no_sample() {
    let mut joiner = joiner();
    let nan = f32::NAN.to_be_bytes();
    assert!(
        joiner
            .push(0, &[0, nan[0], nan[1], nan[2], nan[3], 0, 0, 0], 0)
            .is_none()
    );
    assert!(joiner.push(0, &[0; 7], 0).is_none());
    assert!(joiner.push(9, &[0; 8], 0).is_none());
}

#[test]
fn an_angle_within_one_turn_goes_on() {
    let once = "{ signal = \"ACE1_Angles.Theta_M\", wraps_after = 360 }";
    let config = changed("\"ACE1_Angles.Theta_M\"", once).unwrap();
    let actuator = &config.actuators()[0];
    let mut joiner = Joiner::new(actuator.id, actuator.map.clone().unwrap(), 400.0);
    let mut counts = Vec::new();
    for n in 0..40_u32 {
        for (message, mut data) in frames(n) {
            if message == 1 {
                // 30° a sample, forth and back.
                let steps = if n < 20 { n } else { 40 - n };
                data[..4].copy_from_slice(&(65_536 * (steps % 12) / 12).to_be_bytes());
            }
            let heard = joiner.push(message, &data, u64::from(n) * PERIOD_NS).unwrap();
            counts.extend(heard.sample.map(|(sample, _)| sample.motor_counts));
        }
    }
    let turns: Vec<i32> = counts
        .iter()
        .map(|&counts| (f64::from(counts) * 12.0 / 65_536.0).round() as i32)
        .collect();
    let expected: Vec<i32> = (0..40).map(|n| if n < 20 { n } else { 40 - n }).collect();
    assert_eq!(turns, expected);
}
