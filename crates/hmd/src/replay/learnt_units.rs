//! Which commissioning a replay uses for a unit that a daemon learns.
//!
//! The windows that its run learnt from are learnt from again. A window that its run assessed by a unit learnt before is assessed by that
//! unit: as this replay has learnt it, else as it is kept in `learn_folder`, told apart by the SHA-256 of its file. Where it is neither, the
//! window is assessed as one of a unit that is not commissioned, which is told and counted: its unit may be worn, and is never learnt.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use hmd_core::assess::{AssessError, Assessor};
use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::learning::Learner;
use hmd_core::outbox::WindowJob;
use hmd_core::record::{LogLevel, UnitMark};
use hmd_storage::calibration_file::{KeptUnit, load_learnt_unit};

use super::recorded_units::{RecordedUnit, RecordedUnits};

/// The units of a replay.
#[derive(Debug)]
pub(super) struct LearntUnits {
    config: Arc<Config>,
    recorded: RecordedUnits,
    /// Of each actuator whose unit is known, the SHA-256 that its run gave the file of the same unit: another program or seed learns slightly
    /// other numbers from the same windows.
    same: BTreeMap<String, String>,
    /// Of each actuator whose unit was replaced, that of the unit before: the run may have followed the event with a later window.
    replaced: BTreeMap<String, String>,
    told: BTreeSet<(String, String)>,
    notices: Vec<(LogLevel, String)>,
    /// Windows that were assessed without the unit that their run had learnt.
    pub(super) windows_without: u64,
}

/// Begin of the reason of a window that its unit is not learnt from.
const NOT_LEARNT: &str = "not learnt";

/// Digits of a SHA-256 that tell units apart in a sentence.
const DIGITS_TOLD: usize = 12;

impl LearntUnits {
    /// Of the logs whose marks are given.
    pub(super) fn new(config: Arc<Config>, recorded: RecordedUnits) -> Self {
        Self {
            config,
            recorded,
            same: BTreeMap::new(),
            replaced: BTreeMap::new(),
            told: BTreeSet::new(),
            notices: Vec::new(),
            windows_without: 0,
        }
    }

    /// The windows that come are of this log.
    pub(super) fn begin_log(&mut self, number: usize) {
        self.recorded.begin_log(number);
    }

    /// What an operator should read, since the last call.
    pub(super) fn take_notices(&mut self) -> Vec<(LogLevel, String)> {
        std::mem::take(&mut self.notices)
    }

    /// Before a window is assessed: lets the learner know what its run knew. Returns why the unit is not to be learnt from the window, if it is
    /// not.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub(super) fn prepare(
        &mut self,
        learner: &mut Learner,
        assessor: &mut Assessor,
        job: &WindowJob,
    ) -> Result<Option<String>, AssessError> {
        let (actuator, t_ns) = (&job.actuator, job.window.t_start_ns);
        if actuator.learning.is_none() {
            return Ok(None);
        }
        let name = &actuator.name;
        if learner.follow_events(assessor, actuator, t_ns)?
            && let Some(before) = self.same.remove(name)
        {
            self.replaced.insert(name.clone(), before);
        }
        let RecordedUnit { unit, is_first } = self.recorded.next(name, t_ns);
        // It goes on with what its run began with.
        if is_first && matches!(unit, UnitMark::Learning | UnitMark::Waiting) {
            learner.forget(assessor, name);
            self.same.remove(name);
        }
        let is_known = assessor.knows_unit(actuator);
        match unit {
            UnitMark::Learning => {
                // What comes to be known is what is learnt now.
                self.same.remove(name);
                Ok(None)
            }
            UnitMark::Waiting => Ok(Some(format!("{NOT_LEARNT}: nor did its run learn from this window"))),
            UnitMark::Untold if self.recorded.is_capture() && !is_known => {
                Ok(self.take_for_capture(learner, assessor, actuator, t_ns))
            }
            UnitMark::Untold => Ok(None),
            UnitMark::Learnt(sha256) => Ok(self.take_known(learner, assessor, actuator, sha256, is_known)),
        }
    }

    /// A window that its run assessed by a unit with this SHA-256.
    fn take_known(
        &mut self,
        learner: &mut Learner,
        assessor: &mut Assessor,
        actuator: &ActuatorConfig,
        sha256: String,
        is_known: bool,
    ) -> Option<String> {
        let name = &actuator.name;
        if is_known && self.same.get(name).is_none_or(|same| *same == sha256) {
            self.same.insert(name.clone(), sha256);
            return None;
        }
        if self.replaced.get(name) == Some(&sha256) {
            return None;
        }
        let why = match load_learnt_unit(&self.config, actuator) {
            Ok(Some(kept)) if kept.sha256 == sha256 => {
                self.take(learner, assessor, kept);
                return None;
            }
            Ok(Some(kept)) => format!("{} is that of another one", kept.path.display()),
            Ok(None) => self.not_there(actuator),
            Err(error) => error.to_string(),
        };
        learner.forget(assessor, name);
        // Replaced later, it is the unit before.
        self.same.insert(name.clone(), sha256.clone());
        Some(self.without(name, &sha256, &why))
    }

    /// A window of a capture that does not say by what it was assessed: its unit was learnt before, or later.
    fn take_for_capture(
        &mut self,
        learner: &mut Learner,
        assessor: &mut Assessor,
        actuator: &ActuatorConfig,
        t_ns: u64,
    ) -> Option<String> {
        let why = match load_learnt_unit(&self.config, actuator) {
            Ok(Some(kept)) => {
                let sensors = kept.calibration.sensors.as_ref();
                let until_ns = sensors.map_or(t_ns, |of| u64::try_from(of.until_ns).unwrap_or(0));
                let (from_ns, to_ns) = (t_ns.min(until_ns), t_ns.max(until_ns));
                if !assessor.histories().is_replaced_between(actuator, from_ns, to_ns) {
                    self.take(learner, assessor, kept);
                    return None;
                }
                format!("{} is that of another one", kept.path.display())
            }
            Ok(None) => self.not_there(actuator),
            Err(error) => error.to_string(),
        };
        Some(self.without(&actuator.name, "", &why))
    }

    fn take(&mut self, learner: &mut Learner, assessor: &mut Assessor, kept: KeptUnit<'_>) {
        let name = &kept.actuator.name;
        if self.told.insert((name.clone(), kept.sha256.clone())) {
            let path = kept.path.display();
            self.notices.push((
                LogLevel::Info,
                format!("{name}: assessed by what was learnt of it, {path}"),
            ));
        }
        self.same.insert(name.clone(), kept.sha256.clone());
        learner.take_unit(assessor, name, kept.calibration, kept.sha256);
    }

    fn not_there(&self, actuator: &ActuatorConfig) -> String {
        let path = self.config.learnt_file(actuator).unwrap_or_default();
        format!("{} is not there", path.display())
    }

    /// Counts a window without the unit of its run. Returns why it is not learnt from.
    fn without(&mut self, name: &str, sha256: &str, why: &str) -> String {
        self.windows_without += 1;
        let digits = sha256.get(..DIGITS_TOLD).unwrap_or_default();
        let which = if digits.is_empty() {
            "the unit of this capture was learnt from windows that it lacks".to_owned()
        } else {
            format!("its run assessed it by a unit that it had learnt before (SHA-256 {digits}…)")
        };
        let reason = format!("{NOT_LEARNT}: {which}, and {why}");
        if self.told.insert((name.to_owned(), sha256.to_owned())) {
            let message = format!("{name}: {reason}; assessed as one that is not commissioned");
            self.notices.push((LogLevel::Error, message));
        }
        reason
    }
}
