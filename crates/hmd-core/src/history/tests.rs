use std::cell::Cell;
use std::sync::Arc;

use ema_models::ActuatorParams;

use super::*;
use crate::functional_check::{CHECK_LANES, RequirementCheck, UnmetRequirement};
use crate::sample::MeasuredConditions;
use crate::window::{Window, WindowQuality};

const HOUR_NS: u64 = 3_600_000_000_000;

/// A window of `ema0` that began after some hours, and the operating time shown by the frames.
fn job(config: &Config, number: u64, hours: f64, operating_s: f64) -> WindowJob {
    let actuator = config.actuator_named("ema0").expect("every number is watched").clone();
    WindowJob {
        params: actuator.params,
        actuator: Arc::new(actuator),
        window: Window {
            number,
            t_start_ns: 1_700_000_000_000_000_000 + (hours * HOUR_NS as f64) as u64,
            trigger: 0,
            samples: Vec::new(),
            expected: 0,
            quality: WindowQuality::Complete,
            lost: 0,
            rejected: 0,
            filled: Vec::new(),
            duplicates: 0,
            clock_jumps: 0,
            output_zero_rad: None,
        },
        conditions: MeasuredConditions::default(),
        operating_s,
    }
}

fn friction(damage: f64) -> DamageEvidence {
    let mut all = [0.0; FaultId::COUNT];
    all[0] = damage;
    DamageEvidence {
        damage: all,
        sigma: Some([0.003; FaultId::COUNT]),
    }
}

fn evidence<'a>(damage_evidence: Option<&'a DamageEvidence>, fit: &'a Fit) -> WindowEvidence<'a> {
    WindowEvidence {
        damage_evidence,
        fault: None,
        fit,
        unmet_requirement: None,
    }
}

fn config(rul: &str) -> Arc<Config> {
    Arc::new(Config::from_toml_str(&format!("[rul]\n{rul}"), "test").expect("a configuration"))
}

/// Friction that grows by 0.008 each 10 h, from window `from` to before `to`.
fn wear_out(histories: &mut HistoryStore, config: &Config, from: u64, to: u64) -> Vec<UnitAssessment> {
    (from..to)
        .map(|n| {
            let job = job(config, n, 10.0 * n as f64, 0.0);
            let history = histories
                .history_at(&job.actuator, job.window.t_start_ns)
                .expect("levels");
            history.update(
                &job,
                &evidence(Some(&friction(0.008 * n as f64)), &Fit::default()),
                config,
            )
        })
        .collect()
}

#[test]
fn a_wearing_unit_goes_through_all_states_in_order_and_its_end_is_predicted() {
    let config = config("hours = \"elapsed\"\nwarning_h = 300\ncritical_h = 100");
    let assessments = wear_out(&mut HistoryStore::new(config.clone()), &config, 0, 100);
    let mut states: Vec<HealthState> = assessments.iter().map(|t| t.state).collect();
    states.dedup();
    use HealthState::{Critical, Nominal, Warning, Watch};
    assert_eq!(states, [Nominal, Watch, Warning, Critical]);
    for (n, assessments) in assessments.iter().enumerate().skip(50) {
        let left = assessments.forecast.actuator.expect("a trend").hours;
        let truth = 1000.0 - 10.0 * n as f64;
        assert!(
            (left.p50 - truth).abs() <= 0.2 * truth,
            "window {n}: {left:?}, truth {truth}"
        );
    }
    assert!((assessments[99].used.hours - 990.0).abs() < 1e-6 && assessments[99].used.cycles.round() as u32 == 100);
}

#[test]
fn what_is_left_can_be_worse_than_the_damage() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000\ncritical_h = 100");
    let assessments = wear_out(&mut HistoryStore::new(config.clone()), &config, 0, 20);
    assert_eq!(assessments[19].health.state, HealthState::Watch);
    assert_eq!(assessments[19].state, HealthState::Warning);
}

#[test]
fn the_persistence_of_one_fault_does_not_delay_another() {
    let states = |text: &str| -> Vec<HealthState> {
        let config = config(text);
        let assessments = wear_out(&mut HistoryStore::new(config.clone()), &config, 0, 100);
        assessments.iter().map(|assessments| assessments.state).collect()
    };
    let rul = "hours = \"elapsed\"\nwarning_h = 300\ncritical_h = 100";
    let gain = format!("{rul}\n[health.fault.gain]\npersistence = 50");
    assert_eq!(states(&gain), states(rul), "friction alone grows");
    let friction = format!("{rul}\n[health.fault.friction]\npersistence = 50");
    assert_ne!(states(&friction), states(rul));
}

