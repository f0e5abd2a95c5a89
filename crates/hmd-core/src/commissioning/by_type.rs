//! What windows show of a unit by the numbers of its type alone: what is worn when a unit is commissioned would count as its health.

use std::collections::BTreeMap;

use ema_models::FaultId;

use super::CommissioningError;
use crate::assess::AssessedWindow;
use crate::config::ActuatorConfig;
use crate::health::{Levels, significance};
use crate::record::WindowStatus;
use crate::sensor_checks::Suspect;

/// What one window shows by the type alone.
#[derive(Clone, Debug, Default)]
pub struct SeenByType {
    /// Damage with its standard deviation, of the faults that it shows anything of, in the order of [`FaultId::ALL`].
    damage: [Option<(f64, f64)>; FaultId::COUNT],
    suspects: Vec<Suspect>,
    is_unmodelled: bool,
    is_of_calibrated_type: bool,
    /// Number of the window, and why it is what it is.
    window: u64,
    reason: String,
}

impl SeenByType {
    /// Of a window of a unit that is not commissioned.
    #[must_use]
    pub fn new(assessed: &AssessedWindow) -> Self {
        let evidence = assessed.damage_evidence.as_ref();
        Self {
            damage: FaultId::ALL.map(|fault| evidence.and_then(|evidence| evidence.damage_and_sigma(fault))),
            suspects: assessed.suspects.clone(),
            is_unmodelled: assessed.health.status == WindowStatus::Unmodelled.name(),
            is_of_calibrated_type: assessed.is_calibrated,
            window: assessed.health.window,
            reason: assessed.health.reason.clone(),
        }
    }
}

impl SeenByType {
    /// The part of the reason that names a suspect.
    fn why(&self, suspect: Suspect) -> String {
        let named = format!("{suspect}: ");
        let part = self.reason.split("; ").find(|part| part.contains(&named));
        format!("window {}: {}", self.window, part.unwrap_or(&self.reason))
    }
}

/// Whether the windows of a unit can be those of a healthy one, by its type: what an operator should know of them, in sentences.
///
/// # Errors
/// [`CommissioningError::Worn`]: most windows show a fault at its level `warning`.
pub fn health_by_type(
    windows: &[SeenByType],
    actuator: &ActuatorConfig,
    levels: &[Levels; FaultId::COUNT],
) -> Result<Vec<String>, CommissioningError> {
    let are_most = |count: usize| 2 * count > windows.len();
    let all = windows.len();
    let mut doubted: BTreeMap<Suspect, usize> = BTreeMap::new();
    for suspect in windows.iter().flat_map(|window| &window.suspects) {
        *doubted.entry(*suspect).or_default() += 1;
    }
    let mut warnings: Vec<String> = doubted
        .into_iter()
        .filter(|(_, count)| are_most(*count))
        .map(|(suspect, count)| {
            let first = windows.iter().find(|window| window.suspects.contains(&suspect));
            let why = first.map_or_else(String::new, |first| first.why(suspect));
            format!("warning: check {suspect}: {count} of {all} windows doubt it: {why}")
        })
        .collect();
    let mut unmodelled = windows.iter().filter(|window| window.is_unmodelled);
    let count = unmodelled.clone().count();
    if let (true, Some(first)) = (are_most(count), unmodelled.next()) {
        let advice = if !warnings.is_empty() {
            "correct what they doubt first"
        } else if first.is_of_calibrated_type {
            "the type is calibrated: a gear that bends, or a wrong number of the type, does so"
        } else {
            "calibrate the type first (hmd calibrate --type)"
        };
        warnings.push(format!(
            "warning: whether these windows are healthy could not be checked: {count} of {all} are unmodelled by the type alone, window {}: \
             {}; {advice}",
            first.window, first.reason
        ));
    }
    for fault in FaultId::ALL {
        let shown: Vec<(f64, f64)> = windows
            .iter()
            .filter_map(|window| window.damage[fault.index()])
            .collect();
        // The tolerances of a type are off alike in all windows, so that many are no more certain than one, and their scatter is that of the
        // windows alone.
        let median = median(shown.iter().map(|(damage, _)| *damage).collect());
        let sigma = self::median(shown.iter().map(|(_, sigma)| *sigma).collect());
        let levels = &levels[fault.index()];
        let is_significant = median >= significance(fault) * sigma;
        let is_likely = median >= levels.warning && median >= LIKELY_SIGMAS * sigma;
        if !are_most(shown.len()) || median < levels.watch || !(is_significant || is_likely) {
            continue;
        }
        let count = shown.iter().filter(|(damage, _)| *damage >= levels.watch).count();
        let what = format!(
            "{} of {median:.2} in {} of {all} windows, by the numbers of type {}",
            fault.plain_name(),
            count,
            actuator.type_name
        );
        if !is_significant {
            warnings.push(format!(
                "warning: {what}, ± {sigma:.2} by its tolerances: if the unit is worn, this will count as its health"
            ));
            continue;
        }
        if median >= levels.warning {
            return Err(CommissioningError::Worn(what));
        }
        warnings.push(format!("warning: {what}: what it has now will count as health"));
    }
    Ok(warnings)
}

