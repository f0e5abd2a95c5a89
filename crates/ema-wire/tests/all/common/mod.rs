//! Strategies for samples, frames and packets, shared by the tests.
#![allow(dead_code, reason = "every test binary uses its own part")]

use ema_wire::{ActuatorId, Command, Currents, Mode, Position, Sample, SerialPacket, Status};
use proptest::prelude::*;

const S24: std::ops::Range<i32> = -(1 << 23)..(1 << 23);

pub(crate) fn actuator() -> impl Strategy<Value = ActuatorId> {
    (0_u8..16).prop_map(|index| ActuatorId::new(index).expect("below 16"))
}

pub(crate) fn mode() -> impl Strategy<Value = Mode> {
    prop_oneof![Just(Mode::Idle), Just(Mode::Position), Just(Mode::Speed)]
}

pub(crate) fn currents() -> impl Strategy<Value = Currents> {
    any::<(i16, i16, i16, u16)>().prop_map(|(i_a_ma, i_b_ma, i_c_ma, seq)| Currents {
        i_a_ma,
        i_b_ma,
        i_c_ma,
        seq,
    })
}

pub(crate) fn position() -> impl Strategy<Value = Position> {
    (any::<i32>(), S24, any::<u8>()).prop_map(|(motor_counts, output_counts, seq8)| Position {
        motor_counts,
        output_counts,
        seq8,
    })
}

pub(crate) fn command() -> impl Strategy<Value = Command> {
    (any::<i32>(), mode(), any::<u16>(), any::<u8>()).prop_map(|(setpoint, mode, time_us, seq8)| Command {
        setpoint,
        mode,
        time_us,
        seq8,
    })
}

pub(crate) fn status() -> impl Strategy<Value = Status> {
    (any::<(u16, i16, u8, u8)>(), proptest::option::of(-i16::MAX..=i16::MAX)).prop_map(
        |((dc_link_dv, winding_temp_dc, fault_flags, seq8), load_torque_dnm)| Status {
            dc_link_dv,
            winding_temp_dc,
            load_torque_dnm,
            fault_flags,
            seq8,
        },
    )
}

pub(crate) fn sample() -> impl Strategy<Value = Sample> {
    (actuator(), any::<(u16, u16, i16, i16, i16, i32, i32)>(), S24, mode()).prop_map(
        |(actuator, (seq, time_us, i_a_ma, i_b_ma, i_c_ma, motor_counts, setpoint), output_counts, mode)| Sample {
            actuator,
            seq,
            time_us,
            i_a_ma,
            i_b_ma,
            i_c_ma,
            motor_counts,
            output_counts,
            setpoint,
            mode,
        },
    )
}

/// One to three consecutive samples of one actuator.
pub(crate) fn run() -> impl Strategy<Value = Vec<Sample>> {
    proptest::collection::vec(sample(), 1..=3).prop_map(|mut samples| {
        let first = samples[0];
        for (k, sample) in samples.iter_mut().enumerate() {
            sample.actuator = first.actuator;
            sample.seq = first.seq.wrapping_add(k as u16);
        }
        samples
    })
}

pub(crate) fn packet() -> impl Strategy<Value = SerialPacket> {
    prop_oneof![
        sample().prop_map(SerialPacket::Sample),
        (actuator(), status()).prop_map(|(actuator, status)| SerialPacket::Status { actuator, status }),
    ]
}

/// Sample k of a run in which every field depends on k, so that a sample with fields of two instants equals none of them.
pub(crate) fn nth_sample(k: u64) -> Sample {
    Sample {
        actuator: ActuatorId::new(5).expect("below 16"),
        seq: k as u16,
        time_us: (k * 500) as u16,
        i_a_ma: (k % 30_011) as i16,
        i_b_ma: -((k % 29_989) as i16),
        i_c_ma: (k % 10_007) as i16,
        motor_counts: (k * 65_537) as i32,
        output_counts: (k % 8_388_593) as i32,
        setpoint: (k * 1_000_003) as i32,
        mode: Mode::Position,
    }
}