#[test]
fn operating_hours_follow_the_frames_and_dropped_windows_are_cycles() {
    let config = config("");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let mut used = |number, operating_s| {
        let job = job(&config, number, 0.0, operating_s);
        history.update(&job, &evidence(None, &Fit::default()), &config).used
    };
    assert!((used(0, 3600.0).hours - 1.0).abs() < 1e-12);
    // Two windows were dropped.
    let second = used(3, 7200.0);
    assert!((second.hours - 2.0).abs() < 1e-12 && (second.cycles - 4.0).abs() < 1e-12);
    // The source began anew.
    let third = used(0, 1800.0);
    assert!((third.hours - 2.5).abs() < 1e-12 && (third.cycles - 5.0).abs() < 1e-12);
}

#[test]
fn work_is_measured_and_others_count_as_the_mean() {
    let config = config("");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let fit = Fit {
        i_q_measured: vec![2.0; 1000],
        omega_measured: vec![-50.0; 1000],
        ..Fit::default()
    };
    // 1.5 × 0.9 Nm/A × 2 A × 50 rad/s for half a second.
    let expected = 1.5 * ActuatorParams::bench().motor.k * 2.0 * 50.0 * 0.5;
    let first = history
        .update(&job(&config, 0, 0.0, 1.0), &evidence(None, &fit), &config)
        .used
        .work_j;
    assert!((first / expected - 1.0).abs() < 1e-6, "{first} J");
    let second = history
        .update(&job(&config, 1, 0.0, 2.0), &evidence(None, &Fit::default()), &config)
        .used
        .work_j;
    assert!((second / expected - 2.0).abs() < 1e-6, "{second} J");
}

#[test]
fn a_maintenance_event_resets_the_history_once() {
    let config = config("hours = \"elapsed\"");
    let mut histories = HistoryStore::new(config.clone());
    let event = |hours: f64, actuator: &str| Event {
        t_ns: job(&config, 0, hours, 0.0).window.t_start_ns,
        actuator: actuator.to_owned(),
        event: EventKind::Reset,
        part: None,
        note: None,
    };
    histories.set_events(Events {
        list: vec![event(405.0, "ema0"), event(605.0, "ema1")],
        ..Events::default()
    });
    let assessments = wear_out(&mut histories, &config, 0, 100);
    assert!(assessments[40].forecast.actuator.is_ok());
    assert!(assessments[41].forecast.actuator.is_err() && assessments[41].used.cycles.round() as u32 == 1);
    assert!(
        assessments[99].forecast.actuator.is_ok(),
        "not again by another's event, nor by the same"
    );
    assert_eq!(histories.take_notices().len(), 1);
}

/// The unit that was replaced has had the operating hours before.
#[test]
fn a_new_unit_has_the_operating_hours_since_the_window_before_the_event() {
    let config = config("");
    let mut histories = HistoryStore::new(config.clone());
    let mut used = |number: u64| {
        let job = job(&config, number, number as f64, 3600.0 * (500 + number) as f64);
        let history = histories
            .history_at(&job.actuator, job.window.t_start_ns)
            .expect("levels");
        let used = history.update(&job, &evidence(None, &Fit::default()), &config).used;
        histories.set_events(Events {
            list: vec![Event {
                t_ns: self::job(&config, 0, 2.5, 0.0).window.t_start_ns,
                actuator: "ema0".to_owned(),
                event: EventKind::Reset,
                part: None,
                note: None,
            }],
            ..Events::default()
        });
        (used.hours, used.cycles)
    };
    let found: Vec<_> = (0..5).map(&mut used).collect();
    let expected = [(500.0, 1.0), (501.0, 2.0), (502.0, 3.0), (1.0, 1.0), (2.0, 2.0)];
    for ((hours, cycles), (of_hours, of_cycles)) in found.iter().zip(expected) {
        assert!(
            (hours - of_hours).abs() < 1e-9 && (cycles - of_cycles).abs() < 1e-9,
            "{found:?}"
        );
    }
}

