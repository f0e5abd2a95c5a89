//! Every deviation arrives in the samples, in the plain model and in the one with effects.

use super::rig::effects;
use ema_models::reference::{EFFECTS, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample};

/// Relative deviation that is tried; a gear efficiency above 1 would be limited.
const DEVIATION: f64 = -0.08;

/// The parameter of a deviation: of the unit's hardware, or of the controller, which has those of the type.
fn parameter<'a>(scenario: &'a mut Scenario, name: &str) -> &'a mut f64 {
    let (motor, transmission) = (&mut scenario.unit.motor, &mut scenario.unit.transmission);
    let controller = &mut scenario.nominal.controller;
    match name {
        "back_emf_deviation" => &mut motor.k,
        "resistance_deviation" => &mut motor.r_s,
        "inductance_deviation" => &mut motor.l_s,
        "inertia_deviation" => &mut motor.j,
        "viscous_deviation" => &mut motor.c,
        "dynamic_friction_deviation" => &mut transmission.friction_dynamic,
        "static_friction_deviation" => &mut transmission.friction_static,
        "play_deviation" => &mut transmission.backlash,
        "opposing_efficiency_deviation" => &mut transmission.efficiency_opposing,
        "aiding_efficiency_deviation" => &mut transmission.efficiency_aiding,
        "link_voltage_deviation" => &mut motor.v_dc,
        "current_limit_deviation" => &mut scenario.nominal.motor.i_max,
        "position_gain_deviation" => &mut controller.g_p,
        "speed_gain_deviation" => &mut controller.k_p,
        "integral_gain_deviation" => &mut controller.k_i,
        "speed_limit_deviation" => &mut controller.omega_max,
        unknown => panic!("no parameter of {unknown}"),
    }
}

#[test]
fn each_deviation_arrives_in_the_samples_of_both_models() {
    let names = EFFECTS.iter().map(|info| info.name);
    let names: Vec<&str> = names.filter(|name| name.ends_with("_deviation")).collect();
    assert_eq!(names.len(), 16);
    // Out and back under a load, so that current and speed reach their limits and both gear efficiencies count.
    let mut plain = Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 4);
    plain.load_torque = 30.0;
    plain.actuations.profile = Profile::Step;
    plain.actuations.count = 2;
    plain.actuations.length = 0.25;
    for others in [
        &[][..],
        &[("cogging_nm", 0.05)],
        &[("pwm_frequency_hz", 20e3), ("compliance_hz", 200.0)],
    ] {
        let samples = |scenario: &Scenario| scenario.run().collect::<Vec<SensedSample>>();
        plain.effects = effects(others);
        let without = samples(&plain);
        for name in &names {
            let mut scenario = plain.clone();
            scenario.effects.set(name, DEVIATION).unwrap();
            assert_eq!(scenario.effects.only_change_parameters(), others.is_empty());
            let with_deviation = samples(&scenario);
            assert!(with_deviation != without, "{name} changes no sample beside {others:?}");
            scenario.effects = plain.effects;
            *parameter(&mut scenario, name) *= 1.0 + DEVIATION;
            assert!(with_deviation == samples(&scenario), "{name} beside {others:?}");
        }
    }
}
