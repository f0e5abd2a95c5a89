//! One recommendation per actuator: which part, what to do, until when, since when. Overview and page print the same one.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;
use hmd_core::record::Rul;
use hmd_core::sensor_checks::Suspect;

use super::axis::{Mark, marks_before};
use super::history::{History, Point, Unassessed, hours_of};

/// What a mechanic needs to know of one actuator.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Recommendation {
    /// State of health after the newest window.
    pub(super) state: HealthState,
    /// The fault that the state is about; `None` where no part is worn.
    pub(super) fault: Option<FaultId>,
    /// What to do, a sentence.
    pub(super) action: String,
    /// Hours left to the end of life, 10 %, 50 % and 90 % quantile; or why there is no number.
    pub(super) hours_left: Result<[f64; 3], String>,
    /// Start of the first window since which the state was this or worse (`nominal`: was this), UTC ns.
    pub(super) since_ns: Option<u64>,
    /// The newest windows, where they could not be assessed.
    pub(super) unassessed: Option<Unassessed>,
    /// Faults that no window has shown, in the order of [`FaultId::ALL`].
    pub(super) unknown: Vec<FaultId>,
}

/// Below so many hours there is nothing to plan.
const HOURS_TO_PLAN: f64 = 1.0;

/// What to do where no sensor is named and windows in a row could not be assessed; their reason stands beside it.
const CHECK_WHAT_HINDERS: &str = "Check sensors, wiring and supply, and for a jam, before the next use.";

impl Recommendation {
    /// Life left, or why there is no number.
    pub(super) fn life_left(&self) -> String {
        match &self.hours_left {
            Ok([.., p90]) if *p90 <= 0.0 => "none: its end of life is reached".to_owned(),
            Ok(left) => hours(*left),
            Err(reason) => format!("no number: {reason}"),
        }
    }
}

/// The recommendation after the newest window; `modes` has the levels, in the order of [`FaultId::ALL`].
pub(super) fn recommendation(history: &History, modes: &[FaultMode; FaultId::COUNT]) -> Recommendation {
    let (health, rul) = &history.newest;
    let state = HealthState::named(&health.health);
    let worst = worst_fault(history, |_| true);
    // What a new part leaves to be done; of its own faults nothing is known before the next window.
    let is_left = |fault: FaultId| !history.replaced_since.iter().any(|part| clears(*part, fault));
    let left = worst_fault(history, is_left);
    let replaced = replaced(&history.replaced_since);
    let unassessed = history.unassessed();
    let states = history.states();
    let is_unknown = |fault: &FaultId| states[fault.index()] == HealthState::Unknown;
    let unknown: Vec<FaultId> = FaultId::ALL.into_iter().filter(is_unknown).collect();
    let checks = match (checks(&health.suspects), &unassessed) {
        (checks, _) if !checks.is_empty() => format!("Check {checks}."),
        (_, Some(Unassessed { windows: 2.., .. })) if state != HealthState::Unknown => CHECK_WHAT_HINDERS.to_owned(),
        _ => String::new(),
    };
    let action = match (state, left) {
        (HealthState::Unknown | HealthState::Nominal, _) | (_, None) if !replaced.is_empty() => String::new(),
        (HealthState::Unknown, _) if !checks.is_empty() => "Nothing is known yet.".to_owned(),
        (HealthState::Unknown, _) if unknown.len() < FaultId::COUNT => {
            "Not everything is known yet: see what no window has shown.".to_owned()
        }
        (HealthState::Unknown, _) if health.reason.is_empty() => {
            "Nothing is known yet: no window was assessed.".to_owned()
        }
        (HealthState::Unknown, _) => format!("Nothing is known yet: {}.", health.reason),
        (HealthState::Nominal, _) if !checks.is_empty() => String::new(),
        (HealthState::Nominal, _) if unassessed.is_some() => "Nothing before the next actuation.".to_owned(),
        (HealthState::Nominal, _) => "No action.".to_owned(),
        (_, Some(fault)) if left != worst => {
            let state = history.states()[fault.index()].max(HealthState::Watch);
            let hours = rul.faults()[fault.index()];
            let life_left = hours.map(|hours| LifeLeft {
                hours,
                of: hours_of(rul),
            });
            maintenance(left, state, life_left, modes)
        }
        _ => maintenance(left, state, life_left(rul), modes),
    };
    let sentences = [action, replaced, checks];
    let fault = left.or(worst).filter(|_| state > HealthState::Nominal);
    Recommendation {
        state,
        fault,
        action: sentences
            .into_iter()
            .filter(|text| !text.is_empty())
            .collect::<Vec<_>>()
            .join(" "),
        hours_left: life_left(rul).map(|left| left.hours).ok_or_else(|| match &*rul.reason {
            "" => "none was recorded".to_owned(),
            reason => reason.to_owned(),
        }),
        since_ns: since(history, state, fault),
        unassessed,
        unknown,
    }
}

