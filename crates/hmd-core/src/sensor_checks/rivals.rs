//! Mistakes that only an estimate shows: readings that compete with the faults.
//!
//! A window that accuses a part, or that no fault explains, is estimated again without a reading, or with another one. The better
//! explanation wins; where both explain the window alike and differ in what they accuse, the window accuses nothing.

use ema_models::{DriveKind, FaultId, REFERENCE_TEMPERATURE_DEG_C};

use super::correction::{Correction, LINK_POSSIBLE};
use super::findings::torque_ratio;
use super::suspect::{Suspect, Suspicion};
use crate::health::{SIGNIFICANCE, significance};
use crate::motion::moves_one_way;
use crate::outbox::WindowJob;
use ema_identify::{Estimate, Inferred};

/// One reading taken as wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rival {
    /// The sensor.
    pub suspect: Suspect,
    /// The reading instead, of the currents their gain; `None` as if it were not measured.
    reading: Option<f64>,
}

/// Gain of all currents that no tolerance explains.
const GAIN_OFF: f64 = 0.06;

/// Gains that are tried where nothing explains a window.
const GAINS: [f64; 10] = [0.78, 0.82, 0.86, 0.9, 0.94, 1.07, 1.12, 1.17, 1.22, 1.28];

/// Shares of the read voltage that the link may have instead.
const LINK_SHARES: [f64; 4] = [0.8, 0.9, 1.12, 1.25];

/// Least deviation of the read voltage from the nominal one that makes the nominal one an explanation of its own, as a share.
const LINK_OFF: f64 = 0.05;

/// Distance of a temperature from that of the data sheet from which on it changes what is expected of a motor, K.
const TEMPERATURE_OFF_K: f64 = 40.0;

/// Cost above that of good windows.
const HIGH_COST: f64 = 3.0;

/// The readings of a window that may be wrong.
///
/// Where comparators apply the link to the phases, or are assumed before commissioning, the nominal voltage is tried if another one was
/// read, and others where nothing explains the window well. Gains of all currents are tried of commissioned units, whose motor is known.
#[must_use]
pub fn rivals(job: &WindowJob, estimate: &Estimate, is_commissioned: bool) -> Vec<Rival> {
    let conditions = &job.conditions;
    let mut rivals = Vec::new();
    let mut add = |suspect, reading| rivals.push(Rival { suspect, reading });
    if conditions.load_torque_nm.is_some() {
        add(Suspect::LoadSensor, None);
    }
    let is_far = |read: f64| (read - REFERENCE_TEMPERATURE_DEG_C).abs() > TEMPERATURE_OFF_K;
    if conditions.winding_temp_deg_c.is_some_and(is_far) {
        add(Suspect::WindingTemperature, None);
    }
    if let Some(read) = conditions
        .dc_link_v
        .filter(|_| job.actuator.drive.kind == DriveKind::Hysteresis || !is_commissioned)
    {
        let nominal = job.params.motor.v_dc;
        let is_badly_explained = estimate.cost > HIGH_COST || estimate.is_unmodelled();
        let shares = LINK_SHARES.iter().filter(|_| is_badly_explained);
        let mut voltages: Vec<f64> = shares.map(|share| share * read).collect();
        if (read - nominal).abs() > LINK_OFF * nominal {
            voltages.insert(0, nominal);
        }
        let is_possible = |voltage: &f64| LINK_POSSIBLE.contains(&(voltage / nominal));
        for voltage in voltages.into_iter().filter(is_possible) {
            add(Suspect::DcLink, Some(voltage));
        }
    }
    let ratio = torque_ratio(job).map(|(ratio, _)| 1.0 / ratio);
    let by_balance = ratio.filter(|gain| (gain - 1.0).abs() > GAIN_OFF && (0.5..2.0).contains(gain));
    let tried = GAINS
        .into_iter()
        .filter(|_| is_commissioned && estimate.is_unmodelled());
    for gain in by_balance.into_iter().chain(tried) {
        rivals.push(Rival {
            suspect: Suspect::CurrentGain,
            reading: Some(gain),
        });
    }
    rivals
}

