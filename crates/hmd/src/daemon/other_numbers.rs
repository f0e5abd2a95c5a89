//! A hint for an actuator of which nothing comes, while another number talks on its bus: most likely one of both is mistyped.

use std::collections::BTreeMap;

use ema_wire::ActuatorId;
use hmd_core::config::Config;
use hmd_core::frame::BusNames;

/// Most numbers that a hint names.
const NAMED_MAX: usize = 3;

/// Actuators of the built-in dictionary, and numbers that talk without being watched. Bounded by what is configured, and by sixteen numbers
/// on each bus.
#[derive(Debug)]
pub(super) struct OtherNumbers {
    /// Those of which no hint was given yet.
    untold: Vec<Watched>,
    /// A bit for each number, by bus.
    heard: BTreeMap<u16, u16>,
}

#[derive(Debug)]
struct Watched {
    name: String,
    bus: u16,
    bus_name: String,
    number: ActuatorId,
}

impl OtherNumbers {
    pub(super) fn new(config: Option<&Config>, names: &BusNames) -> Self {
        let actuators = config.iter().flat_map(|config| config.actuators());
        // The frames of a DBC file and of drives have no such numbers.
        let of_dictionary = actuators.filter(|actuator| actuator.map.is_none() && actuator.drive_bus.is_none());
        let untold = of_dictionary.filter_map(|actuator| {
            let bus_name = actuator.bus.clone()?;
            Some(Watched {
                name: actuator.name.clone(),
                bus: names.index_of(&bus_name)?,
                bus_name,
                number: actuator.id,
            })
        });
        Self {
            untold: untold.collect(),
            heard: BTreeMap::new(),
        }
    }

    /// Takes a number that talks on a bus and is not watched there.
    pub(super) fn hear(&mut self, bus: u16, number: ActuatorId) {
        *self.heard.entry(bus).or_default() |= 1 << number.index();
    }

    /// Sentences about the actuators of which nothing came since the start, where others are heard; one for each actuator.
    pub(super) fn hints(&mut self, is_silent: impl Fn(&str) -> bool) -> Vec<String> {
        let mut hints = Vec::new();
        let heard = &self.heard;
        self.untold.retain(|watched| {
            let Some(&bits) = heard.get(&watched.bus).filter(|_| is_silent(&watched.name)) else {
                return true;
            };
            let others: Vec<String> = ActuatorId::all()
                .map(ActuatorId::index)
                .filter(|number| bits & 1 << number != 0)
                .map(|number| number.to_string())
                .collect();
            let further = if others.len() > NAMED_MAX { " and others" } else { "" };
            hints.push(format!(
                "{}: nothing comes of id {} on {}, but of id {}{further}, which is not watched: check the id",
                watched.name,
                watched.number.index(),
                watched.bus_name,
                others[..others.len().min(NAMED_MAX)].join(", ")
            ));
            false
        });
        hints
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_actuator_is_told_once_which_other_number_talks_on_its_bus() {
        let text = "[[actuator]]\nid = 3\nname = \"left\"\nbus = \"can0\"\n[[actuator]]\nid = 4\nname = \"right\"\nbus = \"can1\"\n\
                    [type.bench.sensors]\nsample_rate_hz = 400\n";
        let config = Config::from_toml_str(text, "hmd.toml").unwrap();
        let mut names = BusNames::new();
        let [can0, can1] = ["can0", "can1"].map(|name| names.intern(name).unwrap());
        let number = |n| ActuatorId::new(n).unwrap();
        let mut others = OtherNumbers::new(Some(&config), &names);
        assert!(others.hints(|_| true).is_empty(), "nobody talks");
        others.hear(can0, number(5));
        assert!(others.hints(|name| name == "right").is_empty(), "another bus");
        assert_eq!(
            others.hints(|_| true),
            ["left: nothing comes of id 3 on can0, but of id 5, which is not watched: check the id"]
        );
        for n in [1, 15, 9, 2] {
            others.hear(can1, number(n));
        }
        assert_eq!(
            others.hints(|_| true),
            ["right: nothing comes of id 4 on can1, but of id 1, 2, 9 and others, which is not watched: check the id"]
        );
        assert!(others.hints(|_| true).is_empty(), "told once");
    }
}
