//! One window of a worn actuator as its controller records it, and the host's view of the same window.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Identifier, Method};
use ema_models::reference::{CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, MotorKnowledge, Signals};
use ema_wire::{ActuatorId, Sample, SerialPacket};
use firmware_image::Identification;
use hmd_lab::simulated::SimulatedWindow;

/// The window: 20 ms before the trigger and 480 ms after, at 2 kHz.
const SAMPLES: usize = 1000;
pub(crate) const REST: usize = 40;

/// The same window for both.
pub(crate) struct Case {
    /// The truth.
    pub(crate) worn: FaultVector,
    /// Single precision, one thread.
    pub(crate) identification: Identification,
    /// Its window.
    pub(crate) samples: Vec<Sample>,
    /// The host's, searching the same way.
    pub(crate) identifier: Identifier,
    /// Its window.
    pub(crate) simulated: SimulatedWindow,
}

impl Case {
    /// The actuator of README's logs.
    pub(crate) fn new() -> Option<Self> {
        let params = ActuatorParams::bench();
        let worn = FaultVector {
            friction: 0.4,
            backlash: 0.1,
            short_b: 0.15,
            ..FaultVector::NOMINAL
        };
        let scenario = Scenario {
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: 0.03,
            },
            ..Scenario::new(params, worn, 7)
        };
        let calibration = TypeCalibration::built_in("bench", MonitorForm::ThreePhase)?;
        let identifier = Identifier {
            params,
            calibration: calibration.clone(),
            method: Method::LeastSquares,
            motor: MotorKnowledge::default(),
        };
        let simulated = SimulatedWindow::of(&scenario);
        let coefficients = calibration.coefficients();
        let comparison = identifier.comparison(&simulated.prepared, &coefficients, simulated.conditions);
        let identification = Identification {
            params,
            calibration: coefficients,
            conditions: simulated.conditions,
            weights: comparison.weights,
            expected: Signals::from(calibration.at(params.sensors.sample_rate).residual_rms),
            prior: comparison.prior,
        };
        Some(Self {
            worn,
            identification,
            samples: recorded(&scenario)?,
            identifier,
            simulated,
        })
    }
}

/// The first window of a scenario as the words that the actuator sends.
fn recorded(scenario: &Scenario) -> Option<Vec<Sample>> {
    let sent: Vec<Sample> = firmware_sim::packets(scenario, ActuatorId::new(0)?)
        .filter_map(|packet| match packet {
            SerialPacket::Sample(sample) => Some(sample),
            SerialPacket::Status { .. } => None,
        })
        .collect();
    let rest = sent.first()?.setpoint;
    let trigger = sent.iter().position(|sample| (sample.setpoint - rest).abs() > 1000)?;
    let first = trigger.checked_sub(REST)?;
    Some(sent.get(first..first + SAMPLES)?.to_vec())
}
