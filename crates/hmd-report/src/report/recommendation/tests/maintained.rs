//! What still holds after a part was replaced, and over recordings that know nothing of each other.

use super::*;
use hmd_core::assess::OUTDATED;
use hmd_core::history::FELL;

use HealthState::{Critical, Nominal, Unknown, Warning, Watch};

/// A window with these states of friction, backlash and the others.
fn window(t_start_ns: u64, [friction, backlash, others]: [HealthState; 3], replaced: &str) -> Point {
    let mut states = [others; FaultId::COUNT];
    states[FaultId::Friction.index()] = friction;
    states[FaultId::Backlash.index()] = backlash;
    let worst = states.into_iter().max().unwrap();
    Point {
        window: t_start_ns,
        t_start_ns,
        health: worst.name().to_owned(),
        states,
        replaced: ReplacedPart::in_text(replaced).collect(),
        estimate: (others != Unknown).then(estimate),
        ..Point::default()
    }
}

/// A history of these windows, the newest with these states.
fn of_windows(points: Vec<Point>) -> History {
    let last = points.last().unwrap();
    let mut health = Health {
        health: last.health.clone(),
        ..Health::default()
    };
    health.set_states(&last.states);
    let mut history = History {
        points,
        ..History::default()
    };
    history.newest.add(health);
    history
}

#[test]
fn a_critical_friction_stays_in_doubt_until_a_window_shows_it() {
    let told = |points: Vec<Point>| {
        let found = of(&of_windows(points));
        let told =
            "Friction was critical and may still come from the bearings of the motor: check before the next use.";
        (found.action.contains(told), found.is_before_next_use)
    };
    let critical = || window(1, [Critical, Nominal, Nominal], "");
    let unknown = |t_ns: u64, replaced: &str| window(t_ns, [Unknown, Unknown, Unknown], replaced);
    assert_eq!(
        told(vec![critical(), unknown(2, "gearbox"), unknown(3, "")]),
        (true, true)
    );
    assert!(!told(vec![critical(), unknown(2, "gearbox"), unknown(3, "motor")]).0);
    assert!(!told(vec![critical(), unknown(2, "gearbox"), unknown(3, "unit")]).0);
    assert!(!told(vec![critical(), unknown(2, "gearbox"), window(3, [Nominal; 3], "")]).0);
    let warning = window(1, [Warning, Nominal, Nominal], "");
    assert!(!told(vec![warning, unknown(2, "gearbox")]).0);
    // By the remaining life, too.
    let mut by_life = window(1, [Watch, Nominal, Nominal], "");
    by_life.health = "critical".to_owned();
    assert!(!told(vec![by_life.clone(), unknown(2, "gearbox")]).0);
    by_life.ends_first = Some(FaultId::Friction);
    assert!(told(vec![by_life, unknown(2, "gearbox")]).0);
}

#[test]
fn a_state_holds_since_its_fault_was_first_in_it_over_recordings() {
    let worn = |t_ns: u64| window(t_ns, [Warning, Nominal, Nominal], "");
    let mut begins = window(3, [Unknown; 3], "");
    begins.begins_recording = true;
    // It begins to count its use anew, and knows nothing at first.
    let mut points = vec![window(1, [Nominal; 3], ""), worn(2), begins, worn(4)];
    for (point, used_h) in points.iter_mut().zip([1.0, 2.0, 0.0, 1.0]) {
        point.used_h = Some(used_h);
    }
    assert_eq!(of(&of_windows(points.clone())).since_ns, Some(2));
    points[2].replaced = vec![Some(ReplacedPart::Controller)];
    assert_eq!(of(&of_windows(points.clone())).since_ns, Some(2));
    for replaced in [Some(ReplacedPart::Gearbox), None] {
        points[2].replaced = vec![replaced];
        assert_eq!(of(&of_windows(points.clone())).since_ns, Some(4), "{replaced:?}");
    }
}

#[test]
fn a_fault_was_critical_by_its_life_before_it_was_by_its_damage() {
    let mut by_life = window(2, [Warning, Nominal, Nominal], "");
    by_life.health = "critical".to_owned();
    by_life.ends_first = Some(FaultId::Friction);
    let mut points = vec![
        window(1, [Warning, Nominal, Nominal], ""),
        by_life,
        window(3, [Critical, Nominal, Nominal], ""),
    ];
    assert_eq!(of(&of_windows(points.clone())).since_ns, Some(2));
    points[1].ends_first = Some(FaultId::Backlash);
    assert_eq!(of(&of_windows(points)).since_ns, Some(3));
}

