//! What recorded files say of one actuator.

use std::collections::BTreeMap;

use ema_models::FaultId;
use hmd_core::assess::OUTDATED;
use hmd_core::config::HoursOf;
use hmd_core::health::HealthState;
use hmd_core::history::{Event, ReplacedPart, fallen_by};
use hmd_core::newest::Newest;
use hmd_core::record::{Estimate, Health, Rul, Sensors, Window};

use super::clock_doubt::ClockDoubt;

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
    /// Parts, or the unit (`None`), that were replaced before it.
    pub replaced: Vec<Option<ReplacedPart>>,
    /// Names of the faults that it reported.
    pub faults: Vec<String>,
    /// Whether it suspects a sensor, a wire or a number.
    pub is_suspected: bool,
    /// State of each fault after it, in the order of [`FaultId::ALL`].
    pub states: [HealthState; FaultId::COUNT],
    /// Why it is not `ok`.
    pub reason: String,
    /// The fault whose trend ends the life first, where hours are left by its record and no requirement ends it.
    pub ends_first: Option<FaultId>,
    /// Whether its hours pass without use, too.
    pub is_elapsed: bool,
    /// Whether it is the first of a recording that knew nothing of the one before.
    pub begins_recording: bool,
}

impl Point {
    /// Whether the unit, or the part of a fault, was replaced before it.
    pub(super) fn renews(&self, fault: FaultId) -> bool {
        self.replaced.iter().any(|part| ReplacedPart::renews(*part, fault))
    }
}

/// What is known of one actuator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Its name.
    pub actuator: String,
    /// Its windows, as recorded.
    pub points: Vec<Point>,
    /// Health and remaining life after the newest window, and what the windows have shown of each fault.
    pub newest: Newest,
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
    /// What was replaced between two recordings, as it was entered: no window knows of it.
    pub replaced_between: Vec<Replacement>,
    /// What was replaced after the newest window, as it was entered, each once.
    pub replaced_since: Vec<Replacement>,
    /// What was replaced before the newest window, as it was entered since: no window knows of it.
    pub entered_since: Vec<Replacement>,
    /// Whether recordings of it overlap in time.
    pub overlaps: bool,
    /// Why the order of its recordings, which is that of their stamps, may be wrong.
    pub clock_doubts: Vec<ClockDoubt>,
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

impl Replacement {
    /// That of an event.
    pub(super) fn of(event: &Event) -> Self {
        Self {
            part: event.part,
            t_ns: event.t_ns,
            note: event.note.clone().unwrap_or_default(),
        }
    }

