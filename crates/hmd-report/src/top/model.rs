//! What the state means at a moment, in words and figures.

use super::follow::Progress;
use super::state::{Known, State};
use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::record::ActuatorStatus;

/// Silence from which a source that should be live is called silent, s: status records come every ten seconds and are on the
/// disk a second later.
pub const NEWS_MAX_S: f64 = 15.0;

/// State of the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// It is being read; share, 0…1.
    Reading(f64),
    /// It is being written; s since something was.
    Live(f64),
    /// It should be written and is not; s since something was.
    Silent(f64),
    /// The daemon ended in order; s since then.
    Ended(f64),
    /// A finished file: all that is shown was so at its end.
    Recorded,
}

impl Condition {
    /// From how far the reading came, and the seconds since something was written.
    #[must_use]
    pub fn new(progress: Progress, silent_s: f64) -> Self {
        match progress {
            Progress::Reading(share) => Self::Reading(share),
            Progress::Finished => Self::Recorded,
            Progress::Closed => Self::Ended(silent_s),
            Progress::Waiting if silent_s > NEWS_MAX_S => Self::Silent(silent_s),
            Progress::Waiting => Self::Live(silent_s),
        }
    }

    /// Seconds since the newest record was written, where they make it outdated.
    fn passed_s(self) -> f64 {
        match self {
            Self::Live(s) | Self::Silent(s) | Self::Ended(s) => s,
            Self::Reading(_) | Self::Recorded => 0.0,
        }
    }
}

/// How old an actuator's data are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Freshness {
    /// Not reported by the source: a replay has no clock.
    NotReported,
    /// Fresh, as the daemon reports.
    Fresh,
    /// No sample for so many seconds.
    Stale(f64),
}

/// One line of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row<'a> {
    /// Name of the actuator.
    pub name: &'a str,
    /// Age of its data.
    pub freshness: Freshness,
    /// State by its last window.
    pub health: HealthState,
    /// Its state raises no alarm.
    pub passive: bool,
    /// Windows in a row that ask for a worse state; 0 where the source does not say.
    pub persistence: u64,
    /// Fault and damage, 0…1: the largest of those that the windows have shown last of each fault.
    pub worst: Option<(&'static str, f64)>,
    /// Seconds since the start of its newest window.
    pub window_age_s: Option<f64>,
    /// Its newest records; `None` when no window was read.
    pub known: Option<&'a Known>,
    /// Last change of its state, as a sentence.
    pub changed: Option<String>,
}

/// All that is shown.
#[derive(Clone, Debug)]
pub struct Model<'a> {
    /// Folder or file.
    pub place: &'a str,
    /// State of the source.
    pub condition: Condition,
    /// The records behind it.
    pub state: &'a State,
    /// The actuators.
    pub rows: Vec<Row<'a>>,
    /// How many are in each state, from bad to good, without those of which there are none.
    pub counts: Vec<(HealthState, usize)>,
    /// How many have stale data.
    pub stale: usize,
}

impl<'a> Model<'a> {
    /// The state of `place` at this moment. With `worst_first` the gravest stand on top; else they keep their order.
    #[must_use]
    pub fn new(place: &'a str, state: &'a State, condition: Condition, worst_first: bool) -> Self {
        let names = state.names();
        let rows = names
            .into_iter()
            .enumerate()
            .map(|(n, name)| row(state, condition, n, name));
        let mut rows: Vec<Row<'_>> = rows.collect();
        if worst_first {
            // Stable, so that equal ones keep their order.
            rows.sort_by(|a, b| {
                gravity(b)
                    .0
                    .cmp(&gravity(a).0)
                    .then(gravity(b).1.total_cmp(&gravity(a).1))
            });
        }
        let of = |health| (health, rows.iter().filter(|row| row.health == health).count());
        let counts = HealthState::ALL
            .into_iter()
            .rev()
            .map(of)
            .filter(|(_, count)| *count > 0);
        Self {
            place,
            condition,
            state,
            counts: counts.collect(),
            stale: rows
                .iter()
                .filter(|row| matches!(row.freshness, Freshness::Stale(_)))
                .count(),
            rows,
        }
    }
}

impl Model<'_> {
    /// Place of the gravest row; 0 without any. Of equal ones the first.
    #[must_use]
    pub fn worst_row(&self) -> usize {
        let is_graver = |a: &Row<'_>, b: &Row<'_>| {
            let by_state = gravity(a).0.cmp(&gravity(b).0);
            by_state.then(gravity(a).1.total_cmp(&gravity(b).1)).is_gt()
        };
        let graver = |worst: usize, n: usize| {
            if is_graver(&self.rows[n], &self.rows[worst]) {
                n
            } else {
                worst
            }
        };
        (0..self.rows.len()).fold(0, graver)
    }
}

fn gravity(row: &Row<'_>) -> (HealthState, f64) {
    (row.health, row.worst.map_or(0.0, |(_, damage)| damage))
}

fn row<'a>(state: &'a State, condition: Condition, n: usize, name: &'a str) -> Row<'a> {
    let known = state.actuator(name).filter(|known| !known.health.actuator.is_empty());
    let since = |then_ns: u64| state.newest_ns().saturating_sub(then_ns) as f64 * 1e-9 + condition.passed_s();
    let status = state.status().and_then(|(at_ns, status)| {
        let of = status.actuators.get(n).filter(|of| of.actuator == name)?;
        Some((at_ns, of))
    });
    let reported = status.map(|(_, of)| &of.health);
    let health = known.map(|known| &known.health.health);
    let damages = known.map(|known| known.shown.damages());
    let largest = |damages: [Option<f64>; FaultId::COUNT]| {
        let damages = FaultId::NAMES.into_iter().zip(damages);
        damages
            .filter_map(|(fault, damage)| Some((fault, damage?)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
    };
    Row {
        name,
        freshness: status.map_or(Freshness::NotReported, |(at_ns, of)| {
            freshness(of, condition, since(*at_ns))
        }),
        // The window's own record comes before the counters that repeat it.
        health: health
            .or(reported)
            .map_or(HealthState::Unknown, |name| HealthState::named(name)),
        passive: status.is_some_and(|(_, of)| of.passive),
        persistence: status.map_or(0, |(_, of)| of.persistence),
        worst: damages.and_then(largest),
        window_age_s: known.map(|known| since(known.health.t_start_ns)),
        known,
        changed: status.and_then(|(_, of)| changed(of)),
    }
}

/// State of an actuator's data by the counters, `since_s` ago. The daemon reports at once when they become stale, so data
/// that were fresh are fresh as long as it runs.
fn freshness(of: &ActuatorStatus, condition: Condition, since_s: f64) -> Freshness {
    let nobody_looks = match condition {
        Condition::Silent(_) => true,
        Condition::Ended(s) => s > NEWS_MAX_S,
        Condition::Live(_) | Condition::Reading(_) | Condition::Recorded => false,
    };
    if of.is_stale() || nobody_looks {
        Freshness::Stale(of.data_age_s + since_s)
    } else {
        Freshness::Fresh
    }
}

fn changed(of: &ActuatorStatus) -> Option<String> {
    let at_ns = Some(of.changed_ns).filter(|at| *at > 0)?;
    let (from, to, damage) = (&of.changed_from, &of.health, of.changed_damage);
    let faults = match of.changed_faults.as_str() {
        "" => "no fault".to_owned(),
        faults => faults.replace(',', ", "),
    };
    let when = hmd_core::timestamp::minute(at_ns);
    Some(format!("{from} to {to} at {when}: {faults}, damage {damage:.2}"))
}
