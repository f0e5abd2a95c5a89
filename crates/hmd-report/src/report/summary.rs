//! What a mechanic reads first: the recommendation.

use std::fmt::Write;

use ema_models::FaultId;
use hmd_core::assess::LOCKED;
use hmd_core::counted::counted;
use hmd_core::health::HealthState;
use hmd_core::history::{FELL, ReplacedPart};
use hmd_core::learning::NOT_LEARNT;
use hmd_core::record::{Rul, SensorReading};
use hmd_core::sensor_checks::Suspect;
use hmd_core::sensor_health::SensorQuantity;

use super::clock_doubt::clock_sentence;
use super::doubt::{in_doubt, is_shown_before};
use super::history::{History, Unassessed, hours_of, is_elapsed};
use super::plot::escaped;
use super::recommendation::{Recommendation, drifting};
use super::words::{duration, durations, percent_of, with_capital};
use super::zone::Zone;

/// Part and serial number, number of windows and the time they span.
pub(super) fn period(history: &History, zone: &Zone) -> String {
    let Some([first, last]) = history.period_ns() else {
        return String::new();
    };
    let identity = match &*history.identity {
        "" => String::new(),
        identity => format!("{}<br>", escaped(&with_capital(identity))),
    };
    format!(
        "<p class=\"faint\">{identity}{} from {} to {}</p>\n",
        counted(history.points.len() as u64, "window", "windows"),
        zone.minute(first),
        zone.minute(last)
    )
}

/// What stands in the box of a unit whose recordings overlap in time.
const OVERLAP: &str = "Recordings overlap in time: they are of several units, or of one twice. The newest window counts; serial_number in \
                       the configuration tells units apart, and of one twice leave one out.";

/// State, what to do, since when, and how long the actuator lasts.
pub(super) fn headline(advice: &Recommendation, history: &History, zone: &Zone) -> String {
    let state = advice.state.name();
    let mut text = format!(
        "<p class=\"assessment {state}\"><strong>{state}</strong><br>{}",
        escaped(&advice.action)
    );
    if !advice.faults.is_empty() {
        let found = advice.faults.iter().map(|fault| with_damage(history, *fault));
        let found = found.collect::<Vec<_>>().join(", ");
        let _ = write!(
            text,
            " {}: {}.",
            if advice.faults.len() > 1 { "Faults" } else { "Fault" },
            escaped(&found)
        );
    }
    if history.overlaps {
        let _ = write!(text, "<br>{OVERLAP}");
    }
    if let Some(doubts) = clock_sentence(&history.clock_doubts, zone) {
        let _ = write!(text, "<br>{}", escaped(&doubts));
    }
    if let Some(since) = advice.since_ns {
        let _ = write!(text, "<br>{} since {}.", with_capital(state), zone.minute(since));
    }
    text += &of_newest_windows(advice, history, zone);
    if let Some(since) = advice.suspected_since_ns {
        let _ = write!(text, "<br>Sensors suspected since {}.", zone.minute(since));
    }
    let drifting = drifting(history);
    if !drifting.is_empty() {
        let names: Vec<&str> = drifting.into_iter().map(SensorQuantity::name).collect();
        let of = |reading: &&SensorReading| names.contains(&&*reading.quantity);
        let levels = history.sensors.quantities.iter().filter(of);
        let level = levels.map(|reading| HealthState::named(&reading.level)).max();
        let level = level.unwrap_or_else(|| HealthState::named(&history.sensors.level));
        let _ = write!(text, "<br>Drift of sensors {level}: {}.", escaped(&names.join(", ")));
    }
    if advice.unknown.len() < FaultId::COUNT {
        text += &not_known(advice, history, zone);
    }
    if let Some(by_life) = state_by_life(advice, history, zone) {
        let _ = write!(text, "<br>{by_life}");
    }
    let _ = writeln!(text, "<br>{}</p>", escaped(&remaining_life(advice, history, zone)));
    text
}

/// Why the newest windows were not assessed, or what is wrong with the last one; nothing of another unit than the one that is in place.
fn of_newest_windows(advice: &Recommendation, history: &History, zone: &Zone) -> String {
    let health = &history.newest.health;
    if history.replaced_since.iter().any(|of| of.part.is_none()) {
        return String::new();
    }
    if let Some(Unassessed { windows, since_ns }) = advice.unassessed {
        let which = match windows {
            1 => "The newest window could not be assessed".to_owned(),
            _ => format!(
                "The newest {windows} windows, since {}, could not be assessed",
                zone.minute(since_ns)
            ),
        };
        let reason = if health.reason.is_empty() { "" } else { ": " };
        return format!("<br>{which}{reason}{}.", escaped(&first_what_hinders(&health.reason)));
    }
    let reason = left_of_reason(history);
    if reason.is_empty() {
        return String::new();
    }
    format!(
        "<br>The newest window is {}: {}.",
        escaped(&health.status),
        escaped(&reason)
    )
}

