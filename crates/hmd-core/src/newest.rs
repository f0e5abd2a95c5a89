//! What the recordings of one unit say of it now: newest health, remaining life, and the damage last shown.

mod joined;

use std::collections::BTreeSet;

use ema_models::FaultId;

use crate::health::HealthState;
use crate::history::{LifeEnd, ReplacedPart, fallen_by};
use crate::record::{Health, LastShown, Rul};
use crate::sensor_checks::Suspect;

pub use joined::Joined;

/// The newest records of one unit. Windows of one recording are added in order; recordings are then joined.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Newest {
    /// The newest health record. It has the state of every fault.
    pub health: Health,
    /// What was left then.
    pub rul: Rul,
    /// What the windows have shown of each fault.
    pub shown: LastShown,
    /// Whether some window has a reading of the fault.
    has_reading: [bool; FaultId::COUNT],
    /// Parts, or the unit (`None`), that were replaced before a window, with its start, UTC ns.
    replacements: BTreeSet<(u64, Option<ReplacedPart>)>,
    /// Whether some window had a forecast.
    has_forecast: bool,
    /// What ended the life by the newest forecast that there was; `None` once its part is replaced.
    end: Option<LifeEnd>,
    /// Starts of the earliest and the latest window, UTC ns.
    period_ns: Option<[u64; 2]>,
    /// Operating hours after the first and after the newest window that has them.
    used_h: Option<[f64; 2]>,
    /// Whether the damage of each fault fell without a recorded repair, in the order of [`FaultId::ALL`]; until it is back, or its part is
    /// replaced.
    pub fallen: [bool; FaultId::COUNT],
}

impl Newest {
    /// Takes the next window of the same recording. A record of an older version gets the states of its faults: what it reports is at watch.
    pub fn add(&mut self, mut health: Health) {
        if health.states().is_none() {
            let states = self.states_of_older(&health);
            health.set_states(&states);
        }
        self.shown.update(&health);
        if let Some(estimate) = health.estimate() {
            for fault in FaultId::ALL {
                self.has_reading[fault.index()] |= estimate.tells_of(fault.parameter());
            }
        }
        let fell = fallen_by(&health.reason);
        let states = health.states().unwrap_or_default();
        for fault in FaultId::ALL {
            let fallen = &mut self.fallen[fault.index()];
            *fallen = fell[fault.index()] || (*fallen && states[fault.index()] < HealthState::Warning);
        }
        let t_ns = health.t_start_ns;
        let [first, last] = self.period_ns.unwrap_or([t_ns; 2]);
        self.period_ns = Some([first.min(t_ns), last.max(t_ns)]);
        self.health = health;
        self.rul = Rul::default();
    }

    /// Takes what was left after the newest window.
    pub fn add_rul(&mut self, rul: Rul) {
        for part in ReplacedPart::in_text(&rul.replaced) {
            self.replacements.insert((self.health.t_start_ns, part));
            self.end = self.end.filter(|end| !end.is_of(part));
            for fault in FaultId::ALL {
                self.fallen[fault.index()] &= !ReplacedPart::renews(part, fault);
            }
        }
        if let Some(used_h) = rul.operating_h {
            self.used_h = Some([self.used_h.map_or(used_h, |[first, _]| first), used_h]);
        }
        if let Some(end) = LifeEnd::of(&rul) {
            self.has_forecast = true;
            self.end = Some(end);
        }
        self.rul = rul;
    }

    /// Takes over what was replaced after the newest window: nothing is known of the faults of a new part, nor of the life that one of them ended.
    pub fn replace(&mut self, part: Option<ReplacedPart>) {
        let is_new = |fault: FaultId| ReplacedPart::renews(part, fault);
        let is_life_new = self.is_end_of(part);
        let by_life = self.state_by_life().filter(|_| !is_life_new).unwrap_or_default();
        let mut states = self.states();
        for fault in FaultId::ALL.into_iter().filter(|fault| is_new(*fault)) {
            states[fault.index()] = HealthState::Unknown;
            self.shown.forget(fault);
        }
        if is_life_new {
            self.end = None;
        }
        let is_left = |suspect: Suspect| part.is_some_and(|part| !part.suspects().contains(&suspect));
        let suspects = &mut self.health.suspects;
        suspects.retain(|name| Suspect::from_name(name).is_none_or(is_left));
        match part {
            None => self.rul = Rul::default(),
            Some(_) => self.rul.forget(is_new, is_life_new),
        }
        // Of every part some fault is unknown now.
        let worst = states.into_iter().max().unwrap_or_default().max(by_life);
        let state = Some(worst)
            .filter(|worst| *worst >= HealthState::Watch)
            .unwrap_or_default();
        state.name().clone_into(&mut self.health.health);
        self.health.set_states(&states);
    }

    /// State of each fault, in the order of [`FaultId::ALL`].
    #[must_use]
    pub fn states(&self) -> [HealthState; FaultId::COUNT] {
        self.health.states().unwrap_or_default()
    }

