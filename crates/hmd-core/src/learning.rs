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
use sha2::{Digest, Sha256};

use crate::assess::{
    AssessError, AssessedWindow, Assessor, BegunWindow, ExplainedWindow, LearningProgress, conditions,
};
use crate::commissioning::{CommissioningError, SeenByType, calibrate_unit, health_by_type, in_words};
use crate::config::{ActuatorConfig, Config};
use crate::deadline::TimeLimit;
use crate::metadata_checksum::hex;
use crate::outbox::WindowJob;
use crate::record::{UnitMark, WindowStatus};
use kept_windows::KeptWindows;

/// Why a unit with a known damage is not learnt. Begins the reason.
pub const NOT_LEARNT: &str = "not learnt with";

/// Learns the units of a run.
#[derive(Debug)]
pub struct Learner {
    config: Arc<Config>,
    seed: u64,
    /// Windows of each unit that is not commissioned yet, at most `learn_windows`.
    windows: BTreeMap<String, KeptWindows<(WindowJob, SeenByType)>>,
    /// The units that are known, by actuator: the SHA-256 of their files.
    known: BTreeMap<String, String>,
    /// The actuator of the last window, if that completed its windows.
    complete: Option<Arc<ActuatorConfig>>,
    learnt: Vec<LearntUnit>,
    /// Actuators whose unit was replaced.
    replaced: Vec<Arc<ActuatorConfig>>,
    /// Times of the maintenance events that are followed with the next window, UTC ns.
    followed_ns: Vec<u64>,
    /// Actuators of which it was told that their unit is not learnt for now.
    waiting: BTreeSet<String>,
    notices: Vec<String>,
}

/// A begun window, with what the learner needs to conclude it.
#[derive(Debug)]
pub struct BegunOfUnit {
    window: BegunWindow,
    context: Context,
}

/// An explained window, with what the learner needs to conclude it.
#[derive(Debug)]
pub struct ExplainedOfUnit {
    window: ExplainedWindow,
    context: Context,
}

impl ExplainedOfUnit {
    /// The window, as its explanation left it.
    #[must_use]
    pub fn into_job(self) -> WindowJob {
        self.window.into_job()
    }
}

/// What the learner needs to conclude a window.
#[derive(Debug)]
struct Context {
    /// The window as it came, where its unit is learnt from it: the assessment repairs it.
    kept: Option<Box<WindowJob>>,
    unit: UnitMark,
    events_ns: Vec<u64>,
}

