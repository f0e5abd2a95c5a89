//! Section `[identification]`: how a fault vector is searched, and with which monitor.

use serde::Serialize;

use super::ConfigError;
use super::reader::Section;
use ema_identify::calibration::MonitorForm;

/// How the fault vector is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchMethod {
    /// A short population search, then least squares.
    #[default]
    Hybrid,
    /// The genetic algorithm of the paper.
    Ga,
}

impl SearchMethod {
    /// Every method under its name in the file.
    pub const NAMES: [(&str, Self); 2] = [("hybrid", Self::Hybrid), ("ga", Self::Ga)];
}

/// Every form of the monitor under its name in the file.
pub const MONITOR_NAMES: [(&str, MonitorForm); 3] = [
    ("three-phase", MonitorForm::ThreePhase),
    ("one-axis", MonitorForm::OneAxis),
    ("paper", MonitorForm::Paper),
];

/// How a fault vector is searched, and with which monitor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct IdentificationConfig {
    /// The search.
    pub method: SearchMethod,
    /// The model that is fitted.
    pub monitor: MonitorForm,
    /// Individuals of the population.
    pub population: u32,
    /// Generations after the first population.
    pub generations: u32,
    /// Most monitor runs of one search of a window. A window whose counts turn out wrong is searched again, at most twice.
    pub evaluations_max: u32,
    /// Time for a window from the arrival of its last sample to its assessment, ms; what is best by then is reported. Live only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deadline_ms: Option<u32>,
}

impl IdentificationConfig {
    pub(super) const KEYS: &[&str] = &[
        "method",
        "monitor",
        "population",
        "generations",
        "evaluations_max",
        "deadline_ms",
    ];

    /// The defaults with `method`.
    ///
    /// `ga`: those of MATLAB for eight genes, which the paper used. `hybrid`: enough to start least squares in the right
    /// valley; its budget leaves room for some hundred refinement steps.
    #[must_use]
    pub fn for_method(method: SearchMethod) -> Self {
        let (population, generations, evaluations_max) = match method {
            SearchMethod::Hybrid => (32, 5, 5_000),
            SearchMethod::Ga => (200, 800, 200_000),
        };
        Self {
            method,
            monitor: MonitorForm::ThreePhase,
            population,
            generations,
            evaluations_max,
            deadline_ms: None,
        }
    }

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let default = Self::for_method(section.choice("method", SearchMethod::default(), &SearchMethod::NAMES)?);
        let config = Self {
            monitor: section.choice("monitor", default.monitor, &MONITOR_NAMES)?,
            population: section
                .integer("population", 4..=100_000)?
                .unwrap_or(default.population),
            generations: section
                .integer("generations", 1..=100_000)?
                .unwrap_or(default.generations),
            evaluations_max: section
                .integer("evaluations_max", 1..=1_000_000_000)?
                .unwrap_or(default.evaluations_max),
            deadline_ms: section.integer("deadline_ms", 1..=3_600_000)?,
            ..default
        };
        if config.evaluations_max < config.population {
            let expected = format!("at least population = {}", config.population);
            let effective = format!("{} (not set here)", config.evaluations_max);
            return Err(section.refuse_effective("evaluations_max", &expected, &effective));
        }
        Ok(config)
    }
}

impl Default for IdentificationConfig {
    fn default() -> Self {
        Self::for_method(SearchMethod::default())
    }
}