/// The faults that no window has shown, and those that a window put in doubt, since when and why. What was replaced has its own sentence.
fn not_known(advice: &Recommendation, history: &History, zone: &Zone) -> String {
    let (mut never, mut not_since, mut text) = (Vec::new(), Vec::new(), String::new());
    let is_left = |fault: &&FaultId| !history.is_replaced_since(**fault);
    for fault in advice.unknown.iter().filter(is_left) {
        match in_doubt(history, *fault) {
            None if is_shown_before(history, *fault) => not_since.push(fault.plain_name()),
            None => never.push(fault.plain_name()),
            Some(point) => {
                let reason = if point.reason.is_empty() { "" } else { ": " };
                let _ = write!(
                    text,
                    "<br>In doubt since {}: {}{reason}{}.",
                    zone.minute(point.t_start_ns),
                    fault.plain_name(),
                    escaped(&point.reason)
                );
            }
        }
    }
    let mut sentence = String::new();
    for (what, faults) in [
        ("No window has shown", never),
        ("No window has shown since the replacement", not_since),
    ] {
        if !faults.is_empty() {
            let _ = write!(sentence, "<br>{what}: {}.", faults.join(", "));
        }
    }
    sentence + &text
}

/// A fault with its damage.
fn with_damage(history: &History, fault: FaultId) -> String {
    let damage = history
        .newest
        .shown
        .of(fault)
        .map(|shown| format!(" {}", percent_of(shown.damage)));
    format!("{}{}", fault.plain_name(), damage.unwrap_or_default())
}

/// The reason of a window, a motor that does not turn first.
fn first_what_hinders(reason: &str) -> String {
    let (first, then): (Vec<&str>, Vec<&str>) = reason.split("; ").partition(|part| part.contains(LOCKED));
    [first, then].concat().join("; ")
}

/// The reason of the newest window without what asks for the record of a replacement that was entered since.
fn left_of_reason(history: &History) -> String {
    let entered = || history.replaced_since.iter().chain(&history.entered_since);
    let is_new = |fault: FaultId| entered().any(|of| ReplacedPart::renews(of.part, fault));
    let is_new_unit = entered().any(|of| of.part.is_none());
    let answers = |part: &str| {
        let named = |fault: &FaultId| part.contains(&format!("{} at ", fault.name()));
        let mut worn = FaultId::ALL.into_iter().filter(named).peekable();
        is_new_unit || worn.peek().is_some() && worn.all(is_new)
    };
    let replaced = || history.replaced_since.iter().filter_map(|of| of.part);
    let is_gone = |suspect: &Suspect| replaced().any(|part| part.suspects().contains(suspect));
    let doubts_what_is_gone = |part: &str| {
        let suspect = part.split_once(": ").and_then(|(name, _)| Suspect::from_name(name));
        suspect.as_ref().is_some_and(is_gone)
    };
    let asks = |part: &&str| {
        doubts_what_is_gone(part)
            || part.starts_with(NOT_LEARNT) && answers(part)
            || part.starts_with(FELL) && entered().next().is_some() && !history.has_fallen()
    };
    let reason = &history.newest.health.reason;
    let left: Vec<&str> = reason.split("; ").filter(|part| !asks(part)).collect();
    left.join("; ")
}

/// Why the state is worse than that of every fault.
fn state_by_life(advice: &Recommendation, history: &History, zone: &Zone) -> Option<String> {
    let worst = history.states().into_iter().max().unwrap_or_default();
    let is_worse = advice.state > worst && advice.state >= HealthState::Watch;
    let state = with_capital(advice.state.name());
    is_worse.then(|| match &advice.hours_left {
        Ok(_) => format!("{state} by the short remaining life."),
        Err(_) => {
            let predicted = history.points.iter().rfind(|point| point.left_h.is_some());
            let when = predicted.map_or_else(String::new, |point| format!(" on {}", zone.minute(point.t_start_ns)));
            format!(
                "{state} by the short remaining life that was predicted last{when}: this holds until another forecast says more, \
                 later windows show no growth, or a repair is recorded."
            )
        }
    })
}

