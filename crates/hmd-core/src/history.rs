//! The history of one unit: how much it was used, how worn it is, and how long it will last.
//!
//! Goes in, window by window: the window, and the evidence that its identification gave ([`WindowEvidence`]). Comes out: the
//! health state, the forecast and what limits it ([`UnitAssessment`]). A [`UnitHistory`] can be serialised and resumed; no
//! clock, no files.

mod clock_steps;
mod functional;
mod life_end;
mod maintenance;
mod store;
mod urgency;
mod use_so_far;

use ema_models::{FAULT_COUNT, FaultId, FaultVector};
use serde::{Deserialize, Serialize};

use crate::config::{Config, HoursOf};
use crate::functional_check::RequirementCheck;
use crate::health::{DamageEvidence, Health, HealthDecision, HealthState, LevelsError};
use crate::last_window::LastWindow;
use crate::outbox::WindowJob;
use crate::record;
use crate::rul::{Forecast, Odometer, Prognosis};
use crate::sensor_checks::SensorReadings;
use crate::sensor_health::{SENSOR_QUANTITY_COUNT, SensorHealth, SensorState};
use crate::windows_in_a_row::{News, WindowsInARow};
use clock_steps::ClockSteps;
use ema_identify::Fit;
use ema_identify::unit_calibration::CommissionedSensors;
use functional::Faults;
use urgency::{Left, Urgency};
use use_so_far::{Last, Measured};

pub use crate::fallen::{FELL, FELL_ADVICE, fallen_by};
pub use functional::LimitingCriterion;
pub use life_end::LifeEnd;
pub use maintenance::{Event, EventKind, Events, ReplacedPart, UnreadableLine};
pub use store::HistoryStore;
pub use use_so_far::RunEnd;

/// What is kept of a unit from window to window.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct UnitHistory {
    /// Time of the maintenance event that last reset it, UTC ns; 0 without one.
    begun_ns: u64,
    /// The maintenance events that were followed; older files had their numbers alone.
    #[serde(default)]
    followed: Option<store::FollowedEvents>,
    /// Of older files: number of maintenance events that were followed. Files of version 1 had none.
    #[serde(default, skip_serializing)]
    events_followed: Option<u64>,
    /// Of older files: the same of events that replaced one part, by part.
    #[serde(default, skip_serializing)]
    parts_followed: [u64; ReplacedPart::COUNT],
    /// What was replaced before the window to come: parts by their names, or `unit`; joined by commas, else empty.
    #[serde(skip)]
    replaced: String,
    /// What an operator should read.
    #[serde(skip)]
    notices: Vec<String>,
    /// Serial number of the unit.
    serial_number: Option<String>,
    /// What the hours are; older files did not say.
    #[serde(default)]
    hours_of: Option<HoursOf>,
    health: Health,
    prognosis: Prognosis,
    urgency: Urgency,
    used: Odometer,
    /// Work of the actuations that were measured; the others count with the mean of these.
    measured: Measured,
    last: Option<Last>,
    /// Steps of the clock that stamps the windows; older files had none.
    #[serde(default)]
    clock: ClockSteps,
    /// The newest fault vector.
    fault: Option<[f64; FAULT_COUNT]>,
    /// The last functional check; files of version 1 had none. The name in files is older.
    #[serde(default, rename = "tried")]
    last_check: Option<functional::LastCheck>,
    /// Health of the sensors; older files had none.
    #[serde(default)]
    sensors: SensorHealth,
    /// What was published after the last window; older files had none.
    #[serde(default)]
    published: LastWindow,
}

/// What holds of an actuator by the history of an earlier run until its next window.
#[derive(Clone, Debug)]
pub struct ResumedState {
    /// State after the last window.
    pub health: HealthState,
    /// Level of its sensors.
    pub sensors: HealthState,
    /// Windows in a row that ask for a worse state by damage.
    pub pending: u32,
    /// What the last window showed.
    pub last_window: LastWindow,
}

