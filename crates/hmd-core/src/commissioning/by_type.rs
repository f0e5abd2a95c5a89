//! What windows show of a unit by the numbers of its type alone: what is worn when a unit is commissioned would count as its health.

use std::collections::BTreeMap;

use ema_models::FaultId;

use super::CommissioningError;
use crate::assess::AssessedWindow;
use crate::config::ActuatorConfig;
use crate::health::{Health, Levels, LevelsError};
use crate::sensor_checks::Suspect;

/// What one window shows by the type alone.
#[derive(Clone, Debug, Default)]
pub struct SeenByType {
    /// Damage of the faults that are visible.
    damage: Vec<(FaultId, f64)>,
    suspects: Vec<Suspect>,
}

impl SeenByType {
    /// Of a window of a unit that is not commissioned. A fault is visible from its level `watch` on.
    ///
    /// # Errors
    /// Impossible levels.
    pub fn new(assessed: &AssessedWindow, levels: &[Levels; FaultId::COUNT]) -> Result<Self, LevelsError> {
        let evidence = assessed.damage_evidence.as_ref();
        let decision = Health::new(levels.map(Levels::at_once))?.update(assessed.health.window, evidence);
        let damage = evidence.map_or([f64::NAN; FaultId::COUNT], |evidence| evidence.damage);
        Ok(Self {
            damage: decision
                .faults
                .into_iter()
                .map(|fault| (fault, damage[fault.index()]))
                .collect(),
            suspects: assessed.suspects.clone(),
        })
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
            format!("warning: check {suspect}: {count} of {all} windows doubt it; hmd replay says why")
        })
        .collect();
    for fault in FaultId::ALL {
        let damages = windows.iter().flat_map(|window| &window.damage);
        let mut found: Vec<f64> = damages
            .filter(|(of, _)| *of == fault)
            .map(|(_, damage)| *damage)
            .collect();
        if !are_most(found.len()) {
            continue;
        }
        found.sort_unstable_by(f64::total_cmp);
        let median = found[found.len() / 2];
        let what = format!(
            "{} of {median:.2} in {} of {all} windows, by the numbers of type {}",
            fault.plain_name(),
            found.len(),
            actuator.type_name
        );
        if median >= levels[fault.index()].warning {
            return Err(CommissioningError::Worn(what));
        }
        warnings.push(format!("warning: {what}: what it has now will count as health"));
    }
    Ok(warnings)
}
