//! Simulated units with a vector drive, far from their data sheet, and what the relations between their measured signals say.
#![allow(dead_code, reason = "not every user of this file needs all of it")]

use ema_identify::relations::{BalanceShape, CommissionedRelations, MeasuredWindow, RelationsEstimate, commission};
use ema_models::reference::{CurrentSensing, Effects, Scenario};
use ema_models::{ActuatorParams, FaultVector, SensedSample, Setpoint};
use rayon::prelude::*;

/// A unit: its type and what it has besides.
pub(crate) struct Unit {
    pub(crate) name: &'static str,
    pub(crate) actuator: &'static str,
    pub(crate) effects: &'static [(&'static str, f64)],
}

/// Healthy windows from which a unit is learnt, and other healthy ones.
pub(crate) const COMMISSIONING: u64 = 12;
pub(crate) const HEALTHY: u64 = 12;

/// Current noise, A rms, ahead of a 12-bit converter.
const NOISE_RMS_A: f64 = 0.03;

/// Parameter and value of the faulty windows.
pub(crate) const FAULTS: [(usize, f64); 12] = [
    (2, 0.15),
    (3, 0.15),
    (4, 0.15),
    (2, 0.3),
    (5, 0.3),
    (5, 0.2),
    (0, 0.15),
    (0, 0.3),
    (1, 0.2),
    (1, 0.4),
    (7, 0.7),
    (7, 0.3),
];

/// A vector drive; the same on a unit whose parameters are off; the first with wrong sensors, a slow controller and cogging; a
/// small servo with some of each.
pub(crate) const UNITS: [Unit; 4] = [
    Unit {
        name: "vector drive",
        actuator: "bench",
        effects: &[("pwm_frequency_hz", 20e3), ("dead_time_s", 1.5e-6)],
    },
    Unit {
        name: "parameters off",
        actuator: "bench",
        effects: &[
            ("pwm_frequency_hz", 20e3),
            ("dead_time_s", 2e-6),
            ("dead_time_compensation", 0.8),
            ("resistance_deviation", 0.08),
            ("inductance_deviation", -0.1),
            ("inertia_deviation", 0.08),
            ("dynamic_friction_deviation", 0.1),
            ("static_friction_deviation", 0.1),
            ("viscous_deviation", 0.5),
            ("stribeck_nm", 0.08),
            ("saturation", 0.2),
            ("emf_5", 0.02),
            ("emf_7", 0.01),
        ],
    },
    Unit {
        name: "sensors, controller, cogging",
        actuator: "bench",
        effects: &[
            ("pwm_frequency_hz", 20e3),
            ("dead_time_s", 1.5e-6),
            ("resolver_error_1_rad", 0.0058),
            ("resolver_phase_1_rad", 0.7),
            ("resolver_error_2_rad", 0.0058),
            ("resolver_phase_2_rad", -1.9),
            ("current_offset_a_a", 0.05),
            ("current_offset_b_a", -0.05),
            ("current_offset_c_a", 0.02),
            ("current_gain_a", 0.01),
            ("current_gain_b", -0.01),
            ("current_gain_c", 0.005),
            ("current_latency_s", 5e-5),
            ("speed_filter_hz", 600.0),
            ("control_delay_periods", 1.0),
            ("cogging_nm", 0.144),
            ("cogging_phase_rad", 0.4),
        ],
    },
    Unit {
        name: "small servo",
        actuator: "servo28",
        effects: &[
            ("pwm_frequency_hz", 20e3),
            ("dead_time_s", 1e-6),
            ("dynamic_friction_deviation", 0.2),
            ("static_friction_deviation", 0.2),
            ("stribeck_nm", 0.005),
            ("cogging_nm", 0.005),
            ("cogging_phase_rad", 0.4),
            ("resolver_error_1_rad", 0.0061),
            ("resolver_phase_1_rad", 0.7),
            ("current_offset_a_a", 0.02),
            ("current_offset_b_a", -0.02),
        ],
    },
];

impl Unit {
    pub(crate) fn params(&self) -> ActuatorParams {
        match self.actuator {
            "servo28" => ActuatorParams::servo28(),
            _ => ActuatorParams::bench(),
        }
    }

    /// One actuation of this unit; each seed starts at another rotor angle.
    pub(crate) fn scenario(&self, fault: FaultVector, seed: u64) -> Scenario {
        let mut effects = Effects::default();
        for &(name, value) in self.effects {
            effects.set(name, value).expect("a value within its limits");
        }
        Scenario {
            effects,
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: NOISE_RMS_A,
            },
            ..Scenario::new(self.params(), fault, seed)
        }
    }

    /// The scenarios of a kind of window.
    pub(crate) fn commissioning(&self) -> Vec<Scenario> {
        (0..COMMISSIONING)
            .map(|seed| self.scenario(FaultVector::NOMINAL, 1 + seed))
            .collect()
    }

    pub(crate) fn healthy(&self) -> Vec<Scenario> {
        (0..HEALTHY)
            .map(|seed| self.scenario(FaultVector::NOMINAL, 101 + seed))
            .collect()
    }

    pub(crate) fn faulty(&self) -> Vec<Scenario> {
        let scenario = |(seed, &(parameter, value)): (u64, &(usize, f64))| {
            let mut k = FaultVector::NOMINAL.to_array();
            k[parameter] = value;
            if parameter == 5 {
                k[6] = 0.7;
            }
            self.scenario(FaultVector::from_array(k), 201 + seed)
        };
        (0..).zip(&FAULTS).map(scenario).collect()
    }

    /// Learns the unit from its commissioning windows.
    pub(crate) fn learnt(&self) -> CommissionedRelations {
        let params = self.params();
        let recordings = simulated(&self.commissioning());
        let windows: Vec<_> = recordings
            .iter()
            .map(|samples| MeasuredWindow::new(&params, samples, &[]))
            .collect();
        commission(&windows, &BalanceShape::usual(&params)).expect("a unit from healthy windows")
    }

    /// Estimates of some windows.
    pub(crate) fn estimates(&self, learnt: &CommissionedRelations, scenarios: &[Scenario]) -> Vec<RelationsEstimate> {
        let params = self.params();
        simulated(scenarios)
            .iter()
            .map(|samples| learnt.estimate(&MeasuredWindow::new(&params, samples, &[])))
            .collect()
    }
}

/// The windows of scenarios with one actuation each, 20 ms before the trigger and 480 ms after.
pub(crate) fn simulated(scenarios: &[Scenario]) -> Vec<Vec<SensedSample>> {
    scenarios.par_iter().map(window).collect()
}

fn window(scenario: &Scenario) -> Vec<SensedSample> {
    let samples: Vec<SensedSample> = scenario.run().collect();
    let commanded = |sample: &SensedSample| match sample.setpoint {
        Setpoint::Position(angle) => angle,
        Setpoint::Idle | Setpoint::Speed(_) => 0.0,
    };
    let rest = commanded(&samples[0]);
    let trigger = samples
        .iter()
        .position(|sample| (commanded(sample) - rest).abs() > 1e-3)
        .expect("an actuation");
    let rate = scenario.nominal.sensors.sample_rate;
    let start = trigger - (0.02 * rate) as usize;
    samples[start..start + (0.5 * rate) as usize].to_vec()
}
