mod deadlines;
mod maintained;

use super::super::history::Point;
use super::*;
use hmd_core::health::Levels;
use hmd_core::history::ReplacedPart;
use hmd_core::record::{Estimate, Health, Rul};

fn history(states: &[&str], faults: &[FaultId], damages: [f64; FaultId::COUNT]) -> History {
    let points = states.iter().enumerate().map(|(n, state)| Point {
        window: n as u64,
        t_start_ns: n as u64,
        health: (*state).to_owned(),
        used_h: Some(n as f64),
        estimate: Some(estimate()),
        ..Point::default()
    });
    let mut health = Health {
        health: states.last().map_or_else(String::new, |state| (*state).to_owned()),
        ..Health::default()
    };
    health.set_damage(damages.map(Some));
    health.set_faults(faults);
    let mut history = History {
        points: points.collect(),
        ..History::default()
    };
    history.newest.add(health);
    report(&mut history, faults);
    history
}

/// Gives the newest window the states of its damages, as far as the faults are reported.
fn report(history: &mut History, faults: &[FaultId]) {
    let health = &mut history.newest.health;
    let damages = health.damages();
    let levels = Levels::default();
    let states = FaultId::ALL.map(|fault| match damages[fault.index()] {
        _ if health.health == "unknown" => HealthState::Unknown,
        Some(damage) if faults.contains(&fault) && damage >= levels.critical => HealthState::Critical,
        Some(damage) if faults.contains(&fault) && damage >= levels.warning => HealthState::Warning,
        _ if faults.contains(&fault) => HealthState::Watch,
        _ => HealthState::Nominal,
    });
    health.set_faults(faults);
    health.set_states(&states);
    history.newest.shown.update(health);
}

fn replaced(part: ReplacedPart) -> Replacement {
    Replacement {
        part: Some(part),
        t_ns: 0,
        note: "GB-78".to_owned(),
    }
}

fn estimate() -> Estimate {
    Estimate {
        k: [0.0; 8],
        sigma: [None; 8],
        observable: [true; 8],
    }
}

fn of(history: &History) -> Recommendation {
    recommendation(history, &Rules::default(), &Zone::utc())
}

#[test]
fn the_worst_part_is_named_with_the_action_of_the_catalogue() {
    use FaultId::{Backlash, Friction};
    let worn = [0.4, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0];
    let found = of(&history(
        &["nominal", "warning", "critical", "critical"],
        &[Friction, Backlash],
        worn,
    ));
    assert_eq!(found.faults, [Backlash, Friction]);
    assert_eq!(
        found.action,
        "Repair before the next use: gear and screw. Plan the repair: bearings, gear and screw, at the next scheduled \
         maintenance at the latest, for want of a forecast."
    );
    assert_eq!(found.since_ns, Some(2));
    // The gear is a part of what the friction's action names.
    let rough = [0.7, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0];
    let found = of(&history(&["nominal", "critical"], &[Friction, Backlash], rough));
    assert_eq!(found.action, "Repair before the next use: bearings, gear and screw.");
    let well = of(&history(&["nominal"], &[], [0.0; FaultId::COUNT]));
    assert_eq!((well.faults, &*well.action), (Vec::new(), "No action."));
}

#[test]
fn a_suspected_sensor_is_to_be_checked_and_the_last_known_state_stays() {
    let mut history = history(&["nominal", "critical"], &[FaultId::Backlash], [0.7; FaultId::COUNT]);
    history.points[1].estimate = None;
    history.newest.health.set_faults(&[]);
    history.newest.health.suspects = vec!["frozen current".to_owned(), "phase gain".to_owned(), "?".to_owned()];
    let found = of(&history);
    assert_eq!(
        found.action,
        "Repair before the next use: gear and screw. Check the phase current sensors of the drive and their wiring, before any part."
    );
    let expected = Unassessed {
        windows: 1,
        since_ns: 1,
    };
    assert_eq!(found.unassessed, Some(expected));
    for (state, expected) in [
        (
            "nominal",
            "Check the phase current sensors of the drive and their wiring, before any part.",
        ),
        (
            "unknown",
            "Nothing is known yet. Check the phase current sensors of the drive and their wiring, before any part.",
        ),
    ] {
        history.newest.health.health = state.to_owned();
        report(&mut history, &[]);
        assert_eq!(of(&history).action, expected);
    }
}