impl Rival {
    /// The window with the other reading.
    #[must_use]
    pub fn applied_to(&self, job: &WindowJob) -> WindowJob {
        let mut job = job.clone();
        match self.suspect {
            Suspect::LoadSensor => job.conditions.load_torque_nm = self.reading,
            Suspect::WindingTemperature => job.conditions.winding_temp_deg_c = self.reading,
            Suspect::DcLink => job.conditions.dc_link_v = self.reading,
            _ => Correction::Currents {
                offset: [0.0; 3],
                gain: [self.reading.unwrap_or(1.0); 3],
            }
            .apply(&mut job),
        }
        job
    }

    /// The sentence of it, with the estimate that has the other reading; the read one costs `instead_of`, where that is more.
    #[must_use]
    pub fn suspicion(&self, job: &WindowJob, estimate: &Estimate, instead_of: Option<f64>) -> Suspicion {
        let suspect = self.suspect;
        let conditions = &job.conditions;
        let evidence = match suspect {
            Suspect::LoadSensor => {
                let (read, needed) = (conditions.load_torque_nm.unwrap_or(0.0), estimate.unknowns.load_torque);
                format!("reads {read:.1} N m, the motion fits {needed:.1} N m")
            }
            Suspect::WindingTemperature => {
                let read = conditions.winding_temp_deg_c.unwrap_or(0.0);
                format!("reads {read:.0} °C, the motion fits without it")
            }
            Suspect::CurrentGain => {
                let gain = self.reading.unwrap_or(1.0);
                format!("all phases read {gain:.2} times what fits the motion")
            }
            _ => {
                let (read, fits) = (conditions.dc_link_v.unwrap_or(0.0), self.reading.unwrap_or(0.0));
                format!("reads {read:.0} V, the motion fits {fits:.0} V")
            }
        };
        let compared = match instead_of {
            Some(more) => format!("cost {:.1}, not {more:.1}", estimate.cost),
            None => "as well".to_owned(),
        };
        Suspicion {
            suspect,
            sentence: format!("{suspect}: {evidence}: {compared}"),
        }
    }
}

/// What a rival says of a window; the further down, the more it decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// It explains nothing more.
    Worse,
    /// Another load explains the window alike, and accuses less: its reading alone tells it from the fault.
    Undecided,
    /// It explains the window alike, and accuses less.
    Alike,
    /// It explains the window clearly better.
    Better,
}

/// Factor of the costs from which on one explanation is better.
pub const BETTER: f64 = 2.0;

/// Cost of a window that is explained, with noise of 100 mA.
const GOOD_COST: f64 = 6.5;

/// Factor up to which two explanations are alike.
pub const ALIKE: f64 = 1.15;

/// Share of a damage that may be left where another reading explains it: without a reading every sigma is larger, which alone is no
/// explanation.
const EXPLAINED_AWAY: f64 = 0.5;

/// Damage that no window shows at once where it is not observable without the reading: the reading may be wrong as well.
const LARGE_DAMAGE: f64 = 0.5;

/// Damage from which on a fault is accused: the level `watch` as configured, times sigma.
fn accused(estimate: &Estimate, level: f64) -> Vec<FaultId> {
    let sigma = estimate.damage_sigma();
    let is_accused = |fault: &FaultId| {
        let damage = estimate.fault.damage_of(*fault);
        damage >= level && damage >= significance(*fault) * sigma[fault.parameter()]
    };
    FaultId::ALL.into_iter().filter(is_accused).collect()
}

/// Whether an estimate gives reason to ask for other explanations: it accuses a part, or explains nothing.
#[must_use]
pub fn is_doubtful(estimate: &Estimate, level: f64) -> bool {
    (estimate.is_unmodelled() && !estimate.locked) || !accused(estimate, level).is_empty()
}

/// Spread of three shorts, as a share of the largest, up to which they are alike.
const ALIKE_SHORTS: f64 = 0.25;

/// Share of the largest of three shorts that the least has where they are alike.
const LEAST_SHARE: f64 = 0.5;

