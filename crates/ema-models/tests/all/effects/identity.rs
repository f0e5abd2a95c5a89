//! With every effect off, a scenario's samples keep the bits they had before there were effects.
//!
//! The hashes are those of the reference model of commit de39b47, which knew no effects.

use ema_models::reference::{Effects, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample, Setpoint};

/// FNV-1a over all bits of all samples.
fn hash(samples: impl Iterator<Item = SensedSample>) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut take = |word: u64| {
        for byte in word.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for sample in samples {
        take(sample.seq);
        for current in sample.currents {
            take(current.to_bits());
        }
        take(sample.motor_counts as u64);
        take(sample.output_counts as u64);
        let (mode, value) = match sample.setpoint {
            Setpoint::Idle => (0, 0.0),
            Setpoint::Position(angle) => (1, angle),
            Setpoint::Speed(speed) => (2, speed),
        };
        take(mode);
        take(f64::to_bits(value));
    }
    hash
}

#[test]
fn without_effects_every_sample_keeps_its_bits() {
    let worn = FaultVector::from_array([0.3, 0.2, 0.2, 0.0, 0.1, 0.3, 0.7, 0.6]);
    let cases = [
        (
            "bench",
            ActuatorParams::bench(),
            Profile::Mixed,
            0x4cfc_0b0c_0c22_bc7d_u64,
        ),
        ("bench", ActuatorParams::bench(), Profile::Speed, 0x58bb_3d0a_7e70_be42),
        (
            "servo28",
            ActuatorParams::servo28(),
            Profile::Mixed,
            0x272f_5df4_6424_e770_u64,
        ),
        (
            "servo28",
            ActuatorParams::servo28(),
            Profile::Speed,
            0xc292_bddd_587a_5fc5,
        ),
    ];
    let found = cases.map(|(name, params, profile, expected)| {
        let mut scenario = Scenario::new(params, worn, 5);
        scenario.actuations.profile = profile;
        scenario.sensing.noise_rms = 0.03;
        scenario.sensing.quantised = true;
        assert!(scenario.effects == Effects::default() && scenario.effects.are_off());
        (name, profile, expected, hash(scenario.run()))
    });
    for (name, profile, expected, found) in found {
        assert_eq!(found, expected, "{name} {profile:?}: 0x{found:016x}");
    }
}
