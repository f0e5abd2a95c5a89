//! Health state by the remaining useful life.

use serde::{Deserialize, Serialize};

use crate::config::RulConfig;
use crate::health::HealthState;

/// How far beyond a level the hours left must be before the state improves, as a factor.
const HYSTERESIS: f64 = 1.2;

/// State by the 10 % quantile of the hours left: worsens after as many windows in a row as the fault that ends the life
/// needs by its damage, improves beyond the hysteresis. A window without a forecast changes nothing.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Urgency {
    /// Windows in a row below `warning_h` and `critical_h`.
    below: [u32; 2],
    /// Levels reached.
    reached: usize,
}

impl Urgency {
    /// Whether the state is possible; a damaged file may hold any numbers.
    pub(super) fn is_possible(&self) -> bool {
        self.reached <= self.below.len()
    }

    /// Takes the hours left after a window; `persistence` is that of the fault that ends the life.
    pub(super) fn update(&mut self, left_h: Option<f64>, config: &RulConfig, persistence: u32) -> HealthState {
        if let Some(left_h) = left_h {
            let levels = [config.warning_h, config.critical_h];
            for (below, level) in self.below.iter_mut().zip(levels) {
                *below = if left_h < level { below.saturating_add(1) } else { 0 };
            }
            let worse = self.below.iter().filter(|&&below| below >= persistence).count();
            self.reached = self.reached.max(worse);
            while self.reached > 0 && left_h >= HYSTERESIS * levels[self.reached - 1] {
                self.reached -= 1;
            }
        }
        self.state()
    }

    /// State after the last window.
    pub(super) fn state(&self) -> HealthState {
        [HealthState::Unknown, HealthState::Warning, HealthState::Critical][self.reached]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worsens_at_once_and_improves_beyond_the_hysteresis() {
        let config = RulConfig {
            warning_h: 100.0,
            critical_h: 10.0,
            ..RulConfig::default()
        };
        let mut urgency = Urgency::default();
        let states: Vec<_> = [
            None,
            Some(500.0),
            Some(99.0),
            Some(119.0),
            None,
            Some(5.0),
            Some(11.0),
            Some(12.0),
            Some(120.0),
        ]
        .into_iter()
        .map(|left_h| urgency.update(left_h, &config, 1))
        .collect();
        use HealthState::{Critical as C, Unknown as N, Warning as W};
        assert_eq!(states, [N, N, W, W, W, C, C, W, N]);
        let mut patient = Urgency::default();
        let [once, twice] = [(); 2].map(|()| patient.update(Some(5.0), &config, 2));
        assert_eq!((once, twice), (N, C));
        // Levels of 0 are off.
        assert_eq!(Urgency::default().update(Some(0.0), &RulConfig::default(), 1), N);
    }
}
