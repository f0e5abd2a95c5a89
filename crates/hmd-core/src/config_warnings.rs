//! What is allowed in a configuration and yet seldom meant, before anything runs.

use crate::assess::Models;
use crate::config::Config;

/// A sentence for each type that is not calibrated, takes values from a built-in type, or is not used; `models` holds the
/// calibrations of the types.
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
    found
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
