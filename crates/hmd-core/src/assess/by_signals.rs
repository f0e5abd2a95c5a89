//! What the signals of a window show of mistakes is taken out of it before the estimate.

use super::by_unit::Assessed;
use super::{AssessError, Assessor, conditions, sensors_of};
use crate::outbox::WindowJob;
use crate::outliers::grants_runs;
use crate::sensor_checks::rivals::{ALIKE, BETTER, Verdict, accuses_all_phases_alike, compare, is_doubtful};
use crate::sensor_checks::{
    Correction, Finding, Suspect, Suspicion, current_unit, examine, offset_by_torque, sensor_readings, setpoint_time,
};
use crate::sensor_health::offset_since;
use crate::window::{Defect, Degradation, Invalidity, Signal, WindowQuality};
use ema_identify::effort::Effort;
use ema_models::FaultId;

/// A window without its mistakes.
pub(super) struct BySignals {
    pub(super) corrected: WindowJob,
    pub(super) assessed: Assessed,
    /// Whether what competes with a mistake was left out for want of time.
    pub(super) unchecked: bool,
}

impl Assessor {
    /// An invalid window without the mistakes that made it so, and its estimate; none where it is not fit without them, or something else is
    /// wrong with its signals then.
    pub(super) fn made_fit(
        &self,
        job: &mut WindowJob,
        is_learning: bool,
        effort: &Effort<'_>,
        suspects: &mut Vec<Suspect>,
        reasons: &mut Vec<String>,
    ) -> Result<Option<BySignals>, AssessError> {
        let WindowQuality::Invalid(invalidity) = &job.window.quality else {
            return Ok(None);
        };
        // Currents of a few steps of their resolution stand still between them.
        let unit = current_unit(job).filter(|_| *invalidity == Invalidity::Stuck(Signal::Currents));
        if unit.is_none() {
            suspects.extend(Suspect::of_invalidity(invalidity));
        }
        let findings = if let Some(unit) = unit {
            vec![unit]
        } else if suspects.is_empty() && shows_signals(invalidity) {
            examine(job)
        } else {
            Vec::new()
        };
        let mut made_fit = None;
        let corrections: Option<Vec<Correction>> = findings.iter().map(|finding| finding.correction).collect();
        if let Some(corrections) = corrections.filter(|corrections| !corrections.is_empty() && !is_learning) {
            let mut other = job.clone();
            for correction in corrections {
                correction.apply(&mut other);
            }
            let is_checked = other.window.check_again(self.config.window(), &other.params).is_ok();
            if let (true, Ok(conditions)) = (is_checked && other.window.quality.is_fit(), conditions(&other))
                && examine(&other).is_empty()
            {
                job.window = other.window.clone();
                made_fit = self
                    .estimate(&mut other, conditions, effort)?
                    .map(|assessed| BySignals {
                        assessed: self.beside(assessed, &findings),
                        corrected: other,
                        unchecked: false,
                    });
            }
        }
        if let WindowQuality::Invalid(invalidity) = &job.window.quality {
            reasons.push(invalidity.to_string());
        }
        report(&findings, suspects, reasons);
        Ok(made_fit)
    }

    /// A window without the mistakes that its signals show by themselves, and its estimate; none where a mistake cannot be taken out, or a
    /// worn part explains as much as one.
    pub(super) fn without_mistakes(
        &self,
        job: &WindowJob,
        is_learning: bool,
        effort: &Effort<'_>,
        suspects: &mut Vec<Suspect>,
        reasons: &mut Vec<String>,
    ) -> Result<Option<BySignals>, AssessError> {
        if let WindowQuality::Degraded(handicaps) = &job.window.quality {
            let is_repeated = |handicap: &Degradation| matches!(handicap, Degradation::Repeated(_));
            suspects.extend(handicaps.iter().any(is_repeated).then_some(Suspect::RepeatedSamples));
        }
        let (open, mut findings): (Vec<Finding>, Vec<Finding>) =
            examine(job).into_iter().partition(|finding| finding.or_part);
        // What is learnt holds for set points that are logged as they are.
        if findings.is_empty() && !is_learning && job.actuator.has_output_angle() {
            findings.extend(self.setpoint_time(job));
        }
        report(&findings, suspects, reasons);
        let mut corrected = job.clone();
        for finding in &findings {
            match finding.correction {
                Some(correction) => correction.apply(&mut corrected),
                None => return Ok(None),
            }
        }
        let conditions = match conditions(&corrected) {
            Ok(conditions) => conditions,
            Err(absurd) => {
                reasons.push(absurd);
                return Ok(None);
            }
        };
        let Some(mut assessed) = self.estimate(&mut corrected, conditions, effort)? else {
            return Ok(None);
        };
        let grants = |assessed: &Assessed| grants_runs(effort, assessed.estimate.evaluations, job.length_s());
        let mut unchecked = false;
        if !findings.is_empty() {
            unchecked = !grants(&assessed);
            let as_received = if unchecked {
                None
            } else {
                self.estimate_as_received(job, &assessed, effort)?
            };
            assessed = match as_received {
                // What looked like a mistake is what a worn part does.
                Some((as_received, window)) => {
                    suspects.retain(|suspect| *suspect == Suspect::RepeatedSamples);
                    reasons.clear();
                    corrected = window;
                    as_received
                }
                None => self.beside(assessed, &findings),
            };
        }
        let is_unnamed = findings.is_empty() && open.is_empty() && !is_learning;
        let by_torque = if is_unnamed { self.offset_by_torque(job) } else { None };
        if let Some(finding) = by_torque {
            unchecked |= !grants(&assessed);
            if !unchecked && let Some((other, of_other)) = self.explained_better(job, &assessed, &finding, effort)? {
                report(std::slice::from_ref(&finding), suspects, reasons);
                (corrected, assessed) = (other, of_other.widened(CORRECTED_FACTOR));
            }
        }
        if is_learning || !is_doubtful(&assessed.estimate, self.watch_level()) {
            return Ok(Some(BySignals {
                corrected,
                assessed,
                unchecked,
            }));
        }
        for finding in &open {
            if !grants(&assessed) {
                unchecked = true;
                break;
            }
            let Some((verdict, other, of_other)) = self.with_finding(&corrected, &assessed, finding, effort)? else {
                continue;
            };
            report(std::slice::from_ref(finding), suspects, reasons);
            if verdict == Verdict::Alike {
                reasons.push(format!("or {}", in_words(&assessed)));
                return Ok(None);
            }
            (corrected, assessed) = (other, of_other.widened(CORRECTED_FACTOR));
        }
        Ok(Some(BySignals {
            corrected,
            assessed,
            unchecked,
        }))
    }

