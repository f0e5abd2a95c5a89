//! What recorded files say of one actuator.

use std::collections::BTreeMap;

use ema_models::FaultId;
use hmd_core::config::HoursOf;
use hmd_core::health::HealthState;
use hmd_core::history::{FELL, ReplacedPart};
use hmd_core::record::{Estimate, Health, LastShown, Rul, Sensors, Window};

/// One window of a history.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Number of the window.
    pub window: u64,
    /// Its start, UTC ns.
    pub t_start_ns: u64,
    /// `ok`, `degraded`, `invalid` or `unmodelled`.
    pub status: String,
    /// State of health.
    pub health: String,
    /// Fault vector, if it was assessed.
    pub estimate: Option<Estimate>,
    /// Root mean square of the current residual, A.
    pub residual_rms_a: Option<f64>,
    /// Operating hours so far.
    pub used_h: Option<f64>,
    /// Hours left: 10, 50 and 90 % quantile.
    pub left_h: Option<[f64; 3]>,
    /// What was replaced before it: `unit`, or parts, joined by commas.
    pub replaced: String,
    /// Names of the faults that it reported.
    pub faults: Vec<String>,
    /// Whether it suspects a sensor, a wire or a number.
    pub is_suspected: bool,
}

/// What is known of one actuator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Its name.
    pub actuator: String,
    /// Its windows, as recorded.
    pub points: Vec<Point>,
    /// The newest health record, and what was left then.
    pub newest: (Health, Rul),
    /// What its windows have shown of each fault.
    pub shown: LastShown,
    /// Part and serial number, in words; empty where its configuration had none.
    pub identity: String,
    /// The newest window that was fitted.
    pub fitted: Option<Window>,
    /// Samples of all windows: called for, received, missing.
    pub samples: [u64; 3],
    /// Reasons of windows that are not `ok`, without their values, with the number of windows.
    pub reasons: BTreeMap<String, u64>,
    /// Newest record of its sensors.
    pub sensors: Sensors,
    /// What was replaced after the newest window, as it was entered, each once.
    pub replaced_since: Vec<Replacement>,
    /// Whether the damage of each fault fell without a recorded repair, in the order of [`FaultId::ALL`]; until it is back, or its part is
    /// replaced.
    pub fallen: [bool; FaultId::COUNT],
}

/// A replacement that was entered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replacement {
    /// A part, or `None` for the whole actuator.
    pub part: Option<ReplacedPart>,
    /// When, UTC ns.
    pub t_ns: u64,
    /// What the person who entered it wrote.
    pub note: String,
}

/// The newest windows, as far as none of them was assessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unassessed {
    /// How many.
    pub(super) windows: usize,
    /// Start of the first of them, UTC ns.
    pub(super) since_ns: u64,
}

impl History {
    /// The newest windows without an estimate; `None` if the newest has one.
    pub(super) fn unassessed(&self) -> Option<Unassessed> {
        let tail = self.points.rsplit(|point| point.estimate.is_some()).next()?;
        tail.first().map(|first| Unassessed {
            windows: tail.len(),
            since_ns: first.t_start_ns,
        })
    }

    /// State of each fault after the newest window, in the order of [`FaultId::ALL`].
    pub(super) fn states(&self) -> [HealthState; FaultId::COUNT] {
        self.newest.0.states().unwrap_or_default()
    }

    /// Takes the next window of the same file. A record of an older version gets the states of its faults: what it reports is at watch.
    pub(super) fn add(&mut self, mut health: Health) {
        if health.states().is_none() {
            let states = self.states_of_older(&health);
            health.set_states(&states);
        }
        for reason in health.reason.split("; ").filter(|reason| !reason.is_empty()) {
            *self.reasons.entry(without_numbers(reason)).or_default() += 1;
        }
        let fell = health.reason.split("; ").find(|reason| reason.starts_with(FELL));
        let states = health.states().unwrap_or_default();
        for fault in FaultId::ALL {
            let names = |reason: &str| reason.contains(&format!("{} ", fault.name()));
            let fallen = &mut self.fallen[fault.index()];
            *fallen = fell.is_some_and(names) || (*fallen && states[fault.index()] < HealthState::Warning);
        }
        self.points.push(Point {
            window: health.window,
            t_start_ns: health.t_start_ns,
            status: health.status.clone(),
            health: health.health.clone(),
            estimate: health.estimate(),
            residual_rms_a: health.residual_rms_a,
            used_h: None,
            left_h: None,
            replaced: String::new(),
            faults: health.fault_list.clone(),
            is_suspected: !health.suspects.is_empty(),
        });
        self.shown.update(&health);
        self.newest = (health, Rul::default());
    }

