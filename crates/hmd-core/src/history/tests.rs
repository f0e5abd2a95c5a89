mod life;
mod use_so_far;

use std::sync::Arc;

use ema_models::ActuatorParams;

use super::*;
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
fn a_new_unit_has_the_operating_hours_since_the_event() {
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
    let expected = [(500.0, 1.0), (501.0, 2.0), (502.0, 3.0), (0.5, 1.0), (1.5, 2.0)];
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
            assert!(histories.replacements_to_follow(actuator, at(300.0)).is_empty());
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

/// Parts of the unit before went with it; those of the new one were replaced since.
#[test]
fn a_part_that_was_replaced_after_the_unit_is_replaced_too() {
    let config = config("hours = \"elapsed\"");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    let controller = |hours: f64| reset(at(hours), Some(ReplacedPart::Controller));
    let gearbox = |hours: f64| reset(at(hours), Some(ReplacedPart::Gearbox));
    for (list, expected) in [
        (vec![reset(at(91.0), None), controller(92.0)], "unit,controller"),
        (vec![gearbox(91.0), reset(at(92.0), None)], "unit"),
        (
            vec![gearbox(91.0), reset(at(92.0), None), controller(93.0), controller(94.0)],
            "unit,controller",
        ),
    ] {
        let since_ns = list
            .iter()
            .filter(|event| event.part == Some(ReplacedPart::Controller))
            .map(|event| event.t_ns)
            .max();
        // A history that goes on, and one that begins.
        for (from, told) in [(0, expected), (10, "")] {
            let mut histories = HistoryStore::new(config.clone());
            wear_out(&mut histories, &config, from, 10);
            histories.set_events(events(&list));
            let assessments = wear_out(&mut histories, &config, 10, 12);
            assert_eq!([&*assessments[0].replaced, &*assessments[1].replaced], [told, ""]);
            // Of which no calibration from before tells anything.
            let history = histories.get("ema0").expect("a history");
            let text = serde_json::to_string(&history.sensors).expect("numbers");
            let of_link = since_ns.map(|since_ns| text.contains(&since_ns.to_string()));
            assert_ne!(of_link, Some(false), "{text}");
            let unit_ns = list.iter().find(|event| event.part.is_none()).map(|event| event.t_ns);
            assert_eq!(Some(history.begun_ns), unit_ns);
        }
    }
}

/// That part went with the unit before, however late the event is recorded; a clock that was never set tells no order.
#[test]
fn a_part_that_was_replaced_before_the_unit_resets_nothing_of_the_new_one() {
    let config = config("hours = \"elapsed\"");
    let unit_ns = job(&config, 0, 91.0, 0.0).window.t_start_ns;
    let motor = Some(ReplacedPart::Motor);
    let earlier_ns = unit_ns - 50 * HOUR_NS;
    for (motor_ns, replaced) in [(earlier_ns, ""), (HOUR_NS, "motor")] {
        let mut histories = HistoryStore::new(config.clone());
        wear_out(&mut histories, &config, 0, 10);
        histories.set_events(events(&[reset(unit_ns, None)]));
        let assessments = wear_out(&mut histories, &config, 10, 12);
        assert_eq!(assessments[0].replaced, "unit");
        histories.take_notices();
        histories.set_events(events(&[reset(motor_ns, motor), reset(unit_ns, None)]));
        let assessments = wear_out(&mut histories, &config, 12, 14);
        assert_eq!([&*assessments[0].replaced, &*assessments[1].replaced], [replaced, ""]);
        let notices = histories.take_notices();
        assert_eq!(notices.len(), 1, "{notices:?}");
        let is_told = notices[0].contains("motor replaced before the unit itself was: nothing begins anew");
        assert_eq!(is_told, replaced.is_empty(), "{notices:?}");
    }
}

#[test]
fn an_earlier_run_s_state_leaves_out_what_was_replaced_since() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    let mut histories = HistoryStore::new(config.clone());
    wear_out(&mut histories, &config, 0, 20);
    let state = |event: Option<Event>| {
        let mut again = HistoryStore::new(config.clone());
        again.restore("ema0", stored(&histories));
        again.set_events(events(event.as_slice()));
        let state = again.restored_states(at(300.0)).next().map(|(_, state)| state);
        state.map(|state| {
            (
                state.health,
                state.last_window.states.unwrap_or_default()[FaultId::Friction.index()],
            )
        })
    };
    let before = Some((HealthState::Warning, HealthState::Watch));
    assert_eq!(state(None), before);
    assert_eq!(state(Some(reset(at(250.0), Some(ReplacedPart::Controller)))), before);
    let unknown = Some((HealthState::Unknown, HealthState::Unknown));
    assert_eq!(state(Some(reset(at(250.0), Some(ReplacedPart::Gearbox)))), unknown);
    assert_eq!(state(Some(reset(at(250.0), None))), None);
    // One to come.
    assert_eq!(state(Some(reset(at(301.0), None))), before);
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

    let mut renamed = stored(&second);
    renamed.serial_number = Some("another".to_owned());
    let mut third = HistoryStore::new(config.clone());
    third.restore("ema0", renamed);
    wear_out(&mut third, &config, 60, 61);
    let told = "ema0: another unit by its serial number (another before, without a serial number now): its history begins anew";
    assert_eq!(third.take_notices(), [told]);
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

/// While a worn unit is not learnt every window says so.
#[test]
fn a_damage_that_stays_fallen_is_news_once() {
    let mut history = UnitHistory::new(&config(""), None).expect("levels");
    let mut is_told = |reason: &str| {
        let health = record::Health {
            reason: reason.to_owned(),
            ..record::Health::default()
        };
        let news = history.note_published(&health, &record::Rul::default());
        news.iter().any(|news| news.text.starts_with(FELL))
    };
    let fell = |what: &str| format!("2 samples lost; {FELL} ({what}): {FELL_ADVICE}");
    let friction = fell("friction 0.01 ± 0.01 after warning");
    let both = fell("friction 0.02 ± 0.01 after warning, short_a 0.00 ± 0.01 after critical");
    let told = ["", &friction, &friction, &both, &both, "", &friction].map(&mut is_told);
    assert_eq!(told, [false, true, false, true, false, false, true]);
}
