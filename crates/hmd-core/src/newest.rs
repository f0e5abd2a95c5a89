//! What the recordings of one unit say of it now: newest health, remaining life, and the damage last shown.

mod joined;

use std::collections::BTreeSet;

use ema_models::FaultId;

use crate::health::HealthState;
use crate::history::{Event, FELL, LifeEnd, ReplacedPart};
use crate::record::{Health, LastShown, Rul};

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
        let fell = health.reason.split("; ").find(|reason| reason.starts_with(FELL));
        let states = health.states().unwrap_or_default();
        for fault in FaultId::ALL {
            let names = |reason: &str| reason.contains(&format!("{} ", fault.name()));
            let fallen = &mut self.fallen[fault.index()];
            *fallen = fell.is_some_and(names) || (*fallen && states[fault.index()] < HealthState::Warning);
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

    /// Whether no window began after this time, UTC ns.
    fn is_before(&self, t_ns: u64) -> bool {
        self.period_ns.is_none_or(|[_, last]| last < t_ns)
    }

    /// Whether the windows know of a replacement before the newest of them: a window since then has followed it, or the history began after
    /// it. One whose windows are all dated after now, UTC ns, did not begin then: its clock was wrong.
    fn knows(&self, event: &Event, now_ns: u64) -> bool {
        let mut since = self.replacements.range((event.t_ns, None)..);
        let has_followed = since.any(|(_, part)| part.is_none() || *part == event.part);
        let begun_ns = self.period_ns.map(|[first, _]| first);
        let has_begun = begun_ns.is_some_and(|begun_ns| (event.t_ns..=now_ns).contains(&begun_ns));
        has_followed || has_begun
    }

    /// Notes that a part, or the unit (`None`), was replaced before this recording, which knew nothing of the one before it.
    pub fn begin_part(&mut self, part: Option<ReplacedPart>) {
        self.replacements.extend(self.period_ns.map(|[first, _]| (first, part)));
    }

    /// Whether a replacement at this time, UTC ns, lies between this recording and a later one, whose use begins anew: neither knows of it. A
    /// recording that begins after now has a wrong clock.
    fn is_parted_from(&self, later: &Self, replaced_ns: u64, now_ns: u64) -> bool {
        let (Some([_, last_ns]), Some([first_ns, _])) = (self.period_ns, later.period_ns) else {
            return false;
        };
        let goes_on = matches!((self.used_h, later.used_h), (Some([_, before]), Some([after, _])) if before < after);
        last_ns < replaced_ns && replaced_ns <= first_ns && first_ns <= now_ns && !goes_on
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
    #[must_use]
    pub fn is_end_of(&self, part: Option<ReplacedPart>) -> bool {
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

    /// Order of recordings that know nothing of each other: by the start of the newest window, UTC ns; those without any last.
    #[must_use]
    pub fn newest_ns(&self) -> u64 {
        self.period_ns.map_or(u64::MAX, |_| self.health.t_start_ns)
    }

    /// The same; of recordings of the same windows that comes last which knows of more replacements, then the worse one.
    #[must_use]
    pub fn order(&self) -> (u64, usize, HealthState) {
        let is_replaced = |fault: &FaultId| self.has_renewed(*fault);
        let replaced = FaultId::ALL.iter().filter(|fault| is_replaced(fault)).count();
        (self.newest_ns(), replaced, HealthState::named(&self.health.health))
    }

    /// Whether some of these recordings of one unit lie among each other in time: of several units, or of one twice.
    fn overlap<'a>(recordings: impl Iterator<Item = &'a Self>) -> bool {
        let mut periods: Vec<[u64; 2]> = recordings.filter_map(|newest| newest.period_ns).collect();
        periods.sort_unstable();
        periods.windows(2).any(|pair| pair[1][0] <= pair[0][1])
    }

    /// Goes on with the next segment of the same run, whose states continue those of this one.
    pub fn continue_run(&mut self, later: Self) {
        let states = later.states();
        self.join(later, &states);
    }

    /// Goes on with a later recording, which knew nothing of this one: what it leaves open holds as it was known before, unless the part was
    /// replaced. A fault at watch or worse holds until a window shows that it is less; one that was nominal is in doubt once a window has a reading
    /// of it that does not show its state. A state by the remaining life holds until there is another forecast. Of recordings that overlap in
    /// time, a worse state holds that this one has shown later.
    fn go_on(&mut self, mut later: Self) {
        let own = later.states();
        let mut states = own;
        for (fault, before) in FaultId::ALL.into_iter().zip(self.states()) {
            let n = fault.index();
            let holds = before >= HealthState::Watch || !later.has_reading[n];
            if states[n] == HealthState::Unknown && holds && !later.has_renewed(fault) {
                states[n] = before;
            }
            let shown = [&self.shown, &later.shown].map(|shown| shown.of(fault));
            let is_newer = matches!(shown, [Some(here), Some(there)] if here.t_start_ns > there.t_start_ns);
            if is_newer && before > states[n] && before >= HealthState::Watch && !later.has_renewed(fault) {
                states[n] = before;
                later.shown.forget(fault);
            }
        }
        let by_life = self
            .state_by_life()
            .filter(|_| !later.has_forecast && self.keeps_end(&later));
        let worst = states
            .into_iter()
            .max()
            .unwrap_or_default()
            .max(by_life.unwrap_or_default());
        let is_known = !states.contains(&HealthState::Unknown);
        let state = HealthState::named(&later.health.health);
        let is_other = states != own || by_life.is_some();
        if is_other && worst > state && (worst > HealthState::Nominal || is_known) {
            worst.name().clone_into(&mut later.health.health);
        }
        if by_life.is_some() {
            let mut rul = self.rul.clone();
            rul.forget(|fault| later.has_renewed(fault), false);
            later.rul = rul;
        }
        later.health.set_states(&states);
        self.join(later, &states);
    }

    /// Whether nothing that was replaced later takes away what ends the life.
    fn keeps_end(&self, later: &Self) -> bool {
        !later.parts_replaced().any(|part| self.is_end_of(part))
    }

    /// Takes the later records; of a fault that they leave open in a state that holds, the damage that was shown before.
    fn join(&mut self, later: Self, states: &[HealthState; FaultId::COUNT]) {
        let holds = |fault: FaultId| {
            let n = fault.index();
            states[n] != HealthState::Unknown && !later.has_renewed(fault)
        };
        let both = |a: [bool; FaultId::COUNT], b: [bool; FaultId::COUNT]| std::array::from_fn(|n| a[n] || b[n]);
        let still_fallen = |fault: FaultId| {
            let n = fault.index();
            self.fallen[n] && !later.has_renewed(fault) && states[n] < HealthState::Warning
        };
        let end = self.end.filter(|_| !later.has_forecast && self.keeps_end(&later));
        *self = Self {
            fallen: FaultId::ALL.map(|fault| later.fallen[fault.index()] || still_fallen(fault)),
            shown: later.shown.or(&self.shown, holds),
            has_reading: both(self.has_reading, later.has_reading),
            replacements: self.replacements.union(&later.replacements).copied().collect(),
            has_forecast: self.has_forecast || later.has_forecast,
            end: later.end.or(end),
            period_ns: match (self.period_ns, later.period_ns) {
                (Some(a), Some(b)) => Some([a[0].min(b[0]), a[1].max(b[1])]),
                (a, b) => a.or(b),
            },
            used_h: match (self.used_h, later.used_h) {
                (Some(a), Some(b)) => Some([a[0], b[1]]),
                (a, b) => a.or(b),
            },
            health: later.health,
            rul: later.rul,
        };
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
    use crate::record::Estimate;
    use HealthState::{Critical, Nominal, Unknown, Watch};

    /// A recording of one window with this state of backlash, all others the second state; `has_reading` of every fault.
    fn recording(
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

    /// Health, and state of backlash and of friction, of two recordings after each other.
    fn joined(mut before: Newest, later: Newest) -> (String, [HealthState; 2]) {
        before.go_on(later);
        let states = before.states();
        (
            before.health.health.clone(),
            [FaultId::Backlash, FaultId::ShortA].map(|fault| states[fault.index()]),
        )
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
    fn a_recording_in_which_nothing_was_shown_hides_nothing_that_was_known_before() {
        let worn = || recording(Critical, [Critical, Nominal], true, "");
        let after = |replaced: &str| joined(worn(), recording(Unknown, [Unknown; 2], false, replaced));
        assert_eq!(after(""), ("critical".to_owned(), [Critical, Nominal]));
        assert_eq!(after("unit"), ("unknown".to_owned(), [Unknown; 2]));
        assert_eq!(after("gearbox"), ("unknown".to_owned(), [Unknown, Nominal]));
        // What the later one has shown counts.
        let shown = joined(worn(), recording(Nominal, [Nominal; 2], true, ""));
        assert_eq!(shown, ("nominal".to_owned(), [Nominal; 2]));
    }

    #[test]
    fn a_worse_state_that_another_recording_showed_later_holds() {
        let at = |t_start_ns: u64, state: HealthState, replaced: &str| {
            let mut newest = recording(state, [state, Nominal], true, replaced);
            let mut health = newest.health.clone();
            health.t_start_ns = t_start_ns;
            health.set_damage([Some(0.5); FaultId::COUNT]);
            newest.add(health);
            newest.add_rul(Rul::default());
            newest
        };
        // The later recording has shown backlash before this one did, and ended with a window that does not show it.
        let joined = |replaced: &str| {
            let mut later = at(5, Nominal, replaced);
            let mut silent = later.health.clone();
            silent.t_start_ns = 20;
            silent.set_damage([None; FaultId::COUNT]);
            later.add(silent);
            let mut before = at(10, Critical, "");
            before.go_on(later);
            let shown = before.shown.of(FaultId::Backlash).map(|of| of.t_start_ns);
            (before.health.health, shown)
        };
        assert_eq!(joined(""), ("critical".to_owned(), Some(10)));
        assert_eq!(joined("gearbox"), ("nominal".to_owned(), Some(5)));
        let of = |periods: &[[u64; 2]]| {
            let recordings = periods.iter().map(|period| Newest {
                period_ns: Some(*period),
                ..Newest::default()
            });
            let recordings: Vec<Newest> = recordings.collect();
            Newest::overlap(recordings.iter())
        };
        assert!(of(&[[20, 30], [1, 50], [60, 70]]) && of(&[[1, 2], [2, 3]]));
        assert!(!of(&[[20, 30], [1, 5], [60, 70]]) && !of(&[]));
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
    fn a_later_doubt_stays_a_doubt() {
        let well = || recording(Nominal, [Nominal; 2], true, "");
        let doubt = |has_reading| recording(Unknown, [Unknown, Nominal], has_reading, "");
        assert_eq!(joined(well(), doubt(true)), ("unknown".to_owned(), [Unknown, Nominal]));
        assert_eq!(joined(well(), doubt(false)), ("nominal".to_owned(), [Nominal; 2]));
        // Within a run the newest record has it all.
        let mut run = well();
        run.continue_run(doubt(false));
        assert_eq!(
            (&*run.health.health, run.states()[FaultId::Backlash.index()]),
            ("unknown", Unknown)
        );
        // An alarm is not taken back by a window that does not show it.
        let worn = recording(Critical, [Critical, Nominal], true, "");
        assert_eq!(joined(worn, doubt(true)), ("critical".to_owned(), [Critical, Nominal]));
    }

    #[test]
    fn a_state_by_the_remaining_life_holds_until_there_is_another_forecast() {
        let with = |dominant: &str, p10: Option<f64>, replaced: &str| Rul {
            dominant_fault: dominant.to_owned(),
            rul_p10_h: p10,
            replaced: replaced.to_owned(),
            ..Rul::default()
        };
        let after = |rul: Rul| {
            let mut before = recording(Critical, [Watch, Nominal], true, "");
            before.add_rul(with("backlash", Some(200.0), ""));
            assert_eq!(before.state_by_life(), Some(Critical));
            let mut later = recording(Watch, [Watch, Nominal], true, "");
            later.add_rul(rul);
            before.go_on(later);
            (before.health.health, before.rul.rul_p10_h)
        };
        assert_eq!(after(Rul::default()), ("critical".to_owned(), Some(200.0)));
        assert_eq!(after(with("", None, "motor")), ("critical".to_owned(), Some(200.0)));
        assert_eq!(after(with("", None, "gearbox")), ("watch".to_owned(), None));
        assert_eq!(
            after(with("backlash", Some(900.0), "")),
            ("watch".to_owned(), Some(900.0))
        );
    }

    #[test]
    fn a_forecast_that_holds_has_no_hours_of_a_part_that_was_replaced_since() {
        let mut before = recording(Critical, [Watch, Watch], true, "");
        let mut rul = Rul {
            rul_p10_h: Some(1.0),
            dominant_fault: "short_a".to_owned(),
            ..Rul::default()
        };
        let hours = [None, Some(200.0), Some(1.0), None, None, None, None];
        rul.set_faults(hours.map(|h| h.map(|h| ([h, h, h], 0.5))));
        before.add_rul(rul);
        let mut later = recording(Watch, [Unknown, Watch], true, "");
        later.begin_part(Some(ReplacedPart::Gearbox));
        before.go_on(later);
        assert_eq!(before.state_by_life(), Some(Critical));
        let rul = before.rul;
        assert_eq!(
            (rul.rul_p10_h, rul.short_a_p10_h, rul.backlash_p10_h),
            (Some(1.0), Some(1.0), None)
        );
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
