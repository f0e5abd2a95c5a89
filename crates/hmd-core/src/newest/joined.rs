//! Recordings of one unit as one: what each knows, and what maintenance events say was replaced between and after them.

use ema_models::FaultId;

use super::Newest;
use crate::health::{HealthState, SIGNIFICANCE};
use crate::history::{Event, ReplacedPart};
use crate::record::Rul;
use crate::rul::NoTrend;

/// Recordings of one unit, one after the other.
#[derive(Debug, Default)]
pub struct Joined<'a> {
    /// What they say together. What was replaced since is not yet taken away from it ([`Newest::replace`]).
    pub newest: Newest,
    /// Replacements between each recording and the one before, of which no window knows.
    pub begin_with: Vec<Vec<&'a Event>>,
    /// Replacements after the newest window.
    pub since: Vec<&'a Event>,
    /// Replacements before the newest window that no window knows of.
    pub entered_late: Vec<&'a Event>,
    /// Whether recordings overlap in time.
    pub overlap: bool,
}

impl Newest {
    /// Joins recordings in their [`Newest::order`]: that with the newest window has the last word. `replacements` are those of the unit until now,
    /// UTC ns; what was replaced between two recordings begins anew with the later one.
    #[must_use]
    pub fn joined<'a>(recordings: Vec<Self>, replacements: &[&'a Event], now_ns: u64) -> Joined<'a> {
        let mut joined = Joined {
            overlap: Self::overlap(recordings.iter()),
            ..Joined::default()
        };
        let whole = &mut joined.newest;
        for mut recording in recordings {
            let lies_between = |event: &&Event| whole.is_replaced_between(&recording, event.t_ns, now_ns);
            let between: Vec<&Event> = replacements.iter().copied().filter(lies_between).collect();
            between.iter().for_each(|event| recording.begin_part(event.part));
            joined.begin_with.push(between);
            if recording.period_ns.is_some() {
                whole.go_on(recording);
            }
        }
        for &event in replacements {
            if whole.is_before(event.t_ns) {
                joined.since.push(event);
            } else if !whole.knows(event, now_ns) {
                joined.entered_late.push(event);
            }
        }
        joined
    }

    /// Notes that a part, or the unit (`None`), was replaced before this recording, which knew nothing of the one before it.
    pub fn begin_part(&mut self, part: Option<ReplacedPart>) {
        self.replacements.extend(self.period_ns.map(|[first, _]| (first, part)));
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

    /// Whether no window began after this time, UTC ns.
    fn is_before(&self, t_ns: u64) -> bool {
        self.period_ns.is_none_or(|[_, last]| last < t_ns)
    }

    /// Whether a replacement at this time, UTC ns, lies between this recording and a later one, whose use begins anew: neither knows of it. A
    /// recording that begins after now has a wrong clock.
    fn is_replaced_between(&self, later: &Self, replaced_ns: u64, now_ns: u64) -> bool {
        let (Some([_, last_ns]), Some([first_ns, _])) = (self.period_ns, later.period_ns) else {
            return false;
        };
        let goes_on = matches!((self.used_h, later.used_h), (Some([_, before]), Some([after, _])) if before < after);
        last_ns < replaced_ns && replaced_ns <= first_ns && first_ns <= now_ns && !goes_on
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
    /// of it that does not show its state. A forecast, and a state by it, holds until there is another or no growth. Of recordings that overlap in
    /// time, a worse state holds that this one has shown later.
    pub(super) fn go_on(&mut self, mut later: Self) {
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
        for (fault, of_later) in FaultId::ALL.into_iter().zip(own) {
            later.fallen[fault.index()] |= of_later == HealthState::Nominal && self.falls_to(&later, fault);
        }
        let holds = self.keeps_forecast(&later);
        let by_life = self.state_by_life().filter(|_| holds && self.keeps_end(&later));
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
        let left = self.forecast_left(&later, &states, by_life.is_some());
        if holds && left.rul_p10_h.is_some() {
            later.rul = left;
        }
        later.health.set_states(&states);
        self.join(later, &states);
    }

    /// Whether the forecast before a later recording holds after it: that has none, and no windows show that what ends the life does not grow.
    fn keeps_forecast(&self, later: &Self) -> bool {
        let is_shown = |fault: FaultId| later.shown.of(fault).is_some();
        let is_steady = later.rul.reason == NoTrend::NoGrowth.to_string() && self.ends_first().is_none_or(is_shown);
        !later.has_forecast && !is_steady
    }

    /// The hours that are left by the forecast before a later recording, to the faults that are still at watch or worse after it; `is_by_life`: and
    /// to that which ends the life.
    fn forecast_left(&self, later: &Self, states: &[HealthState; FaultId::COUNT], is_by_life: bool) -> Rul {
        let ends_first = self.ends_first().filter(|_| is_by_life);
        let is_worn = |fault: FaultId| states[fault.index()] >= HealthState::Watch || ends_first == Some(fault);
        let is_gone = |fault: FaultId| later.has_renewed(fault) || !is_worn(fault);
        let ends_alone = self.end().filter(|end| !end.by_function).and_then(|end| end.fault);
        // All faults together miss a requirement.
        let is_end_well = match ends_alone {
            Some(fault) => is_gone(fault),
            None => !is_by_life && !FaultId::ALL.into_iter().any(is_worn),
        };
        let mut rul = self.rul.clone();
        rul.forget(is_gone, is_end_well || !self.keeps_end(later));
        rul
    }

    /// Whether the damage of a fault at warning or worse is less than half of it in a later recording, with three sigmas, and its part the same.
    fn falls_to(&self, later: &Self, fault: FaultId) -> bool {
        let [Some(before), Some(after)] = [&self.shown, &later.shown].map(|shown| shown.of(fault)) else {
            return false;
        };
        let is_worn = self.states()[fault.index()] >= HealthState::Warning && before.t_start_ns < after.t_start_ns;
        let is_less = after.damage + SIGNIFICANCE * after.sigma.unwrap_or(0.0) < 0.5 * before.damage;
        is_worn && is_less && !later.has_renewed(fault)
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::EventKind;
    use crate::newest::tests::recording;
    use crate::record::Health;
    use HealthState::{Critical, Nominal, Unknown, Watch};

    /// Windows at these times, UTC ns, all faults in one state.
    fn windows(times_ns: &[u64], state: HealthState, used_h: f64) -> Newest {
        let mut newest = Newest::default();
        for &t_start_ns in times_ns {
            let mut health = Health {
                t_start_ns,
                health: state.name().to_owned(),
                ..Health::default()
            };
            health.set_states(&[state; FaultId::COUNT]);
            newest.add(health);
            newest.add_rul(Rul {
                operating_h: Some(used_h),
                ..Rul::default()
            });
        }
        newest
    }

    #[test]
    fn events_between_recordings_begin_the_later_one_and_others_are_told() {
        let event = |t_ns: u64, part: ReplacedPart| Event {
            t_ns,
            actuator: "left".to_owned(),
            event: EventKind::Reset,
            part: Some(part),
            note: None,
        };
        use ReplacedPart::{Controller, Gearbox, Motor};
        let events = [event(5, Gearbox), event(11, Motor), event(30, Controller)];
        let events: Vec<&Event> = events.iter().collect();
        let recordings = vec![
            windows(&[1, 2], Watch, 3.0),
            Newest::default(),
            windows(&[10, 12], Unknown, 1.0),
        ];
        let joined = Newest::joined(recordings, &events, 40);
        assert_eq!(joined.begin_with, [vec![], vec![], vec![events[0]]]);
        let states = joined.newest.states();
        let state = |fault: FaultId| states[fault.index()];
        // Known of an event that lies within a recording is what its windows say: nothing.
        assert_eq!([FaultId::Backlash, FaultId::ShortA].map(state), [Unknown, Watch]);
        assert_eq!((joined.since, joined.entered_late), (vec![events[2]], vec![events[1]]));
        assert!(!joined.overlap);
        // Recordings that overlap are joined all the same.
        let around = vec![windows(&[10, 20], Watch, 1.0), windows(&[11, 30], Nominal, 1.0)];
        let joined = Newest::joined(around, &[], 40);
        assert!(joined.overlap);
        assert_eq!(joined.newest.newest_ns(), 30);
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

    /// A forecast of gain and backlash, then a recording with these states of backlash and of all others.
    fn after_forecast(later: [HealthState; 2], reason: &str, replaced: &str) -> Newest {
        let mut before = recording(Watch, [Watch, Watch], true, "");
        let mut rul = Rul {
            rul_p10_h: Some(90.0),
            dominant_fault: "backlash".to_owned(),
            governed_by: "damage".to_owned(),
            ..Rul::default()
        };
        let hours = [None, Some(90.0), None, None, None, None, Some(200.0)];
        rul.set_faults(hours.map(|h| h.map(|h| ([h, h, h], 0.5))));
        before.add_rul(rul);
        let mut later = recording(later[0], later, true, replaced);
        let mut health = later.health.clone();
        health.set_damage([Some(0.1); FaultId::COUNT]);
        later.add(health);
        later.add_rul(Rul {
            reason: reason.to_owned(),
            ..Rul::default()
        });
        before.go_on(later);
        before
    }

    #[test]
    fn a_forecast_of_worn_parts_holds_over_a_recording_without_one() {
        let few = "no trend yet: 1 of 6 estimates";
        let hours = |newest: Newest| (newest.rul.rul_p10_h, newest.rul.backlash_p10_h, newest.rul.gain_p10_h);
        assert_eq!(
            hours(after_forecast([Watch; 2], few, "")),
            (Some(90.0), Some(90.0), Some(200.0))
        );
        // Until windows show no growth, and of the parts that are still worn.
        assert_eq!(
            hours(after_forecast([Watch; 2], "no fault grows", "")),
            (None, None, None)
        );
        assert_eq!(
            hours(after_forecast([Watch, Nominal], few, "")),
            (Some(90.0), Some(90.0), None)
        );
        assert_eq!(
            hours(after_forecast([Nominal, Watch], few, "")),
            (Some(200.0), None, Some(200.0))
        );
        assert_eq!(hours(after_forecast([Nominal; 2], few, "")), (None, None, None));
        // A new part leaves the hours of the others.
        let gearbox = after_forecast([Unknown, Watch], few, "gearbox");
        assert_eq!(hours(gearbox), (Some(200.0), None, Some(200.0)));
        // Where none are left, the later recording says why.
        assert_eq!(after_forecast([Unknown; 2], few, "unit").rul.reason, few);
    }

    #[test]
    fn a_damage_that_fell_between_recordings_is_told() {
        let at = |t_start_ns: u64, state: HealthState, damage: f64| {
            let mut newest = recording(state, [state, Nominal], false, "");
            let mut health = newest.health.clone();
            health.t_start_ns = t_start_ns;
            health.set_damage([Some(damage); FaultId::COUNT]);
            newest.add(health);
            newest
        };
        let has_fallen = |damage: f64, part: Option<ReplacedPart>, state: HealthState| {
            let mut before = at(10, HealthState::Warning, 0.4);
            let mut later = at(20, state, damage);
            if part.is_some() {
                later.begin_part(part);
            }
            before.go_on(later);
            before.fallen[FaultId::Backlash.index()]
        };
        use ReplacedPart::{Gearbox, Motor};
        assert!(has_fallen(0.01, None, Nominal) && has_fallen(0.01, Some(Motor), Nominal));
        assert!(!has_fallen(0.01, Some(Gearbox), Nominal));
        assert!(!has_fallen(0.3, None, Nominal) && !has_fallen(0.1, None, Watch));
    }
}