    fn states_of_older(&self, health: &Health) -> [HealthState; FaultId::COUNT] {
        let state = HealthState::named(&health.health);
        if health.estimate().is_none() && state != HealthState::Unknown {
            return self.states();
        }
        FaultId::ALL.map(|fault| match state {
            HealthState::Unknown => state,
            _ if health.fault_list.iter().any(|name| name == fault.name()) => HealthState::Watch,
            _ => HealthState::Nominal,
        })
    }

    /// Goes on with what a later file says of the same actuator. Where that has shown nothing of a fault, what was known of it before holds,
    /// unless its part was replaced.
    pub(super) fn go_on(&mut self, mut later: Self) {
        for fault in FaultId::ALL {
            let is_back = later.states()[fault.index()] >= HealthState::Warning;
            later.fallen[fault.index()] |= self.fallen[fault.index()] && later.keeps(fault) && !is_back;
        }
        let counts = |fault: FaultId| later.keeps(fault);
        later.shown = later.shown.or(&self.shown, counts);
        let own = later.states();
        let mut states = own;
        for (fault, before) in FaultId::ALL.into_iter().zip(self.states()) {
            let state = &mut states[fault.index()];
            if *state == HealthState::Unknown && later.keeps(fault) {
                *state = before;
            }
        }
        let worst = states.into_iter().max().unwrap_or_default();
        let is_known = !states.contains(&HealthState::Unknown);
        let newest = &mut later.newest.0;
        let state = HealthState::named(&newest.health);
        if states != own && worst > state && (worst > HealthState::Nominal || is_known) {
            newest.health = worst.name().to_owned();
        }
        newest.set_states(&states);
        let Self {
            actuator: _,
            points,
            newest,
            shown,
            identity,
            fitted,
            samples,
            reasons,
            sensors,
            replaced_since: _,
            fallen,
        } = later;
        self.fallen = fallen;
        if !points.is_empty() {
            self.newest = newest;
            self.shown = shown;
        }
        self.points.extend(points);
        if !identity.is_empty() {
            self.identity = identity;
        }
        if sensors != Sensors::default() {
            self.sensors = sensors;
        }
        self.fitted = fitted.or(self.fitted.take());
        for (sum, count) in self.samples.iter_mut().zip(samples) {
            *sum += count;
        }
        for (reason, count) in reasons {
            *self.reasons.entry(reason).or_default() += count;
        }
    }

    /// Whether what was known of a fault before these windows still holds: neither its part nor the unit was replaced.
    fn keeps(&self, fault: FaultId) -> bool {
        !self.points.iter().any(|point| replaces(&point.replaced, fault))
    }

    /// Takes what was replaced before the newest window.
    pub(super) fn note_replaced(&mut self, replaced: &str) {
        for fault in FaultId::ALL.into_iter().filter(|fault| replaces(replaced, *fault)) {
            self.fallen[fault.index()] = false;
        }
        if let Some(point) = self.points.last_mut() {
            replaced.clone_into(&mut point.replaced);
        }
    }

    /// Whether a damage fell without a recorded repair, also after the newest window.
    pub(super) fn has_fallen(&self) -> bool {
        let mut fallen = FaultId::ALL.into_iter().filter(|fault| self.fallen[fault.index()]);
        fallen.any(|fault| {
            let mut since = self.replaced_since.iter();
            since.all(|replacement| replacement.part.is_some_and(|part| !part.faults().contains(&fault)))
        })
    }
}

/// Whether what was replaced, parts by their names or `unit`, joined by commas, has a fault.
fn replaces(replaced: &str, fault: FaultId) -> bool {
    replaced.split(',').any(|what| {
        let is_of_fault = |part: ReplacedPart| part.faults().contains(&fault);
        what == "unit" || ReplacedPart::from_name(what).is_some_and(is_of_fault)
    })
}

/// Hours left by all faults, 10 %, 50 % and 90 % quantile.
pub(super) fn hours_of_all(rul: &Rul) -> Option<[f64; 3]> {
    Some([rul.rul_p10_h?, rul.rul_p50_h?, rul.rul_p90_h?])
}

/// Whether the hours of a record pass without use, too.
pub(super) fn is_elapsed(rul: &Rul) -> bool {
    rul.hours_of == HoursOf::Elapsed.name()
}