/// What to do about the part of a fault, or about the actuator, in this state and with these hours left (quantiles).
fn maintenance(
    fault: Option<FaultId>,
    state: HealthState,
    life_left: Option<LifeLeft>,
    modes: &[FaultMode; FaultId::COUNT],
) -> String {
    let what = fault.map_or("actuator", FaultId::part);
    let severity = modes[fault.map_or(0, FaultId::index)].severity;
    let action_of = |state: HealthState| {
        let class = severity.iter().find(|severity| severity.class == state);
        with_capital(class.map_or("", |severity| severity.action))
    };
    let action = action_of(state);
    // By when nine of ten such actuators still work.
    match (state, life_left) {
        (HealthState::Watch | HealthState::Warning, Some(LifeLeft { hours: [p10, ..], .. })) if p10 < HOURS_TO_PLAN => {
            let action = match state {
                HealthState::Watch => "Inspect before the next use".to_owned(),
                _ => action_of(HealthState::Critical),
            };
            format!("{action}: {what}. It may last less than {HOURS_TO_PLAN:.0} h more.")
        }
        (HealthState::Watch, Some(LifeLeft { hours: [p10, ..], of })) => {
            format!("{action}: {what}, at the latest within {}{of}.", duration(p10))
        }
        (HealthState::Warning, Some(LifeLeft { hours: [p10, ..], of })) => {
            format!("{action}: {what}, within {}{of}.", duration(p10))
        }
        (HealthState::Warning, None) => {
            format!("{action}: {what}, at the next scheduled maintenance at the latest, for want of a forecast.")
        }
        _ => format!("{action}: {what}."),
    }
}

/// Whether nothing is known of this fault once the part, or the actuator (`None`), is another one.
fn clears(part: Option<ReplacedPart>, fault: FaultId) -> bool {
    part.is_none_or(|part| part.faults().contains(&fault))
}

/// What was replaced since the newest window, a sentence; empty if nothing was.
fn replaced(parts: &[Option<ReplacedPart>]) -> String {
    let (verb, shows) = match parts.len() {
        0 => return String::new(),
        1 => ("was", "its"),
        _ => ("were", "their"),
    };
    let names: Vec<&str> = parts
        .iter()
        .map(|part| part.map_or("actuator", ReplacedPart::name))
        .collect();
    let names = names.join(" and the ");
    format!("The {names} {verb} replaced after the last window: the next actuation shows {shows} health.")
}

/// What to look at besides the actuator, for these suspects of a record; each once.
fn checks(suspects: &[String]) -> String {
    let mut found: Vec<&str> = Vec::new();
    for suspect in suspects.iter().filter_map(|name| Suspect::from_name(name)) {
        if !found.contains(&suspect.to_check()) {
            found.push(suspect.to_check());
        }
    }
    found.join("; ")
}

/// Hours left: 10 %, 50 % and 90 % quantile, and what they are hours of, as words that follow a number.
#[derive(Clone, Copy)]
struct LifeLeft {
    hours: [f64; 3],
    of: &'static str,
}

fn life_left(rul: &Rul) -> Option<LifeLeft> {
    let hours = [rul.rul_p10_h?, rul.rul_p50_h?, rul.rul_p90_h?];
    Some(LifeLeft {
        hours,
        of: hours_of(rul),
    })
}

