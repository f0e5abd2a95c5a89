//! A hint for an actuator of which nothing comes, while another number talks on its bus: most likely one of both is mistyped.

use std::collections::BTreeSet;

use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::frame::BusNames;
use hmd_core::talker::Talker;

/// Most numbers that a hint names.
const NAMED_MAX: usize = 3;

/// Actuators that are watched, and who else talks. Bounded by what is configured, and by the numbers that there are on each bus.
#[derive(Debug)]
pub(super) struct OtherNumbers {
    /// Those of which no hint was given yet.
    untold: Vec<Watched>,
    watched: BTreeSet<(u16, Talker)>,
    heard: BTreeSet<(u16, Talker)>,
}

#[derive(Debug)]
struct Watched {
    name: String,
    bus: u16,
    bus_name: String,
    itself: Talker,
}

impl OtherNumbers {
    pub(super) fn new(config: Option<&Config>, names: &BusNames) -> Self {
        let actuators = config.iter().flat_map(|config| config.actuators());
        let untold = actuators.filter_map(|actuator| {
            let bus_name = actuator.bus.clone()?;
            Some(Watched {
                name: actuator.name.clone(),
                bus: names.index_of(&bus_name)?,
                bus_name,
                itself: talker(actuator)?,
            })
        });
        let untold: Vec<Watched> = untold.collect();
        Self {
            watched: untold.iter().map(|of| (of.bus, of.itself)).collect(),
            untold,
            heard: BTreeSet::new(),
        }
    }

    /// Takes somebody who talks on a bus and of whom nothing is used.
    pub(super) fn hear(&mut self, bus: u16, talker: Talker) {
        self.heard.insert((bus, talker));
    }

    /// Sentences about the actuators of which nothing came since the start, where others are heard; one for each actuator.
    pub(super) fn hints(&mut self, is_silent: impl Fn(&str) -> bool) -> Vec<String> {
        let (mut hints, heard, known) = (Vec::new(), &self.heard, &self.watched);
        self.untold.retain(|watched| {
            let (bus, itself) = (watched.bus, watched.itself);
            // Not everything that an actuator sends is used.
            let others = heard.difference(known);
            let others = others.filter(|(on, other)| *on == bus && other.is_like(itself));
            let others: Vec<String> = others.map(|(_, other)| other.number().to_string()).collect();
            if others.is_empty() || heard.contains(&(bus, itself)) || !is_silent(&watched.name) {
                return true;
            }
            let further = if others.len() > NAMED_MAX { " and others" } else { "" };
            hints.push(format!(
                "{}: nothing comes of {itself} on {}, but of {}{further}, not watched: is the number right?",
                watched.name,
                watched.bus_name,
                others[..others.len().min(NAMED_MAX)].join(", ")
            ));
            false
        });
        hints
    }
}

/// Under which number an actuator talks; that of a DBC file has none.
fn talker(actuator: &ActuatorConfig) -> Option<Talker> {
    match (&actuator.drive_bus, &actuator.map) {
        (Some(drive), _) => Some(Talker::Node(drive.settings().preset, drive.settings().node)),
        (None, Some(_)) => None,
        (None, None) => Some(Talker::Actuator(actuator.id)),
    }
}

#[cfg(test)]
mod tests {
    use ema_wire::ActuatorId;
    use hmd_core::drive_bus::Preset;

    use super::*;

    #[test]
    fn a_silent_actuator_is_told_once_which_other_number_talks_on_its_bus() {
        let text = "[[actuator]]\nid = 3\nname = \"left\"\nbus = \"can0\"\n[[actuator]]\nid = 4\nname = \"right\"\nbus = \"can1\"\n\
                    [type.bench.sensors]\nsample_rate_hz = 400\n";
        let config = Config::from_toml_str(text, "hmd.toml").unwrap();
        let mut names = BusNames::new();
        let [can0, can1] = ["can0", "can1"].map(|name| names.intern(name).unwrap());
        let number = |n| Talker::Actuator(ActuatorId::new(n).unwrap());
        let mut others = OtherNumbers::new(Some(&config), &names);
        assert!(others.hints(|_| true).is_empty(), "nobody talks");
        others.hear(can0, number(5));
        assert!(others.hints(|name| name == "right").is_empty(), "another bus");
        assert_eq!(
            others.hints(|_| true),
            ["left: nothing comes of id 3 on can0, but of 5, not watched: is the number right?"]
        );
        for n in [1, 15, 9, 2] {
            others.hear(can1, number(n));
        }
        assert_eq!(
            others.hints(|_| true),
            ["right: nothing comes of id 4 on can1, but of 1, 2, 9 and others, not watched: is the number right?"]
        );
        assert!(others.hints(|_| true).is_empty(), "told once");
    }

    /// At the usual rate two drives are too much for a bus.
    const SLOW: &str = "[type.bench.sensors]\nsample_rate_hz = 400\n";

    #[test]
    fn of_a_drive_nodes_of_its_preset_are_told_unless_its_own_talks() {
        let text =
            "[[actuator]]\nid = 3\nname = \"left\"\nbus = \"can0\"\n[actuator.drive]\npreset = \"odrive\"\nnode = 5\n";
        let config = Config::from_toml_str(text, "hmd.toml").unwrap();
        let mut names = BusNames::new();
        let can0 = names.intern("can0").unwrap();
        let mut others = OtherNumbers::new(Some(&config), &names);
        others.hear(can0, Talker::Actuator(ActuatorId::new(4).unwrap()));
        others.hear(can0, Talker::Node(Preset::Vesc, 6));
        assert!(others.hints(|_| true).is_empty(), "no such drives");
        others.hear(can0, Talker::Node(Preset::Odrive, 6));
        let mut its_own = OtherNumbers::new(Some(&config), &names);
        its_own.hear(can0, Talker::Node(Preset::Odrive, 5));
        its_own.hear(can0, Talker::Node(Preset::Odrive, 6));
        assert!(its_own.hints(|_| true).is_empty(), "something else is wrong");
        let second = text
            .replace("left", "right")
            .replace("= 3", "= 4")
            .replace("= 5", "= 6");
        let both = Config::from_toml_str(&format!("{text}{second}{SLOW}"), "hmd.toml").unwrap();
        let mut of_both = OtherNumbers::new(Some(&both), &names);
        of_both.hear(can0, Talker::Node(Preset::Odrive, 6));
        assert!(of_both.hints(|_| true).is_empty(), "it is watched");
        assert_eq!(
            others.hints(|_| true),
            ["left: nothing comes of node 5 on can0, but of 6, not watched: is the number right?"]
        );
    }
}