    /// The state, where it is worse than that of every fault: it is then by the remaining life.
    #[must_use]
    pub fn state_by_life(&self) -> Option<HealthState> {
        let recorded = HealthState::named(&self.health.health);
        let worst = self.states().into_iter().max().unwrap_or_default();
        Some(recorded).filter(|recorded| *recorded > worst && *recorded >= HealthState::Watch)
    }

    /// The fault that ends the life first, by the newest forecast that there was: a state by the remaining life is about it.
    #[must_use]
    pub fn ends_first(&self) -> Option<FaultId> {
        self.end()?.fault
    }

    /// What ended the life by the newest forecast that there was.
    fn end(&self) -> Option<LifeEnd> {
        LifeEnd::of(&self.rul).or(self.end)
    }

    /// Whether a new part, or unit (`None`), takes away what ends the life by that forecast; of older records without any, the unit alone.
    fn is_end_of(&self, part: Option<ReplacedPart>) -> bool {
        self.end().map_or(part.is_none(), |end| end.is_of(part))
    }

    /// What was replaced before some window.
    fn parts_replaced(&self) -> impl Iterator<Item = Option<ReplacedPart>> {
        self.replacements.iter().map(|(_, part)| *part)
    }

    /// Whether nothing that was known of a fault before holds, as its part was replaced before some window.
    fn has_renewed(&self, fault: FaultId) -> bool {
        self.parts_replaced().any(|part| ReplacedPart::renews(part, fault))
    }

