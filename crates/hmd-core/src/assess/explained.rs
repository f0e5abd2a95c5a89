//! What explains a window: worn parts, or a wrong sensor, wire or number.
//!
//! What the signals show by themselves is taken out before the estimate; readings that only an estimate can doubt compete with the
//! faults after it.

use ema_identify::unit_fit::healthy_cost;
use ema_identify::{Identifier, Method, Prepared};
use ema_models::{Comparison, Conditions, FaultId, Tolerances};

use super::by_unit::{self, Assessed};
use super::{AssessError, Assessor, conditions, unseen};
use crate::outbox::WindowJob;
use crate::outliers::identify_without_outliers;
use crate::seed::{mix, name_hash};
use crate::sensor_checks::rivals::{
    BETTER, Corrected, Rival, Verdict, accuses_all_phases_alike, compare, correct, is_doubtful, rivals,
};
use crate::sensor_checks::{Contradiction, Finding, Shown, Suspect, Suspicion, contradictions, examine};
use crate::window::{Degradation, Invalidity, WindowQuality};

/// The explanation of a window.
pub(super) struct Explained {
    /// The estimate; none where the window is invalid.
    pub(super) assessed: Option<Assessed>,
    /// What may be wrong besides the actuator.
    pub(super) suspects: Vec<Suspect>,
    /// Why the window is not simply good.
    pub(super) reasons: Vec<String>,
    /// The errors of readings that the window shows; none where nothing was estimated.
    pub(super) shown: Option<Shown>,
}

impl Explained {
    fn invalid(suspects: Vec<Suspect>, reasons: Vec<String>) -> Self {
        Self {
            assessed: None,
            suspects,
            reasons,
            shown: None,
        }
    }
}

impl Assessor {
    /// Explains a window. Of a unit that is being learnt no reading competes with the faults, which are not reported anyway.
    ///
    /// # Errors
    /// Those of the identification.
    pub(super) fn explain(&self, job: &mut WindowJob, is_learning: bool) -> Result<Explained, AssessError> {
        let (mut suspects, mut reasons) = (Vec::new(), Vec::new());
        if let WindowQuality::Invalid(invalidity) = &job.window.quality {
            reasons.push(invalidity.to_string());
            suspects.extend(Suspect::of_invalidity(invalidity));
            if suspects.is_empty() && shows_signals(invalidity) {
                report(&examine(job), &mut suspects, &mut reasons);
            }
            return Ok(Explained::invalid(suspects, reasons));
        }
        if let WindowQuality::Degraded(handicaps) = &job.window.quality {
            let is_repeated = |handicap: &Degradation| matches!(handicap, Degradation::Repeated(_));
            suspects.extend(handicaps.iter().any(is_repeated).then_some(Suspect::RepeatedSamples));
        }
        let findings = examine(job);
        report(&findings, &mut suspects, &mut reasons);
        let mut corrected = job.clone();
        for finding in &findings {
            match finding.correction {
                Some(correction) => correction.apply(&mut corrected),
                None => return Ok(Explained::invalid(suspects, reasons)),
            }
        }
        let mut assessed = match conditions(&corrected) {
            Ok(conditions) if findings.is_empty() => self.estimate(&mut corrected, conditions)?,
            Ok(conditions) => {
                let without = self.estimate(&mut corrected, conditions)?;
                match self.estimate_as_received(job, &without)? {
                    // What looked like a mistake is what a worn part does.
                    Some((as_received, window)) => {
                        suspects.retain(|suspect| *suspect == Suspect::RepeatedSamples);
                        reasons.clear();
                        corrected = window;
                        as_received
                    }
                    None => without.widened(CORRECTED_FACTOR),
                }
            }
            Err(absurd) => {
                reasons.push(absurd);
                return Ok(Explained::invalid(suspects, reasons));
            }
        };
        let shown = Shown::by(
            &corrected,
            &assessed.estimate,
            self.commissioned_temperatures(&corrected),
        );
        if !is_learning {
            assessed = self.without_contradicted(&mut corrected, assessed, &mut suspects, &mut reasons)?;
        }
        if !is_learning && is_doubtful(&assessed.estimate, self.watch_level()) {
            match self.best_rival(&corrected, &assessed)? {
                Some((Verdict::Better, suspicion, of_rival)) => {
                    name(suspicion.suspect, &mut suspects);
                    reasons.push(suspicion.sentence);
                    assessed = of_rival;
                }
                Some((Verdict::Alike, suspicion, _)) => {
                    name(suspicion.suspect, &mut suspects);
                    reasons.push(format!("{}, or {}", suspicion.sentence, in_words(&assessed)));
                    return Ok(Explained::invalid(suspects, reasons));
                }
                Some((Verdict::Worse, ..)) | None => {}
            }
        }
        if !is_learning && accuses_all_phases_alike(&assessed.estimate, self.watch_level()) {
            // Of a commissioned unit, magnets and drive are known.
            suspects.extend(self.knows_unit(&job.actuator).then_some(Suspect::CurrentGain));
            reasons.push(format!(
                "current gain, magnets or drive: all three phases alike: {}",
                in_words(&assessed)
            ));
            return Ok(Explained::invalid(suspects, reasons));
        }
        job.window = corrected.window;
        Ok(Explained {
            assessed: Some(assessed),
            suspects,
            reasons,
            shown: Some(shown),
        })
    }

