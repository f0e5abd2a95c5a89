//! Learns units from their first windows, where the configuration asks for it (`learn_windows`).
//!
//! In: the windows of all actuators, in their order. Out: their records; until a unit is commissioned its health is unknown, for the
//! reason `learning`, and its windows are kept. With the last of them the unit is commissioned as `hmd calibrate` does it, and later windows are
//! assessed by what was learnt. Where that fails, the older half of the windows is dropped and learning goes on. A unit whose history knows a
//! worn part is not learnt: its damage would count as health. It is assessed as one that is not commissioned until the part is replaced; what is
//! known does not improve meanwhile. The same windows and seed give the same records. No files: what was learnt is taken by [`Learner::take_learnt`]. CPU-bound.

mod kept_windows;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ema_identify::unit_calibration::UnitCalibration;

use crate::assess::{AssessError, AssessedWindow, Assessor, LearningProgress};
use crate::commissioning::{CommissioningError, SeenByType, calibrate_unit, health_by_type, in_words};
use crate::config::{ActuatorConfig, Config};
use crate::deadline::TimeLimit;
use crate::outbox::WindowJob;
use crate::record::WindowStatus;
use kept_windows::KeptWindows;

/// Learns the units of a run.
#[derive(Debug)]
pub struct Learner {
    config: Arc<Config>,
    seed: u64,
    /// Windows of each unit that is not commissioned yet, at most `learn_windows`.
    windows: BTreeMap<String, KeptWindows<(WindowJob, SeenByType)>>,
    /// The actuator of the last window, if that completed its windows.
    complete: Option<Arc<ActuatorConfig>>,
    learnt: Vec<LearntUnit>,
    /// Actuators whose unit was replaced.
    replaced: Vec<Arc<ActuatorConfig>>,
    /// Actuators of which it was told that their unit is not learnt for now.
    waiting: BTreeSet<String>,
    notices: Vec<String>,
}

/// A unit that was commissioned by its first windows.
#[derive(Clone, Debug)]
pub struct LearntUnit {
    /// Its actuator.
    pub actuator: Arc<ActuatorConfig>,
    /// What was learnt.
    pub calibration: UnitCalibration,
}

impl Learner {
    /// Without any window; `seed` is that of every search.
    #[must_use]
    pub fn new(config: Arc<Config>, seed: u64) -> Self {
        Self {
            config,
            seed,
            windows: BTreeMap::new(),
            complete: None,
            learnt: Vec::new(),
            replaced: Vec::new(),
            waiting: BTreeSet::new(),
            notices: Vec::new(),
        }
    }

    /// Assesses a window, and keeps it where its unit is to be learnt. [`Learner::commission_complete`] comes next.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn assess(
        &mut self,
        assessor: &mut Assessor,
        job: WindowJob,
        limit: &TimeLimit<'_>,
    ) -> Result<AssessedWindow, AssessError> {
        let actuator = job.actuator.clone();
        let is_learnt = actuator.learning.is_some();
        let t_ns = job.window.t_start_ns;
        // A run that keeps no history, or was killed since, knows the events alone.
        let is_void = assessor.histories().is_replaced(&actuator, t_ns) || assessor.is_outdated(&actuator, t_ns);
        if is_learnt && is_void {
            self.forget(assessor, &actuator.name);
            self.replaced.push(actuator.clone());
        }
        let Some(learning) = actuator.learning.as_ref().filter(|_| !assessor.knows_unit(&actuator)) else {
            return assessor.assess_within(job, limit, &LearningProgress::NotToLearn);
        };
        // Follows the events first: what was replaced is no longer known.
        let history = assessor.histories().history_at(&actuator, t_ns)?;
        if is_void {
            history.hold();
        }
        if let Some(known) = history.known_damage() {
            let name = &actuator.name;
            let reason = format!(
                "not learnt with {known}: repair it and record that (hmd event --reset {name}, with --part of one part)"
            );
            self.windows.remove(name);
            if self.waiting.insert(name.clone()) {
                self.notices.push(format!("{name}: {reason}"));
            }
            return assessor.assess_within(job, limit, &LearningProgress::Waits(reason));
        }
        self.waiting.remove(&actuator.name);
        let kept = self.windows.entry(actuator.name.clone()).or_default();
        let number = kept.len() + 1;
        let copy = job.clone();
        let reason = format!("learning, {number} of {} windows", learning.windows);
        let assessed = assessor.assess_within(job, limit, &LearningProgress::Learns(reason))?;
        let is_valid = assessed.health.status != WindowStatus::Invalid.name();
        let seen = SeenByType::new(&assessed);
        let is_complete = is_valid && kept.keep((copy, seen), learning.windows);
        self.complete = is_complete.then_some(actuator);
        Ok(assessed)
    }

    /// Commissions the unit of the last window, if that was the last of its `learn_windows`. Takes as long as many assessments.
    /// Returns whether there was one.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn commission_complete(&mut self, assessor: &mut Assessor) -> Result<bool, AssessError> {
        let Some(actuator) = self.complete.take() else {
            return Ok(false);
        };
        self.commission(assessor, &actuator)?;
        Ok(true)
    }

    fn commission(&mut self, assessor: &mut Assessor, actuator: &Arc<ActuatorConfig>) -> Result<(), AssessError> {
        let name = &actuator.name;
        let Some(kept) = self.windows.get_mut(name) else {
            return Ok(());
        };
        // Commissioning repairs what it learns from; the windows stay as they came.
        let (mut jobs, seen): (Vec<_>, Vec<_>) = kept.windows().iter().cloned().unzip();
        let levels = self.config.health().levels();
        let commissioned = health_by_type(&seen, actuator, levels).and_then(|warnings| {
            let commissioned = calibrate_unit(assessor, levels, &mut jobs, self.seed, &|_| {})?;
            Ok((commissioned.calibration, warnings))
        });
        match commissioned {
            Ok((calibration, warnings)) => {
                let warnings = warnings.into_iter().map(|warning| format!("{name}: {warning}"));
                self.notices.extend(warnings);
                let sentences = in_words(&calibration).join("; ");
                self.notices.push(format!("{name}: commissioned, {sentences}"));
                self.windows.remove(name);
                assessor.set_unit(name, calibration.clone());
                self.learnt.push(LearntUnit {
                    actuator: actuator.clone(),
                    calibration,
                });
            }
            Err(CommissioningError::Assess(error)) => return Err(error),
            Err(error) => {
                let windows = kept.len();
                kept.drop_older_half();
                self.notices.push(format!(
                    "{name}: not commissioned by {windows} windows, learning goes on: {error}"
                ));
            }
        }
        Ok(())
    }

    /// The windows that come are of another run, which does not have those of the one before.
    pub fn begin_run(&mut self) {
        self.windows.clear();
        self.waiting.clear();
    }

    /// Forgets what was learnt of an actuator whose unit turns out to be another one.
    pub fn forget(&mut self, assessor: &mut Assessor, actuator: &str) {
        if self
            .config
            .actuator_named(actuator)
            .is_some_and(|of| of.learning.is_some())
        {
            self.windows.remove(actuator);
            assessor.remove_unit(actuator);
        }
    }

    /// Actuators whose unit, or a part of it, a maintenance event replaced since the last call: what was learnt of the one before is void.
    pub fn take_replaced(&mut self) -> Vec<Arc<ActuatorConfig>> {
        std::mem::take(&mut self.replaced)
    }

    /// Units commissioned since the last call.
    pub fn take_learnt(&mut self) -> Vec<LearntUnit> {
        std::mem::take(&mut self.learnt)
    }

    /// What an operator should read, since the last call.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }
}
