//! What explains a window: worn parts, or a wrong sensor, wire or number.
//!
//! What the signals show by themselves is taken out before the estimate (`by_signals`); readings that only an estimate can doubt compete with the
//! faults after it.

use ema_identify::effort::{Effort, Stage};
use ema_identify::unit_calibration::{UnitCalibration, UnitEstimator};
use ema_identify::unit_fit::healthy_cost;
use ema_identify::{Fit, Identifier, Method};
use ema_models::{Comparison, Conditions, FAULT_COUNT, FaultId, Tolerances};

use super::by_signals::{BySignals, CORRECTED_FACTOR, in_words};
use super::by_unit::{self, Assessed, OF_THE_ROTOR};
use super::coarse_setpoint::with_coarse_setpoint;
use super::reasons::unseen;
use super::{AssessError, Assessor, conditions};
use crate::config::SearchMethod;
use crate::log_map::LogMap;
use crate::motion::{ONE_WAY_FACTOR, moves_one_way};
use crate::outbox::WindowJob;
use crate::outliers::grants_runs;
use crate::seed::{mix, name_hash};
use crate::sensor_checks::rivals::{
    BETTER, Corrected, Rival, Verdict, accused_by_reading, accuses_all_phases_alike, correct, is_doubtful, judge,
    reversed_current, rivals,
};
use crate::sensor_checks::{Contradiction, Correction, Suspect, Suspicion, contradictions};
use crate::window::WindowQuality;

/// Monitor runs that tell which of several readings is the likeliest: a healthy actuator with each of them, and two descents.
const LIKELIEST_RUNS: u64 = 400;

/// Why a window without set point is not assessed: the monitor follows it.
const NO_MONITOR: &str =
    "no set point: assessed by relations between measured signals alone, of a commissioned unit (hmd calibrate)";

/// Why controller gain is not observable where the output angle is that of the motor.
const PLAY_OR_DELAY: &str = "set point and motor are off in time: without an output angle a play looks so, and controller gain is not observable";

/// The explanation of a window.
#[derive(Debug)]
pub(super) struct Explained {
    /// The estimate; none where the window is invalid.
    pub(super) assessed: Option<Assessed>,
    /// What may be wrong besides the actuator.
    pub(super) suspects: Vec<Suspect>,
    /// Why the window is not simply good.
    pub(super) reasons: Vec<String>,
    /// Whether a reading that competes with the faults was left out for want of time: no damage counts then.
    pub(super) unchecked: bool,
}

impl Explained {
    fn invalid(suspects: Vec<Suspect>, reasons: Vec<String>) -> Self {
        Self {
            assessed: None,
            suspects,
            reasons,
            unchecked: false,
        }
    }
}

/// What competes with the faults of an estimate.
#[expect(clippy::large_enum_variant, reason = "one for a window, matched at once")]
enum Competitors {
    /// None explains the window as well, or another one better.
    Best(Option<(Verdict, Suspicion, Assessed)>),
    /// Not all were granted.
    Unknown,
}

