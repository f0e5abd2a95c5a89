//! By when something is to be done.

use super::*;

const HOUR: u64 = 3_600_000_000_000;

/// Warning by friction of 40 % with this 10 % quantile of the hours left.
fn worn(p10_h: f64) -> History {
    let mut history = history(&["warning"], &[FaultId::Friction], [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let rul = &mut history.newest.rul;
    rul.dominant_fault = "friction".to_owned();
    rul.governed_by = "damage".to_owned();
    (rul.friction_p10_h, rul.friction_p50_h, rul.friction_p90_h) = (Some(p10_h), Some(p10_h), Some(p10_h));
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(p10_h), Some(p10_h), Some(p10_h));
    history
}

fn by(history: &History, critical_h: f64, are_levels_of_windows: bool) -> String {
    let rules = Rules::new(&[Levels::default(); FaultId::COUNT], critical_h, are_levels_of_windows);
    recommendation(history, &rules, &Zone::utc()).action
}

const PLAN: &str = "Plan the repair: bearings, gear and screw, to be done within";

#[test]
fn a_deadline_counts_from_the_window_that_showed_the_damage() {
    let silent = |p10_h: f64, hours_of: &str| {
        let mut history = worn(p10_h);
        history.newest.rul.hours_of = hours_of.to_owned();
        history.newest.rul.t_start_ns = 480 * HOUR;
        history.points.push(Point {
            window: 1,
            t_start_ns: 480 * HOUR,
            health: "warning".to_owned(),
            used_h: Some(480.0),
            ..Point::default()
        });
        by(&history, 0.0, true)
    };
    // Half of 480 h + 800 h are until critical.
    assert_eq!(
        silent(800.0, "operating"),
        format!("{PLAN} 160 h of operation: it may be critical then.")
    );
    assert_eq!(
        silent(800.0, "elapsed"),
        format!("{PLAN} 160 h of elapsed time, by 1970-01-27 15:59 UTC: it may be critical then.")
    );
    let at_once = "Repair before the next use: bearings, gear and screw. It may be critical in less than 1 h.";
    assert_eq!(silent(338.0, "operating"), at_once);
}

#[test]
fn a_forecast_of_an_earlier_recording_counts_from_its_own_window() {
    let mut history = worn(800.0);
    history.newest.rul.hours_of = "elapsed".to_owned();
    history.newest.rul.t_start_ns = HOUR;
    history.points[0].t_start_ns = HOUR;
    history.points.push(Point {
        t_start_ns: 101 * HOUR,
        estimate: Some(estimate()),
        health: "warning".to_owned(),
        ..Point::default()
    });
    // Shown at 0 h, predicted at 1 h, now 101 h: half of 801 h are until critical.
    let expected = format!("{PLAN} 299 h of elapsed time, by 1970-01-17 16:29 UTC: it may be critical then.");
    assert_eq!(by(&history, 0.0, true), expected);
}

#[test]
fn an_actuator_may_be_critical_by_the_hours_left_before_its_damage_is() {
    let of = |critical_h: f64| by(&worn(200.0), critical_h, true);
    assert_eq!(of(50.0), format!("{PLAN} 100 h of operation: it may be critical then."));
    assert_eq!(of(150.0), format!("{PLAN} 50 h of operation: it may be critical then."));
    assert!(of(200.0).starts_with("Repair before the next use"));
}

#[test]
fn without_the_levels_of_the_recording_nobody_knows_when_it_is_critical() {
    let expected = "Plan the repair: bearings, gear and screw, at the next scheduled maintenance at the latest, for want of a forecast by its own \
                    levels (-c CONFIG).";
    assert_eq!(by(&worn(200.0), 0.0, false), expected);
    assert!(by(&worn(0.5), 0.0, false).starts_with("Repair before the next use"));
}

#[test]
fn a_requirement_that_is_missed_is_laid_on_no_part() {
    let of = |left_h: f64, critical_h: f64| {
        let mut history = worn(430.0);
        let rul = &mut history.newest.rul;
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(left_h), Some(left_h), Some(left_h));
        rul.governed_by = "stall".to_owned();
        by(&history, critical_h, true)
    };
    let part = format!("{PLAN} 215 h of operation: it may be critical then.");
    let missed = "Inspect before the next use: the actuator misses the requirement stall of its specification.";
    assert_eq!(of(0.0, 0.0), format!("{part} {missed}"));
    let later =
        "Inspect the actuator within 50 h of operation: it may miss the requirement stall of its specification then.";
    assert_eq!(of(50.0, 0.0), format!("{part} {later}"));
    let critical = "Inspect the actuator within 20 h of operation: it may be critical by the requirement stall of its specification then.";
    assert_eq!(of(50.0, 30.0), format!("{part} {critical}"));
    // Nor is a state by the remaining life.
    let mut history = critical_by_life();
    history.newest.rul.governed_by = "stall".to_owned();
    let action = by(&history, 0.0, true);
    assert!(
        action.starts_with("Repair before the next use: actuator. Inspect at the next scheduled maintenance: bearings"),
        "{action}"
    );
}