#[test]
fn a_replaced_part_begins_its_faults_anew_once_and_the_rest_goes_on() {
    let config = config("hours = \"elapsed\"");
    let mut histories = HistoryStore::new(config.clone());
    let event = |hours: f64, part| Event {
        t_ns: job(&config, 0, hours, 0.0).window.t_start_ns,
        actuator: "ema0".to_owned(),
        event: EventKind::Reset,
        part: Some(part),
        note: Some("S/N 4711".to_owned()),
    };
    let events = |list| Events {
        list,
        ..Events::default()
    };
    histories.set_events(events(vec![event(405.0, ReplacedPart::Controller)]));
    let assessments = wear_out(&mut histories, &config, 0, 60);
    // What wears is friction: its trend goes on, and the hours too.
    assert!(assessments[41].forecast.actuator.is_ok() && (assessments[41].used.hours - 410.0).abs() < 1e-9);
    let replaced: Vec<_> = assessments.iter().map(|one| one.replaced.as_str()).collect();
    assert_eq!(replaced.iter().position(|what| !what.is_empty()), Some(41));
    assert_eq!((replaced[41], replaced[42]), ("controller", ""));

    let both = vec![
        event(405.0, ReplacedPart::Controller),
        event(605.0, ReplacedPart::Gearbox),
    ];
    histories.set_events(events(both.clone()));
    // The stored history knows which events it has followed.
    let mut again = HistoryStore::new(config.clone());
    again.restore("ema0", stored(&histories));
    again.set_events(events(both));
    let assessments = wear_out(&mut again, &config, 60, 100);
    let replaced = assessments.iter().filter(|one| !one.replaced.is_empty());
    assert_eq!(
        replaced.map(|one| one.replaced.as_str()).collect::<Vec<_>>(),
        ["gearbox"]
    );
    assert!(assessments[0].forecast.actuator.is_ok() && assessments[1].forecast.actuator.is_err());
    assert!((assessments[1].used.hours - 610.0).abs() < 1e-9 && assessments[39].forecast.actuator.is_ok());
    let expected = "ema0: gearbox replaced, its faults begin anew (friction, backlash): S/N 4711";
    assert_eq!(again.take_notices(), [expected]);
}

/// The technician's clock was in 1970, or behind the one before.
#[test]
fn an_event_recorded_later_counts_even_if_it_lies_earlier() {
    let config = config("hours = \"elapsed\"");
    let mut histories = HistoryStore::new(config.clone());
    let event = |t_ns: u64| Event {
        t_ns,
        actuator: "ema0".to_owned(),
        event: EventKind::Reset,
        part: None,
        note: None,
    };
    let first = event(job(&config, 0, 105.0, 0.0).window.t_start_ns);
    let list = |list| Events {
        list,
        ..Events::default()
    };
    histories.set_events(list(vec![first.clone()]));
    wear_out(&mut histories, &config, 0, 30);
    assert_eq!(histories.take_notices().len(), 1);
    histories.set_events(list(vec![event(3_600_000_000_000), first]));
    let assessments = wear_out(&mut histories, &config, 30, 60);
    assert!(assessments[0].forecast.actuator.is_err() && assessments[29].forecast.actuator.is_ok());
    assert_eq!(histories.take_notices().len(), 1, "once");
}

fn reset(t_ns: u64, part: Option<ReplacedPart>) -> Event {
    Event {
        t_ns,
        actuator: "ema0".to_owned(),
        event: EventKind::Reset,
        part,
        note: None,
    }
}

fn events(list: &[Event]) -> Events {
    Events {
        list: list.to_vec(),
        ..Events::default()
    }
}

/// The file lost a line, was another one or none for a while: what was followed is not followed again, and what is new is.
#[test]
fn a_file_of_events_that_lost_lines_hides_no_new_event() {
    let config = config("hours = \"elapsed\"");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    for part in [None, Some(ReplacedPart::Gearbox)] {
        let [first, second, third] = [105.0, 205.0, 405.0].map(|hours| reset(at(hours), part));
        let mut histories = HistoryStore::new(config.clone());
        histories.set_events(events(&[first.clone(), second.clone()]));
        wear_out(&mut histories, &config, 0, 30);
        assert_eq!(histories.take_notices().len(), 2);
        for list in [&[][..], &[first.clone(), second.clone()], std::slice::from_ref(&second)] {
            histories.set_events(events(list));
            let actuator = config.actuator_named("ema0").expect("watched");
            assert!(!histories.is_replaced(actuator, at(300.0)));
            wear_out(&mut histories, &config, 30, 32);
            assert!(histories.take_notices().is_empty());
        }
        let mut again = HistoryStore::new(config.clone());
        again.restore("ema0", stored(&histories));
        again.set_events(events(&[second, third]));
        let assessments = wear_out(&mut again, &config, 32, 60);
        let replaced = assessments.iter().position(|one| !one.replaced.is_empty());
        assert_eq!((replaced, again.take_notices().len()), (Some(9), 1));
    }
}

