//! What is allowed in a configuration and yet seldom meant, before anything runs.

use std::collections::BTreeSet;

use crate::assess::Models;
use crate::config::Config;

/// A sentence for each type that is not calibrated, takes values from a built-in type, or is not used, and those of [`bus_warnings`];
/// `models` holds the calibrations of the types.
#[must_use]
pub fn warnings(config: &Config, models: &Models) -> Vec<String> {
    let mut found = Vec::new();
    for (name, of_type) in config.types().filter(|(name, _)| config.is_used(name)) {
        let is_calibrated = models.of_type(name).is_ok_and(|model| model.calibrated);
        let mut units = config.actuators().iter().filter(|actuator| actuator.type_name == name);
        if !is_calibrated && units.any(|unit| unit.calibration.is_none()) {
            found.push(format!(
                "type {name} is not calibrated: its windows are degraded; make a calibration with hmd calibrate --type --actuator \
                 {name}"
            ));
        }
        let inherited = of_type.inherited(name);
        if !inherited.is_empty() {
            found.push(format!(
                "type {name} takes {} values from the built-in type {}: {}",
                inherited.len(),
                of_type.built_in(),
                inherited.join(", ")
            ));
        }
    }
    found.extend(
        config
            .unused_types()
            .map(|name| format!("type {name}: no actuator uses it")),
    );
    found.extend(bus_warnings(config));
    found
}

/// A sentence for each bus that no `[[serial]]` has and that is not called like a CAN interface: a serial line may have been meant.
#[must_use]
pub fn bus_warnings(config: &Config) -> Vec<String> {
    let buses: BTreeSet<&str> = config
        .actuators()
        .iter()
        .filter_map(|actuator| actuator.bus.as_deref())
        .collect();
    buses
        .into_iter()
        .filter(|bus| config.serial(bus).is_none() && !bus.to_lowercase().contains("can"))
        .map(|bus| format!("bus {bus}: no [[serial]] has it, so a CAN interface of this name is sought"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Vec<String> {
        let config = Config::from_toml_str(text, "hmd.toml").unwrap();
        let models = Models::without_files(&config).unwrap();
        warnings(&config, &models)
    }

    #[test]
    fn a_built_in_type_at_another_rate_or_with_other_tolerances_warns_of_nothing() {
        for text in [
            "",
            "[type.bench]\ntolerances = \"exact\"\nsensors = { sample_rate_hz = 400 }",
            "[type.own]\nbased_on = \"servo28\"\n[[actuator]]\nid = 1\ntype = \"servo28\"",
        ] {
            let found = of(text);
            assert!(
                found.iter().all(|line| line == "type own: no actuator uses it"),
                "{text}: {found:?}"
            );
            assert_eq!(found.len(), usize::from(text.contains("own")), "{text}");
        }
    }

    #[test]
    fn a_bus_that_is_no_serial_line_and_not_called_can_is_told() {
        let on = |bus: &str| format!("[[actuator]]\nid = 0\nbus = \"{bus}\"\n");
        let told = "bus uart1: no [[serial]] has it, so a CAN interface of this name is sought";
        assert_eq!(of(&on("uart1")), [told]);
        let line = "[[serial]]\nbus = \"uart1\"\ndevice = \"ttyS0\"\n";
        for silent in [on("can0"), on("vcan0"), on("uart1") + line] {
            assert!(of(&silent).is_empty(), "{silent}");
        }
    }

    #[test]
    fn another_name_for_a_built_in_type_is_calibrated_and_names_what_it_inherits() {
        let text = "[type.own]\nbased_on = \"servo28\"\nsensors = { sample_rate_hz = 400 }\n[[actuator]]\nid = 1\ntype = \"own\"";
        let found = of(text);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].starts_with("type own takes 25 values from the built-in type servo28"),
            "{found:?}"
        );
    }

    #[test]
    fn a_type_with_a_value_of_its_own_is_not_calibrated_and_names_what_it_inherits() {
        let found = of(
            "[type.own]\nbased_on = \"bench\"\nmotor = { inertia_kg_m2 = 1.1e-3 }\n[[actuator]]\nid = 0\ntype = \"own\"",
        );
        let [uncalibrated, inherited] = &found[..] else {
            panic!("{found:?}")
        };
        assert!(uncalibrated.starts_with("type own is not calibrated"), "{uncalibrated}");
        assert!(
            inherited.starts_with("type own takes 25 values from the built-in type bench: motor.pole_pairs, "),
            "{inherited}"
        );
        assert!(!inherited.contains("inertia"), "{inherited}");
    }
}