/// Whether an estimate accuses a phase and finds all three alike: no winding fails so, but a gain of all currents, a weak magnet or a drive that
/// the monitor does not know looks so.
#[must_use]
pub fn accuses_all_phases_alike(estimate: &Estimate, level: f64) -> bool {
    let accused = accused(estimate, level);
    let phases = [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC];
    let damages = phases.map(|phase| estimate.fault.damage_of(phase));
    let sigma = estimate.damage_sigma();
    let noise = phases
        .map(|phase| sigma[phase.parameter()])
        .into_iter()
        .fold(0.0, f64::max);
    let largest = damages.into_iter().fold(0.0, f64::max);
    let least = damages.into_iter().fold(f64::INFINITY, f64::min);
    let is_alike = largest - least <= ALIKE_SHORTS * largest + SIGNIFICANCE * noise;
    let are_accused = |phase: &FaultId| accused.contains(phase);
    let one_suffices = least > LEAST_SHARE * largest && !estimate.is_unmodelled();
    is_alike && (phases.iter().all(are_accused) || one_suffices && phases.iter().any(are_accused))
}

/// What becomes of a reading that the motion, or the configuration, contradicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corrected {
    /// The window is estimated without it.
    Without,
    /// The estimate stands: it does not depend on the reading, or the two explain the window alike and the other accuses no less.
    Alike,
    /// The estimate without it contradicts the correction.
    Contradicted,
}

/// Compares an estimate with that without a reading.
///
/// A link voltage off the configured one may be read rightly: it stands where it explains the window clearly better, and it is used unless
/// the configured one accuses less.
#[must_use]
pub fn correct(estimate: &Estimate, without: &Estimate, correction: Correction, level: f64) -> Corrected {
    let is_worse = without.is_unmodelled() && !estimate.is_unmodelled();
    if is_worse || without.cost > BETTER * estimate.cost {
        return Corrected::Contradicted;
    }
    let is_link = matches!(correction, Correction::Link(_));
    let explains_more = estimate.is_unmodelled() || estimate.cost > BETTER * without.cost;
    let accuses_less = accused(without, level).len() < accused(estimate, level).len();
    if without.fault == estimate.fault || (is_link && !explains_more && !accuses_less) {
        Corrected::Alike
    } else {
        Corrected::Without
    }
}

/// Compares an estimate with that of a rival. A gain of all currents looks as a weak motor does, which the tolerances hold: it counts
/// only where it explains a window better.
#[must_use]
pub fn compare(estimate: &Estimate, suspect: Suspect, rival: &Estimate, level: f64) -> Verdict {
    if rival.is_unmodelled() {
        return Verdict::Worse;
    }
    // An explanation that no fault vector gives need not be far better, but must be better.
    let factor = if estimate.is_unmodelled() { ALIKE } else { BETTER };
    if estimate.cost > factor * rival.cost {
        return if rival.cost < GOOD_COST {
            Verdict::Better
        } else {
            Verdict::Worse
        };
    }
    if suspect == Suspect::CurrentGain || estimate.is_unmodelled() {
        return Verdict::Worse;
    }
    let of_rival = accused(rival, level);
    let is_explained_away = |fault: FaultId| {
        let damage = estimate.fault.damage_of(fault);
        let is_open = damage > LARGE_DAMAGE && rival.sigma[fault.parameter()].is_none();
        rival.fault.damage_of(fault) < EXPLAINED_AWAY * damage || is_open
    };
    let accuses_less = accused(estimate, level)
        .into_iter()
        .any(|fault| !of_rival.contains(&fault) && is_explained_away(fault));
    if accuses_less && rival.cost < ALIKE * estimate.cost {
        Verdict::Alike
    } else {
        Verdict::Worse
    }
}