/// Files before this form had the number of events alone.
#[test]
fn an_older_file_has_followed_as_many_events_as_it_says() {
    let config = config("hours = \"elapsed\"");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    let list: Vec<Event> = [105.0, 205.0]
        .into_iter()
        .flat_map(|hours| [reset(at(hours), None), reset(at(hours), Some(ReplacedPart::Motor))])
        .collect();
    let mut histories = HistoryStore::new(config.clone());
    wear_out(&mut histories, &config, 0, 30);
    let mut history = serde_json::to_value(stored(&histories)).expect("numbers");
    let fields = history.as_object_mut().expect("fields");
    fields.remove("followed");
    for (unit, parts, replaced) in [(2, 2, ""), (1, 2, "unit"), (2, 1, "motor")] {
        let mut older = history.clone();
        let fields = older.as_object_mut().expect("fields");
        fields.insert("events_followed".to_owned(), unit.into());
        fields.insert("parts_followed".to_owned(), vec![parts, 0, 0].into());
        let mut again = HistoryStore::new(config.clone());
        again.restore("ema0", serde_json::from_value(older).expect("a history"));
        again.set_events(events(&list));
        let assessments = wear_out(&mut again, &config, 30, 33);
        assert_eq!(assessments[0].replaced, replaced);
        assert!(assessments[1..].iter().all(|one| one.replaced.is_empty()));
    }
}

#[test]
fn a_history_that_begins_has_followed_all_events_before_without_a_word() {
    let config = config("hours = \"elapsed\"");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    let old = [reset(at(5.0), None), reset(at(6.0), Some(ReplacedPart::Motor))];
    let mut histories = HistoryStore::new(config.clone());
    histories.set_events(events(&old));
    let assessments = wear_out(&mut histories, &config, 1, 10);
    assert!(assessments.iter().all(|one| one.replaced.is_empty()));
    assert!(histories.take_notices().is_empty());
    histories.set_events(events(&[&old[..], &[reset(at(100.0), None)]].concat()));
    assert_eq!(wear_out(&mut histories, &config, 11, 12)[0].replaced, "unit");
}

#[test]
fn elapsed_hours_do_not_jump_with_the_clock() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let mut hours = |number, t_start_ns| {
        let mut job = job(&config, number, 0.0, 0.0);
        job.window.t_start_ns = t_start_ns;
        history
            .update(&job, &evidence(None, &Fit::default()), &config)
            .used
            .hours
    };
    let begun = 1_700_000_000_000_000_000;
    // A clock without a battery, which is set after the second window.
    let shown = [
        3 * HOUR_NS,
        4 * HOUR_NS,
        begun,
        begun + HOUR_NS,
        5 * HOUR_NS,
        begun + 3 * HOUR_NS,
    ];
    for ((number, t_start_ns), expected) in (0..).zip(shown).zip([0.0, 1.0, 1.0, 2.0, 2.0, 4.0]) {
        let hours = hours(number, t_start_ns);
        assert!((hours - expected).abs() < 1e-9, "window {number}: {hours} h");
    }
}

#[test]
fn many_bad_lines_and_events_of_nobody_are_counted() {
    let mut histories = HistoryStore::new(config(""));
    let of_nobody: Vec<Event> = (0..1000)
        .map(|t_ns| Event {
            actuator: "nobody".to_owned(),
            ..reset(t_ns, None)
        })
        .collect();
    let all = Events {
        more_bad_lines: 7,
        ..events(&of_nobody)
    };
    for expected in [102, 0] {
        histories.set_events(all.clone());
        assert_eq!(histories.take_notices().len(), expected);
    }
}

/// The history of `ema0`, written and read again.
fn stored(histories: &HistoryStore) -> UnitHistory {
    let text = serde_json::to_string(histories.get("ema0").expect("a history")).expect("numbers");
    serde_json::from_str(&text).expect("a history")
}

