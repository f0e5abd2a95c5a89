//! Units behind one name: recordings of several airframes have actuators of the same name, and a recording that goes on after a unit was
//! replaced has two units one after the other.

use std::collections::BTreeMap;

use hmd_core::history::Event;
use hmd_core::newest::Newest;

use super::clock_doubt::{Dated, clock_doubts};
use super::history::{History, Replacement};
use super::replacements::{Maintenance, SERIAL};

/// What one file says of one actuator, and the serial number that its writer's configuration had for it.
#[derive(Debug)]
pub(super) struct Part {
    /// Name of the file.
    pub(super) file: String,
    /// Run that wrote it, where it is a segment of one.
    pub(super) run: Option<String>,
    pub(super) serial: Option<String>,
    pub(super) history: History,
}

/// The histories by name. Units that were used at the same times are different ones, each with its serial number in the name; of units one
/// after the other the history goes on.
pub(super) fn by_unit(parts: Vec<Part>, maintenance: &Maintenance<'_>) -> BTreeMap<String, History> {
    let mut spans: BTreeMap<String, BTreeMap<String, [u64; 2]>> = BTreeMap::new();
    for part in &parts {
        let Some(serial) = &part.serial else { continue };
        let units = spans.entry(part.history.actuator.clone()).or_default();
        for point in &part.history.points {
            let span = units.entry(serial.clone()).or_insert([u64::MAX, 0]);
            *span = [span[0].min(point.t_start_ns), span[1].max(point.t_start_ns)];
        }
    }
    let is_shared = |name: &str| {
        let Some(units) = spans.get(name) else { return false };
        let spans: Vec<&[u64; 2]> = units.values().collect();
        let overlap = |n: usize| {
            spans[..n]
                .iter()
                .any(|other| other[0] <= spans[n][1] && spans[n][0] <= other[1])
        };
        (1..spans.len()).any(overlap)
    };
    // The segments of a run first: their states continue each other, whatever its clock did.
    let mut recordings: BTreeMap<String, Vec<Part>> = BTreeMap::new();
    for part in parts {
        let name = match &part.serial {
            Some(serial) if is_shared(&part.history.actuator) => format!("{}{SERIAL}{serial}", part.history.actuator),
            _ => part.history.actuator.clone(),
        };
        let of_unit = recordings.entry(name).or_default();
        let is_of_its_run = |before: &&mut Part| part.run.is_some() && before.run == part.run;
        match of_unit.iter_mut().rev().find(is_of_its_run) {
            Some(before) => before.history.continue_run(part.history),
            None => of_unit.push(part),
        }
    }
    recordings
        .into_iter()
        .map(|(name, recordings)| (name.clone(), joined(name, recordings, maintenance)))
        .collect()
}

/// The history of a unit from its recordings: that with the newest window has the last word. What was replaced between two of them begins anew
/// with the later one.
fn joined(actuator: String, mut recordings: Vec<Part>, maintenance: &Maintenance<'_>) -> History {
    recordings.sort_by_key(|recording| recording.history.newest.order());
    let dated = recordings.iter().map(|recording| Dated {
        file: &recording.file,
        times_ns: recording.history.points.iter().map(|point| point.t_start_ns).collect(),
    });
    let clock_doubts = clock_doubts(&dated.collect::<Vec<_>>(), maintenance.now_ns);
    let mut unit = None;
    let mut newest = Vec::new();
    for recording in &mut recordings {
        let before = unit.clone();
        unit = recording.serial.take().or(unit);
        if before.is_some() && unit != before {
            recording.history.newest.begin_part(None);
            recording.history.mark_replaced(None);
        }
        newest.push(std::mem::take(&mut recording.history.newest));
    }
    let replacements: Vec<&Event> = maintenance.replacements_of(&actuator).collect();
    let joined = Newest::joined(newest, &replacements, maintenance.now_ns);
    let mut whole = History {
        actuator,
        newest: joined.newest,
        replaced_since: newest_of_each(joined.since),
        entered_since: newest_of_each(joined.entered_late),
        overlaps: joined.overlap,
        clock_doubts,
        ..History::default()
    };
    for (recording, replacements) in recordings.into_iter().zip(joined.begin_with) {
        let mut later = recording.history;
        for event in replacements {
            later.mark_replaced(event.part);
            whole.replaced_between.push(Replacement::of(event));
        }
        if let Some(first) = later.points.first_mut() {
            first.begins_recording = true;
        }
        whole.append(later);
    }
    whole
}