/// Of the faults that count, the reported one with the worst state, then the largest damage. Where no fault at all is reported, the one
/// whose trend ends the life first.
fn worst_fault(history: &History, counts: impl Fn(FaultId) -> bool) -> Option<FaultId> {
    let states = history.states();
    let is_reported = |fault: &FaultId| states[fault.index()] >= HealthState::Watch;
    if !FaultId::ALL.iter().any(is_reported) {
        return FaultId::from_name(&history.newest.1.dominant_fault).filter(|fault| counts(*fault));
    }
    let reported = FaultId::ALL
        .into_iter()
        .filter(|fault| is_reported(fault) && counts(*fault));
    let damage = |fault: FaultId| history.shown.of(fault).map_or(0.0, |shown| shown.damage);
    reported.max_by(|a, b| {
        let by_state = states[a.index()].cmp(&states[b.index()]);
        by_state.then(damage(*a).total_cmp(&damage(*b)))
    })
}

/// Start of the oldest window of the newest run of windows in this state or a worse one (`nominal`: in this state) that reported the fault where the newest did, since the
/// last reset.
fn since(history: &History, state: HealthState, fault: Option<FaultId>) -> Option<u64> {
    let reports = |point: &Point| fault.is_some_and(|fault| point.faults.iter().any(|name| name == fault.name()));
    let assessed = history.points.iter().rfind(|point| point.estimate.is_some());
    let is_reported = assessed.or(history.points.last()).is_some_and(reports);
    let mut since = None;
    for n in (0..history.points.len()).rev() {
        let point = &history.points[n];
        // One that did not show it says nothing of it.
        let was_silent = point.estimate.is_none();
        let of_point = HealthState::named(&point.health);
        if of_point == HealthState::Unknown && was_silent && state != HealthState::Unknown {
            continue;
        }
        let is_another = match state {
            HealthState::Nominal => of_point != state,
            _ => of_point < state,
        };
        if is_another || (is_reported && !was_silent && !reports(point)) {
            break;
        }
        since = Some(point.t_start_ns);
        let begins_anew = |mark: &Mark| matches!(mark, Mark::Unit | Mark::Reset);
        if n > 0 && marks_before(history, n).iter().any(begins_anew) {
            break;
        }
    }
    since
}

/// Operating time as people read it.
pub(super) fn duration(hours: f64) -> String {
    match hours {
        h if h >= 9.95 => format!("{h:.0} h"),
        h if h >= 0.995 => format!("{h:.1} h"),
        h if h >= 1.0 / 60.0 => format!("{:.0} min", 60.0 * h),
        h if h <= 0.0 => "0 h".to_owned(),
        _ => "less than 1 min".to_owned(),
    }
}

/// Quantiles of an operating time: where some is left, none of them is "0 h".
pub(super) fn durations(quantiles: [f64; 3]) -> [String; 3] {
    let is_over = quantiles[2] <= 0.0;
    quantiles.map(|hours| duration(if is_over { hours } else { hours.max(f64::MIN_POSITIVE) }))
}

/// Median and 80 % interval of an operating time.
pub(super) fn hours(quantiles: [f64; 3]) -> String {
    let [low, median, high] = durations(quantiles);
    if low == high {
        return median;
    }
    format!("{median} ({low} … {high})")
}

