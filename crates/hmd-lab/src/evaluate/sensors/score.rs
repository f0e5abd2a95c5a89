//! Assessed windows with a mistake -> counts -> rates.

use ema_models::{FaultId, FaultVector};
use hmd_core::assess::AssessedWindow;
use hmd_core::record::{Health, WindowStatus};
use hmd_core::sensor_checks::Suspect;
use serde::Serialize;

use super::mistakes::Mistake;

/// Counts of windows.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    windows: u64,
    judged: u64,
    accused: u64,
    named: u64,
    wrongly_named: u64,
    worn: u64,
    found: u64,
    denied: u64,
    shown: u64,
    named_of_shown: u64,
    findable: u64,
    found_of_findable: u64,
    units: u64,
    units_named: u64,
    units_wrongly_named: u64,
}

/// Rates over windows. A window that was not cut counts with what the pipeline reported.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rates {
    /// Windows.
    pub windows: u64,
    /// Share of the windows with status `ok` or `degraded`.
    pub judged_rate: f64,
    /// Share of these that name a part which is not worn.
    pub accused_rate: f64,
    /// Share of the windows that name the mistake.
    pub named_rate: f64,
    /// Share of the windows that name another mistake and not this one.
    pub wrongly_named_rate: f64,
    /// Share of the windows of worn actuators that name the worn part.
    pub found_rate: f64,
    /// Share of the same that deny it: judged, and the estimate lies further below the damage than three of its sigmas.
    pub denied_rate: f64,
    /// Share of the windows that show the mistake: no actuator of the type makes the motion with what was read.
    pub shown_rate: f64,
    /// Share of these that name it.
    pub named_of_shown_rate: f64,
    /// Share of the windows that show the mistake and report the worn part without it, which report it beside the mistake, too.
    pub found_of_findable_rate: f64,
    /// Units.
    pub units: u64,
    /// Share of the units of which a window names the mistake.
    pub units_named_rate: f64,
    /// Share of the units of which a window names another mistake and not this one, whatever the others name.
    pub units_wrongly_named_rate: f64,
}

/// What was said of one window.
pub(super) struct Outcome<'a> {
    /// The worn part, and the fault vector.
    pub(super) worn: Option<(FaultId, FaultVector)>,
    /// The window, if one was cut.
    pub(super) assessed: Option<&'a AssessedWindow>,
    /// Suspects that the pipeline named.
    pub(super) noticed: &'a [Suspect],
    /// Whether the motion shows the mistake.
    pub(super) is_shown: bool,
    /// Whether the worn part is reported without it.
    pub(super) is_findable: bool,
}

/// Standard deviations below the damage at which an estimate denies it.
const DENIED_SIGMAS: f64 = 3.0;

/// Whether an estimate says that a worn part is clearly better than it is.
fn denies(health: &Health, (fault, truth): (FaultId, FaultVector)) -> bool {
    let Some(estimate) = health.estimate() else {
        return false;
    };
    let place = fault.parameter();
    let [found, worn] = [FaultVector::from_array(estimate.k), truth].map(|vector| vector.damage_of(fault));
    let error = (estimate.k[place] - truth.to_array()[place]).abs();
    found < worn && estimate.sigma[place].is_some_and(|sigma| error > DENIED_SIGMAS * sigma)
}

impl Tally {
    /// Counts one window.
    pub(super) fn add(&mut self, mistake: &Mistake, outcome: &Outcome<'_>) {
        let faults: &[String] = outcome.assessed.map_or(&[], |window| &window.health.fault_list);
        let suspects: Vec<Suspect> = outcome
            .assessed
            .map_or(&[][..], |window| &window.suspects)
            .iter()
            .chain(outcome.noticed)
            .copied()
            .collect();
        let is_worn = |name: &String| outcome.worn.is_some_and(|(worn, _)| worn.name() == name);
        let is_judged = outcome.assessed.is_some_and(|window| {
            let status = WindowStatus::from_name(&window.health.status);
            matches!(status, Some(WindowStatus::Ok | WindowStatus::Degraded))
        });
        let is_named = suspects.iter().any(|suspect| mistake.suspects.contains(suspect));
        self.windows += 1;
        self.judged += u64::from(is_judged);
        self.accused += u64::from(is_judged && !faults.iter().all(is_worn));
        self.named += u64::from(is_named);
        self.wrongly_named += u64::from(!is_named && !suspects.is_empty());
        self.worn += u64::from(outcome.worn.is_some());
        let is_found = faults.iter().any(is_worn);
        self.found += u64::from(is_found);
        let denies = |window: &AssessedWindow| outcome.worn.is_some_and(|worn| denies(&window.health, worn));
        self.denied += u64::from(is_judged && !is_found && outcome.assessed.is_some_and(denies));
        self.shown += u64::from(outcome.is_shown);
        self.named_of_shown += u64::from(outcome.is_shown && is_named);
        self.findable += u64::from(outcome.is_shown && outcome.is_findable);
        self.found_of_findable += u64::from(outcome.is_shown && outcome.is_findable && is_found);
    }

    /// Counts one unit by its windows.
    pub(super) fn add_unit(&mut self, windows: &Self) {
        let unit = Self {
            units: 1,
            units_named: u64::from(windows.named > 0),
            units_wrongly_named: u64::from(windows.wrongly_named > 0),
            ..*windows
        };
        *self = Self::sum([*self, unit].iter());
    }

    pub(super) fn sum<'a>(tallies: impl Iterator<Item = &'a Self>) -> Self {
        tallies.fold(Self::default(), |sum, other| Self {
            windows: sum.windows + other.windows,
            judged: sum.judged + other.judged,
            accused: sum.accused + other.accused,
            named: sum.named + other.named,
            wrongly_named: sum.wrongly_named + other.wrongly_named,
            worn: sum.worn + other.worn,
            found: sum.found + other.found,
            denied: sum.denied + other.denied,
            shown: sum.shown + other.shown,
            named_of_shown: sum.named_of_shown + other.named_of_shown,
            findable: sum.findable + other.findable,
            found_of_findable: sum.found_of_findable + other.found_of_findable,
            units: sum.units + other.units,
            units_named: sum.units_named + other.units_named,
            units_wrongly_named: sum.units_wrongly_named + other.units_wrongly_named,
        })
    }

    pub(super) fn rates(&self) -> Rates {
        let share = |count: u64, of: u64| count as f64 / of.max(1) as f64;
        Rates {
            windows: self.windows,
            judged_rate: share(self.judged, self.windows),
            accused_rate: share(self.accused, self.judged),
            named_rate: share(self.named, self.windows),
            wrongly_named_rate: share(self.wrongly_named, self.windows),
            found_rate: share(self.found, self.worn),
            denied_rate: share(self.denied, self.worn),
            shown_rate: share(self.shown, self.windows),
            named_of_shown_rate: share(self.named_of_shown, self.shown),
            found_of_findable_rate: share(self.found_of_findable, self.findable),
            units: self.units,
            units_named_rate: share(self.units_named, self.units),
            units_wrongly_named_rate: share(self.units_wrongly_named, self.units),
        }
    }
}
