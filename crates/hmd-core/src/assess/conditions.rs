//! Operating conditions of a window, and the prior knowledge of a motor under them.

use ema_models::{Conditions, MotorDeviation, MotorKnowledge, Scale, Tolerances};

use crate::outbox::WindowJob;

/// Prior knowledge of the motor of a unit without a calibration: R and k of its type within their tolerances. A weak magnet looks
/// much like three slightly shorted phases; estimated along, it is not mistaken for them, and what cannot be distinguished widens
/// their sigma.
#[must_use]
pub fn motor_within(tolerances: &Tolerances) -> MotorKnowledge {
    let default = Tolerances::MOTOR_ONLY;
    // The product of the rounded deviations has other last bits than the variance.
    let variance = |own: f64, default: f64, squared: f64| {
        let is_default = own.to_bits() == default.to_bits();
        if is_default { squared } else { own * own }
    };
    MotorKnowledge {
        mean: MotorDeviation::default(),
        covariance: [
            [variance(tolerances.r_s, default.r_s, 0.05 * 0.05 / 3.0), 0.0],
            [0.0, variance(tolerances.k, default.k, 0.03 * 0.03 / 3.0)],
        ],
    }
}

/// What is known of a motor under a temperature that is measured or not.
#[must_use]
pub fn motor_knowledge_at(motor: MotorKnowledge, winding_temp_deg_c: Option<f64>) -> MotorKnowledge {
    match winding_temp_deg_c {
        Some(_) => motor,
        None => motor.at_unknown_temperature(WINDING_TEMP_SIGMA_K),
    }
}

/// Load, supply and temperature as measured; without a measurement the load is left open, the supply is nominal and the
/// temperature widens what is known of the motor ([`motor_knowledge_at`]).
///
/// # Errors
/// A sentence when a measurement is beyond what the actuator can have been working with: then the sensor is bad.
pub fn conditions(job: &WindowJob) -> Result<Conditions, String> {
    let motor = &job.params.motor;
    let v_dc = job.conditions.dc_link_v.unwrap_or(motor.v_dc);
    let [low, high] = DC_LINK_SHARES.map(|share| share * motor.v_dc);
    if !(low..=high).contains(&v_dc) {
        return Err(format!("dc_link: expected {low:.0} to {high:.0} V, found {v_dc:.1} V"));
    }
    let load_torque = job.conditions.load_torque_nm;
    let load_max = LOAD_MAX_SHARE * Scale::new(&job.params).load_unit();
    if let Some(load) = load_torque.filter(|load| load.abs() > load_max) {
        return Err(format!(
            "load_torque: expected at most {load_max:.0} Nm, found {load:.1} Nm"
        ));
    }
    let winding_temp_deg_c = job.conditions.winding_temp_deg_c;
    let [low, high] = WINDING_TEMP_DEG_C;
    if let Some(temperature) = winding_temp_deg_c.filter(|temperature| !(low..=high).contains(temperature)) {
        return Err(format!(
            "winding_temp: expected {low:.0} to {high:.0} °C, found {temperature:.1} °C"
        ));
    }
    Ok(Conditions {
        load_torque,
        v_dc,
        winding_temp_deg_c,
    })
}

/// DC link voltages that a drive works with, as shares of the nominal one.
const DC_LINK_SHARES: [f64; 2] = [0.5, 1.5];

/// Temperatures that a winding can have, °C: from the coldest air to where its insulation fails.
const WINDING_TEMP_DEG_C: [f64; 2] = [-80.0, 250.0];

/// Standard deviation of an unmeasured winding temperature around 20 °C, K: −40 to 120 °C are within two.
const WINDING_TEMP_SIGMA_K: f64 = 45.0;

/// Largest load as a share of what the motor can lift without losses; a lossy gear holds more than the motor can lift.
const LOAD_MAX_SHARE: f64 = 2.0;