/// What the identification of a window gave.
#[derive(Clone, Copy)]
pub struct WindowEvidence<'a> {
    /// Damage, if the window was assessed.
    pub damage_evidence: Option<&'a DamageEvidence>,
    /// Fault vector, if the window was assessed.
    pub fault: Option<&'a FaultVector>,
    /// Currents and speeds, for the work done; empty where it was not identified.
    pub fit: &'a Fit,
    /// The check of fault vectors against the specification; `None` where nothing is required.
    pub unmet_requirement: Option<&'a RequirementCheck<'a>>,
}

/// Assessment of a unit after a window.
#[derive(Clone, Debug)]
pub struct UnitAssessment {
    /// State and faults by damage alone.
    pub health: HealthDecision,
    /// The worse of the states by damage and by remaining useful life.
    pub state: HealthState,
    /// Remaining useful life.
    pub forecast: Forecast,
    /// The criterion that ends the life.
    pub limiting_criterion: LimitingCriterion,
    /// Use so far.
    pub used: Odometer,
    /// What was replaced since the window before: parts by their names, or `unit`; joined by commas, else empty.
    pub replaced: String,
}

impl UnitHistory {
    /// The history of a new unit.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn new(config: &Config, serial_number: Option<String>) -> Result<Self, LevelsError> {
        let levels = *config.health().levels();
        Ok(Self {
            begun_ns: 0,
            followed: None,
            events_followed: None,
            parts_followed: [0; ReplacedPart::COUNT],
            replaced: String::new(),
            notices: Vec::new(),
            serial_number,
            hours_of: Some(config.rul().hours),
            health: Health::new(levels)?,
            prognosis: Prognosis::new(levels.map(|l| l.end_of_life)),
            urgency: Urgency::default(),
            used: Odometer::default(),
            measured: Measured::default(),
            last: None,
            clock: ClockSteps::default(),
            fault: None,
            last_check: None,
            sensors: SensorHealth::default(),
            published: LastWindow::default(),
        })
    }

    /// Whether the history is possible; a damaged file may hold any numbers.
    #[must_use]
    pub fn is_possible(&self) -> bool {
        let used = [self.used.hours, self.used.cycles, self.used.work_j];
        used.iter().all(|used| *used >= 0.0)
            && i64::try_from(self.begun_ns).is_ok()
            && self.health.is_possible()
            && self.prognosis.is_possible()
            && self.urgency.is_possible()
            && self.sensors.is_possible()
            && self.clock.is_possible()
    }

    /// Resumes a stored history under a configuration. The pause counts as no use; a unit with another serial number begins a
    /// new history.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn resumed(self, config: &Config, serial_number: Option<String>) -> Result<Self, LevelsError> {
        let new = Self::new(config, serial_number)?;
        if self.serial_number != new.serial_number {
            return Ok(new);
        }
        let hours_of = self.hours_of;
        let mut resumed = Self {
            hours_of: new.hours_of,
            health: self.health.with_rules_of(&new.health),
            prognosis: self.prognosis.with_end_of_life(new.prognosis.end_of_life()),
            clock: self.clock.with_end_of_life(new.prognosis.end_of_life()),
            ..self
        };
        resumed.begin_run();
        if hours_of.is_some() && hours_of != resumed.hours_of {
            resumed.forget_use();
        }
        Ok(resumed)
    }

    /// The windows that come are of another run, which counts them and its time of operation from 0; elapsed hours continue.
    fn begin_run(&mut self) {
        // The specification may be another one.
        self.last_check = None;
        self.last = self.last.map(Last::before_run);
    }

    /// Begins use and all trends over it anew: the hours of two clocks do not add.
    fn forget_use(&mut self) {
        self.prognosis = Prognosis::new(self.prognosis.end_of_life());
        self.urgency = Urgency::default();
        self.used = Odometer::default();
        self.measured = Measured::default();
        self.clock = ClockSteps::default();
        self.sensors.forget_trends();
        let hours = self.hours_of.map_or("", HoursOf::name);
        self.notices.push(format!(
            "rul.hours is another than before, now {hours}: use and trends begin anew"
        ));
    }

    /// Forgets the wear of what a new part changes, and the references of the sensors in it; use and all other damage go on.
    fn replace(&mut self, part: ReplacedPart, t_ns: u64) {
        for fault in part.faults() {
            self.health.forget(*fault);
            self.prognosis.forget(*fault);
            self.published.forget(*fault);
        }
        // What was known before a pause knows nothing of the new part.
        self.clock.forget_before_pause();
        self.sensors.forget(part.sensors(), t_ns);
        if self.urgency.forget(part) {
            self.published.rul_h = [None; 3];
        }
        // It rests on all faults together.
        self.last_check = None;
        self.note_replaced(part.name());
    }

    fn note_replaced(&mut self, what: &str) {
        if !self.replaced.is_empty() {
            self.replaced.push(',');
        }
        self.replaced.push_str(what);
    }

    /// Keeps what is known of worn parts as it is, at least: the calibration by which it was found is void. Until their part is replaced, or the
    /// unit is commissioned again ([`UnitHistory::release`]).
    pub(crate) fn hold(&mut self) {
        self.health.hold();
        self.urgency.hold();
    }

    /// Lets the damages of the windows decide again.
    pub(crate) fn release(&mut self) {
        self.health.release();
        self.urgency.release();
    }

    /// The faults that are known at watch or worse, and a short remaining life, in words; `None` where there are none.
    pub(crate) fn known_damage(&self) -> Option<String> {
        let states = FaultId::ALL.into_iter().zip(self.health.states());
        let is_known = |(_, state): &(FaultId, HealthState)| *state >= HealthState::Watch;
        let mut known: Vec<String> = states
            .filter(is_known)
            .map(|(fault, state)| format!("{} at {state}", fault.name()))
            .collect();
        let by_life = self.urgency.state();
        if by_life >= HealthState::Watch {
            known.push(format!("{by_life} by remaining life"));
        }
        (!known.is_empty()).then(|| known.join(", "))
    }

    /// Adds a window and its evidence, and decides on the health state: the worse of the state by damage and the state by
    /// remaining life.
    pub fn update(&mut self, job: &WindowJob, evidence: &WindowEvidence<'_>, config: &Config) -> UnitAssessment {
        self.count(job, evidence.fit, config.rul().hours);
        // Too uncertain a damage ends no life.
        let levels = config.health().levels();
        let estimates = FaultId::ALL.map(|fault| {
            let shown = |of: &&DamageEvidence| of.shows(fault, &levels[fault.index()]);
            evidence.damage_evidence.filter(shown)?.damage_and_sigma(fault)
        });
        self.prognosis.update(self.used, &estimates);
        let mut forecast = self.prognosis.forecast(config.rul().horizon_h);
        self.health.hide(job.actuator.hidden_faults());
        let health = self.health.update(job.window.number, evidence.damage_evidence);
        self.fault = evidence.fault.map(|fault| fault.to_array()).or(self.fault);
        let limiting_criterion = match (evidence.unmet_requirement, self.fault) {
            (Some(unmet_requirement), Some(fault)) => {
                let faults = Faults {
                    prognosis: &self.prognosis,
                    states: health.states,
                    seen: FaultVector::from_array(fault),
                };
                functional::bring_forward(&mut forecast, &faults, unmet_requirement, &mut self.last_check)
            }
            _ => LimitingCriterion::Damage,
        };
        // The function is missed by all faults together.
        let ends_by = forecast
            .dominant
            .filter(|_| limiting_criterion == LimitingCriterion::Damage);
        let left = Left {
            forecast: &forecast,
            ends_by,
            shown: estimates.map(|estimate| estimate.is_some()),
        };
        let urgent = self
            .urgency
            .update(&left, config.rul(), |fault| self.health.persistence(fault));
        UnitAssessment {
            state: health.state.max(urgent),
            health,
            forecast,
            limiting_criterion,
            used: self.used,
            replaced: std::mem::take(&mut self.replaced),
        }
    }

    /// Takes what a window shows of the sensors, after [`UnitHistory::update`] has counted its hours; `None` of a window that is no
    /// evidence. `commissioned` is what the unit's commissioning has shown; one from before the unit came is of another.
    pub fn update_sensors(
        &mut self,
        job: &WindowJob,
        readings: Option<&SensorReadings>,
        commissioned: Option<&CommissionedSensors>,
    ) -> [SensorState; SENSOR_QUANTITY_COUNT] {
        let tolerances = &job.actuator.tolerances;
        let is_of_unit = |of: &&CommissionedSensors| u64::try_from(of.until_ns).unwrap_or(0) >= self.begun_ns;
        if let Some(commissioned) = commissioned.filter(is_of_unit) {
            self.sensors.compare_with(commissioned);
        }
        self.sensors.update(self.used.hours, readings, &job.params, tolerances)
    }

    /// The reason that names the faults whose damage fell since the windows before, though no maintenance event replaced their part; before
    /// [`UnitHistory::update`].
    pub(crate) fn fallen(&self, evidence: &DamageEvidence) -> Option<String> {
        let told = |(fault, state): (FaultId, HealthState)| {
            let (damage, sigma) = evidence.damage_and_sigma(fault)?;
            Some(format!("{} {damage:.2} ± {sigma:.2} after {state}", fault.name()))
        };
        let fallen: Vec<String> = self.health.fallen(evidence).into_iter().filter_map(told).collect();
        (!fallen.is_empty()).then(|| format!("{FELL} ({}): {FELL_ADVICE}", fallen.join(", ")))
    }

    /// Takes the records of a window as they are published; what became news by it.
    pub(crate) fn note_published(&mut self, health: &record::Health, rul: &record::Rul) -> Vec<News> {
        let mut in_a_row = std::mem::take(&mut self.published.in_a_row);
        let mut news = in_a_row.update(health);
        let published = LastWindow::new(health, rul, &in_a_row);
        // A damage that stays fallen, as while a worn unit is not learnt, is told once.
        let is_news = FaultId::ALL
            .iter()
            .any(|fault| published.fallen[fault.index()] && !self.published.fallen[fault.index()]);
        let fell = health.reason.split("; ").find(|reason| reason.starts_with(FELL));
        news.extend(fell.filter(|_| is_news).map(|reason| News {
            text: format!("{reason} (window {})", health.window),
            for_the_worse: true,
        }));
        self.published = published;
        news
    }

    /// What the newest windows have in common.
    pub(crate) fn in_a_row(&self) -> &WindowsInARow {
        &self.published.in_a_row
    }

    /// Serial number of the unit, if the configuration gives one.
    #[must_use]
    pub fn serial_number(&self) -> Option<&str> {
        self.serial_number.as_deref()
    }

    /// Start of the last window, UTC ns; `None` before the first.
    #[must_use]
    pub fn last_window_ns(&self) -> Option<u64> {
        self.last.map(|last| last.t_start_ns)
    }

    /// What holds until the next window.
    pub(crate) fn resumed_state(&self) -> ResumedState {
        let mut last_window = self.published.clone();
        if last_window.states.is_none() {
            // A file of before has the states alone.
            last_window.states = Some(self.health.states());
            last_window.t_start_ns = self.last_window_ns().unwrap_or(0);
        }
        // While the unit is learnt its history knows more than the last window told.
        let is_open = |states: [HealthState; FaultId::COUNT]| states == [HealthState::Unknown; FaultId::COUNT];
        let health = match last_window.states {
            Some(states) if is_open(states) => self.urgency.state(),
            _ => self.state(),
        };
        ResumedState {
            health,
            sensors: self.sensors.level(),
            pending: self.pending(),
            last_window,
        }
    }

    /// State after the last window: the worse of those by damage and by remaining life.
    fn state(&self) -> HealthState {
        self.health.state().max(self.urgency.state())
    }

    /// Windows in a row that ask for a worse state by damage.
    pub(crate) fn pending(&self) -> u32 {
        self.health.pending()
    }
}

#[cfg(test)]
mod tests;