#[test]
fn a_part_replaced_after_the_last_window_is_not_to_be_repaired_again() {
    let worn = [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut history = history(&["critical"], &[FaultId::Backlash], worn);
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    let expected = "The gearbox (1970-01-01 00:00 UTC, GB-78) was replaced after the last window: the next actuation shows its health.";
    assert_eq!(of(&history).action, expected);
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox), replaced(ReplacedPart::Motor)];
    let expected = "The gearbox (1970-01-01 00:00 UTC, GB-78) and the motor (1970-01-01 00:00 UTC, GB-78) were replaced after the last window: the next actuation shows their health.";
    assert_eq!(of(&history).action, expected);
    // Another part takes nothing away.
    history.replaced_since = vec![replaced(ReplacedPart::Controller)];
    let found = of(&history);
    assert!(
        found.action.starts_with(
            "Repair before the next use: gear and screw. The controller (1970-01-01 00:00 UTC, GB-78) was replaced"
        ),
        "{}",
        found.action
    );
}

#[test]
fn friction_may_come_from_what_was_not_replaced() {
    use ReplacedPart::{Gearbox, Motor};
    let mut worn = history(&["critical"], &[FaultId::Friction], [0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let with = |history: &mut History, parts: &[ReplacedPart]| {
        history.replaced_since = parts.iter().map(|part| replaced(*part)).collect();
        let found = of(history);
        let left = found.action.split_once("health.").map_or("", |(_, rest)| rest.trim());
        (found.state, left.to_owned(), found.is_before_next_use)
    };
    let check =
        |what: &str| format!("Friction was critical and may still come from {what}: check before the next use.");
    let unknown = HealthState::Unknown;
    assert_eq!(with(&mut worn, &[Motor]), (unknown, check("gear and screw"), true));
    assert_eq!(
        with(&mut worn, &[Gearbox]),
        (unknown, check("the bearings of the motor"), true)
    );
    assert_eq!(with(&mut worn, &[Motor, Gearbox]), (unknown, String::new(), false));
    // By the remaining life, too; below critical the next actuation is soon enough.
    assert_eq!(
        with(&mut critical_by_life(), &[Motor]),
        (unknown, check("gear and screw"), true)
    );
    let mut worn = history(&["warning"], &[FaultId::Friction], [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(with(&mut worn, &[Motor]), (unknown, String::new(), false));
}

#[test]
fn a_replacement_that_was_entered_late_is_told_beside_the_state() {
    let mut history = history(&["critical"], &[FaultId::Backlash], [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0]);
    history.entered_since = vec![replaced(ReplacedPart::Gearbox)];
    let expected = "Repair before the next use: gear and screw. The gearbox (1970-01-01 00:00 UTC, GB-78) is entered as replaced, but these \
                    windows were assessed before that: hmd replay of the logs, or the next movement of a running hmd, takes it over.";
    assert_eq!(of(&history).action, expected);
}

#[test]
fn a_replaced_part_leaves_the_faults_of_the_others_with_their_own_level() {
    use FaultId::{Backlash, Gain};
    let mut history = history(&["critical"], &[Backlash, Gain], [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.1]);
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    let expected = "Inspect at the next scheduled maintenance: position controller. The gearbox (1970-01-01 00:00 UTC, GB-78) was replaced \
                    after the last window: the next actuation shows its health.";
    // The hours are those of what is left, not of the gearbox.
    history.newest.rul.dominant_fault = "backlash".to_owned();
    let rul = &mut history.newest.rul;
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(0.0), Some(0.1), Some(0.2));
    let found = of(&history);
    assert_eq!((found.faults, &*found.action), (vec![Gain], expected));
    history
        .newest
        .health
        .set_damage([0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.4].map(Some));
    report(&mut history, &[Backlash, Gain]);
    let found = of(&history).action;
    assert!(
        found.starts_with("Plan the repair: position controller, at the next scheduled")
            && found.contains("The gearbox ("),
        "{found}"
    );
    // A trend that nobody reports is no reason to go on with a repair.
    let rul = &mut history.newest.rul;
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(10.0), Some(20.0), Some(30.0));
    report(&mut history, &[Backlash]);
    history.newest.rul.dominant_fault = "gain".to_owned();
    assert!(of(&history).action.starts_with("The gearbox ("));
}

#[test]
fn no_action_is_never_said_of_windows_that_could_not_be_assessed() {
    let mut well = history(&["nominal"; 3], &[], [0.0; FaultId::COUNT]);
    for expected in [
        "No action.",
        "Nothing before the next actuation.",
        checks::CHECK_WHAT_HINDERS,
    ] {
        assert_eq!(of(&well).action, expected);
        well.points
            .iter_mut()
            .rfind(|point| point.estimate.is_some())
            .unwrap()
            .estimate = None;
    }
    // A known fault stays, and what hinders is to be found as well.
    let mut worn = history(&["warning"; 2], &[FaultId::Gain], [0.4; FaultId::COUNT]);
    for point in &mut worn.points {
        point.estimate = None;
    }
    let expected = format!(
        "Plan the repair: position controller, at the next scheduled maintenance at the latest, for want of a \
         forecast. {}",
        checks::CHECK_WHAT_HINDERS
    );
    assert_eq!(of(&worn).action, expected);
}

#[test]
fn a_state_by_the_remaining_life_names_the_part_that_ends_it() {
    let mut history = history(&["critical"], &[], [0.04; FaultId::COUNT]);
    // By the newest forecast that there was: a record without hours names the largest damage.
    for (fault, p10) in [("friction", Some(9.0)), ("short_a", None)] {
        history.newest.add_rul(Rul {
            dominant_fault: fault.to_owned(),
            rul_p10_h: p10,
            ..Rul::default()
        });
        let found = of(&history);
        assert_eq!(found.action, "Repair before the next use: bearings, gear and screw.");
    }
    history.replaced_since = vec![replaced(ReplacedPart::Controller)];
    assert_eq!(of(&history).state, HealthState::Critical);
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    assert_eq!(of(&history).state, HealthState::Unknown);
}

#[test]
fn a_repair_is_planned_within_the_life_that_nine_of_ten_have() {
    let mut history = history(&["warning"], &[FaultId::Backlash], [0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut with = |p10: f64| {
        let rul = &mut history.newest.rul;
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(p10), Some(2.0 * p10), Some(3.0 * p10));
        of(&history)
    };
    let planned = with(90.0);
    assert_eq!(
        planned.action,
        "Plan the repair: gear and screw, to be done within 45 h of operation: it may be critical then."
    );
    assert_eq!(planned.life_left(), "180 h (90 h … 270 h)");
    let urgent = with(0.002);
    assert_eq!(
        urgent.action,
        "Repair before the next use: gear and screw. It may be critical in less than 1 h."
    );
    assert_eq!(urgent.life_left(), "less than 1 min");
}

#[test]
fn an_inspection_is_due_within_the_life_that_nine_of_ten_have() {
    let mut history = history(&["watch"], &[FaultId::Gain], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1]);
    let mut with = |p10: f64, hours_of: &str| {
        let rul = &mut history.newest.rul;
        rul.hours_of = hours_of.to_owned();
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(p10), Some(2.0 * p10), Some(3.0 * p10));
        of(&history).action
    };
    let found = with(90.0, "elapsed");
    let expected = "Inspect at the next scheduled maintenance: position controller, at the latest within 64 h of elapsed time, by \
                    1970-01-03 16:17 UTC: it may be critical then.";
    assert_eq!(found, expected);
    let found = with(0.002, "operating");
    let expected = "Inspect before the next use: position controller. It may be critical in less than 1 h.";
    assert_eq!(found, expected);
}

#[test]
fn a_part_that_no_window_has_shown_is_not_called_well() {
    let mut history = history(&["unknown"], &[], [0.0; FaultId::COUNT]);
    let mut states = [HealthState::Nominal; FaultId::COUNT];
    states[0] = HealthState::Unknown;
    history.newest.health.set_states(&states);
    let found = of(&history);
    assert_eq!(found.unknown, [FaultId::Friction]);
    assert!(
        found.action.starts_with("Not everything is known yet"),
        "{}",
        found.action
    );
}

#[test]
fn an_actuator_is_nominal_again_since_its_last_fault() {
    let history = history(
        &["nominal", "critical", "watch", "nominal", "nominal"],
        &[],
        [0.0; FaultId::COUNT],
    );
    assert_eq!(of(&history).since_ns, Some(3));
}

#[test]
fn a_replaced_actuator_is_unknown_and_promises_no_hours() {
    let worn = [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.1];
    let mut history = history(&["critical"], &[FaultId::Backlash, FaultId::Gain], worn);
    history.newest.rul.dominant_fault = "backlash".to_owned();
    let rul = &mut history.newest.rul;
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(1.0), Some(2.0), Some(3.0));
    (rul.gain_p10_h, rul.gain_p50_h, rul.gain_p90_h) = (Some(10.0), Some(20.0), Some(30.0));
    // The gearbox alone: the hours are those of the controller.
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    let found = of(&history);
    assert_eq!(
        (found.state, found.ends_first),
        (HealthState::Watch, Some(FaultId::Gain))
    );
    assert_eq!(found.hours_left, Ok([10.0, 20.0, 30.0]));
    history.replaced_since[0].part = None;
    let found = of(&history);
    assert_eq!((found.state, found.faults.len()), (HealthState::Unknown, 0));
    assert_eq!(found.hours_left, Err(REPLACED.to_owned()));
    assert!(found.action.starts_with("The actuator ("), "{}", found.action);
    // Nothing ended it where there was no forecast.
    history.newest.rul = Rul {
        dominant_fault: "backlash".to_owned(),
        reason: "no trend yet".to_owned(),
        ..Rul::default()
    };
    assert_eq!(of(&history).hours_left, Err(PART_REPLACED.to_owned()));
    history.replaced_since.clear();
    assert_eq!(of(&history).hours_left, Err("no trend yet".to_owned()));
}