    fn states_of_older(&self, health: &Health) -> [HealthState; FaultId::COUNT] {
        let state = HealthState::named(&health.health);
        if health.estimate().is_none() && state != HealthState::Unknown {
            return self.states();
        }
        FaultId::ALL.map(|fault| match state {
            HealthState::Unknown => state,
            _ if health.fault_list.iter().any(|name| name == fault.name()) => HealthState::Watch,
            _ => HealthState::Nominal,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::FELL;
    use crate::record::Estimate;
    use HealthState::{Critical, Nominal, Unknown, Watch};

    /// A recording of one window with this state of backlash, all others the second state; `has_reading` of every fault.
    pub(super) fn recording(
        health: HealthState,
        [backlash, others]: [HealthState; 2],
        has_reading: bool,
        replaced: &str,
    ) -> Newest {
        let mut states = [others; FaultId::COUNT];
        states[FaultId::Backlash.index()] = backlash;
        let mut record = Health {
            health: health.name().to_owned(),
            ..Health::default()
        };
        record.set_states(&states);
        let estimate = Estimate {
            k: [0.0; 8],
            sigma: [Some(0.5); 8],
            observable: [false; 8],
        };
        record.set_estimate(Some(&estimate).filter(|_| has_reading));
        let mut newest = Newest::default();
        newest.add(record);
        newest.add_rul(Rul {
            replaced: replaced.to_owned(),
            ..Rul::default()
        });
        newest
    }

    #[test]
    fn a_damage_that_fell_is_told_until_it_is_back_or_its_part_is_replaced() {
        let window = |state: HealthState, reason: String| {
            let mut health = Health {
                reason,
                ..Health::default()
            };
            let mut states = [Nominal; FaultId::COUNT];
            states[FaultId::Friction.index()] = state;
            health.set_states(&states);
            health
        };
        let reason = format!("2 samples lost; {FELL} (friction 0.00 ± 0.02 after warning): check");
        let fell = || window(Nominal, reason.clone());
        let sound = || window(Nominal, String::new());
        let of = |windows: Vec<Health>, replaced: &str| {
            let mut newest = Newest::default();
            windows.into_iter().for_each(|health| newest.add(health));
            newest.add_rul(Rul {
                replaced: replaced.to_owned(),
                ..Rul::default()
            });
            newest
        };
        let has_fallen = |newest: &Newest| newest.fallen[FaultId::Friction.index()];
        assert!(has_fallen(&of(vec![fell()], "")) && has_fallen(&of(vec![fell(), sound()], "controller")));
        assert!(!has_fallen(&of(vec![sound()], "")));
        assert!(!has_fallen(&of(
            vec![fell(), window(HealthState::Warning, String::new())],
            ""
        )));
        for replaced in ["gearbox", "unit"] {
            assert!(!has_fallen(&of(vec![fell(), sound()], replaced)), "{replaced}");
        }
        // Over files alike.
        for (later, expected) in [("", true), ("controller", true), ("gearbox", false)] {
            let mut newest = of(vec![fell()], "");
            newest.go_on(of(vec![sound()], later));
            assert_eq!(has_fallen(&newest), expected, "{later}");
        }
    }

    #[test]
    fn nothing_is_known_of_a_part_that_was_replaced_after_the_newest_window() {
        let after = |part: Option<ReplacedPart>| {
            let mut newest = recording(Critical, [Watch, Nominal], true, "");
            newest.add_rul(Rul {
                dominant_fault: "backlash".to_owned(),
                rul_p10_h: Some(10.0),
                ..Rul::default()
            });
            newest.replace(part);
            let states = newest.states();
            let of = |fault: FaultId| states[fault.index()];
            (
                newest.health.health,
                of(FaultId::Backlash),
                of(FaultId::ShortA),
                newest.rul.rul_p10_h,
            )
        };
        let found = after(Some(ReplacedPart::Gearbox));
        assert_eq!(found, ("unknown".to_owned(), Unknown, Nominal, None));
        let found = after(Some(ReplacedPart::Motor));
        assert_eq!(found, ("critical".to_owned(), Watch, Unknown, Some(10.0)));
        assert_eq!(after(None), ("unknown".to_owned(), Unknown, Unknown, None));
    }

    #[test]
    fn the_part_of_a_forecast_that_was_withdrawn_stays_known() {
        let with = |dominant: &str, p10: Option<f64>, replaced: &str| Rul {
            dominant_fault: dominant.to_owned(),
            rul_p10_h: p10,
            replaced: replaced.to_owned(),
            ..Rul::default()
        };
        let ends_first = |replaced: &str| {
            let mut newest = recording(Critical, [Watch, Nominal], true, "");
            newest.add_rul(with("backlash", Some(10.0), ""));
            newest.add_rul(with("", None, replaced));
            let mut joined = newest.clone();
            joined.go_on(recording(Watch, [Watch, Nominal], true, ""));
            assert_eq!(joined.ends_first(), newest.ends_first());
            newest.ends_first()
        };
        assert_eq!(ends_first(""), Some(FaultId::Backlash));
        assert_eq!(ends_first("motor"), Some(FaultId::Backlash));
        assert_eq!(ends_first("gearbox"), None);
    }

    /// Without hours a record names the largest damage, which need not be what ended the life.
    #[test]
    fn a_record_without_hours_does_not_say_what_ends_the_life() {
        let with = |dominant: &str, p10: Option<f64>, governed_by: &str| Rul {
            dominant_fault: dominant.to_owned(),
            rul_p10_h: p10,
            governed_by: governed_by.to_owned(),
            ..Rul::default()
        };
        let ended = |governed_by: &str| {
            let mut newest = recording(Critical, [Watch, Nominal], true, "");
            newest.add_rul(with("backlash", Some(10.0), governed_by));
            newest.add_rul(with("short_a", None, ""));
            newest
        };
        assert_eq!(ended("damage").ends_first(), Some(FaultId::Backlash));
        let after = |part: ReplacedPart, governed_by: &str| {
            let mut newest = ended(governed_by);
            newest.replace(Some(part));
            // A later file says the same.
            let mut before = ended(governed_by);
            before.go_on(recording(Watch, [Watch, Nominal], true, part.name()));
            let (now, over_files) = (newest.state_by_life(), before.state_by_life());
            assert_eq!(now, over_files, "{part:?} {governed_by}");
            now
        };
        assert_eq!(after(ReplacedPart::Motor, "damage"), Some(Critical));
        assert_eq!(after(ReplacedPart::Gearbox, "damage"), None);
        for part in ReplacedPart::ALL {
            assert_eq!(after(part, "slew_rate"), None, "{part:?}");
        }
    }

    #[test]
    fn a_replaced_part_that_ended_the_life_leaves_the_hours_of_the_others() {
        let mut newest = recording(Critical, [Watch, Watch], true, "");
        let mut rul = Rul {
            rul_p10_h: Some(1.0),
            rul_p50_h: Some(2.0),
            rul_p90_h: Some(3.0),
            failure_probability: Some(0.9),
            horizon_h: Some(100.0),
            dominant_fault: "short_a".to_owned(),
            governed_by: "stall".to_owned(),
            ..Rul::default()
        };
        let hours = [None, Some(200.0), Some(10.0), None, None, Some(20.0), Some(100.0)];
        rul.set_faults(hours.map(|h| h.map(|h| ([h, h + 1.0, h + 2.0], h / 1000.0))));
        newest.add_rul(rul);
        let of = |part: ReplacedPart| {
            let mut newest = newest.clone();
            newest.replace(Some(part));
            newest.rul
        };
        let motor = of(ReplacedPart::Motor);
        let hours = [motor.rul_p10_h, motor.rul_p50_h, motor.rul_p90_h];
        assert_eq!(hours, [100.0, 101.0, 102.0].map(Some));
        assert_eq!((motor.failure_probability, motor.horizon_h), (Some(0.1), Some(100.0)));
        assert_eq!((&*motor.dominant_fault, &*motor.governed_by), ("gain", "damage"));
        assert_eq!((motor.short_a_p10_h, motor.backlash_p10_h), (None, Some(200.0)));
        // A requirement is missed by all parts together: any new one takes that end away, and the state with it.
        let gearbox = of(ReplacedPart::Gearbox);
        assert_eq!(
            (gearbox.rul_p10_h, gearbox.failure_probability, &*gearbox.governed_by),
            (Some(10.0), Some(0.01), "damage")
        );
        assert_eq!((&*gearbox.dominant_fault, gearbox.backlash_p10_h), ("short_a", None));
        // A damage is that of its part.
        newest.rul.governed_by = "damage".to_owned();
        let mut gearbox = newest.clone();
        gearbox.replace(Some(ReplacedPart::Gearbox));
        assert_eq!((gearbox.rul.rul_p10_h, gearbox.rul.backlash_p10_h), (Some(1.0), None));
    }
}
