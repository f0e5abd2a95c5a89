//! A device that wears: the fault vector of each actuation and its effect on the currents.

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::{ActuatorId, SerialPacket};
use firmware_sim::Plan;

fn plan() -> Plan {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let scenario = Scenario {
        actuations: Actuations {
            profile: Profile::Ramp,
            count: 2,
            rest: 0.1,
            length: 0.4,
        },
        ..Scenario::new(params, FaultVector::NOMINAL, 5)
    };
    Plan::new(ActuatorId::new(0).expect("0 to 15"), scenario)
}

/// rms of the currents during each of the two motions, mA.
fn rms_currents(plan: &Plan) -> [f64; 2] {
    let samples: Vec<f64> = plan
        .start()
        .filter_map(|timed| match timed.value {
            SerialPacket::Sample(sample) => Some(sum_of_squares([sample.i_a_ma, sample.i_b_ma, sample.i_c_ma])),
            SerialPacket::Status { .. } => None,
        })
        .collect();
    // A rest of 40 samples and a motion of 160, twice. The wear increases at the end of a motion.
    [&samples[40..200], &samples[240..400]].map(|motion| (motion.iter().sum::<f64>() / motion.len() as f64).sqrt())
}

fn sum_of_squares(currents: [i16; 3]) -> f64 {
    currents.map(|i| f64::from(i).powi(2)).iter().sum()
}

#[test]
fn damage_grows_with_each_actuation_within_its_bounds() {
    let mut plan = plan();
    plan.growth = [0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.2];
    let faults: Vec<FaultVector> = [0, 1, 4].map(|n| plan.fault_during(n)).to_vec();
    assert_eq!(faults[0], FaultVector::NOMINAL);
    let expected = FaultVector {
        friction: 0.3,
        gain: 0.3,
        ..FaultVector::NOMINAL
    };
    assert_eq!(faults[1], expected);
    let expected = FaultVector {
        friction: 1.0,
        gain: 0.0,
        ..FaultVector::NOMINAL
    };
    assert_eq!(faults[2], expected);
}

#[test]
fn wear_changes_the_second_actuation_and_not_the_first() {
    let healthy = rms_currents(&plan());
    let mut worn = plan();
    worn.growth[0] = 0.9;
    let worn = rms_currents(&worn);
    assert!((worn[0] - healthy[0]).abs() < 1e-9, "{worn:?} {healthy:?}");
    // Nearly three times the friction changes the rms current.
    assert!((worn[1] / healthy[1] - 1.0).abs() > 0.1, "{worn:?} {healthy:?}");
}