/// A later recording that has no forecast is at watch by itself.
#[test]
fn a_state_by_a_forecast_of_before_has_its_time() {
    let mut by_life = window(2, [Watch, Nominal, Nominal], "");
    by_life.health = "critical".to_owned();
    by_life.ends_first = Some(FaultId::Friction);
    let points = vec![
        window(1, [Watch, Nominal, Nominal], ""),
        by_life,
        window(3, [Watch, Nominal, Nominal], ""),
    ];
    let mut history = of_windows(points);
    history.newest.health.health = "critical".to_owned();
    let rul = &mut history.newest.rul;
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(1.0), Some(2.0), Some(3.0));
    (rul.t_start_ns, rul.dominant_fault) = (2, "friction".to_owned());
    assert_eq!((of(&history).state, of(&history).since_ns), (Critical, Some(2)));
}

#[test]
fn an_actuator_stays_nominal_over_a_recording_that_knows_nothing_at_first() {
    let mut opening = window(3, [Unknown, Nominal, Nominal], "");
    opening.health = "unknown".to_owned();
    let mut points = vec![
        window(1, [Watch, Nominal, Nominal], ""),
        window(2, [Nominal; 3], ""),
        opening,
        window(4, [Nominal; 3], ""),
    ];
    // A doubt ends it.
    assert_eq!(of(&of_windows(points.clone())).since_ns, Some(4));
    points[2].begins_recording = true;
    assert_eq!(of(&of_windows(points)).since_ns, Some(2));
}

#[test]
fn the_time_of_a_state_is_not_that_of_another_part() {
    let points = vec![
        window(1, [Warning, Nominal, Nominal], ""),
        window(2, [Critical, Warning, Nominal], ""),
        window(3, [Critical, Warning, Nominal], ""),
    ];
    let mut history = of_windows(points);
    assert_eq!(of(&history).since_ns, Some(2));
    // Motor and its friction are others, the play of the gear is left.
    history.replaced_since = vec![replaced(ReplacedPart::Motor)];
    assert_eq!((of(&history).state, of(&history).since_ns), (Warning, Some(2)));
    history.replaced_since[0].part = None;
    assert_eq!((of(&history).state, of(&history).since_ns), (Unknown, None));
}

#[test]
fn what_hinders_is_to_be_found_before_the_next_use_after_a_replacement_too() {
    let unknown = |t_ns: u64, replaced: &str| window(t_ns, [Unknown; 3], replaced);
    let action = |points: Vec<Point>| of(&of_windows(points)).action;
    let shown = window(1, [Nominal; 3], "");
    let found = action(vec![shown, unknown(2, "unit"), unknown(3, "")]);
    assert!(found.ends_with(checks::CHECK_WHAT_HINDERS), "{found}");
    let found = action(vec![unknown(2, ""), unknown(3, "")]);
    assert!(found.ends_with(checks::CHECK_ALL), "{found}");
}

#[test]
fn a_repair_that_another_recording_knows_of_is_recorded() {
    let reason = format!("{FELL} (friction 0.01 ± 0.01 after warning): check");
    let asks = |replaced_ns: u64, part: &str| {
        let mut fell = window(3, [Nominal; 3], "");
        fell.reason.clone_from(&reason);
        let points = vec![
            window(replaced_ns, [Nominal; 3], part),
            window(1, [Warning, Nominal, Nominal], ""),
            fell,
        ];
        let mut history = of_windows(points);
        history.newest.fallen[FaultId::Friction.index()] = true;
        of(&history).has_checks
    };
    assert!(!asks(3, "gearbox") && !asks(2, "unit"));
    // Of another part, before the damage, or after it fell.
    assert!(asks(3, "controller") && asks(1, "gearbox") && asks(4, "gearbox"));
    // No event, but a calibration that is outdated.
    let mut fell = window(2, [Nominal; 3], "");
    fell.reason = format!("{reason}; {OUTDATED}");
    let mut history = of_windows(vec![window(1, [Warning, Nominal, Nominal], ""), fell]);
    history.newest.fallen[FaultId::Friction.index()] = true;
    assert!(!of(&history).has_checks);
}

#[test]
fn three_parts_are_listed_with_commas() {
    let mut history = of_windows(vec![window(1, [Nominal; 3], "")]);
    history.replaced_since = ReplacedPart::ALL.map(replaced).into();
    let found = of(&history).action;
    let at = "(1970-01-01 00:00 UTC, GB-78)";
    assert!(
        found.starts_with(&format!(
            "The motor {at}, the gearbox {at} and the controller {at} were replaced"
        )),
        "{found}"
    );
}
