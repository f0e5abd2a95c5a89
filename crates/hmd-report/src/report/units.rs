//! Units behind one name: recordings of several airframes have actuators of the same name, and a recording that goes on after a unit was
//! replaced has two units one after the other.

use std::collections::BTreeMap;

use hmd_core::newest::Newest;

use super::history::History;

/// What stands between the name of an actuator and its serial number, where units have one name.
pub(super) const SERIAL: &str = ", serial ";

/// What one file says of one actuator, and the serial number that its writer's configuration had for it.
#[derive(Debug)]
pub(super) struct Part {
    /// Run that wrote it, where it is a segment of one.
    pub(super) run: Option<String>,
    pub(super) serial: Option<String>,
    pub(super) history: History,
}

/// The histories by name. Units that were used at the same times are different ones, each with its serial number in the name; of units one
/// after the other the history goes on.
pub(super) fn by_unit(parts: Vec<Part>) -> BTreeMap<String, History> {
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
        .map(|(name, recordings)| (name.clone(), joined(name, recordings)))
        .collect()
}

/// The history of a unit from its recordings: that with the newest window has the last word.
fn joined(actuator: String, mut recordings: Vec<Part>) -> History {
    recordings.sort_by_key(|recording| recording.history.newest.newest_ns());
    let mut whole = History {
        actuator,
        overlaps: Newest::overlap(recordings.iter().map(|recording| &recording.history.newest)),
        ..History::default()
    };
    let mut unit = None;
    for mut recording in recordings {
        let before = unit.clone();
        unit = recording.serial.or(unit);
        if before.is_some() && unit != before {
            recording.history.begin_unit();
        }
        whole.go_on(recording.history);
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::record::Health;

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
            run: None,
            serial: serial.map(str::to_owned),
            history,
        }
    }

    fn found(parts: Vec<Part>) -> Vec<(String, Vec<u64>)> {
        let times = |history: History| history.points.iter().map(|point| point.t_start_ns).collect();
        by_unit(parts)
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
            let history = by_unit(parts).remove("left").unwrap();
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
        let joined = |parts: Vec<Part>| by_unit(parts)["left"].newest.health.health.clone();
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
}