    /// Winding temperatures at which the unit of a window was commissioned, °C, if it was; `None` inside where none was measured.
    fn commissioned_temperatures(&self, job: &WindowJob) -> Option<Option<[f64; 2]>> {
        let unit = self.models.unit(&job.actuator)?;
        Some(unit.seen.winding_temp_deg_c)
    }

    /// The estimate of a window without the readings that it contradicts; they are reported.
    fn without_contradicted(
        &self,
        job: &mut WindowJob,
        mut assessed: Assessed,
        suspects: &mut Vec<Suspect>,
        reasons: &mut Vec<String>,
    ) -> Result<Assessed, AssessError> {
        let commissioned = self.commissioned_temperatures(job);
        for Contradiction { suspicion, correction } in contradictions(job, &assessed.estimate, commissioned) {
            if suspects.contains(&suspicion.suspect) {
                continue;
            }
            let mut other = job.clone();
            correction.apply(&mut other);
            let Ok(conditions) = conditions(&other) else { continue };
            let without = self.estimate(&mut other, conditions)?;
            match correct(&assessed.estimate, &without.estimate, correction, self.watch_level()) {
                Corrected::Contradicted => continue,
                Corrected::Alike => {}
                Corrected::Without => {
                    assessed = without.widened(CORRECTED_FACTOR);
                    *job = other;
                }
            }
            suspects.push(suspicion.suspect);
            reasons.push(suspicion.sentence);
        }
        Ok(assessed)
    }

    /// The estimate of a window as it was received, and the window, if it explains more than the one `without` a mistake.
    fn estimate_as_received(
        &self,
        job: &WindowJob,
        without: &Assessed,
    ) -> Result<Option<(Assessed, WindowJob)>, AssessError> {
        let mut job = job.clone();
        let Ok(conditions) = conditions(&job) else {
            return Ok(None);
        };
        let as_received = self.estimate(&mut job, conditions)?;
        let (own, other) = (&as_received.estimate, &without.estimate);
        let is_better = !own.is_unmodelled() && (other.is_unmodelled() || BETTER * own.cost < other.cost);
        Ok(is_better.then_some((as_received, job)))
    }

    /// Estimates a window by what is known of its unit, else of its type.
    fn estimate(&self, job: &mut WindowJob, conditions: Conditions) -> Result<Assessed, AssessError> {
        let identifier = self.identifier_of(job)?;
        let seed = mix(self.seed, &[name_hash(&job.actuator.name), job.window.number]);
        if let Some(unit) = self.models.unit(&job.actuator) {
            return by_unit::estimate(unit, &identifier, job, conditions, seed);
        }
        let (prepared, estimate) = identify_without_outliers(&identifier, &mut job.window, conditions, seed)?;
        Ok(Assessed {
            fit: identifier.fit(&prepared, conditions, &estimate),
            reasons: unseen(&estimate).into_iter().collect(),
            estimate,
        })
    }