/// Sigmas from which on a damage at its level `warning` is worth a word: one unit in twenty of this type has it without wear.
const LIKELY_SIGMAS: f64 = 2.0;

/// The middle of some values; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    fn windows(damages: &[(f64, f64)]) -> Vec<SeenByType> {
        let seen = |friction: &(f64, f64)| SeenByType {
            damage: core::array::from_fn(|n| (n == 0).then_some(*friction)),
            ..SeenByType::default()
        };
        damages.iter().map(seen).collect()
    }

    fn health(damages: &[(f64, f64)]) -> Result<usize, CommissioningError> {
        let config = Config::default();
        let warnings = health_by_type(&windows(damages), &config.actuators()[0], config.health().levels());
        warnings.map(|warnings| warnings.len())
    }

    #[test]
    fn that_most_windows_are_unmodelled_is_said() {
        let config = Config::default();
        let of_ten = |unmodelled: usize| {
            let mut seen = vec![SeenByType::default(); 10];
            for window in seen.iter_mut().take(unmodelled) {
                window.is_unmodelled = true;
                window.reason = "no fault vector explains the data: cost 99".to_owned();
            }
            health_by_type(&seen, &config.actuators()[0], config.health().levels()).unwrap()
        };
        assert!(of_ten(5).is_empty());
        let expected = "warning: whether these windows are healthy could not be checked: 6 of 10 are unmodelled by the type alone, \
                        window 0: no fault vector explains the data: cost 99; calibrate the type first (hmd calibrate --type)";
        assert_eq!(of_ten(6), [expected]);
    }

    #[test]
    fn what_most_windows_doubt_is_said_with_the_reason_of_a_replay() {
        let config = Config::default();
        let doubting = SeenByType {
            suspects: vec![Suspect::GearRatio, Suspect::EncoderCounts],
            is_unmodelled: true,
            window: 3,
            reason: "gear ratio: it seems to be 90.0, not 91.0, or encoder counts: 19780; not excited: gain".to_owned(),
            ..SeenByType::default()
        };
        let said = health_by_type(&vec![doubting; 5], &config.actuators()[0], config.health().levels()).unwrap();
        let why =
            "5 of 5 windows doubt it: window 3: gear ratio: it seems to be 90.0, not 91.0, or encoder counts: 19780";
        for (line, suspect) in said.iter().zip(["encoder counts", "gear ratio"]) {
            assert_eq!(*line, format!("warning: check {suspect}: {why}"));
        }
        assert!(
            said[2].ends_with("; not excited: gain; correct what they doubt first"),
            "{said:?}"
        );
    }

    #[test]
    fn windows_of_which_few_are_significant_alone_are_worn_together() {
        // Three sigmas are 0.39: four of ten reach it.
        let worn = [0.52, 0.36, 0.35, 0.45, 0.38, 0.55, 0.37, 0.43, 0.41, 0.4].map(|damage| (damage, 0.13));
        assert!(matches!(health(&worn), Err(CommissioningError::Worn(_))));
        assert_eq!(health(&worn.map(|(damage, _)| (damage - 0.15, 0.05))).ok(), Some(1));
        assert_eq!(health(&worn.map(|(damage, _)| (damage - 0.2, 0.13))).ok(), Some(0));
        // What tolerances explain with one unit in twenty is worth a word.
        assert_eq!(health(&worn.map(|(damage, _)| (damage, 0.19))).ok(), Some(1));
        // Of one window in three nobody knows.
        assert!(health(&[(0.5, 0.1); 3]).is_err());
        let mut few = windows(&[(0.5, 0.1); 6]);
        few.iter_mut()
            .take(4)
            .for_each(|window| window.damage = [None; FaultId::COUNT]);
        let config = Config::default();
        assert!(
            health_by_type(&few, &config.actuators()[0], config.health().levels()).is_ok_and(|found| found.is_empty())
        );
    }
}