#[test]
fn a_restored_history_continues_and_a_new_unit_begins_its_own() {
    let config = config("hours = \"elapsed\"");
    let in_one = wear_out(&mut HistoryStore::new(config.clone()), &config, 0, 60);
    let mut first = HistoryStore::new(config.clone());
    wear_out(&mut first, &config, 0, 30);
    let mut second = HistoryStore::new(config.clone());
    second.restore("ema0", stored(&first));
    let rest = wear_out(&mut second, &config, 30, 60);
    let [whole, kept] =
        [&in_one[59], &rest[29]].map(|assessments| assessments.forecast.actuator.expect("a trend").hours);
    assert_eq!(whole, kept);

    let other = stored(&second)
        .resumed(&config, Some("another".to_owned()))
        .expect("levels");
    assert_eq!(other.used, Odometer::default());
}

/// Whatever numbers a file holds: it is refused, or the history resumes.
#[test]
fn a_stored_history_with_any_number_in_it_does_not_stop_the_daemon() {
    fn numbers(value: &mut serde_json::Value) -> Vec<&mut serde_json::Value> {
        match value {
            serde_json::Value::Array(items) => items.iter_mut().flat_map(numbers).collect(),
            serde_json::Value::Object(items) => items.values_mut().flat_map(numbers).collect(),
            serde_json::Value::Number(_) => vec![value],
            _ => vec![],
        }
    }
    let config = config("hours = \"elapsed\"\nwarning_h = 100");
    let mut histories = HistoryStore::new(config.clone());
    wear_out(&mut histories, &config, 0, 12);
    let actuator = config.actuator_named("ema0").expect("watched");
    let history = serde_json::to_value(histories.history_at(actuator, 0).expect("levels")).expect("numbers");
    let count = numbers(&mut history.clone()).len();
    let (mut refused, mut taken) = (0, 0);
    // The first and the last fields, and of the laws, which are thousands, every so many.
    for n in (0..40).chain((40..count).step_by(97)).chain(count - 40..count) {
        for extreme in [
            "0",
            "1",
            "99",
            "-1",
            "18446744073709551615",
            "-9223372036854775808",
            "1e308",
            "-1e308",
            "1e-308",
        ] {
            let mut bad = history.clone();
            *numbers(&mut bad)[n] = serde_json::from_str(extreme).expect("a number");
            match serde_json::from_value::<UnitHistory>(bad)
                .ok()
                .filter(UnitHistory::is_possible)
            {
                None => refused += 1,
                Some(history) => {
                    taken += 1;
                    let mut history = history.resumed(&config, None).expect("levels");
                    for number in 12..20 {
                        let job = job(&config, number, 10.0 * number as f64, 0.0);
                        let damage_evidence = friction(0.05 * number as f64);
                        history.update(&job, &evidence(Some(&damage_evidence), &Fit::default()), &config);
                    }
                }
            }
        }
    }
    assert!(refused > 50 && taken > 50, "{refused} refused, {taken} taken");
}

/// A requirement that is missed from a friction of 0.5 on, and how often it was checked.
fn useless(trials: &Cell<u32>) -> impl Fn(&[FaultVector; CHECK_LANES]) -> [Option<UnmetRequirement>; CHECK_LANES] {
    |faults| {
        trials.set(trials.get() + 1);
        faults.map(|fault| (fault.friction >= 0.5).then_some(UnmetRequirement::SlewRate))
    }
}

/// The assessment after a window with this friction, where a requirement is checked.
fn tried_after(
    history: &mut UnitHistory,
    job: &WindowJob,
    damage: f64,
    trial: &RequirementCheck<'_>,
    config: &Config,
) -> UnitAssessment {
    let fault = FaultVector {
        friction: damage,
        ..FaultVector::NOMINAL
    };
    let evidence = WindowEvidence {
        damage_evidence: Some(&friction(damage)),
        fault: Some(&fault),
        fit: &Fit::default(),
        unmet_requirement: Some(trial),
    };
    history.update(job, &evidence, config)
}