    /// Part in words and note.
    pub(super) fn noted(&self) -> String {
        let part = self.part.map_or("actuator", ReplacedPart::name);
        match &*self.note {
            "" => format!("{part} replaced"),
            note => format!("{part} replaced: {note}"),
        }
    }
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
    /// Starts of the earliest and the latest window, UTC ns. Recordings that overlap are not in the order of time.
    pub(super) fn period_ns(&self) -> Option<[u64; 2]> {
        let times = self.points.iter().map(|point| point.t_start_ns);
        Some([times.clone().min()?, times.max()?])
    }

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
        self.newest.states()
    }

    /// The newest records without what is not known any more as its part was replaced since.
    pub(super) fn newest_left(&self) -> Newest {
        let mut newest = self.newest.clone();
        let since = self.replaced_since.iter();
        since.for_each(|replacement| newest.replace(replacement.part));
        newest
    }

    /// Whether nothing is known of a fault as its part was replaced after the newest window.
    pub(super) fn is_replaced_since(&self, fault: FaultId) -> bool {
        let mut since = self.replaced_since.iter();
        since.any(|replacement| ReplacedPart::renews(replacement.part, fault))
    }

    /// Takes the next window of the same file.
    pub(super) fn add(&mut self, health: Health) {
        for reason in health.reason.split("; ").filter(|reason| !reason.is_empty()) {
            *self.reasons.entry(without_numbers(reason)).or_default() += 1;
        }
        self.newest.add(health);
        let health = &self.newest.health;
        self.points.push(Point {
            window: health.window,
            t_start_ns: health.t_start_ns,
            status: health.status.clone(),
            health: health.health.clone(),
            estimate: health.estimate(),
            residual_rms_a: health.residual_rms_a,
            used_h: None,
            left_h: None,
            replaced: Vec::new(),
            faults: health.fault_list.clone(),
            is_suspected: !health.suspects.is_empty(),
            states: self.newest.states(),
            reason: health.reason.clone(),
            ends_first: None,
            is_elapsed: false,
            begins_recording: false,
        });
    }

    /// Marks that a part, or the unit (`None`), was replaced before these windows, which do not know of it.
    pub(super) fn mark_replaced(&mut self, part: Option<ReplacedPart>) {
        let first = self.points.first_mut();
        if let Some(first) = first.filter(|first| !first.replaced.contains(&part)) {
            first.replaced.push(part);
        }
    }

    /// Goes on with the next segment of the same run.
    pub(super) fn continue_run(&mut self, mut later: Self) {
        if !later.points.is_empty() {
            self.newest.continue_run(std::mem::take(&mut later.newest));
        }
        self.append(later);
    }

    /// Adds what a later recording of the same actuator says, besides its newest records.
    pub(super) fn append(&mut self, later: Self) {
        let Self {
            actuator: _,
            points,
            newest: _,
            identity,
            fitted,
            samples,
            reasons,
            sensors,
            replaced_between: _,
            replaced_since: _,
            entered_since: _,
            overlaps: _,
            clock_doubts: _,
        } = later;
        self.points.extend(points);
        if !identity.is_empty() {
            self.identity = identity;
        }
        if sensors != Sensors::default() {
            self.sensors = sensors;
        }
        self.fitted = fitted.or(self.fitted.take());
        for (sum, count) in self.samples.iter_mut().zip(samples) {
            *sum = sum.saturating_add(count);
        }
        for (reason, count) in reasons {
            *self.reasons.entry(reason).or_default() += count;
        }
    }
}

impl History {
    /// Whether a damage fell without a recorded repair, also one that was entered since, or that another recording of the same windows knows of.
    pub(super) fn has_fallen(&self) -> bool {
        let mut fallen = FaultId::ALL
            .into_iter()
            .filter(|fault| self.newest.fallen[fault.index()]);
        fallen.any(|fault| {
            let mut since = self.replaced_since.iter().chain(&self.entered_since);
            let is_entered = since.any(|replacement| ReplacedPart::renews(replacement.part, fault));
            !is_entered && !self.is_repaired(fault)
        })
    }

    /// Whether some window knows of a replacement between the window at which the damage of a fault fell and the last one before that showed it:
    /// by an event, or by a calibration that is older than one.
    fn is_repaired(&self, fault: FaultId) -> bool {
        let fell = |point: &&Point| fallen_by(&point.reason)[fault.index()];
        let Some(fell_ns) = self.points.iter().rfind(fell).map(|point| point.t_start_ns) else {
            return false;
        };
        let was_worn =
            |point: &&Point| point.t_start_ns < fell_ns && point.states[fault.index()] >= HealthState::Warning;
        let worn = self.points.iter().filter(was_worn).map(|point| point.t_start_ns);
        let worn_ns = worn.max().unwrap_or(0);
        let knows = |point: &Point| point.renews(fault) || point.reason.contains(OUTDATED);
        let is_repair = |point: &Point| (worn_ns + 1..=fell_ns).contains(&point.t_start_ns) && knows(point);
        self.points.iter().any(is_repair)
    }
}

/// The requirement of the specification that ends the life, in words; `None` where a damage does, or nothing is predicted.
pub(super) fn requirement(rul: &Rul) -> Option<String> {
    let is_requirement = !["", "damage"].contains(&&*rul.governed_by);
    is_requirement.then(|| rul.governed_by.replace('_', " "))
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
    // With its sign, its bracket and its unit: `(149°`.
    let is_number = |word: &str| {
        let value = word.trim_start_matches(|c: char| !c.is_alphanumeric());
        value.starts_with(|c: char| c.is_ascii_digit())
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
            "begins at 149° electrical",
            "begins at -12.5° electrical",
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
            [
                ("begins at … electrical", 2),
                ("no fault vector explains the data: cost …", 2),
                ("… samples lost", 1)
            ]
        );
    }
}