/// Compares an estimate with that of a rival by [`compare`]. A load sensor is accused by nothing that its reading explains as well: where another
/// load does so too and accuses less, the reading alone parts load and fault.
#[must_use]
pub fn judge(job: &WindowJob, estimate: &Estimate, suspect: Suspect, rival: &Estimate, level: f64) -> Verdict {
    let verdict = compare(estimate, suspect, rival, level);
    if suspect != Suspect::LoadSensor || verdict == Verdict::Better {
        return verdict;
    }
    let accuses = |estimate: &Estimate| accused(estimate, level).contains(&FaultId::Friction);
    // Along the valley of load and friction a fit ends anywhere: where it ends says nothing of the reading.
    let is_friction_of_one_way = moves_one_way(job) && accuses(estimate);
    let hides_friction = || {
        is_friction_of_one_way
            && !rival.is_unmodelled()
            && !(accuses(rival) && rival.sigma[FaultId::Friction.parameter()].is_some())
            && rival.cost < ALIKE * estimate.cost
    };
    let is_alike = || verdict == Verdict::Alike && (is_friction_of_one_way || is_other_load(job, rival));
    if is_alike() || hides_friction() {
        Verdict::Undecided
    } else {
        Verdict::Worse
    }
}

/// Share of the friction at the output by which two loads differ.
const ANOTHER_LOAD: f64 = 0.15;

/// Whether the load of a rival is another one than is read.
fn is_other_load(job: &WindowJob, rival: &Estimate) -> bool {
    let gear = &job.params.transmission;
    let least = ANOTHER_LOAD * gear.friction_dynamic * gear.gear_ratio;
    let read = job.conditions.load_torque_nm;
    read.is_some_and(|read| (rival.unknowns.load_torque - read).abs() > least)
}

/// The faults that an estimate accuses and a rival does not.
#[must_use]
pub fn accused_by_reading(estimate: &Estimate, rival: &Estimate, level: f64) -> Vec<FaultId> {
    let of_rival = accused(rival, level);
    let only = accused(estimate, level).into_iter();
    only.filter(|fault| !of_rival.contains(fault)).collect()
}

/// Standard deviations by which the turns of a phase are less than none.
const NEGATIVE_SIGMAS: f64 = 4.0;

/// What is wrong where the motion needs a current of the other sign, and in which phases: the worst winding has no turns, none less than that.
#[must_use]
pub fn reversed_current(estimate: &Estimate) -> Option<[Suspicion; 2]> {
    of_turns(&estimate.inferred.turns)
}

/// Of the turns of each phase that a window shows, 1.
fn of_turns(turns: &[Option<Inferred>; 3]) -> Option<[Suspicion; 2]> {
    let is_reversed = |turns: &Inferred| turns.value < -NEGATIVE_SIGMAS * turns.sigma;
    let reversed: Vec<String> = ['a', 'b', 'c']
        .into_iter()
        .zip(turns)
        .filter_map(|(phase, turns)| Some((phase, turns.filter(is_reversed)?)))
        .map(|(phase, Inferred { value, sigma })| format!("in phase {phase} {value:.1} ± {sigma:.1}"))
        .collect();
    (!reversed.is_empty()).then(|| {
        let phases = reversed.join(", ");
        let evidence = format!("the torque has the other sign than the current: {phases} of the healthy one");
        [Suspect::CurrentSign, Suspect::PhaseOrder].map(|suspect| Suspicion {
            suspect,
            sentence: format!("{suspect}: {evidence}"),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_less_than_none_are_a_reversed_current_of_that_phase_and_no_short() {
        let of = |turns: [(f64, f64); 3]| of_turns(&turns.map(|(value, sigma)| Some(Inferred { value, sigma })));
        assert_eq!(of([(1.0, 0.05), (0.0, 0.05), (-0.3, 0.1)]), None);
        let [sign, order] = of([(1.0, 0.05), (-1.0, 0.2), (0.9, 0.05)]).expect("less than none");
        assert_eq!(
            (sign.suspect, order.suspect),
            (Suspect::CurrentSign, Suspect::PhaseOrder)
        );
        assert_eq!(
            sign.sentence,
            "current sign: the torque has the other sign than the current: in phase b -1.0 ± 0.2 of the healthy one"
        );
        let [two, _] = of([(-0.9, 0.1), (-1.0, 0.2), (0.9, 0.05)]).expect("less than none");
        assert!(
            two.sentence
                .ends_with("in phase a -0.9 ± 0.1, in phase b -1.0 ± 0.2 of the healthy one"),
            "{}",
            two.sentence
        );
    }
}