#[test]
fn an_unmet_requirement_ends_the_life_before_the_damage_does() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    // Useless from a friction of 0.5 on: 625 h after the beginning instead of 1000 h.
    let trials = Cell::new(0);
    let useless = useless(&trials);
    for n in 0..70_u64 {
        let damage = 0.008 * n as f64;
        let assessments = tried_after(
            &mut history,
            &job(&config, n, 10.0 * n as f64, 0.0),
            damage,
            &useless,
            &config,
        );
        let Ok(left) = assessments.forecast.actuator else {
            continue;
        };
        let truth = (625.0 - 10.0 * n as f64).max(0.0);
        if n >= 20 {
            assert_eq!(
                assessments.limiting_criterion,
                LimitingCriterion::Function(UnmetRequirement::SlewRate)
            );
            assert!(
                (left.hours.p50 - truth).abs() <= 0.05 * truth + 5.0,
                "window {n}: {left:?}, truth {truth}"
            );
            assert!(left.hours.p10 <= left.hours.p50 && left.hours.p50 <= left.hours.p90);
            assert!(assessments.forecast.faults[0].expect("a trend").hours.p50 > left.hours.p50);
        }
    }
    assert!(trials.get() <= 2 * 70 / 3 + 2, "{} trials", trials.get());
    // A part that breaks ends the life with its second window: the first may be an outlier.
    let missed = LimitingCriterion::Function(UnmetRequirement::SlewRate);
    for damages in [
        &[0.9, 0.9, 0.9][..],
        &[0.0, 0.9, 0.9],
        &[0.9, 0.0, 0.0],
        &[0.0, 0.9, 0.0],
    ] {
        let mut fresh = UnitHistory::new(&config, None).expect("levels");
        let mut before = 0.0;
        for (n, damage) in (0..).zip(damages) {
            let assessments = tried_after(&mut fresh, &job(&config, n, n as f64, 0.0), *damage, &useless, &config);
            let is_missed = damage.min(before) > 0.5;
            let expected = if is_missed { missed } else { LimitingCriterion::Damage };
            assert_eq!(assessments.limiting_criterion, expected, "{damages:?}, window {n}");
            before = *damage;
        }
    }
}

#[test]
fn slow_wear_is_checked_every_eighth_window() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let trials = Cell::new(0);
    let useless = useless(&trials);
    for n in 0..240_u64 {
        let damage = 0.002 * n as f64;
        tried_after(
            &mut history,
            &job(&config, n, 10.0 * n as f64, 0.0),
            damage,
            &useless,
            &config,
        );
    }
    assert!(
        (40..=2 * 240 / 8 + 4).contains(&trials.get()),
        "{} trials",
        trials.get()
    );
}

/// As long as its state is unknown, a fault ends no life, whatever damage the windows find.
#[test]
fn an_uncertain_damage_ends_no_life_and_neither_raises_nor_clears_an_alarm_by_it() {
    let config = config("hours = \"elapsed\"\nwarning_h = 20\ncritical_h = 10");
    let uncertain = |damage: f64, sigma: f64| {
        let mut evidence = friction(damage);
        evidence.sigma.as_mut().expect("sigmas")[0] = sigma;
        evidence
    };
    let trials = Cell::new(0);
    let useless = useless(&trials);
    let assessed = |history: &mut UnitHistory, n: u64, evidence: &DamageEvidence| {
        let fault = FaultVector {
            friction: evidence.damage[0],
            ..FaultVector::NOMINAL
        };
        let evidence = WindowEvidence {
            damage_evidence: Some(evidence),
            fault: Some(&fault),
            fit: &Fit::default(),
            unmet_requirement: Some(&useless),
        };
        history.update(&job(&config, n, 10.0 * n as f64, 0.0), &evidence, &config)
    };
    for (damage, sigma) in [(1.0, 0.57), (0.54, 0.43), (0.85, 0.3), (0.7, 0.24)] {
        let mut history = UnitHistory::new(&config, None).expect("levels");
        for n in 0..12 {
            // That it grows is as uncertain.
            let found = uncertain(damage - 0.01 * (12 - n) as f64, sigma);
            let assessment = assessed(&mut history, n, &found);
            assert!(assessment.forecast.actuator.is_err(), "{damage} ± {sigma}, window {n}");
            assert_eq!(assessment.limiting_criterion, LimitingCriterion::Damage);
            assert_eq!(assessment.state, HealthState::Unknown);
        }
    }
    let mut history = UnitHistory::new(&config, None).expect("levels");
    for n in 0..4 {
        assessed(&mut history, n, &friction(0.9));
    }
    for n in 4..30 {
        let assessment = assessed(&mut history, n, &uncertain(0.2, 0.5));
        let left = assessment.forecast.actuator.expect("none left").hours;
        assert!(left.p50 <= 0.0, "{left:?}");
        assert_eq!(assessment.state, HealthState::Critical);
    }
}

