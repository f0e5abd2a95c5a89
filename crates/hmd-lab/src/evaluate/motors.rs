//! Motors as they leave the factory and are installed: off their type, behind real sensors, under a load that nobody
//! measures, and known from five healthy windows.

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{
    ActuatorParams, FaultVector, MotorDeviation, MotorKnowledge, Profile, REFERENCE_TEMPERATURE_DEG_C, Scale,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::simulated::SimulatedWindow;
use ema_identify::Identifier;
use ema_identify::unit_fit::fit_motor;
use hmd_core::seed::mix;

/// Current noise of each phase, A rms, beside the converters of the type.
pub(super) const NOISE_RMS_A: f64 = 0.05;

/// Largest deviation of a motor's resistance and back-EMF from its type's.
const TOLERANCE: MotorDeviation = MotorDeviation {
    resistance: 0.05,
    back_emf: 0.03,
};

/// Largest load at the output of `bench`, Nm; on another type the same share of what its motor can lift.
const LOAD_NM: f64 = 10.0;

/// Healthy windows from which a motor is learnt.
const HEALTHY_WINDOWS: u64 = 5;

/// What a window is taken under, beside noise and load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surroundings {
    /// What is commanded.
    pub(super) profile: Profile,
    /// Winding temperature, °C.
    pub(super) winding_temp_deg_c: f64,
    /// Whether the monitor is told the temperature.
    pub(super) temperature_measured: bool,
    /// DC link voltage as a share of the nominal one; always measured.
    pub(super) supply: f64,
}

impl Surroundings {
    /// Those of the suites `noise` and `detection`.
    pub(super) const USUAL: Self = Self {
        profile: Profile::Mixed,
        winding_temp_deg_c: REFERENCE_TEMPERATURE_DEG_C,
        temperature_measured: true,
        supply: 1.0,
    };
}

/// One motor of a type, sampled at one rate.
pub(super) struct Motor {
    /// The type as the monitor knows it.
    pub(super) nominal: ActuatorParams,
    unit: ActuatorParams,
    load_nm: f64,
    seed: u64,
}

impl Motor {
    /// Draws a motor.
    pub(super) fn draw(params: &ActuatorParams, sample_rate: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[0]));
        let mut nominal = *params;
        nominal.sensors.sample_rate = sample_rate;
        let mut unit = nominal;
        unit.motor.r_s *= 1.0 + rng.random_range(-TOLERANCE.resistance..TOLERANCE.resistance);
        unit.motor.k *= 1.0 + rng.random_range(-TOLERANCE.back_emf..TOLERANCE.back_emf);
        Self {
            nominal,
            unit,
            load_nm: LOAD_NM * Scale::new(params).load() / Scale::new(&ActuatorParams::bench()).load(),
            seed,
        }
    }

    /// One mixed actuation of it in some state of wear, under a constant load that is not measured.
    pub(super) fn window(&self, fault: FaultVector, seed: u64) -> SimulatedWindow {
        self.actuation(&Surroundings::USUAL, fault, seed)
    }

    /// The same under other circumstances.
    pub(super) fn actuation(&self, around: &Surroundings, fault: FaultVector, seed: u64) -> SimulatedWindow {
        let load = ChaCha8Rng::seed_from_u64(mix(seed, &[1])).random_range(-self.load_nm..self.load_nm);
        let mut unit = self.unit;
        unit.motor.v_dc *= around.supply;
        let mut window = SimulatedWindow::of(&Scenario {
            unit,
            load_torque: load,
            winding_temp_deg_c: around.winding_temp_deg_c,
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: NOISE_RMS_A,
            },
            actuations: Actuations::one(around.profile),
            ..Scenario::new(self.nominal, fault, seed)
        });
        window.conditions.load_torque = None;
        if !around.temperature_measured {
            window.conditions.winding_temp_deg_c = None;
        }
        window
    }

    /// The type's identifier with what healthy windows tell of this motor.
    pub(super) fn calibrated(&self, of_type: &Identifier) -> Identifier {
        let identifier = Identifier {
            params: self.nominal,
            motor: MotorKnowledge {
                mean: MotorDeviation::default(),
                covariance: [
                    [TOLERANCE.resistance.powi(2) / 3.0, 0.0],
                    [0.0, TOLERANCE.back_emf.powi(2) / 3.0],
                ],
            },
            ..of_type.clone()
        };
        let windows: Vec<SimulatedWindow> = (0..HEALTHY_WINDOWS)
            .map(|n| self.window(FaultVector::NOMINAL, mix(self.seed, &[2, n])))
            .collect();
        let coefficients = identifier.calibration.coefficients();
        let compared: Vec<_> = windows
            .iter()
            .map(|w| identifier.comparison(&w.prepared, &coefficients, w.conditions))
            .collect();
        let motor = fit_motor(&compared).map_or(identifier.motor, |fit| fit.motor);
        drop(compared);
        Identifier { motor, ..identifier }
    }
}
