//! Catalogue of fault modes, for machines: what a health record can say of an actuator, in the sense of SAE JA6268.

use serde::Serialize;

use crate::health::{HealthState, Levels, significance};
use ema_models::FaultId;

/// Version of the catalogue's form; a breaking change counts it up.
const VERSION: u32 = 3;

/// All fault modes, with the levels of one configuration.
#[derive(Clone, Debug, Serialize)]
pub struct Catalogue {
    /// Version of this form.
    pub version: u32,
    /// The program that detects them.
    pub build: &'static str,
    /// What confidence means here.
    pub confidence: Confidence,
    /// The modes, in the order in which records list faults.
    pub fault_modes: [FaultMode; FaultId::COUNT],
}

/// Meaning of the uncertainties in a record.
#[derive(Clone, Debug, Serialize)]
pub struct Confidence {
    /// Meaning of the standard deviations.
    pub sigma: &'static str,
    /// Meaning of the quantiles of the remaining life.
    pub quantiles: &'static str,
}

/// One way in which an actuator fails.
#[derive(Clone, Debug, Serialize)]
pub struct FaultMode {
    /// Stable identifier.
    pub id: &'static str,
    /// The name that `faults` and `dominant_fault` of records use.
    pub name: &'static str,
    /// The part that fails.
    pub item: &'static str,
    /// What happens to it.
    pub mode: &'static str,
    /// What the monitor sees of it.
    pub symptom: &'static str,
    /// What it does to the actuator.
    pub effect: &'static str,
    /// The fields of `hmd.v1.Health` that hold estimate, standard deviation and damage.
    pub fields: [String; 3],
    /// How damage follows from the estimate.
    pub damage: &'static str,
    /// A damage of fewer sigmas than this is no evidence of the fault.
    pub significance_sigmas: f64,
    /// Damage from which on each class of severity holds, rising.
    pub severity: [Severity; 3],
    /// Windows in a row that a worse class needs.
    pub persistence_windows: u32,
    /// Damage at the end of life.
    pub end_of_life: f64,
}

/// A class of severity.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Severity {
    /// The state of `health`.
    pub class: HealthState,
    /// Smallest damage.
    pub damage: f64,
    /// What to do.
    pub action: &'static str,
}

/// What is known of a fault mode whatever the configuration.
struct Known {
    id: &'static str,
    mode: &'static str,
    symptom: &'static str,
    effect: &'static str,
}

/// In the order of [`FaultId::ALL`].
const KNOWN: [Known; FaultId::COUNT] = [
    Known {
        id: "EMA-01",
        mode: "dry friction grows beyond that of a new part",
        symptom: "more current for the same motion, and more of it to break away",
        effect: "less force at the output, more heat",
    },
    Known {
        id: "EMA-02",
        mode: "free play grows",
        symptom: "the output stands still while the motor turns back",
        effect: "lost motion, limit cycles, impacts",
    },
    Known {
        id: "EMA-03",
        mode: "turns are shorted",
        symptom: "current and back-EMF uneven over the electrical angle, weak in phase A",
        effect: "less torque, torque ripple, local heat that spreads the short",
    },
    Known {
        id: "EMA-04",
        mode: "turns are shorted",
        symptom: "current and back-EMF uneven over the electrical angle, weak in phase B",
        effect: "less torque, torque ripple, local heat that spreads the short",
    },
    Known {
        id: "EMA-05",
        mode: "turns are shorted",
        symptom: "current and back-EMF uneven over the electrical angle, weak in phase C",
        effect: "less torque, torque ripple, local heat that spreads the short",
    },
    Known {
        id: "EMA-06",
        mode: "static eccentricity: the air gap is uneven",
        symptom: "back-EMF and torque modulated once in each electrical turn",
        effect: "torque ripple, vibration, at the end rubbing",
    },
    Known {
        id: "EMA-07",
        mode: "proportional gain drifts, up or down",
        symptom: "response to a setpoint too slow or too fast",
        effect: "sluggish or oscillating position",
    },
];

/// The catalogue under the levels of each fault of a configuration.
#[must_use]
pub fn catalogue(levels: &[Levels; FaultId::COUNT]) -> Catalogue {
    Catalogue {
        version: VERSION,
        build: concat!("hmd ", env!("CARGO_PKG_VERSION")),
        confidence: Confidence {
            sigma: "standard deviation of an estimate from one window: noise and model error together; absent where the window \
                    tells nothing of the parameter",
            quantiles: "the life ends earlier than p10 with 10 %, than p50 with 50 %, than p90 with 90 % probability",
        },
        fault_modes: FaultId::ALL.map(|fault| mode(fault, &levels[fault.index()])),
    }
}

fn mode(fault: FaultId, levels: &Levels) -> FaultMode {
    let (known, name, k) = (&KNOWN[fault.index()], fault.name(), fault.parameter() + 1);
    let severity = |class, damage, action| Severity { class, damage, action };
    FaultMode {
        id: known.id,
        name,
        item: fault.part(),
        mode: known.mode,
        symptom: known.symptom,
        effect: known.effect,
        fields: [format!("k{k}"), format!("k{k}_sigma"), format!("damage_{name}")],
        damage: if fault == FaultId::Gain {
            "2 abs(k8 - 0.5)"
        } else {
            "the estimate itself"
        },
        significance_sigmas: significance(fault),
        severity: [
            severity(
                HealthState::Watch,
                levels.watch,
                "inspect at the next scheduled maintenance",
            ),
            severity(HealthState::Warning, levels.warning, "plan the repair"),
            severity(HealthState::Critical, levels.critical, "repair before the next use"),
        ],
        persistence_windows: levels.persistence,
        end_of_life: levels.end_of_life,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Health, Record};

    #[test]
    fn every_fault_has_a_mode_whose_fields_are_in_the_records() {
        let mut levels = [Levels::default(); FaultId::COUNT];
        levels[FaultId::Gain.index()].persistence = 2;
        let found = catalogue(&levels);
        let descriptor = Health::descriptor();
        let known: Vec<&str> = descriptor.file[0].message_type[0]
            .field
            .iter()
            .map(|f| f.name())
            .collect();
        for (mode, name) in found.fault_modes.iter().zip(FaultId::NAMES) {
            assert_eq!(mode.name, name);
            for field in &mode.fields {
                assert!(known.contains(&field.as_str()), "{field}");
            }
            assert!(
                mode.severity
                    .is_sorted_by(|a, b| a.damage < b.damage && a.class < b.class)
            );
        }
        let mut ids: Vec<&str> = found.fault_modes.iter().map(|mode| mode.id).collect();
        ids.dedup();
        assert_eq!(ids.len(), FaultId::COUNT);
        assert_eq!(
            found.fault_modes.map(|mode| mode.persistence_windows),
            [1, 1, 1, 1, 1, 1, 2]
        );
    }
}