impl BegunOfUnit {
    /// Explains the window: nearly all the work. Windows of different actuators may be explained side by side.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn explain(self, assessor: &Assessor, limit: &TimeLimit<'_>) -> Result<ExplainedOfUnit, AssessError> {
        Ok(ExplainedOfUnit {
            window: assessor.explain_begun(self.window, limit)?,
            context: self.context,
        })
    }
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
            known: BTreeMap::new(),
            complete: None,
            learnt: Vec::new(),
            replaced: Vec::new(),
            followed_ns: Vec::new(),
            waiting: BTreeSet::new(),
            notices: Vec::new(),
        }
    }

    /// Goes on with what an earlier run learnt of an actuator's unit; `sha256` is that of its file.
    pub fn take_unit(&mut self, assessor: &mut Assessor, actuator: &str, unit: UnitCalibration, sha256: String) {
        self.windows.remove(actuator);
        assessor.set_unit(actuator, unit);
        self.known.insert(actuator.to_owned(), sha256);
    }

    /// Forgets what was learnt of a unit that a maintenance event has replaced, or a part of it, by the time of a window, UTC ns. Returns
    /// whether one has.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn follow_events(
        &mut self,
        assessor: &mut Assessor,
        actuator: &Arc<ActuatorConfig>,
        t_ns: u64,
    ) -> Result<bool, AssessError> {
        let events_ns = assessor.histories().replacements_to_follow(actuator, t_ns);
        // A run that keeps no history, or was killed since, knows the events alone.
        let is_void = !events_ns.is_empty() || assessor.is_outdated(actuator, t_ns);
        self.followed_ns.extend(events_ns);
        if actuator.learning.is_none() || !is_void {
            return Ok(false);
        }
        self.forget(assessor, &actuator.name);
        self.replaced.push(actuator.clone());
        // What was replaced is no longer known.
        assessor.histories().history_at(actuator, t_ns)?.hold();
        Ok(true)
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
        self.assess_unless(assessor, job, limit, None)
    }

    /// The same; a unit that is not known is not learnt from this window where there is a reason against it, which its record then has.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn assess_unless(
        &mut self,
        assessor: &mut Assessor,
        job: WindowJob,
        limit: &TimeLimit<'_>,
        not_learnt: Option<String>,
    ) -> Result<AssessedWindow, AssessError> {
        let begun = self.begin(assessor, job, not_learnt)?;
        let explained = begun.explain(assessor, limit)?;
        self.conclude(assessor, explained, limit)
    }

    /// Begins the assessment of a window, as [`Learner::assess_unless`] does.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn begin(
        &mut self,
        assessor: &mut Assessor,
        job: WindowJob,
        not_learnt: Option<String>,
    ) -> Result<BegunOfUnit, AssessError> {
        self.follow_events(assessor, &job.actuator, job.window.t_start_ns)?;
        let events_ns = std::mem::take(&mut self.followed_ns);
        let (progress, unit) = self.progress(assessor, &job, not_learnt)?;
        let kept = (unit == UnitMark::Learning).then(|| Box::new(job.clone()));
        Ok(BegunOfUnit {
            window: assessor.begin(job, progress),
            context: Context { kept, unit, events_ns },
        })
    }

    /// What is done about the unit of a window once the events up to it are followed, and by what it is assessed.
    fn progress(
        &mut self,
        assessor: &mut Assessor,
        job: &WindowJob,
        not_learnt: Option<String>,
    ) -> Result<(LearningProgress, UnitMark), AssessError> {
        let (actuator, name) = (&job.actuator, &job.actuator.name);
        let Some(learning) = actuator.learning.as_ref().filter(|_| !assessor.knows_unit(actuator)) else {
            let known = self.known.get(name).cloned();
            return Ok((
                LearningProgress::NotToLearn,
                known.map_or(UnitMark::Untold, UnitMark::Learnt),
            ));
        };
        let known_damage = assessor
            .histories()
            .history_at(actuator, job.window.t_start_ns)?
            .known_damage();
        if let Some(known) = known_damage {
            let reason = format!(
                "{NOT_LEARNT} {known}: repair it and record that (hmd event --reset {name}, with --part of one part)"
            );
            self.windows.remove(name);
            if self.waiting.insert(name.clone()) {
                self.notices.push(format!("{name}: {reason}"));
            }
            return Ok((LearningProgress::Waits(reason), UnitMark::Waiting));
        }
        self.waiting.remove(name);
        if let Some(reason) = not_learnt {
            self.windows.remove(name);
            return Ok((LearningProgress::Waits(reason), UnitMark::Waiting));
        }
        let number = self.windows.get(name).map_or(0, KeptWindows::len) + 1;
        let reason = format!("learning, {number} of {} windows", learning.windows);
        Ok((LearningProgress::Learns(reason), UnitMark::Learning))
    }

    /// Decides on the health of a window that is explained, and keeps it where its unit is to be learnt.
    ///
    /// # Errors
    /// Those of [`Assessor::assess`].
    pub fn conclude(
        &mut self,
        assessor: &mut Assessor,
        explained: ExplainedOfUnit,
        limit: &TimeLimit<'_>,
    ) -> Result<AssessedWindow, AssessError> {
        let ExplainedOfUnit { window, context } = explained;
        let mut assessed = assessor.conclude(window, limit)?;
        assessed.unit = context.unit;
        assessed.events_ns = context.events_ns;
        if let Some(job) = context.kept {
            self.keep(*job, &assessed);
        }
        Ok(assessed)
    }

    /// Keeps a window from which its unit is learnt.
    fn keep(&mut self, job: WindowJob, assessed: &AssessedWindow) {
        let actuator = job.actuator.clone();
        let Some(learning) = &actuator.learning else { return };
        // No monitor assesses a window without set point; the relations learn from one that is fit, as by `hmd calibrate`.
        let is_for_relations = !actuator.has_set_point() && job.window.quality.is_fit() && conditions(&job).is_ok();
        if is_for_relations || assessed.health.status != WindowStatus::Invalid.name() {
            let kept = self.windows.entry(actuator.name.clone()).or_default();
            let is_complete = kept.keep((job, SeenByType::new(assessed)), learning.windows);
            self.complete = is_complete.then_some(actuator);
        }
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
                let sha256 = hex(&Sha256::digest(calibration.emit()));
                self.take_unit(assessor, name, calibration.clone(), sha256);
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
            self.known.remove(actuator);
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
