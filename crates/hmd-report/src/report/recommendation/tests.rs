use super::super::history::Point;
use super::*;
use hmd_core::catalogue::catalogue;
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
        newest: (health, Rul::default()),
        ..History::default()
    };
    report(&mut history, faults);
    history
}

/// Gives the newest window the states of its damages, as far as the faults are reported.
fn report(history: &mut History, faults: &[FaultId]) {
    let health = &mut history.newest.0;
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
    history.shown.update(health);
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
    recommendation(
        history,
        &catalogue(&[Levels::default(); FaultId::COUNT]).fault_modes,
        &Zone::utc(),
    )
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
    let well = of(&history(&["nominal"], &[], [0.0; FaultId::COUNT]));
    assert_eq!((well.faults, &*well.action), (Vec::new(), "No action."));
}

#[test]
fn a_suspected_sensor_is_to_be_checked_and_the_last_known_state_stays() {
    let mut history = history(&["nominal", "critical"], &[FaultId::Backlash], [0.7; FaultId::COUNT]);
    history.points[1].estimate = None;
    history.newest.0.set_faults(&[]);
    history.newest.0.suspects = vec!["frozen current".to_owned(), "phase gain".to_owned(), "?".to_owned()];
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
        history.newest.0.health = state.to_owned();
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
fn a_replaced_part_leaves_the_faults_of_the_others_with_their_own_level() {
    use FaultId::{Backlash, Gain};
    let mut history = history(&["critical"], &[Backlash, Gain], [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.1]);
    history.replaced_since = vec![replaced(ReplacedPart::Gearbox)];
    let expected = "Inspect at the next scheduled maintenance: position controller. The gearbox (1970-01-01 00:00 UTC, GB-78) was replaced \
                    after the last window: the next actuation shows its health.";
    // The hours are those of what is left, not of the gearbox.
    history.newest.1.dominant_fault = "backlash".to_owned();
    let rul = &mut history.newest.1;
    (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(0.0), Some(0.1), Some(0.2));
    let found = of(&history);
    assert_eq!((found.faults, &*found.action), (vec![Gain], expected));
    history
        .newest
        .0
        .set_damage([0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.4].map(Some));
    report(&mut history, &[Backlash, Gain]);
    let found = of(&history).action;
    assert!(
        found.starts_with("Plan the repair: position controller, at the next scheduled")
            && found.contains("The gearbox ("),
        "{found}"
    );
    // A trend that nobody reports is no reason to go on with a repair.
    report(&mut history, &[Backlash]);
    history.newest.1.dominant_fault = "gain".to_owned();
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
    history.newest.1.dominant_fault = "friction".to_owned();
    let found = of(&history);
    assert_eq!(found.action, "Repair before the next use: bearings, gear and screw.");
}

#[test]
fn a_repair_is_planned_within_the_life_that_nine_of_ten_have() {
    let mut history = history(&["warning"], &[FaultId::Backlash], [0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut with = |p10: f64| {
        let rul = &mut history.newest.1;
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(p10), Some(2.0 * p10), Some(3.0 * p10));
        of(&history)
    };
    let planned = with(90.0);
    assert_eq!(
        planned.action,
        "Plan the repair: gear and screw, within 45 h of operation: it may be critical then."
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
        let rul = &mut history.newest.1;
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
    history.newest.0.set_states(&states);
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
fn a_reset_begins_a_new_since() {
    let mut history = history(&["watch", "watch", "watch"], &[FaultId::Gain], [0.1; FaultId::COUNT]);
    history.points[2].used_h = Some(0.0);
    assert_eq!(of(&history).since_ns, Some(2));
}

#[test]
fn a_replaced_actuator_is_unknown_and_promises_no_hours() {
    let worn = [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.1];
    let mut history = history(&["critical"], &[FaultId::Backlash, FaultId::Gain], worn);
    history.newest.1.dominant_fault = "backlash".to_owned();
    let rul = &mut history.newest.1;
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
}

#[test]
fn a_motor_that_did_not_turn_is_to_be_checked_at_once() {
    let mut history = history(&["nominal", "nominal"], &[], [0.0; FaultId::COUNT]);
    history.points[1].estimate = None;
    history.newest.0.reason = format!("not excited: gain; {}", hmd_core::assess::LOCKED);
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

#[test]
fn a_damage_that_fell_without_a_repair_asks_for_its_record() {
    let mut history = history(&["warning", "nominal"], &[], [0.0; FaultId::COUNT]);
    history.fallen[FaultId::Friction.index()] = true;
    let found = of(&history);
    let expected =
        "A damage fell without a recorded repair: record the maintenance with hmd event, or check the sensors.";
    assert_eq!((found.action.as_str(), found.has_checks), (expected, true));
}
