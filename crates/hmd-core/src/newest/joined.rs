//! Recordings of one unit as one: what each knows, and what maintenance events say was replaced between and after them.

use super::Newest;
use crate::history::{Event, ReplacedPart};

/// Recordings of one unit, one after the other.
#[derive(Debug, Default)]
pub struct Joined<'a> {
    /// What they say together. What was replaced since is not yet taken away from it ([`Newest::replace`]).
    pub newest: Newest,
    /// Parts, or the unit (`None`), that were replaced between each recording and the one before by an event, of which no window knows.
    pub begin_with: Vec<Vec<Option<ReplacedPart>>>,
    /// Replacements after the newest window.
    pub since: Vec<&'a Event>,
    /// Replacements before the newest window that no window knows of.
    pub entered_late: Vec<&'a Event>,
    /// Whether recordings overlap in time ([`Newest::overlap`]).
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
            let lies_between = |event: &&&Event| whole.is_parted_from(&recording, event.t_ns, now_ns);
            let parts = replacements.iter().filter(lies_between).map(|event| event.part);
            let parts: Vec<Option<ReplacedPart>> = parts.collect();
            parts.iter().for_each(|part| recording.begin_part(*part));
            joined.begin_with.push(parts);
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::health::HealthState::{self, Nominal, Unknown, Watch};
    use crate::history::EventKind;
    use crate::record::{Health, Rul};
    use ema_models::FaultId;

    /// Windows at these times, UTC ns, all faults in one state.
    fn recording(times_ns: &[u64], state: HealthState, used_h: f64) -> Newest {
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
            recording(&[1, 2], Watch, 3.0),
            Newest::default(),
            recording(&[10, 12], Unknown, 1.0),
        ];
        let joined = Newest::joined(recordings, &events, 40);
        assert_eq!(joined.begin_with, [vec![], vec![], vec![Some(Gearbox)]]);
        let states = joined.newest.states();
        let state = |fault: FaultId| states[fault.index()];
        // Known of an event that lies within a recording is what its windows say: nothing.
        assert_eq!([FaultId::Backlash, FaultId::ShortA].map(state), [Unknown, Watch]);
        assert_eq!((joined.since, joined.entered_late), (vec![events[2]], vec![events[1]]));
        assert!(!joined.overlap);
        // Recordings that overlap are joined all the same.
        let around = vec![recording(&[10, 20], Watch, 1.0), recording(&[11, 30], Nominal, 1.0)];
        let joined = Newest::joined(around, &[], 40);
        assert!(joined.overlap);
        assert_eq!(joined.newest.newest_ns(), 30);
    }
}