/// What the hours of a record are hours of, as words that follow a number.
pub(super) fn hours_of(rul: &Rul) -> &'static str {
    if is_elapsed(rul) {
        " of elapsed time"
    } else {
        " of operation"
    }
}

/// A reason without its values, so that one kind is counted together: every number becomes an ellipsis.
fn without_numbers(reason: &str) -> String {
    let is_number = |word: &str| {
        let word = word.trim_matches(|c: char| "+-−±(),:%".contains(c));
        word.parse::<f64>().is_ok()
    };
    let words = reason.split(' ').map(|word| if is_number(word) { "…" } else { word });
    let mut words: Vec<&str> = words.collect();
    words.dedup_by(|a, b| *a == "…" && *b == "…");
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_of_one_kind_are_counted_together() {
        let mut history = History::default();
        for reason in [
            "no fault vector explains the data: cost 17; 3 samples lost",
            "no fault vector explains the data: cost 230",
            "",
        ] {
            let health = Health {
                reason: reason.to_owned(),
                ..Health::default()
            };
            history.add(health);
        }
        let found: Vec<(&str, u64)> = history
            .reasons
            .iter()
            .map(|(reason, n)| (reason.as_str(), *n))
            .collect();
        assert_eq!(
            found,
            [("no fault vector explains the data: cost …", 2), ("… samples lost", 1)]
        );
    }

    fn recording(health: &str, states: [HealthState; FaultId::COUNT], replaced: &str) -> History {
        let mut history = History::default();
        let mut record = Health {
            health: health.to_owned(),
            ..Health::default()
        };
        record.set_states(&states);
        history.add(record);
        history.points[0].replaced = replaced.to_owned();
        history
    }

    #[test]
    fn a_damage_that_fell_is_told_until_it_is_back_or_its_part_is_replaced() {
        use HealthState::{Nominal, Warning};
        let window = |state: HealthState, reason: String| {
            let mut health = Health {
                reason,
                ..Health::default()
            };
            let mut states = [Nominal; FaultId::COUNT];
            states[FaultId::Friction.index()] = state;
            health.set_states(&states);
            health
        };
        let fell = || {
            window(
                Nominal,
                format!("2 samples lost; {FELL} (friction 0.00 ± 0.02 after warning): check"),
            )
        };
        let after = |windows: &[Health], replaced: &str| {
            let mut history = History::default();
            windows.iter().cloned().for_each(|health| history.add(health));
            history.note_replaced(replaced);
            history.has_fallen()
        };
        let sound = || window(Nominal, String::new());
        assert!(after(&[fell()], "") && after(&[fell(), sound()], "controller"));
        assert!(!after(&[sound()], "") && !after(&[fell(), window(Warning, String::new())], ""));
        assert!(!after(&[fell(), sound()], "gearbox") && !after(&[fell(), sound()], "unit"));
        let mut history = recording("nominal", [Nominal; FaultId::COUNT], "");
        history.add(fell());
        history.go_on(recording("nominal", [Nominal; FaultId::COUNT], ""));
        assert!(history.has_fallen());
        history.replaced_since.push(Replacement {
            part: Some(ReplacedPart::Gearbox),
            t_ns: 0,
            note: String::new(),
        });
        assert!(!history.has_fallen());
    }

    #[test]
    fn a_recording_in_which_nothing_was_shown_hides_nothing_that_was_known_before() {
        use HealthState::{Critical, Nominal, Unknown};
        let mut worn = [Nominal; FaultId::COUNT];
        worn[FaultId::Backlash.index()] = Critical;
        let nothing = [Unknown; FaultId::COUNT];
        let after = |replaced: &str| {
            let mut history = recording("critical", worn, "");
            history.go_on(recording("unknown", nothing, replaced));
            (history.newest.0.health.clone(), history.states())
        };
        assert_eq!(after(""), ("critical".to_owned(), worn));
        assert_eq!(after("unit"), ("unknown".to_owned(), nothing));
        let (health, states) = after("gearbox");
        assert_eq!((&*health, states[FaultId::Backlash.index()]), ("unknown", Unknown));
        assert_eq!(states[FaultId::ShortA.index()], Nominal);
        // What the later one has shown counts.
        let mut history = recording("critical", worn, "");
        history.go_on(recording("nominal", [Nominal; FaultId::COUNT], ""));
        assert_eq!(history.newest.0.health, "nominal");
    }
}