impl Assessor {
    /// Explains a window. Of a unit that is being learnt no reading competes with the faults, which are not reported anyway.
    ///
    /// # Errors
    /// Those of the identification.
    pub(super) fn explain(
        &self,
        job: &mut WindowJob,
        is_learning: bool,
        effort: &Effort<'_>,
    ) -> Result<Explained, AssessError> {
        let (mut suspects, mut reasons) = (Vec::new(), Vec::new());
        if !job.actuator.has_set_point() && !self.has_relations(job) {
            match &job.window.quality {
                // What is wrong with the window itself, a calibration does not mend.
                WindowQuality::Invalid(invalidity) => {
                    suspects.extend(Suspect::of_invalidity(invalidity));
                    reasons.push(invalidity.to_string());
                }
                _ if is_learning => {}
                _ => reasons.push(NO_MONITOR.to_owned()),
            }
            return Ok(Explained::invalid(suspects, reasons));
        }
        let by_signals = if job.window.quality.is_fit() {
            self.without_mistakes(job, is_learning, effort, &mut suspects, &mut reasons)?
        } else {
            self.made_fit(job, is_learning, effort, &mut suspects, &mut reasons)?
        };
        let Some(BySignals {
            mut corrected,
            mut assessed,
            mut unchecked,
        }) = by_signals
        else {
            return Ok(Explained::invalid(suspects, reasons));
        };
        if let Some(reversed) = reversed_current(&assessed.estimate).filter(|_| !is_learning) {
            suspects.extend(reversed.iter().map(|suspicion| suspicion.suspect));
            let sentences: Vec<String> = reversed.iter().map(ToString::to_string).collect();
            reasons.push(sentences.join(", or "));
            return Ok(Explained::invalid(suspects, reasons));
        }
        if !is_learning {
            let found = self.without_contradicted(&mut corrected, assessed, effort, &mut suspects, &mut reasons)?;
            assessed = found.0;
            unchecked |= found.1;
        }
        if !is_learning && is_doubtful(&assessed.estimate, self.watch_level()) {
            match self.best_rival(&corrected, &assessed, effort)? {
                Competitors::Unknown => unchecked = true,
                Competitors::Best(Some((Verdict::Better, suspicion, of_rival))) => {
                    name(suspicion.suspect, &mut suspects);
                    reasons.push(suspicion.sentence);
                    assessed = of_rival.widened(CORRECTED_FACTOR);
                }
                Competitors::Best(Some((Verdict::Alike, suspicion, _))) => {
                    name(suspicion.suspect, &mut suspects);
                    reasons.push(format!("{}, or {}", suspicion.sentence, in_words(&assessed)));
                    return Ok(Explained::invalid(suspects, reasons));
                }
                Competitors::Best(Some((Verdict::Undecided, _, of_rival))) => {
                    let hidden = accused_by_reading(&assessed.estimate, &of_rival.estimate, self.watch_level());
                    reasons.push(told_by_load_alone(&corrected, &assessed, &hidden));
                    assessed = assessed.without(&hidden);
                }
                Competitors::Best(Some((Verdict::Worse, ..)) | None) => {}
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
        if let Some(suspicion) = assessed.suspicion.take().filter(|_| !is_learning) {
            name(suspicion.suspect, &mut suspects);
            reasons.push(suspicion.sentence);
        }
        job.window = corrected.window;
        Ok(Explained {
            assessed: Some(assessed),
            suspects,
            reasons,
            unchecked,
        })
    }

    /// Whether the unit of a window is known by relations between measured signals.
    fn has_relations(&self, job: &WindowJob) -> bool {
        let unit = self.models.unit(&job.actuator);
        unit.is_some_and(|unit| unit.relations.is_some())
    }

    /// Winding temperatures at which the unit of a window was commissioned, °C, if it was; `None` inside where none was measured.
    fn commissioned_temperatures(&self, job: &WindowJob) -> Option<Option<[f64; 2]>> {
        let unit = self.models.unit(&job.actuator)?;
        Some(unit.seen.winding_temp_deg_c)
    }

    /// The estimate of a window without the readings that it contradicts; they are reported. Whether one was left out for want of
    /// time, too.
    fn without_contradicted(
        &self,
        job: &mut WindowJob,
        mut assessed: Assessed,
        effort: &Effort<'_>,
        suspects: &mut Vec<Suspect>,
        reasons: &mut Vec<String>,
    ) -> Result<(Assessed, bool), AssessError> {
        let mut unchecked = false;
        let commissioned = self.commissioned_temperatures(job);
        let unit = self.models.unit(&job.actuator).and_then(|unit| unit.relations.as_ref());
        let load_error = unit.map_or(0.0, |unit| unit.commissioned.healthy_load_error());
        for Contradiction { suspicion, correction } in contradictions(job, &assessed.estimate, commissioned, load_error)
        {
            if suspects.contains(&suspicion.suspect) {
                continue;
            }
            let mut other = job.clone();
            correction.apply(&mut other);
            let Ok(conditions) = conditions(&other) else { continue };
            if !grants_runs(effort, assessed.estimate.evaluations, other.length_s()) {
                unchecked = true;
                continue;
            }
            let Some(without) = self.estimate(&mut other, conditions, effort)? else {
                unchecked = true;
                continue;
            };
            match correct(&assessed.estimate, &without.estimate, correction, self.watch_level()) {
                Corrected::Contradicted => continue,
                Corrected::Alike => {}
                Corrected::Without => {
                    assessed = without.widened(CORRECTED_FACTOR);
                    // An inertia shows in the friction: shorts do not explain it.
                    if let (Suspect::CurrentGain, Correction::Currents { gain: [gain, ..], .. }) =
                        (suspicion.suspect, correction)
                    {
                        assessed.estimate = assessed.estimate.beside_common_gain(gain);
                    }
                    *job = other;
                }
            }
            suspects.push(suspicion.suspect);
            reasons.push(suspicion.sentence);
        }
        Ok((assessed, unchecked))
    }

    /// Estimates a window by what is known of its unit, else of its type; none where that is not granted. What its log does not have
    /// hides faults, whatever the estimate says of them.
    pub(super) fn estimate(
        &self,
        job: &mut WindowJob,
        conditions: Conditions,
        effort: &Effort<'_>,
    ) -> Result<Option<Assessed>, AssessError> {
        let seen = self.models.unit(&job.actuator).map(|unit| &unit.seen);
        let Some(assessed) = self.estimate_of_all(job, conditions, effort)? else {
            return Ok(None);
        };
        let mut assessed = with_coarse_setpoint(assessed, job, seen);
        for gap in job.actuator.log.as_deref().into_iter().flat_map(LogMap::gaps) {
            assessed = assessed.without(gap.hides());
        }
        if !job.actuator.has_output_angle() && self.setpoint_time(job).is_some() {
            assessed = assessed.without(&[FaultId::Gain]);
            assessed.reasons.push(PLAY_OR_DELAY.to_owned());
        }
        Ok(Some(assessed))
    }

    fn estimate_of_all(
        &self,
        job: &mut WindowJob,
        conditions: Conditions,
        effort: &Effort<'_>,
    ) -> Result<Option<Assessed>, AssessError> {
        let identifier = self.identifier_of(job)?;
        let seed = mix(self.seed, &[name_hash(&job.actuator.name), job.window.number]);
        let has_set_point = job.actuator.has_set_point();
        let only_relations = self.config.identification().method == SearchMethod::Relations || !has_set_point;
        let mut reasons = Vec::new();
        match self.models.unit(&job.actuator) {
            Some(unit) if only_relations && unit.relations.is_some() => {
                let alone = UnitCalibration {
                    estimator: UnitEstimator::Relations,
                    monitor: None,
                    ..unit.clone()
                };
                let found = by_unit::estimate(&alone, &identifier, job, conditions, seed, effort)?;
                // The monitor has no curve to show without a set point.
                return Ok(found.map(|assessed| Assessed {
                    fit: if has_set_point { assessed.fit } else { Fit::default() },
                    ..assessed
                }));
            }
            Some(unit) => return by_unit::estimate(unit, &identifier, job, conditions, seed, effort),
            // They are changes since commissioning.
            None if only_relations => reasons.push("not commissioned: assessed by the monitor".to_owned()),
            None => {}
        }
        let found = self.estimator.estimate(&identifier, job, conditions, seed, effort)?;
        let may_vary = job.conditions.load_torque_nm.is_none() && moves_one_way(job);
        Ok(found.map(|(estimate, fit)| {
            let estimate = if may_vary {
                estimate.widened(&one_way_factors())
            } else {
                estimate
            };
            Assessed {
                fit,
                reasons: reasons.into_iter().chain(unseen(&estimate)).collect(),
                suspicion: None,
                estimate,
            }
        }))
    }

    /// The reading that explains a window best instead of the faults: the best of those that explain it better, else the first
    /// that explains it alike.
    fn best_rival(
        &self,
        job: &WindowJob,
        assessed: &Assessed,
        effort: &Effort<'_>,
    ) -> Result<Competitors, AssessError> {
        let level = self.watch_level();
        let mut found: Option<(Verdict, Rival, Assessed)> = None;
        let rivals = rivals(job, &assessed.estimate, self.knows_unit(&job.actuator));
        for readings in rivals.chunk_by(|one, next| one.suspect == next.suspect) {
            let which = if readings.len() > 1 { LIKELIEST_RUNS } else { 0 };
            if !grants_runs(effort, which + assessed.estimate.evaluations, job.length_s()) {
                return Ok(Competitors::Unknown);
            }
            let likeliest = self.likeliest(job, readings)?;
            effort.ran(Stage::Conclusion, job.length_s(), which);
            let Some(rival) = likeliest else { continue };
            let mut other = rival.applied_to(job);
            let Ok(conditions) = conditions(&other) else { continue };
            let Some(of_rival) = self.estimate(&mut other, conditions, effort)? else {
                return Ok(Competitors::Unknown);
            };
            let verdict = judge(job, &assessed.estimate, rival.suspect, &of_rival.estimate, level);
            let is_best = match &found {
                None => verdict > Verdict::Worse,
                Some((Verdict::Better, _, best)) => {
                    verdict == Verdict::Better && of_rival.estimate.cost < best.estimate.cost
                }
                Some((before, ..)) => verdict > *before,
            };
            if is_best {
                found = Some((verdict, rival, of_rival));
            }
        }
        Ok(Competitors::Best(found.map(|(verdict, rival, of_rival)| {
            let instead_of = (verdict == Verdict::Better).then_some(assessed.estimate.cost);
            let suspicion = rival.suspicion(job, &of_rival.estimate, instead_of);
            (verdict, suspicion, of_rival)
        })))
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
        let prepared = job.window.prepared(&identifier.params);
        let coefficients = identifier.calibration.coefficients();
        cost(
            &identifier,
            &identifier.comparison(&prepared, &coefficients, conditions),
        )
    }

    /// The lowest level of any fault.
    pub(super) fn watch_level(&self) -> f64 {
        let levels = self.config.health().levels();
        levels.iter().map(|levels| levels.watch).fold(f64::INFINITY, f64::min)
    }
}

/// Why faults that only the reading of the load accuses are not shown.
fn told_by_load_alone(job: &WindowJob, assessed: &Assessed, faults: &[FaultId]) -> String {
    let named = faults.iter().map(|fault| {
        let damage = assessed.estimate.fault.damage_of(*fault);
        format!("{} {damage:.2}", fault.name())
    });
    format!(
        "{} by the reading of the load alone, {:.1} N m: without it the motion does not show that",
        named.collect::<Vec<String>>().join(", "),
        job.conditions.load_torque_nm.unwrap_or(0.0),
    )
}

fn name(suspect: Suspect, suspects: &mut Vec<Suspect>) {
    if !suspects.contains(&suspect) {
        suspects.push(suspect);
    }
}

/// Factors on the sigmas of a window in one direction whose load nobody measures. One that varies there passes for friction, or hides it, and
/// for what goes with the rotor's angle: of ramps of `servo28` at 1 kHz with a friction of 0.4 and a load that varies by 1.5 Nm, 3 of 40 show it
/// healthy, 3 to 4 sigmas off.
fn one_way_factors() -> [f64; FAULT_COUNT] {
    let faults = OF_THE_ROTOR.into_iter().chain([FaultId::Friction]);
    let mut factors = [1.0; FAULT_COUNT];
    for fault in faults {
        factors[fault.parameter()] = ONE_WAY_FACTOR;
    }
    factors
}
