//! Actuators whose changes raise no alarm, and their buses.

use std::collections::BTreeSet;

use hmd_core::config::Config;

/// Names of what is passive in a configuration.
#[derive(Default)]
pub(super) struct PassiveNames {
    pub(super) actuators: BTreeSet<String>,
    /// Buses on which all actuators are such.
    pub(super) buses: BTreeSet<String>,
}

impl PassiveNames {
    pub(super) fn of(config: &Config) -> Self {
        let passive = config.actuators().iter().filter(|actuator| actuator.passive);
        Self {
            actuators: passive.map(|actuator| actuator.name.clone()).collect(),
            buses: passive_buses(config),
        }
    }
}

/// Names of the buses of a configuration on which all actuators are passive.
fn passive_buses(config: &Config) -> BTreeSet<String> {
    let buses = |is_passive: bool| -> BTreeSet<String> {
        let of = config
            .actuators()
            .iter()
            .filter(|actuator| actuator.passive == is_passive);
        of.filter_map(|actuator| actuator.bus.clone()).collect()
    };
    &buses(true) - &buses(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_is_passive_if_all_its_actuators_are() {
        let text = [("u", true), ("v", true), ("v", false), ("w", false), ("u", true)];
        let text: String = (0..)
            .zip(text)
            .map(|(id, (bus, passive))| format!("[[actuator]]\nid = {id}\nbus = \"{bus}\"\npassive = {passive}\n"))
            .collect();
        let text = format!("[type.bench.sensors]\nsample_rate_hz = 400\n{text}");
        let config = Config::from_toml_str(&text, "hmd.toml").expect("a good configuration");
        assert!(passive_buses(&config).into_iter().eq(["u"]));
    }
}