#[test]
fn a_motor_that_did_not_turn_is_to_be_checked_at_once() {
    let mut history = history(&["nominal", "nominal"], &[], [0.0; FaultId::COUNT]);
    history.points[1].estimate = None;
    history.newest.health.reason = format!("not excited: gain; {}", hmd_core::assess::LOCKED);
    assert_eq!(of(&history).action, checks::CHECK_FOR_A_JAM);
}

#[test]
fn a_drifting_sensor_is_to_be_checked_before_any_part() {
    let mut history = history(&["nominal"], &[], [0.0; FaultId::COUNT]);
    history.sensors.drifting = vec!["current_sum_a".to_owned(), "dc_link_v".to_owned()];
    let found = of(&history);
    assert_eq!(
        found.action,
        "Check the phase current sensors of the drive and their wiring; the sensor of the DC link voltage, before any part."
    );
    assert!(found.has_checks);
}

/// Recordings of one window each, where two in a row must show a level.
#[test]
fn a_level_that_no_recording_is_long_enough_for_is_told() {
    let worn = [0.71, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut history = history(&["nominal"; 3], &[], worn);
    for point in &mut history.points {
        point.begins_recording = true;
        point.estimate.as_mut().unwrap().k[0] = 0.71;
    }
    let action = |history: &History, persistence: u32| {
        let levels = Levels {
            persistence,
            ..Levels::default()
        };
        let rules = Rules::new(&[levels; FaultId::COUNT], 0.0, true);
        recommendation(history, &rules, &Zone::utc()).action
    };
    let expected = "Friction counts as critical once 2 windows in a row show it, so far 1: replay the logs as one.";
    assert_eq!(action(&history, 2), expected);
    assert_eq!(action(&history, 1), "No action.");
    // By other levels than those of the windows the damage has its level at once; where they are not higher nothing is said.
    let by_page = |watch: f64| {
        let levels = Levels {
            watch,
            warning: watch + 0.1,
            critical: watch + 0.2,
            ..Levels::default()
        };
        let rules = Rules::new(&[levels; FaultId::COUNT], 0.0, false);
        recommendation(&history, &rules, &Zone::utc()).action
    };
    let expected = "Friction is at watch by the levels of this page, but the files were recorded with others: replay the logs with this configuration.";
    assert_eq!(
        (by_page(0.7).as_str(), by_page(0.75).as_str()),
        (expected, "No action.")
    );
    // One that is long enough decides by itself.
    history.points[1].begins_recording = false;
    history.points[2].begins_recording = false;
    assert_eq!(action(&history, 2), "No action.");
    let expected = "Friction counts as critical once 4 windows in a row show it, so far 3: move the actuator again, and look at this page then.";
    assert_eq!(action(&history, 4), expected);
    // Another window of the recording shows less.
    history.points[1].estimate.as_mut().unwrap().k[0] = 0.0;
    let expected = "Friction counts as critical once 2 windows in a row show it, so far 1: move the actuator again, and look at this page \
                    then.";
    assert_eq!(action(&history, 2), expected);
}

#[test]
fn a_damage_that_fell_without_a_repair_asks_for_its_record() {
    let mut history = history(&["warning", "nominal"], &[], [0.0; FaultId::COUNT]);
    history.newest.fallen[FaultId::Friction.index()] = true;
    let found = of(&history);
    let expected =
        "A damage fell without a recorded repair: record the maintenance with hmd event, or check the sensors.";
    assert_eq!((found.action.as_str(), found.has_checks), (expected, true));
    history.entered_since = vec![replaced(ReplacedPart::Controller)];
    assert!(of(&history).has_checks);
    history.entered_since = vec![replaced(ReplacedPart::Gearbox)];
    assert!(!of(&history).has_checks, "it is entered now");
}

/// At watch by friction, with 200 h left: critical where `critical_h` is more.
fn critical_by_life() -> History {
    let mut history = history(
        &["critical"],
        &[FaultId::Friction],
        [0.54, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    let mut states = [HealthState::Nominal; FaultId::COUNT];
    states[FaultId::Friction.index()] = HealthState::Watch;
    history.newest.health.set_states(&states);
    let rul = &mut history.newest.rul;
    rul.dominant_fault = "friction".to_owned();
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(200.0), Some(250.0), Some(300.0));
    history
}

#[test]
fn a_fault_at_watch_by_damage_and_critical_by_life_is_to_be_repaired() {
    let mut history = critical_by_life();
    let found = of(&history);
    assert_eq!(
        (found.state, &*found.faults),
        (HealthState::Critical, &[FaultId::Friction][..])
    );
    assert_eq!(found.action, "Repair before the next use: bearings, gear and screw.");
    // Another fault at watch does not take its place.
    let mut states = [HealthState::Nominal; FaultId::COUNT];
    states[FaultId::Gain.index()] = HealthState::Watch;
    history.newest.health.set_states(&states);
    let expected = "Repair before the next use: bearings, gear and screw. Inspect at the next scheduled maintenance: position controller.";
    assert_eq!(of(&history).action, expected);
    // Since the first window in this state, whatever was reported before.
    history.points = super::tests::history(&["warning", "critical", "critical"], &[], [0.0; FaultId::COUNT]).points;
    history.points[2].faults = vec!["friction".to_owned()];
    assert_eq!(of(&history).since_ns, Some(1));
    // Nor where no fault ends the life.
    history.newest.rul.dominant_fault.clear();
    let action = of(&history).action;
    assert!(action.starts_with("Repair before the next use: actuator. "), "{action}");
}

#[test]
fn a_part_that_does_not_end_the_life_takes_no_state_by_life_with_it() {
    let mut history = critical_by_life();
    history.replaced_since = vec![replaced(ReplacedPart::Controller)];
    let found = of(&history);
    assert_eq!(found.state, HealthState::Critical);
    assert!(
        found
            .action
            .starts_with("Repair before the next use: bearings, gear and screw. The controller ("),
        "{}",
        found.action
    );
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    let found = of(&history);
    assert_eq!(found.state, HealthState::Unknown);
    assert!(found.action.starts_with("The gearbox ("), "{}", found.action);
}

#[test]
fn no_action_is_never_said_beside_a_life_of_less_than_an_hour() {
    let mut history = history(&["nominal"], &[], [0.0; FaultId::COUNT]);
    let mut with = |hours: f64, governed_by: &str, dominant: &str| {
        let rul = &mut history.newest.rul;
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(hours), Some(hours), Some(hours));
        (rul.governed_by, rul.dominant_fault) = (governed_by.to_owned(), dominant.to_owned());
        let found = of(&history);
        (found.action, found.is_before_next_use)
    };
    let missed = "Inspect before the next use: the actuator misses the requirement slew rate of its specification.";
    assert_eq!(with(0.0, "slew_rate", "friction"), (missed.to_owned(), true));
    let soon = "Inspect before the next use: the actuator may miss the requirement stall of its specification in less than 1 h.";
    assert_eq!(with(0.5, "stall", "friction"), (soon.to_owned(), true));
    let part = "Inspect before the next use: bearings, gear and screw. Its life may end in less than 1 h.";
    assert_eq!(with(0.5, "damage", "friction"), (part.to_owned(), true));
    assert_eq!(with(5.0, "stall", "friction"), ("No action.".to_owned(), false));
    // Beside another worn part, too.
    history.newest.health.health = "watch".to_owned();
    report(&mut history, &[FaultId::Gain]);
    history.newest.rul.rul_p10_h = Some(0.5);
    history.newest.rul.governed_by = "damage".to_owned();
    let expected = format!("Inspect at the next scheduled maintenance: position controller. {part}");
    assert_eq!(of(&history).action, expected);
    history.newest.health.health = "nominal".to_owned();
    report(&mut history, &[]);
    // What misses it was replaced.
    history.newest.rul.governed_by = "stall".to_owned();
    history.newest.rul.rul_p10_h = Some(0.0);
    history.newest.rul.dominant_fault = "friction".to_owned();
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    assert!(of(&history).action.starts_with("The gearbox ("));
}

#[test]
fn what_was_replaced_since_is_not_to_be_checked() {
    let mut history = history(&["nominal", "nominal"], &[], [0.0; FaultId::COUNT]);
    history.sensors.drifting = vec!["dc_link_v".to_owned()];
    history.newest.health.suspects = vec!["frozen current".to_owned(), "frozen encoder".to_owned()];
    history.points[1].is_suspected = true;
    let with = |history: &mut History, part: Option<ReplacedPart>| {
        history.replaced_since = vec![Replacement {
            part,
            t_ns: 0,
            note: String::new(),
        }];
        let found = of(history);
        let checks = found.action.split_once("health.").map_or("", |(_, rest)| rest.trim());
        (checks.to_owned(), found.suspected_since_ns)
    };
    let encoder = "Check the output encoder and its wiring, before any part.".to_owned();
    assert_eq!(with(&mut history, Some(ReplacedPart::Controller)), (encoder, Some(1)));
    assert_eq!(with(&mut history, None), (String::new(), None));
    // A jam goes with motor or gear.
    history.newest.health.suspects.clear();
    history.sensors.drifting.clear();
    history.points[1].estimate = None;
    history.newest.health.reason = hmd_core::assess::LOCKED.to_owned();
    assert_eq!(
        with(&mut history, Some(ReplacedPart::Controller)).0,
        checks::CHECK_FOR_A_JAM
    );
    assert_eq!(with(&mut history, Some(ReplacedPart::Gearbox)).0, "");
}

#[test]
fn parts_without_a_forecast_have_a_sentence_of_their_own() {
    use FaultId::{Backlash, Gain};
    let mut history = history(&["warning"], &[Backlash, Gain], [0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.4]);
    let rul = &mut history.newest.rul;
    rul.dominant_fault = "backlash".to_owned();
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(90.0), Some(180.0), Some(270.0));
    assert_eq!(
        of(&history).action,
        "Plan the repair: gear and screw, to be done within 45 h of operation: it may be critical then. Plan the repair: position controller, at the next \
         scheduled maintenance at the latest, for want of a forecast."
    );
}
