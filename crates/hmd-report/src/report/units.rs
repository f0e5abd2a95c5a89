//! Units behind one name: recordings of several airframes have actuators of the same name, and a recording that goes on after a unit was
//! replaced has two units one after the other.

use std::collections::BTreeMap;

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
pub(super) fn by_unit(mut parts: Vec<Part>) -> BTreeMap<String, History> {
    in_order_of_time(&mut parts);
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
    // The segments of a run first: their states continue each other.
    let mut runs: BTreeMap<String, Vec<Part>> = BTreeMap::new();
    for part in parts {
        let name = match &part.serial {
            Some(serial) if is_shared(&part.history.actuator) => format!("{}{SERIAL}{serial}", part.history.actuator),
            _ => part.history.actuator.clone(),
        };
        let runs = runs.entry(name).or_default();
        match runs.last_mut() {
            Some(before) if part.run.is_some() && before.run == part.run => before.history.continue_run(part.history),
            _ => runs.push(part),
        }
    }
    let whole = |(name, runs): (String, Vec<Part>)| {
        let mut whole = History {
            actuator: name.clone(),
            ..History::default()
        };
        let mut unit = None;
        for mut part in runs {
            let before = unit.clone();
            unit = part.serial.or(unit);
            if before.is_some() && unit != before {
                part.history.begin_unit();
            }
            whole.go_on(part.history);
        }
        (name, whole)
    };
    runs.into_iter().map(whole).collect()
}

/// Recordings in the order of their first windows; the segments of a run stay as they are, whatever its clock did.
fn in_order_of_time(parts: &mut [Part]) {
    let first = |part: &Part| part.history.points.first().map_or(u64::MAX, |point| point.t_start_ns);
    let mut begun: BTreeMap<String, u64> = BTreeMap::new();
    for part in &*parts {
        if let Some(run) = &part.run {
            let begins = begun.entry(run.clone()).or_insert(u64::MAX);
            *begins = first(part).min(*begins);
        }
    }
    let begins = |part: &Part| part.run.as_ref().map_or_else(|| first(part), |run| begun[run]);
    parts.sort_by_key(begins);
}

#[cfg(test)]
mod tests {
    use super::super::history::Point;
    use super::*;

    fn part(serial: Option<&str>, times: &[u64]) -> Part {
        let point = |&t_start_ns| Point {
            t_start_ns,
            ..Point::default()
        };
        Part {
            run: None,
            serial: serial.map(str::to_owned),
            history: History {
                actuator: "left".to_owned(),
                points: times.iter().map(point).collect(),
                ..History::default()
            },
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
    fn segments_of_a_run_continue_each_other_and_another_recording_holds_where_they_are_silent() {
        use hmd_core::health::HealthState::{self, Critical, Nominal, Unknown};
        let segment = |run: Option<&str>, t_start_ns: u64, state: HealthState| {
            let mut part = part(None, &[]);
            part.run = run.map(str::to_owned);
            let mut health = hmd_core::record::Health {
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