/// The text with a capital letter at its start.
pub(super) fn with_capital(text: &str) -> String {
    let mut chars = text.chars();
    chars
        .next()
        .map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::catalogue::catalogue;
    use hmd_core::health::Levels;
    use hmd_core::record::{Estimate, Health};

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

    fn estimate() -> Estimate {
        Estimate {
            k: [0.0; 8],
            sigma: [None; 8],
            observable: [true; 8],
        }
    }

    fn of(history: &History) -> Recommendation {
        recommendation(history, &catalogue(&[Levels::default(); FaultId::COUNT]).fault_modes)
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
        assert_eq!(found.fault, Some(Backlash));
        assert_eq!(found.action, "Repair before the next use: gear and screw.");
        assert_eq!(found.since_ns, Some(2));
        let well = of(&history(&["nominal"], &[], [0.0; FaultId::COUNT]));
        assert_eq!((well.fault, &*well.action), (None, "No action."));
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
            "Repair before the next use: gear and screw. Check the phase current sensors of the drive and their wiring."
        );
        let expected = Unassessed {
            windows: 1,
            since_ns: 1,
        };
        assert_eq!(found.unassessed, Some(expected));
        for (state, expected) in [
            (
                "nominal",
                "Check the phase current sensors of the drive and their wiring.",
            ),
            (
                "unknown",
                "Nothing is known yet. Check the phase current sensors of the drive and their wiring.",
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
        history.replaced_since = vec![Some(ReplacedPart::Gearbox)];
        let expected = "The gearbox was replaced after the last window: the next actuation shows its health.";
        assert_eq!(of(&history).action, expected);
        history.replaced_since = vec![Some(ReplacedPart::Gearbox), Some(ReplacedPart::Motor)];
        let expected =
            "The gearbox and the motor were replaced after the last window: the next actuation shows their health.";
        assert_eq!(of(&history).action, expected);
        // Another part takes nothing away.
        history.replaced_since = vec![Some(ReplacedPart::Controller)];
        let found = of(&history);
        assert!(
            found
                .action
                .starts_with("Repair before the next use: gear and screw. The controller was replaced"),
            "{}",
            found.action
        );
    }

    #[test]
    fn a_replaced_part_leaves_the_faults_of_the_others_with_their_own_level() {
        use FaultId::{Backlash, Gain};
        let mut history = history(&["critical"], &[Backlash, Gain], [0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.1]);
        history.replaced_since = vec![Some(ReplacedPart::Gearbox)];
        let expected = "Inspect at the next scheduled maintenance: position controller. The gearbox was replaced \
                        after the last window: the next actuation shows its health.";
        // The hours are those of what is left, not of the gearbox.
        history.newest.1.dominant_fault = "backlash".to_owned();
        let rul = &mut history.newest.1;
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(0.0), Some(0.1), Some(0.2));
        let found = of(&history);
        assert_eq!((found.fault, &*found.action), (Some(Gain), expected));
        history
            .newest
            .0
            .set_damage([0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.4].map(Some));
        report(&mut history, &[Backlash, Gain]);
        let found = of(&history).action;
        assert!(
            found.starts_with("Plan the repair: position controller, at the next scheduled")
                && found.contains("The gearbox was replaced"),
            "{found}"
        );
        // A trend that nobody reports is no reason to go on with a repair.
        report(&mut history, &[Backlash]);
        history.newest.1.dominant_fault = "gain".to_owned();
        assert!(of(&history).action.starts_with("The gearbox was replaced"));
    }

    #[test]
    fn no_action_is_never_said_of_windows_that_could_not_be_assessed() {
        let mut well = history(&["nominal"; 3], &[], [0.0; FaultId::COUNT]);
        for expected in ["No action.", "Nothing before the next actuation.", CHECK_WHAT_HINDERS] {
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
             forecast. {CHECK_WHAT_HINDERS}"
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
            "Plan the repair: gear and screw, within 90 h of operation."
        );
        assert_eq!(planned.life_left(), "180 h (90 h … 270 h)");
        let urgent = with(0.002);
        assert_eq!(
            urgent.action,
            "Repair before the next use: gear and screw. It may last less than 1 h more."
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
        let expected = "Inspect at the next scheduled maintenance: position controller, at the latest within 90 h of elapsed time.";
        assert_eq!(found, expected);
        let found = with(0.002, "operating");
        let expected = "Inspect before the next use: position controller. It may last less than 1 h more.";
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
    fn durations_have_the_unit_that_suits_them() {
        let shown = [1234.4, 9.96, 9.94, 0.996, 0.5, 0.017, 0.01, 0.0].map(duration);
        let expected = [
            "1234 h",
            "10 h",
            "9.9 h",
            "1.0 h",
            "30 min",
            "1 min",
            "less than 1 min",
            "0 h",
        ];
        assert_eq!(shown, expected);
        assert_eq!(hours([0.0, 1e-4, 2e-4]), "less than 1 min");
        assert_eq!(hours([0.0, 1.0, 20.0]), "1.0 h (less than 1 min … 20 h)");
        assert_eq!(hours([0.0; 3]), "0 h");
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
}