    /// The estimate of a window from which these mistakes were taken out, with what they leave open.
    fn beside(&self, assessed: Assessed, findings: &[Finding]) -> Assessed {
        let assessed = self.hide_gain_beside_ratio(assessed, findings);
        self.open_phase_beside_order(assessed, findings)
            .widened(CORRECTED_FACTOR)
    }

    /// With a reason where a winding is accused and another mistake, which looks like the corrected one, puts its short into another phase: two
    /// phases exchanged or the angle of the other sign, all phases in another order or the angle from another zero.
    fn open_phase_beside_order(&self, mut assessed: Assessed, findings: &[Finding]) -> Assessed {
        let is_accused = |short: FaultId| assessed.estimate.fault.damage_of(short) >= self.watch_level();
        let is_order = |suspicion: &Suspicion| suspicion.suspect == Suspect::PhaseOrder;
        let is_open = |phase: usize| {
            findings.iter().any(|finding| match finding.correction {
                Some(Correction::Swap(one, other)) => [one, other].contains(&phase),
                _ => finding.suspicions.iter().any(is_order),
            })
        };
        let shorts = [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC];
        if (0..3).any(|phase| is_accused(shorts[phase]) && is_open(phase)) {
            assessed.reasons.push(PHASE_BY_MISTAKE.to_owned());
        }
        assessed
    }

    /// Without a gain that is not the healthy one where the output turns by another ratio than the motor: where output angle and set point are
    /// both logged in a wrong scale, the controller seems to act on so much less or more of their difference.
    fn hide_gain_beside_ratio(&self, mut assessed: Assessed, findings: &[Finding]) -> Assessed {
        let is_ratio = |finding: &Finding| matches!(finding.correction, Some(Correction::GearRatio(_)));
        let damage = assessed.estimate.fault.damage_of(FaultId::Gain);
        if findings.iter().any(is_ratio) && damage >= self.watch_level() {
            assessed = assessed.without(&[FaultId::Gain]);
            assessed.reasons.push(GAIN_OR_SCALE.to_owned());
        }
        assessed
    }

    /// Offsets of the currents since commissioning that only the torque shows.
    fn offset_by_torque(&self, job: &WindowJob) -> Option<Finding> {
        let commissioned = sensors_of(self.models.unit(&job.actuator)?, job)?;
        offset_by_torque(job, offset_since(commissioned, &sensor_readings(job))?)
    }

    /// The window without a mistake that is clear by itself, and its estimate, if that explains the window better.
    fn explained_better(
        &self,
        job: &WindowJob,
        assessed: &Assessed,
        finding: &Finding,
        effort: &Effort<'_>,
    ) -> Result<Option<(WindowJob, Assessed)>, AssessError> {
        let mut other = job.clone();
        let corrections = finding.correction.into_iter();
        corrections.for_each(|correction| correction.apply(&mut other));
        let Ok(conditions) = conditions(&other) else {
            return Ok(None);
        };
        let Some(of_other) = self.estimate(&mut other, conditions, effort)? else {
            return Ok(None);
        };
        let is_better = !of_other.estimate.is_unmodelled() && assessed.estimate.cost > ALIKE * of_other.estimate.cost;
        Ok(is_better.then_some((other, of_other)))
    }