/// The forecast in one or two sentences that do not contradict the action.
fn remaining_life(advice: &Recommendation, history: &History, zone: &Zone) -> String {
    let rul = &history.newest_left().rul;
    let of = hours_of(rul);
    let [p10, p50, p90] = match &advice.hours_left {
        Ok(left) => durations(*left),
        Err(reason) => return format!("Remaining life: no number ({reason})."),
    };
    let mut text = if p10 == p90 {
        format!("Remaining life, to the end of life: {p50}{of}")
    } else {
        format!(
            "Remaining life, to the end of life: nine of ten such actuators last {p10}{of}, half of them {p50}, one of ten {p90}"
        )
    };
    match (&advice.requirement, advice.ends_first) {
        (Some(requirement), _) => {
            let _ = write!(text, "; the requirement {requirement} ends it first");
        }
        (None, Some(fault)) => {
            let _ = write!(text, "; {} ends it first", fault.plain_name());
        }
        (None, None) => {}
    }
    let without = without_forecast(advice, rul);
    if !without.is_empty() {
        let names: Vec<&str> = without.iter().map(|fault| fault.plain_name()).collect();
        let _ = write!(text, "; without {}, of which there is no forecast", names.join(" and "));
    }
    let newest = history.points.last().map(|point| point.t_start_ns);
    if newest.is_some_and(|newest| rul.t_start_ns != 0 && newest != rul.t_start_ns) {
        let _ = write!(
            text,
            "; predicted {}, later files have no forecast",
            zone.minute(rul.t_start_ns)
        );
    }
    if let Some(operation) = little_operation(history) {
        let _ = write!(text, "; {operation}");
    }
    if advice.state == HealthState::Critical {
        text += ". These hours are a forecast; they do not permit another use.";
        return text;
    }
    let is_recorded = advice
        .ends_first
        .is_some_and(|fault| fault.name() == rul.dominant_fault);
    let is_of_all = is_recorded && without.is_empty();
    if let (Some(probability), Some(horizon), true) = (rul.failure_probability, rul.horizon_h, is_of_all) {
        let _ = write!(text, "; it ends within {horizon:.0} h with {}", percent(probability));
    }
    text + "."
}

/// Worn faults that the remaining life knows nothing of: they may end it earlier.
fn without_forecast(advice: &Recommendation, rul: &Rul) -> Vec<FaultId> {
    let left = rul.faults();
    let is_open = |fault: &&FaultId| left[fault.index()].is_none() && Some(**fault) != advice.ends_first;
    advice.faults.iter().filter(is_open).copied().collect()
}

/// Share of the time that the windows span below which their operation is told: logs of single movements hold little of it.
const LITTLE_OPERATION: f64 = 0.01;

/// How much operation the windows hold, where hours are of operation and these are a small part of the time.
fn little_operation(history: &History) -> Option<String> {
    if is_elapsed(&history.newest.rul) {
        return None;
    }
    // A recording whose hours are those of the clock tells nothing of the operation.
    let of_operation = history.points.iter().filter(|point| !point.is_elapsed);
    let times = of_operation.clone().map(|point| point.t_start_ns);
    let span_h = (times.clone().max()? - times.min()?) as f64 / 3.6e12;
    // Use counts from before the first window; a history that begins anew counts from zero.
    let used: Vec<f64> = of_operation.filter_map(|point| point.used_h).collect();
    let grown = |pair: &[f64]| if pair[1] < pair[0] { pair[1] } else { pair[1] - pair[0] };
    let used_h: f64 = used.windows(2).map(grown).sum();
    (used_h < LITTLE_OPERATION * span_h).then(|| {
        let (used, span) = (duration(used_h), duration(span_h));
        format!("hours of operation, of which the windows hold {used} within {span}; rul.hours = \"elapsed\" counts those of the clock")
    })
}

