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
    /// The genetic algorithm alone, with the settings of the paper's.
    Ga,
    /// Differential evolution alone.
    De,
    /// Evolution strategy with covariance matrix adaptation alone.
    Cmaes,
    /// Least squares from health alone.
    LeastSquares,
    /// The relations between measured signals of a commissioned unit, whatever estimator its calibration names.
    Relations,
}

impl SearchMethod {
    /// Every method under its name in the file.
    pub const NAMES: [(&str, Self); 6] = [
        ("hybrid", Self::Hybrid),
        ("ga", Self::Ga),
        ("de", Self::De),
        ("cmaes", Self::Cmaes),
        ("least-squares", Self::LeastSquares),
        ("relations", Self::Relations),
    ];

    /// Its name in the file.
    #[must_use]
    pub fn name(self) -> &'static str {
        let found = Self::NAMES.into_iter().find(|(_, method)| *method == self);
        found.map_or("", |(name, _)| name)
    }

    /// Whether a population is all there is of it: it may then minimise any cost.
    #[must_use]
    pub fn is_population(self) -> bool {
        matches!(self, Self::Ga | Self::De | Self::Cmaes)
    }

    /// Population, generations and budget by default; none where it has no population, whose work is bounded by itself.
    fn extent(self) -> Option<[u32; 3]> {
        match self {
            Self::Hybrid => Some([32, 5, 5_000]),
            // MATLAB's for eight genes, which the paper used.
            Self::Ga => Some([200, 800, 200_000]),
            // Ten individuals a gene.
            Self::De => Some([80, 800, 200_000]),
            // Two batches of 16 lanes.
            Self::Cmaes => Some([32, 800, 200_000]),
            Self::LeastSquares | Self::Relations => None,
        }
    }
}

/// What a population search minimises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchObjective {
    /// The weighted squares of all signals' residuals, angles by measurement.
    #[default]
    Residual,
    /// The paper's eq. 14: the quadrature current alone, of a monitor that simulates its own angles.
    Eq14,
}

impl SearchObjective {
    /// Every objective under its name in the file.
    pub const NAMES: [(&str, Self); 2] = [("residual", Self::Residual), ("eq14", Self::Eq14)];
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
    /// What it minimises; `eq14` with a population alone.
    pub objective: SearchObjective,
    /// The model that is fitted.
    pub monitor: MonitorForm,
    /// Individuals of the population; like the next two 0 where the method has none.
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
        "objective",
        "monitor",
        "population",
        "generations",
        "evaluations_max",
        "deadline_ms",
    ];

    /// The defaults with `method`. That of `hybrid` is enough to start least squares in the right valley; its budget leaves room
    /// for some hundred refinement steps.
    #[must_use]
    pub fn for_method(method: SearchMethod) -> Self {
        let [population, generations, evaluations_max] = method.extent().unwrap_or_default();
        Self {
            method,
            objective: SearchObjective::Residual,
            monitor: MonitorForm::ThreePhase,
            population,
            generations,
            evaluations_max,
            deadline_ms: None,
        }
    }

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let default = Self::for_method(section.choice("method", SearchMethod::default(), &SearchMethod::NAMES)?);
        let name = default.method.name();
        let objective = section.choice("objective", default.objective, &SearchObjective::NAMES)?;
        if objective != SearchObjective::Residual && !default.method.is_population() {
            return Err(section.refuse("objective", &format!("\"residual\" with method = \"{name}\"")));
        }
        let of_population = ["population", "generations", "evaluations_max"];
        if let (None, Some(key)) = (
            default.method.extent(),
            of_population.into_iter().find(|key| section.has(key)),
        ) {
            return Err(section.refuse(key, &format!("none with method = \"{name}\"")));
        }
        let config = Self {
            objective,
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
