//! Simulated windows: the reference model's actuations, cut as recorded ones are, less the last sample (the suites'
//! figures are of 1000 samples at 2 kHz, a recorded window has 1001). For calibration and the suites.

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, Conditions, FaultVector, Profile, SensedSample, Setpoint};

use ema_identify::Prepared;

/// Rest before the trigger that belongs to a window, s.
const PRE_TRIGGER: f64 = 0.02;

/// Length of a window, s.
const DURATION: f64 = 0.5;

/// One simulated window and what the monitor may know of it.
#[derive(Clone, Debug)]
pub struct SimulatedWindow {
    /// The true fault vector.
    pub truth: FaultVector,
    /// The samples as received.
    pub samples: Vec<SensedSample>,
    /// The same, ready for comparison.
    pub prepared: Prepared,
    /// Load, supply voltage and winding temperature.
    pub conditions: Conditions,
}

impl SimulatedWindow {
    /// One actuation of a unit that is its type exactly, without noise.
    #[must_use]
    pub fn new(params: &ActuatorParams, truth: FaultVector, profile: Profile, seed: u64) -> Self {
        Self::first_of(&Scenario {
            actuations: Actuations::single(profile),
            ..Scenario::new(*params, truth, seed)
        })
    }

    /// The first window of a scenario.
    #[must_use]
    pub fn first_of(scenario: &Scenario) -> Self {
        let rate = scenario.nominal.sensors.sample_rate;
        let samples: Vec<SensedSample> = scenario.run().collect();
        let rest = (PRE_TRIGGER * rate).round() as usize;
        let start = trigger(&samples).saturating_sub(rest);
        let end = (start + (DURATION * rate).round() as usize).min(samples.len());
        let samples = samples[start..end].to_vec();
        Self {
            truth: scenario.fault,
            prepared: Prepared::new(&scenario.nominal, &samples, &[], rest, None),
            samples,
            conditions: Conditions {
                load_torque: Some(scenario.load_torque),
                v_dc: scenario.unit.motor.v_dc,
                winding_temp_deg_c: Some(scenario.temperature_deg_c()),
            },
        }
    }
}

/// Index of the first sample whose setpoint has left its resting value by more than 1 mrad, in speed mode 1 rad/s.
fn trigger(samples: &[SensedSample]) -> usize {
    let share = |s: &SensedSample| match s.setpoint {
        Setpoint::Idle => 0.0,
        Setpoint::Position(angle) => angle / 1e-3,
        Setpoint::Speed(speed) => speed,
    };
    samples
        .iter()
        .position(|s| (share(s) - share(&samples[0])).abs() > 1.0)
        .unwrap_or(0)
}