#[test]
fn health_by_remaining_life_ends_with_the_growth() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000\ncritical_h = 10000");
    let mut histories = HistoryStore::new(config.clone());
    assert_eq!(
        wear_out(&mut histories, &config, 0, 20)[19].state,
        HealthState::Critical
    );
    let actuator = config.actuator_named("ema0").expect("watched");
    let mut states = Vec::new();
    // It was repaired, and nobody recorded it.
    for n in 20..40 {
        let history = histories.history_at(actuator, 0).expect("levels");
        let job = job(&config, n, 10.0 * n as f64, 0.0);
        let assessment = history.update(&job, &evidence(Some(&friction(0.0)), &Fit::default()), &config);
        states.push(assessment.state);
    }
    states.dedup();
    assert_eq!(states, [HealthState::Critical, HealthState::Nominal]);
}

#[test]
fn windows_that_were_not_assessed_raise_no_health() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000\n[health]\npersistence = 5");
    let mut histories = HistoryStore::new(config.clone());
    let worn = wear_out(&mut histories, &config, 0, 9);
    assert!(worn[8].forecast.actuator.is_ok() && worn[8].state < HealthState::Warning);
    let actuator = config.actuator_named("ema0").expect("watched");
    for n in 9..30 {
        let history = histories.history_at(actuator, 0).expect("levels");
        let job = job(&config, n, 10.0 * n as f64, 0.0);
        let assessment = history.update(&job, &evidence(None, &Fit::default()), &config);
        assert_eq!(assessment.state, worn[8].state, "window {n}");
    }
    let more = wear_out(&mut histories, &config, 30, 40);
    assert!(more.iter().any(|one| one.state == HealthState::Warning));
}

#[test]
fn another_part_leaves_the_alarm_by_remaining_life_as_it_is() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    for (part, state) in [
        (ReplacedPart::Controller, HealthState::Warning),
        (ReplacedPart::Gearbox, HealthState::Unknown),
    ] {
        let mut histories = HistoryStore::new(config.clone());
        wear_out(&mut histories, &config, 0, 20);
        histories.set_events(events(&[reset(at(195.0), Some(part))]));
        let actuator = config.actuator_named("ema0").expect("watched");
        let history = histories.history_at(actuator, at(200.0)).expect("levels");
        let job = job(&config, 20, 200.0, 0.0);
        let assessment = history.update(&job, &evidence(None, &Fit::default()), &config);
        assert_eq!(assessment.state, state, "{part:?}");
    }
}

#[test]
fn a_stamp_far_in_the_future_does_not_end_the_counting_of_elapsed_hours() {
    let config = config("hours = \"elapsed\"");
    let window = |hours: f64| job(&config, 0, hours, 0.0);
    let used = |histories: &mut HistoryStore, hours: f64| {
        let job = window(hours);
        let history = histories
            .history_at(&job.actuator, job.window.t_start_ns)
            .expect("levels");
        history
            .update(&job, &evidence(None, &Fit::default()), &config)
            .used
            .hours
    };
    let far = 700_000.0;
    let mut histories = HistoryStore::new(config.clone());
    let found = [0.0, far, 10.0, 12.0, 11.0, 13.0].map(|hours| used(&mut histories, hours) - far);
    let expected = [-far, 0.0, 0.0, 2.0, 2.0, 3.0];
    let near = |found: &[f64], expected: &[f64]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(&found, &expected), "{found:?}");
    let notices = histories.take_notices();
    assert_eq!(notices.len(), 1, "{notices:?}");
    assert!(
        notices[0].starts_with("ema0: the clock is 699990 h behind"),
        "{notices:?}"
    );

    // A new unit's hours count from its event on, whatever stamp was before.
    let mut histories = HistoryStore::new(config.clone());
    used(&mut histories, 0.0);
    used(&mut histories, far);
    histories.set_events(events(&[reset(window(20.0).window.t_start_ns, None)]));
    let found = [26.0, 27.0].map(|hours| used(&mut histories, hours));
    assert!(near(&found, &[6.0, 7.0]), "{found:?}");
}