/// A probability in words that never say impossible or certain.
fn percent(probability: f64) -> String {
    match 100.0 * probability {
        p if p < 0.1 => "less than 0.1 % probability".to_owned(),
        p if p > 99.9 => "more than 99.9 % probability".to_owned(),
        p => format!("{p:.1} % probability"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::history::{Point, Replacement};
    use super::super::recommendation::recommendation;
    use super::super::rules::Rules;
    use super::*;
    use crate::report::clock_doubt::ClockDoubt;
    use hmd_core::record::Health;

    fn advice(state: HealthState) -> Recommendation {
        Recommendation {
            state,
            faults: vec![FaultId::Friction],
            action: "Act.".to_owned(),
            hours_left: Ok([90.0, 100.0, 110.0]),
            ends_first: Some(FaultId::Friction),
            requirement: None,
            since_ns: Some(0),
            suspected_since_ns: None,
            unassessed: None,
            unknown: Vec::new(),
            has_checks: false,
            is_before_next_use: false,
        }
    }

    fn predicted(rul: Rul) -> History {
        let mut history = History::default();
        history.newest.add_rul(rul);
        history
    }

    #[test]
    fn a_worn_part_without_a_forecast_is_not_in_the_remaining_life() {
        let mut rul = Rul {
            failure_probability: Some(0.0),
            horizon_h: Some(10.0),
            dominant_fault: "short_b".to_owned(),
            ..Rul::default()
        };
        rul.set_faults(FaultId::ALL.map(|fault| (fault == FaultId::ShortB).then_some(([90.0, 100.0, 110.0], 0.0))));
        let history = predicted(rul);
        let advice = Recommendation {
            faults: vec![FaultId::Friction, FaultId::ShortB],
            ends_first: Some(FaultId::ShortB),
            ..advice(HealthState::Warning)
        };
        let text = remaining_life(&advice, &history, &Zone::utc());
        assert!(
            text.contains("without friction, of which there is no forecast"),
            "{text}"
        );
        assert!(!text.contains("probability"), "{text}");
    }

    #[test]
    fn a_critical_state_has_no_probability_beside_it() {
        let rul = Rul {
            failure_probability: Some(0.0),
            horizon_h: Some(10.0),
            dominant_fault: "friction".to_owned(),
            ..Rul::default()
        };
        let history = predicted(rul);
        let critical = headline(&advice(HealthState::Critical), &history, &Zone::utc());
        assert!(
            !critical.contains("ends within") && critical.contains("do not permit"),
            "{critical}"
        );
        let watch = headline(&advice(HealthState::Watch), &history, &Zone::utc());
        assert!(watch.contains("less than 0.1 % probability"), "{watch}");
    }

    #[test]
    fn a_state_by_a_forecast_that_was_withdrawn_says_so() {
        let history = History {
            points: vec![
                Point {
                    left_h: Some([1.0, 2.0, 3.0]),
                    ..Point::default()
                },
                Point {
                    t_start_ns: 3_600_000_000_000,
                    ..Point::default()
                },
            ],
            ..History::default()
        };
        let mut advice = advice(HealthState::Critical);
        let of = |advice: &Recommendation| state_by_life(advice, &history, &Zone::utc()).unwrap_or_default();
        assert_eq!(of(&advice), "Critical by the short remaining life.");
        advice.hours_left = Err("a new trend begins".to_owned());
        assert_eq!(
            of(&advice),
            "Critical by the short remaining life that was predicted last on 1970-01-01 00:00 UTC: this holds until another forecast says \
             more, later windows show no growth, or a repair is recorded."
        );
    }

    #[test]
    fn recordings_that_overlap_have_the_time_of_all_and_a_sentence() {
        let point = |t_start_ns: u64| Point {
            t_start_ns,
            ..Point::default()
        };
        let minute = 60_000_000_000;
        let mut history = History {
            points: [3, 59, 2, 82].map(|n| point(n * minute)).to_vec(),
            ..History::default()
        };
        let text = |history: &History| {
            let advice = advice(HealthState::Watch);
            period(history, &Zone::utc()) + &headline(&advice, history, &Zone::utc())
        };
        assert!(text(&history).contains("4 windows from 1970-01-01 00:02 UTC to 1970-01-01 01:22 UTC"));
        assert!(!text(&history).contains(OVERLAP));
        history.overlaps = true;
        assert!(text(&history).contains(OVERLAP));
        history.clock_doubts = vec![
            ClockDoubt::Ahead {
                file: "b.mcap".to_owned(),
                t_ns: 60 * minute,
            },
            ClockDoubt::Far {
                files: ["c.mcap", "b.mcap"].map(str::to_owned),
                days: 1599,
            },
            ClockDoubt::Step {
                file: "d.mcap".to_owned(),
                t_ns: [60 * minute, 0],
            },
        ];
        let expected = "Recordings stand in the order of their time stamps: b.mcap ends 1970-01-01 01:00 UTC, after the present; 1599 days lie \
                        between c.mcap and b.mcap; d.mcap steps from 1970-01-01 01:00 UTC to 1970-01-01 00:00 UTC, and hours and dates of a \
                        forecast may be wrong by that.";
        assert!(text(&history).contains(expected), "{}", text(&history));
    }

    #[test]
    fn a_fault_in_doubt_is_not_one_that_no_window_has_shown() {
        let point = |n: u64, friction: HealthState, reason: &str| {
            let mut states = [HealthState::Nominal; FaultId::COUNT];
            (states[0], states[1]) = (friction, HealthState::Unknown);
            Point {
                window: n,
                t_start_ns: n * 60_000_000_000,
                states,
                reason: reason.to_owned(),
                ..Point::default()
            }
        };
        let mut history = History {
            points: vec![
                point(0, HealthState::Nominal, ""),
                point(1, HealthState::Unknown, "too uncertain: friction"),
                point(2, HealthState::Unknown, ""),
            ],
            ..History::default()
        };
        let of = |history: &History| {
            let advice = Recommendation {
                unknown: vec![FaultId::Friction, FaultId::Backlash],
                ..advice(HealthState::Unknown)
            };
            not_known(&advice, history, &Zone::utc())
        };
        assert_eq!(
            of(&history),
            "<br>No window has shown: backlash.<br>In doubt since 1970-01-01 00:01 UTC: friction: too uncertain: friction."
        );
        // A new part was never shown.
        history.points[1].replaced = vec![Some(ReplacedPart::Gearbox)];
        assert_eq!(
            of(&history),
            "<br>No window has shown: backlash.<br>No window has shown since the replacement: friction."
        );
    }

    /// The probability is that of what is left to end it.
    #[test]
    fn a_requirement_that_a_replaced_part_took_away_leaves_no_probability() {
        let mut rul = Rul {
            rul_p10_h: Some(1.0),
            rul_p50_h: Some(2.0),
            rul_p90_h: Some(3.0),
            failure_probability: Some(0.9),
            horizon_h: Some(100.0),
            dominant_fault: "short_a".to_owned(),
            governed_by: "stall".to_owned(),
            ..Rul::default()
        };
        rul.set_faults(FaultId::ALL.map(|fault| (fault == FaultId::ShortA).then_some(([900.0, 910.0, 920.0], 0.02))));
        let mut history = History::default();
        history.add(Health::default());
        history.newest.add_rul(rul);
        history.replaced_since = vec![Replacement {
            part: Some(ReplacedPart::Gearbox),
            t_ns: 0,
            note: String::new(),
        }];
        let advice = recommendation(&history, &Rules::default(), &Zone::utc());
        let text = remaining_life(&advice, &history, &Zone::utc());
        assert!(text.contains("it ends within 100 h with 2.0 % probability"), "{text}");
    }

    #[test]
    fn a_requirement_that_ends_the_life_is_named_in_place_of_a_part() {
        let advice = Recommendation {
            requirement: Some("slew rate".to_owned()),
            ..advice(HealthState::Nominal)
        };
        let text = remaining_life(&advice, &History::default(), &Zone::utc());
        assert!(
            text.contains("; the requirement slew rate ends it first") && !text.contains("friction ends"),
            "{text}"
        );
    }

    #[test]
    fn the_operation_of_the_windows_alone_is_compared_with_their_time() {
        let point = |t_start_ns: u64, used_h: f64| Point {
            t_start_ns,
            used_h: Some(used_h),
            ..Point::default()
        };
        let history = History {
            points: vec![point(0, 5000.0), point(100 * 3_600_000_000_000, 5000.1)],
            ..History::default()
        };
        let text = little_operation(&history);
        assert!(text.is_some_and(|text| text.contains("hold 6 min within 100 h")));
        // Beside a recording whose hours are those of the clock.
        let mut mixed = history;
        for (n, used_h) in [0.0, 700.0].into_iter().enumerate() {
            let clock = Point {
                is_elapsed: true,
                ..point(n as u64, used_h)
            };
            mixed.points.insert(n, clock);
        }
        let text = little_operation(&mixed);
        assert!(text.is_some_and(|text| text.contains("hold 6 min within 100 h")));
    }

    #[test]
    fn a_reason_that_asks_for_what_was_entered_since_is_left_out() {
        let mut history = History::default();
        let reason = format!(
            "2 samples lost; {NOT_LEARNT} friction at warning: repair it; {FELL} (friction 0.01 ± 0.01 after warning): check"
        );
        history.add(Health {
            reason: reason.clone(),
            ..Health::default()
        });
        history.newest.fallen[FaultId::Friction.index()] = true;
        assert_eq!(left_of_reason(&history), reason);
        let of = |part| Replacement {
            part: Some(part),
            t_ns: 1,
            note: String::new(),
        };
        // A controller has no bearings.
        history.replaced_since = vec![of(ReplacedPart::Controller)];
        assert_eq!(left_of_reason(&history), reason);
        history.replaced_since = vec![of(ReplacedPart::Gearbox)];
        assert_eq!(left_of_reason(&history), "2 samples lost");
    }
}
