//! The byte stream of a device deframes into the simulated samples, and a status ten times a second.

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample, Setpoint};
use ema_wire::{
    ActuatorId, Deframer, Mode, Sample, SerialPacket, quantity, unwrap_motor_counts, unwrap_output_counts, unwrap_seq,
};
use firmware_sim::{packets, write_stream};

/// Two actuations of a worn unit at 400 Hz: 1.15 s, during which the low bytes of counter and time wrap.
fn scenario() -> Scenario {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let fault = FaultVector {
        friction: 0.3,
        backlash: 0.2,
        ..FaultVector::NOMINAL
    };
    Scenario {
        load_torque: -5.0,
        actuations: Actuations {
            profile: Profile::Mixed,
            count: 2,
            rest: 0.05,
            length: 0.5,
        },
        ..Scenario::new(params, fault, 7)
    }
}

fn ema3() -> ActuatorId {
    ActuatorId::new(3).expect("3 is below 16")
}

fn stream(scenario: &Scenario) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_stream(scenario, ema3(), &mut bytes).expect("writing to a Vec does not fail");
    bytes
}

/// Asserts that a received sample equals the simulated one within half an LSB of each field.
fn assert_equal_within_lsb(received: &Sample, sensed: &SensedSample) {
    let at = sensed.seq;
    assert_eq!(
        (received.actuator, received.mode),
        (ema3(), Mode::Position),
        "sample {at}"
    );
    assert_eq!(
        unwrap_seq(sensed.seq.cast_signed(), received.seq),
        sensed.seq.cast_signed()
    );
    assert_eq!(
        unwrap_motor_counts(sensed.motor_counts, received.motor_counts),
        sensed.motor_counts,
        "sample {at}"
    );
    assert_eq!(
        unwrap_output_counts(sensed.output_counts, received.output_counts),
        sensed.output_counts,
        "sample {at}"
    );
    assert_eq!(u64::from(received.time_us), sensed.seq * 2_500 % 65_536, "sample {at}");
    for (ours, theirs) in received.currents_a().into_iter().zip(sensed.currents) {
        assert!(
            (ours - theirs).abs() <= 0.5e-3 + 1e-12,
            "sample {at}: {ours} A, simulated {theirs} A"
        );
    }
    let Setpoint::Position(angle) = sensed.setpoint else {
        panic!("sample {at}: expected a position setpoint")
    };
    assert_eq!(
        received.setpoint,
        quantity::position_setpoint_urad(angle),
        "sample {at}"
    );
}

#[test]
fn the_stream_deframes_into_the_simulated_samples() {
    let scenario = scenario();
    let mut deframer = Deframer::new();
    let (mut samples, mut status) = (Vec::new(), Vec::new());
    // In chunks of 13 bytes, which are shorter than a frame.
    for chunk in stream(&scenario).chunks(13) {
        for packet in deframer.push_slice(chunk) {
            match packet {
                SerialPacket::Sample(sample) => samples.push(sample),
                SerialPacket::Status {
                    actuator,
                    status: packet,
                } => status.push((samples.len(), actuator, packet)),
            }
        }
    }
    deframer.finish();
    assert_eq!(deframer.stats().dropped(), 0);

    let simulated: Vec<SensedSample> = scenario.run().collect();
    assert_eq!(samples.len(), simulated.len());
    for (received, sensed) in samples.iter().zip(&simulated) {
        assert_equal_within_lsb(received, sensed);
    }

    // Ten per second: after samples 0, 40, 80, … of 460.
    assert_eq!(
        status.iter().map(|(after, _, _)| *after).collect::<Vec<_>>(),
        (1..=460).step_by(40).collect::<Vec<_>>()
    );
    for (after, actuator, status) in status {
        assert_eq!(
            (actuator, status.dc_link_dv, status.load_torque_dnm),
            (ema3(), 3_800, Some(-50))
        );
        assert_eq!(usize::from(status.seq8), (after - 1) % 256);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let scenario = scenario();
    assert_eq!(stream(&scenario), stream(&scenario));
    let other = Scenario {
        seed: 8,
        ..scenario.clone()
    };
    assert_ne!(stream(&scenario), stream(&other));
}

#[test]
fn a_flipped_bit_costs_one_packet() {
    let scenario = scenario();
    let mut bytes = stream(&scenario);
    // The flip neither creates nor removes a zero, which would end a frame.
    let flipped = (bytes.len() / 2..bytes.len())
        .find(|&n| bytes[n] > 1)
        .expect("some byte above 1");
    bytes[flipped] ^= 1;
    let mut deframer = Deframer::new();
    let good = deframer.push_slice(&bytes).count();
    assert_eq!(deframer.stats().dropped(), 1);
    assert_eq!(good, packets(&scenario, ema3()).count() - 1);
}