#[test]
fn hours_of_another_kind_begin_anew_and_are_told() {
    let elapsed = config("hours = \"elapsed\"");
    let mut histories = HistoryStore::new(elapsed.clone());
    wear_out(&mut histories, &elapsed, 0, 60);
    for (hours, expected) in [("elapsed", 590.0), ("operating", 0.0)] {
        let config = config(&format!("hours = {hours:?}"));
        let mut again = HistoryStore::new(config.clone());
        again.restore("ema0", stored(&histories));
        let actuator = config.actuator_named("ema0").expect("watched");
        let history = again.history_at(actuator, 0).expect("levels");
        assert!(
            (history.used.hours - expected).abs() < 1e-6,
            "{hours}: {:?}",
            history.used
        );
        let is_kept = history.prognosis.forecast(1.0).actuator.is_ok();
        let notices = again.take_notices();
        assert_eq!(
            (is_kept, notices.len()),
            (hours == "elapsed", usize::from(hours != "elapsed"))
        );
    }
    // Older files did not say of which kind they were.
    let mut older = serde_json::to_value(stored(&histories)).expect("numbers");
    older.as_object_mut().expect("fields").remove("hours_of");
    let older: UnitHistory = serde_json::from_value(older).expect("a history");
    let resumed = older.resumed(&config(""), None).expect("levels");
    assert!(resumed.used.hours > 500.0 && resumed.notices.is_empty());
}

#[test]
fn windows_dropped_at_the_start_of_a_run_are_cycles() {
    let config = config("");
    let mut histories = HistoryStore::new(config.clone());
    let cycles = |histories: &mut HistoryStore, number| {
        let job = job(&config, number, 0.0, 0.0);
        let history = histories.history_at(&job.actuator, 0).expect("levels");
        let used = history.update(&job, &evidence(None, &Fit::default()), &config).used;
        used.cycles.round() as u64
    };
    let first = [0, 1, 3].map(|number| cycles(&mut histories, number));
    assert_eq!(first, [1, 2, 4]);
    histories.begin_run();
    let second = [1, 2].map(|number| cycles(&mut histories, number));
    assert_eq!(second, [6, 7], "the first was dropped");
    // The first of all, too.
    assert_eq!(cycles(&mut HistoryStore::new(config.clone()), 2), 3);
}

/// Damages that are ruled out at the level of warning, and of which none is significant, add to nothing.
#[test]
fn insignificant_damages_together_miss_no_requirement() {
    let config = config("hours = \"elapsed\"");
    let slow = |faults: &[FaultVector; CHECK_LANES]| {
        let is_missed = |fault: &FaultVector| fault.short_a + fault.short_b + fault.short_c > 0.1;
        faults.map(|fault| is_missed(&fault).then_some(UnmetRequirement::SlewRate))
    };
    for (sigma, expected) in [
        (0.06, LimitingCriterion::Damage),
        (0.01, LimitingCriterion::Function(UnmetRequirement::SlewRate)),
    ] {
        let mut history = UnitHistory::new(&config, None).expect("levels");
        let mut shorts = friction(0.0);
        for short in [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC] {
            shorts.damage[short.index()] = 0.06;
            shorts.sigma.as_mut().expect("sigmas")[short.index()] = sigma;
        }
        for n in 0..12 {
            let evidence = WindowEvidence {
                damage_evidence: Some(&shorts),
                fault: Some(&FaultVector::NOMINAL),
                fit: &Fit::default(),
                unmet_requirement: Some(&slow),
            };
            let found = history.update(&job(&config, n, 10.0 * n as f64, 0.0), &evidence, &config);
            assert!(n == 0 || found.limiting_criterion == expected, "± {sigma}, window {n}");
        }
    }
}

#[test]
fn operation_after_the_last_window_of_a_run_counts_also_in_a_run_without_any() {
    let config = config("");
    let mut histories = HistoryStore::new(config.clone());
    let used = |histories: &mut HistoryStore, operating_s: f64| {
        let job = job(&config, 0, 0.0, operating_s);
        let history = histories.history_at(&job.actuator, 0).expect("levels");
        let used = history.update(&job, &evidence(None, &Fit::default()), &config).used;
        used.hours
    };
    let end = |histories: &mut HistoryStore, operating_s: f64| {
        histories.end_run([("ema0", operating_s)].into_iter()).expect("levels");
        histories.begin_run();
    };
    end(&mut histories, 7200.0);
    assert!(
        histories.get("ema0").is_none(),
        "a history starts with the first window"
    );
    used(&mut histories, 3600.0);
    end(&mut histories, 10_800.0);
    // As a replay, and as a daemon that is started again.
    let mut again = HistoryStore::new(config.clone());
    again.restore("ema0", stored(&histories));
    for mut histories in [histories, again] {
        end(&mut histories, 1800.0);
        let hours = used(&mut histories, 3600.0);
        assert!((hours - 4.5).abs() < 1e-9, "{hours}");
    }
}