    /// The set point that is logged before or after its effect.
    pub(super) fn setpoint_time(&self, job: &WindowJob) -> Option<Finding> {
        match self.models.unit(&job.actuator) {
            None => setpoint_time(job, None),
            Some(unit) => {
                let relations = &unit.relations.as_ref()?.commissioned;
                // Where the output angle is the motor's, the play stands in the control deviation.
                if unit.seen.no_output_angle && job.actuator.has_output_angle() {
                    return None;
                }
                setpoint_time(job, Some((relations, &unit.seen)))
            }
        }
    }

    /// The window without a mistake that a worn part explains alike, and its estimate, if that explains the window better, or alike and
    /// accuses less.
    fn with_finding(
        &self,
        job: &WindowJob,
        assessed: &Assessed,
        finding: &Finding,
        effort: &Effort<'_>,
    ) -> Result<Option<(Verdict, WindowJob, Assessed)>, AssessError> {
        let (Some(correction), Some(suspicion)) = (finding.correction, finding.suspicions.first()) else {
            return Ok(None);
        };
        let mut other = job.clone();
        correction.apply(&mut other);
        let Ok(conditions) = conditions(&other) else {
            return Ok(None);
        };
        let Some(of_other) = self.estimate(&mut other, conditions, effort)? else {
            return Ok(None);
        };
        let level = self.watch_level();
        let verdict = compare(&assessed.estimate, suspicion.suspect, &of_other.estimate, level);
        Ok((verdict >= Verdict::Alike).then_some((verdict, other, of_other)))
    }

    /// The estimate of a window as it was received, and the window, if it explains more than the one `without` a mistake.
    fn estimate_as_received(
        &self,
        job: &WindowJob,
        without: &Assessed,
        effort: &Effort<'_>,
    ) -> Result<Option<(Assessed, WindowJob)>, AssessError> {
        let mut job = job.clone();
        let Ok(conditions) = conditions(&job) else {
            return Ok(None);
        };
        let Some(as_received) = self.estimate(&mut job, conditions, effort)? else {
            return Ok(None);
        };
        let (own, other) = (&as_received.estimate, &without.estimate);
        // No part wears in all three phases alike: another wiring does so.
        let is_better = !own.is_unmodelled()
            && !accuses_all_phases_alike(own, self.watch_level())
            && (other.is_unmodelled() || BETTER * own.cost < other.cost);
        Ok(is_better.then_some((as_received, job)))
    }
}

/// Why a gain is not observable beside another gear ratio.
const GAIN_OR_SCALE: &str =
    "the scale of output angle and set point, both, would show so, too: controller gain is not observable";

/// Why the phase of a short is open beside another order of the phases.
const PHASE_BY_MISTAKE: &str =
    "the phase of the short depends on what is wrong: the order of the phases, or sign or zero of the motor angle";

/// Factor on every sigma of a window from which a mistake was taken out: how large it was is itself an estimate.
pub(super) const CORRECTED_FACTOR: f64 = 2.0;

/// Whether the samples of an invalid window show why it is. Between those that are missing anything may have happened.
fn shows_signals(invalidity: &Invalidity) -> bool {
    let is_gap = matches!(
        invalidity,
        Invalidity::TooManyFlawed {
            defect: Defect::Missing,
            ..
        }
    );
    !is_gap
        && matches!(
            invalidity,
            Invalidity::TooManyFlawed { .. }
                | Invalidity::CountersDisagree { .. }
                | Invalidity::CounterJumped { .. }
                | Invalidity::StartInMotion { .. }
                | Invalidity::Stuck(_)
        )
}

fn report(findings: &[Finding], suspects: &mut Vec<Suspect>, reasons: &mut Vec<String>) {
    for finding in findings {
        suspects.extend(finding.suspicions.iter().map(|suspicion| suspicion.suspect));
        let sentences: Vec<String> = finding.suspicions.iter().map(ToString::to_string).collect();
        reasons.push(sentences.join(", or "));
    }
}

/// Damage from which on a sentence contains it.
const DAMAGE_IN_WORDS: f64 = 0.02;

/// The damages that an estimate finds, in words.
pub(super) fn in_words(assessed: &Assessed) -> String {
    let fault = &assessed.estimate.fault;
    let damages: Vec<String> = FaultId::ALL
        .into_iter()
        .map(|id| (id.name(), fault.damage_of(id)))
        .filter(|(_, damage)| *damage >= DAMAGE_IN_WORDS)
        .map(|(name, damage)| format!("{name} {damage:.2}"))
        .collect();
    damages.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_no_evidence_of_a_sensor() {
        let flawed = |defect| Invalidity::TooManyFlawed {
            defect,
            count: 200,
            longest: 90,
        };
        assert!(!shows_signals(&flawed(Defect::Missing)));
        assert!(shows_signals(&flawed(Defect::CurrentSum)) && shows_signals(&flawed(Defect::MotorSpike)));
        assert!(!shows_signals(&Invalidity::ModeChanged));
    }
}
