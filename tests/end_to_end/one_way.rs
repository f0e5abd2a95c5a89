//! Motion in one direction shows friction and load together: the reading of the load alone parts them.

use std::sync::Arc;

use ema_models::reference::{Actuations, Drive, Effects, Scenario};
use ema_models::{FaultVector, Profile};
use hmd_core::assess::{Assessor, Models};
use hmd_core::config::Config;

use crate::new_unit::new_units::window_of;

/// Status, faults and reason of a ramp of a healthy `bench` under a load whose sensor reads `read_nm`.
fn ramp(load_nm: f64, read_nm: f64) -> [String; 3] {
    let config = Arc::new(
        Config::from_toml_str(
            "[[actuator]]\nid = 0\ntype = \"bench\"\n[type.bench.drive]\nkind = \"vector\"\n",
            "one_way",
        )
        .expect("a configuration"),
    );
    let scenario = Scenario {
        load_torque: load_nm,
        effects: Effects {
            drive: Drive::of_type(&config.actuators()[0].drive),
            ..Effects::default()
        },
        actuations: Actuations::single(Profile::Ramp),
        ..Scenario::new(config.actuators()[0].params, FaultVector::NOMINAL, 7)
    };
    let mut job = window_of(&config, &scenario).expect("a bus").expect("a window");
    job.conditions.load_torque_nm = Some(read_nm);
    let models = Models::load_types(&config, &|_| Err(std::io::ErrorKind::Unsupported.into())).expect("models");
    let assessed = Assessor::new(config, models, 1).assess(job).expect("an assessment");
    let health = assessed.health;
    [health.status, health.faults, health.reason]
}

#[test]
fn a_wrong_load_is_no_friction() {
    let [status, faults, reason] = ramp(-6.0, 0.0);
    assert_eq!((status.as_str(), faults.as_str()), ("degraded", ""), "{reason}");
    assert!(
        reason.contains("friction 0.") && reason.contains("by the reading of the load alone, 0.0 N m"),
        "{reason}"
    );
    assert!(!reason.contains("load sensor"), "{reason}");
    let [status, faults, reason] = ramp(-6.0, -6.0);
    assert!(status != "invalid" && faults.is_empty(), "{reason}");
}