/// The newest replacement of each part, and of the unit.
fn newest_of_each(events: Vec<&Event>) -> Vec<Replacement> {
    let mut newest: Vec<Replacement> = Vec::new();
    for event in events {
        newest.retain(|known| known.part != event.part);
        newest.push(Replacement::of(event));
    }
    newest
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::config::Config;
    use hmd_core::history::{EventKind, Events, ReplacedPart};
    use hmd_core::record::{Estimate, Health, Rul};
    use std::sync::LazyLock;

    fn part(serial: Option<&str>, times: &[u64]) -> Part {
        let mut history = History {
            actuator: "left".to_owned(),
            ..History::default()
        };
        for &t_start_ns in times {
            history.add(Health {
                t_start_ns,
                ..Health::default()
            });
        }
        Part {
            file: String::new(),
            run: None,
            serial: serial.map(str::to_owned),
            history,
        }
    }

    /// No maintenance.
    fn none() -> Maintenance<'static> {
        static NOTHING: LazyLock<(Events, Config)> = LazyLock::new(Default::default);
        Maintenance {
            events: &NOTHING.0,
            config: &NOTHING.1,
            now_ns: 1_000,
        }
    }

    fn found(parts: Vec<Part>) -> Vec<(String, Vec<u64>)> {
        let times = |history: History| history.points.iter().map(|point| point.t_start_ns).collect();
        by_unit(parts, &none())
            .into_iter()
            .map(|(name, history)| (name, times(history)))
            .collect()
    }

    #[test]
    fn units_of_the_same_times_are_told_apart_and_others_go_on() {
        let airframes = vec![
            part(Some("1"), &[10, 30]),
            part(Some("2"), &[20, 40]),
            part(Some("1"), &[50]),
        ];
        assert_eq!(
            found(airframes),
            [
                ("left, serial 1".to_owned(), vec![10, 30, 50]),
                ("left, serial 2".to_owned(), vec![20, 40])
            ]
        );
        let replaced = vec![part(Some("1"), &[10, 20]), part(Some("2"), &[30]), part(None, &[40])];
        assert_eq!(found(replaced), [("left".to_owned(), vec![10, 20, 30, 40])]);
        let mixed = vec![part(Some("2"), &[30]), part(Some("1"), &[10, 20])];
        assert_eq!(found(mixed), [("left".to_owned(), vec![10, 20, 30])]);
        let segment = |times: &[u64]| Part {
            run: Some("a".to_owned()),
            ..part(None, times)
        };
        let clock_set_back = vec![segment(&[50]), segment(&[20]), part(None, &[30])];
        assert_eq!(found(clock_set_back), [("left".to_owned(), vec![50, 20, 30])]);
        assert_eq!(
            found(vec![part(Some("1"), &[10]), part(Some("1"), &[10])]),
            [("left".to_owned(), vec![10, 10])]
        );
    }

    #[test]
    fn of_recordings_that_overlap_that_with_the_newest_window_comes_last() {
        let of = |parts: Vec<Part>| {
            let history = by_unit(parts, &none()).remove("left").unwrap();
            let times: Vec<u64> = history.points.iter().map(|point| point.t_start_ns).collect();
            (history.newest.health.t_start_ns, times, history.overlaps)
        };
        for around_first in [true, false] {
            let mut parts = vec![part(None, &[2, 82]), part(None, &[3, 59])];
            if !around_first {
                parts.reverse();
            }
            assert_eq!(of(parts), (82, vec![3, 59, 2, 82], true));
        }
        assert_eq!(
            of(vec![part(None, &[60, 70]), part(None, &[3, 59])]),
            (70, vec![3, 59, 60, 70], false)
        );
        // A run whose clock was set back does not overlap with itself.
        let segment = |times: &[u64]| Part {
            run: Some("a".to_owned()),
            ..part(None, times)
        };
        assert_eq!(
            of(vec![segment(&[50, 60]), segment(&[20, 55])]),
            (55, vec![50, 60, 20, 55], false)
        );
    }

    #[test]
    fn segments_of_a_run_continue_each_other_and_another_recording_holds_where_they_are_silent() {
        use hmd_core::health::HealthState::{self, Critical, Nominal, Unknown};
        let segment = |run: Option<&str>, t_start_ns: u64, state: HealthState| {
            let mut part = part(None, &[]);
            part.run = run.map(str::to_owned);
            let mut health = Health {
                t_start_ns,
                health: state.name().to_owned(),
                ..Default::default()
            };
            health.set_states(&[state; ema_models::FaultId::COUNT]);
            part.history.add(health);
            part
        };
        let joined = |parts: Vec<Part>| by_unit(parts, &none())["left"].newest.health.health.clone();
        let doubt = vec![segment(Some("a"), 1, Nominal), segment(Some("a"), 2, Unknown)];
        assert_eq!(joined(doubt), "unknown");
        let silent = vec![
            segment(None, 0, Critical),
            segment(Some("a"), 1, Unknown),
            segment(Some("a"), 2, Unknown),
        ];
        assert_eq!(joined(silent), "critical");
        // Of another unit nothing is known yet.
        let of_unit = |serial: &str, t_start_ns: u64, state: HealthState| Part {
            serial: Some(serial.to_owned()),
            ..segment(None, t_start_ns, state)
        };
        let replaced = vec![of_unit("1", 0, Critical), of_unit("2", 1, Unknown)];
        assert_eq!(joined(replaced), "unknown");
    }

    #[test]
    fn what_was_replaced_between_two_recordings_begins_anew_with_the_later_one() {
        use hmd_core::health::HealthState::{self, Nominal, Unknown, Warning};
        let recording = |windows: &[(u64, HealthState, f64)]| {
            let mut part = part(None, &[]);
            for (n, &(t_start_ns, state, used_h)) in windows.iter().enumerate() {
                let mut health = Health {
                    window: n as u64,
                    t_start_ns,
                    health: state.name().to_owned(),
                    ..Health::default()
                };
                let mut states = [if state == Unknown { Unknown } else { Nominal }; ema_models::FaultId::COUNT];
                states[0] = state;
                health.set_states(&states);
                let estimate = Estimate {
                    k: [0.4; 8],
                    sigma: [Some(0.01); 8],
                    observable: [true; 8],
                };
                health.set_estimate((state != Unknown).then_some(&estimate));
                part.history.add(health);
                let rul = Rul {
                    window: n as u64,
                    operating_h: Some(used_h),
                    ..Rul::default()
                };
                part.history.points[n].used_h = rul.operating_h;
                part.history.newest.add_rul(rul);
            }
            part
        };
        let config = Config::from_toml_str("[[actuator]]\nid = 0\nname = \"left\"\n", "test").unwrap();
        let of = |part: Option<ReplacedPart>, t_ns: u64, first_used_h: f64| {
            let events = Events {
                list: vec![Event {
                    t_ns,
                    actuator: "left".to_owned(),
                    event: EventKind::Reset,
                    part,
                    note: None,
                }],
                ..Events::default()
            };
            let maintenance = Maintenance {
                events: &events,
                config: &config,
                now_ns: 1_000,
            };
            let worn = recording(&[(1, Warning, 0.0), (2, Warning, 5.0)]);
            let silent = recording(&[(10, Unknown, first_used_h), (11, Unknown, first_used_h + 1.0)]);
            let history = by_unit(vec![worn, silent], &maintenance).remove("left").unwrap();
            let states = history.newest.states();
            let entered = !history.entered_since.is_empty();
            let replaced = history.points[2].replaced.clone();
            let between: Vec<_> = history.replaced_between.iter().map(|of| of.part).collect();
            assert_eq!(between, replaced);
            (states[0], states[1], replaced, entered)
        };
        let gearbox = Some(ReplacedPart::Gearbox);
        assert_eq!(of(gearbox, 5, 0.0), (Unknown, Unknown, vec![gearbox], false));
        assert_eq!(of(None, 5, 0.0), (Unknown, Unknown, vec![None], false));
        // Another part leaves it.
        let controller = Some(ReplacedPart::Controller);
        assert_eq!(of(controller, 5, 0.0), (Warning, Nominal, vec![controller], false));
        // A history that goes on was to follow it, as was one that it lies within.
        assert_eq!(of(gearbox, 5, 6.0), (Warning, Nominal, vec![], true));
        assert_eq!(of(gearbox, 11, 0.0), (Warning, Nominal, vec![], true));
    }

    #[test]
    fn of_the_same_windows_twice_the_recording_that_knows_of_a_replacement_comes_last() {
        let recording = |replaced: &str| {
            let mut part = part(None, &[1, 2]);
            part.history.newest.add_rul(Rul {
                replaced: replaced.to_owned(),
                ..Rul::default()
            });
            part.history.reasons.insert(format!("by {replaced}"), 1);
            part.history.identity = format!("by {replaced}");
            part
        };
        for around in [["", "gearbox"], ["gearbox", ""]] {
            let history = by_unit(around.map(recording).into(), &none()).remove("left").unwrap();
            assert_eq!(history.identity, "by gearbox");
        }
    }

    fn reset(t_ns: u64, note: &str) -> Event {
        Event {
            t_ns,
            actuator: "left".to_owned(),
            event: EventKind::Reset,
            part: Some(ReplacedPart::Gearbox),
            note: Some(note.to_owned()),
        }
    }

    /// The histories of these recordings, with these events of a configuration with this line of the actuator.
    fn with_events(parts: Vec<Part>, line: &str, events: Vec<Event>, now_ns: u64) -> Vec<History> {
        let config = format!("[[actuator]]\nid = 0\nname = \"left\"\n{line}");
        let config = Config::from_toml_str(&config, "test").unwrap();
        let events = Events {
            list: events,
            ..Events::default()
        };
        let maintenance = Maintenance {
            events: &events,
            config: &config,
            now_ns,
        };
        by_unit(parts, &maintenance).into_values().collect()
    }

    #[test]
    fn a_replacement_is_of_the_unit_with_the_serial_number_of_the_configuration() {
        let replaced = |line: &str, events: Vec<Event>| {
            let mut other = part(None, &[5]);
            other.history.actuator = "lefty".to_owned();
            let parts = vec![part(Some("1"), &[5]), part(Some("2"), &[5]), other];
            let notes = |history: History| {
                let notes = history.replaced_since.iter().map(|of| of.note.clone());
                notes.collect::<Vec<_>>().join(",")
            };
            let histories = with_events(parts, line, events, 10);
            histories.into_iter().map(notes).collect::<Vec<_>>()
        };
        let once = || vec![reset(6, "a")];
        assert_eq!(replaced("serial_number = \"2\"", once()), ["", "a", ""]);
        assert_eq!(replaced("", once()), ["a", "a", ""]);
        // The newest of two counts, none that is to come, and none before the newest window.
        let several = vec![reset(4, "old"), reset(6, "a"), reset(8, "b"), reset(11, "later")];
        assert_eq!(replaced("", several), ["b", "b", ""]);
    }

    #[test]
    fn a_replacement_that_no_window_knows_of_is_told() {
        let entered = |points: &[(u64, f64, &str)], now_ns: u64| {
            let mut recording = part(None, &[]);
            for &(t_start_ns, used_h, replaced) in points {
                recording.history.add(Health {
                    t_start_ns,
                    ..Health::default()
                });
                recording.history.newest.add_rul(Rul {
                    operating_h: Some(used_h),
                    replaced: replaced.to_owned(),
                    ..Rul::default()
                });
            }
            let history = with_events(vec![recording], "", vec![reset(6, "a")], now_ns).remove(0);
            (history.replaced_since.len(), history.entered_since.len())
        };
        assert_eq!(entered(&[(5, 1.0, ""), (7, 2.0, "")], 10), (0, 1));
        // The windows went on after it, or began after it.
        assert_eq!(entered(&[(5, 1.0, ""), (7, 2.0, "gearbox"), (8, 3.0, "")], 10), (0, 0));
        assert_eq!(
            entered(&[(5, 1.0, ""), (7, 2.0, "motor"), (8, 3.0, "unit")], 10),
            (0, 0)
        );
        assert_eq!(entered(&[(7, 1.0, ""), (8, 2.0, "")], 10), (0, 0));
        // Windows from a clock ahead of now.
        assert_eq!(entered(&[(17, 1.0, ""), (18, 2.0, "")], 10), (0, 1));
        assert_eq!(entered(&[(5, 1.0, "")], 10), (1, 0));
    }
}
