//! What levels and persistence ask for, said once more and plainly: the last windows decide.

use hmd_core::record::Health;

/// Default levels of watch, warning and critical.
const LEVELS: [(f64, &str); 3] = [(0.05, "watch"), (0.3, "warning"), (0.6, "critical")];
const HYSTERESIS: f64 = 0.02;
/// Sigmas below which a damage is none.
const SIGMAS: f64 = 3.0;
const SIGMAS_OF_ECCENTRICITY: f64 = 3.44;

/// One actuator in one run.
pub(crate) struct HealthOracle {
    persistence: usize,
    /// Of each fault, the damages and sigmas of the windows that tell something of it, and the levels that it has reached.
    faults: [(Vec<(f64, f64)>, usize); 7],
    /// Faults whose state the windows so far have shown.
    shown: [bool; 7],
    events: Option<usize>,
}

impl HealthOracle {
    pub(crate) fn new(persistence: u32) -> Self {
        Self {
            persistence: persistence as usize,
            faults: Default::default(),
            shown: [false; 7],
            events: None,
        }
    }

    /// State after a window, before which so many events had come.
    pub(crate) fn next(&mut self, health: &Health, come: usize) -> &'static str {
        let before = self.events.replace(come.max(self.events.unwrap_or(0)));
        if before.is_some_and(|before| come > before) {
            self.faults = Default::default();
            self.shown = [false; 7];
        }
        let sigmas = [
            health.k1_sigma,
            health.k2_sigma,
            health.k3_sigma,
            health.k4_sigma,
            health.k5_sigma,
            health.k6_sigma,
            health.k8_sigma.map(|sigma| 2.0 * sigma),
        ];
        let damages = [
            health.k1,
            health.k2,
            health.k3,
            health.k4,
            health.k5,
            health.k6,
            health.k8.map(|gain| (2.0 * (gain - 0.5)).abs()),
        ];
        for (n, (damage, sigma)) in damages.into_iter().zip(sigmas).enumerate() {
            let (Some(damage), Some(sigma)) = (damage, sigma) else {
                continue;
            };
            let (found, reached) = &mut self.faults[n];
            found.push((damage, sigma));
            let least = if n == 5 { SIGMAS_OF_ECCENTRICITY } else { SIGMAS };
            let is_significant = damage >= least * sigma;
            if is_significant || damage + 2.0 * sigma < LEVELS[1].0 {
                self.shown[n] = true;
            } else if damage >= LEVELS[1].0 {
                self.shown[n] = false;
            }
            let last = &found[found.len().saturating_sub(self.persistence)..];
            let holds = |level: f64| {
                last.len() == self.persistence
                    && last
                        .iter()
                        .all(|(damage, sigma)| *damage >= level && *damage >= least * sigma)
            };
            let risen = LEVELS.iter().filter(|(level, _)| holds(*level)).count();
            if risen > *reached {
                *reached = risen;
            } else {
                while *reached > 0 && damage + sigma < LEVELS[*reached - 1].0 - HYSTERESIS {
                    *reached -= 1;
                }
            }
        }
        let worst = self.faults.iter().map(|(_, reached)| *reached).max().unwrap_or(0);
        match worst {
            0 if self.shown.contains(&false) => "unknown",
            0 => "nominal",
            reached => LEVELS[reached - 1].1,
        }
    }
}