    /// The reading that explains a window best instead of the faults: the best of those that explain it better, else the first
    /// that explains it alike.
    fn best_rival(
        &self,
        job: &WindowJob,
        assessed: &Assessed,
    ) -> Result<Option<(Verdict, Suspicion, Assessed)>, AssessError> {
        let level = self.watch_level();
        let mut found: Option<(Verdict, Rival, Assessed)> = None;
        let rivals = rivals(job, &assessed.estimate, self.knows_unit(&job.actuator));
        for readings in rivals.chunk_by(|one, next| one.suspect == next.suspect) {
            let Some(rival) = self.likeliest(job, readings)? else {
                continue;
            };
            let mut other = rival.applied_to(job);
            let Ok(conditions) = conditions(&other) else { continue };
            let of_rival = self.estimate(&mut other, conditions)?;
            let verdict = compare(&assessed.estimate, rival.suspect, &of_rival.estimate, level);
            let is_best = match &found {
                None => verdict != Verdict::Worse,
                Some((Verdict::Better, _, best)) => {
                    verdict == Verdict::Better && of_rival.estimate.cost < best.estimate.cost
                }
                Some(_) => verdict == Verdict::Better,
            };
            if is_best {
                found = Some((verdict, rival, of_rival));
            }
        }
        Ok(found.map(|(verdict, rival, of_rival)| {
            let suspicion = rival.suspicion(job, &of_rival.estimate, assessed.estimate.cost);
            (verdict, suspicion, of_rival)
        }))
    }

    /// Of several readings of one sensor the one with which the healthy actuator fits best, if a descent from there explains the window
    /// clearly better than with what was read. A whole identification of each takes many times as long.
    fn likeliest(&self, job: &WindowJob, readings: &[Rival]) -> Result<Option<Rival>, AssessError> {
        if let [only] = readings {
            return Ok(Some(*only));
        }
        let mut best: Option<(f64, Rival)> = None;
        for rival in readings {
            let cost =
                self.cost_with_exact_numbers(&rival.applied_to(job), |_, comparison| Ok(healthy_cost(comparison)))?;
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, *rival));
            }
        }
        let Some((_, rival)) = best else { return Ok(None) };
        let descent = |identifier: &Identifier, comparison: &Comparison<'_>| {
            let end = identifier.search(comparison, self.seed)?;
            Ok(comparison.cost(&end))
        };
        let as_read = self.cost_with_exact_numbers(job, descent)?;
        let cost = self.cost_with_exact_numbers(&rival.applied_to(job), descent)?;
        Ok((BETTER * cost < as_read).then_some(rival))
    }

    /// A cost of a window, every number known exactly; infinite where a reading is absurd.
    fn cost_with_exact_numbers(
        &self,
        job: &WindowJob,
        cost: impl Fn(&Identifier, &Comparison<'_>) -> Result<f64, AssessError>,
    ) -> Result<f64, AssessError> {
        let Ok(conditions) = conditions(job) else {
            return Ok(f64::INFINITY);
        };
        let identifier = Identifier {
            method: Method::LeastSquares,
            tolerances: Tolerances::NONE,
            ..self.identifier_of(job)?
        };
        let window = &job.window;
        let prepared = Prepared::new(&identifier.params, &window.samples, &window.filled, window.trigger);
        let coefficients = identifier.calibration.coefficients();
        cost(
            &identifier,
            &identifier.comparison(&prepared, &coefficients, conditions),
        )
    }

    /// The lowest level of any fault.
    fn watch_level(&self) -> f64 {
        let levels = self.config.health().levels();
        levels.iter().map(|levels| levels.watch).fold(f64::INFINITY, f64::min)
    }
}

/// Factor on every sigma of a window from which a mistake was taken out: how large it was is itself an estimate.
const CORRECTED_FACTOR: f64 = 2.0;

/// Whether the samples of an invalid window show why it is.
fn shows_signals(invalidity: &Invalidity) -> bool {
    matches!(
        invalidity,
        Invalidity::TooManyFlawed { .. }
            | Invalidity::CountersDisagree { .. }
            | Invalidity::CounterJumped { .. }
            | Invalidity::StartInMotion { .. }
            | Invalidity::Stuck(_)
    )
}

fn name(suspect: Suspect, suspects: &mut Vec<Suspect>) {
    if !suspects.contains(&suspect) {
        suspects.push(suspect);
    }
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
fn in_words(assessed: &Assessed) -> String {
    let fault = &assessed.estimate.fault;
    let damages: Vec<String> = FaultId::ALL
        .into_iter()
        .map(|id| (id.name(), fault.damage_of(id)))
        .filter(|(_, damage)| *damage >= DAMAGE_IN_WORDS)
        .map(|(name, damage)| format!("{name} {damage:.2}"))
        .collect();
    damages.join(", ")
}
