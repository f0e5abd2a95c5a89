//! Health state by the remaining useful life.

use ema_models::FaultId;
use serde::{Deserialize, Serialize};

use crate::config::RulConfig;
use crate::health::HealthState;
use crate::rul::{Forecast, NoTrend};

/// How far beyond a level the hours left must be before the state improves, as a factor.
const HYSTERESIS: f64 = 1.2;

/// State by the 10 % quantile of the hours left: worsens after as many windows in a row as the fault that ends the life
/// needs by its damage, improves beyond the hysteresis, and after as many windows in a row by which that fault does not grow or its end is
/// out of reach. A window that shows nothing of the fault changes nothing, nor does a trend that has just begun.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Urgency {
    /// Windows in a row below `warning_h` and `critical_h`.
    below: [u32; 2],
    /// Windows in a row without an end in reach; older files had none.
    #[serde(default)]
    beyond: u32,
    /// Levels reached.
    reached: usize,
    /// Index of the fault that ended the life in the last forecast; `None`: all together, or an older file.
    #[serde(default)]
    fault: Option<usize>,
}

/// What a window says of the remaining life.
pub(super) struct Left<'a> {
    /// The forecast after it.
    pub(super) forecast: &'a Forecast,
    /// The fault that ends the life; `None` where all together do.
    pub(super) ends_by: Option<FaultId>,
    /// Whether the window shows each fault, in the order of [`FaultId::ALL`].
    pub(super) shown: [bool; FaultId::COUNT],
}

impl Urgency {
    /// Whether the state is possible; a damaged file may hold any numbers.
    pub(super) fn is_possible(&self) -> bool {
        self.reached <= self.below.len() && self.fault.is_none_or(|fault| fault < FaultId::COUNT)
    }

    /// Takes what a window says of the life that is left; `persistence` is that of a fault, or of all together.
    pub(super) fn update(
        &mut self,
        left: &Left<'_>,
        config: &RulConfig,
        persistence: impl Fn(Option<FaultId>) -> u32,
    ) -> HealthState {
        let fault = if left.forecast.actuator.is_ok() {
            left.ends_by
        } else {
            self.fault()
        };
        let is_shown = fault.map_or(left.shown.contains(&true), |fault| left.shown[fault.index()]);
        if is_shown {
            match left.forecast.actuator {
                Ok(life) => self.take_hours(life.hours.p10, fault, config, persistence(fault)),
                Err(_) if fault.is_some_and(|fault| is_new(left.forecast, fault)) => {}
                Err(_) => self.take_none(persistence(fault)),
            }
        }
        self.state()
    }

    fn take_hours(&mut self, left_h: f64, fault: Option<FaultId>, config: &RulConfig, persistence: u32) {
        self.fault = fault.map(FaultId::index);
        self.beyond = 0;
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

    fn take_none(&mut self, persistence: u32) {
        self.below = [0; 2];
        self.beyond = self.beyond.saturating_add(1);
        if self.beyond >= persistence {
            self.reached = 0;
        }
    }

    /// Forgets the forecasts by faults whose part was replaced; those by all faults together rest on any.
    pub(super) fn forget(&mut self, faults: &[FaultId]) {
        if self.fault().is_none_or(|fault| faults.contains(&fault)) {
            *self = Self::default();
        }
    }

    /// State after the last window.
    pub(super) fn state(&self) -> HealthState {
        [HealthState::Unknown, HealthState::Warning, HealthState::Critical][self.reached]
    }

    fn fault(&self) -> Option<FaultId> {
        self.fault.map(|fault| FaultId::ALL[fault])
    }
}

/// Whether the trend of a fault is too new to say anything.
fn is_new(forecast: &Forecast, fault: FaultId) -> bool {
    matches!(
        forecast.faults[fault.index()],
        Err(NoTrend::TooFew { .. } | NoTrend::Jumped { .. })
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rul::{Quantiles, RemainingLife};

    const FRICTION: usize = 0;
    const BACKLASH: usize = 5;

    fn forecast(life: Result<f64, NoTrend>, fault: usize) -> Forecast {
        let life = life.map(|left_h| RemainingLife {
            hours: Quantiles {
                p10: left_h,
                p50: left_h,
                p90: left_h,
            },
            cycles: None,
            fails_within_horizon: 0.0,
        });
        let mut faults = [Err(NoTrend::NoGrowth); FaultId::COUNT];
        faults[fault] = life;
        Forecast {
            faults,
            actuator: life,
            dominant: life.is_ok().then_some(FaultId::ALL[fault]),
            horizon_h: 1.0,
        }
    }

    fn config() -> RulConfig {
        RulConfig {
            warning_h: 100.0,
            critical_h: 10.0,
            ..RulConfig::default()
        }
    }

    /// Takes a forecast by a fault after a window that shows one fault.
    fn take(
        urgency: &mut Urgency,
        life: Result<f64, NoTrend>,
        fault: usize,
        shown: usize,
        persistence: u32,
    ) -> HealthState {
        let forecast = forecast(life, fault);
        let left = Left {
            ends_by: forecast.dominant,
            forecast: &forecast,
            shown: std::array::from_fn(|fault| fault == shown),
        };
        urgency.update(&left, &config(), |_| persistence)
    }

    use HealthState::{Critical as C, Unknown as N, Warning as W};

    #[test]
    fn worsens_at_once_and_improves_beyond_the_hysteresis() {
        let mut urgency = Urgency::default();
        let lives = [500.0, 99.0, 119.0, 5.0, 11.0, 12.0, 120.0];
        let states = lives.map(|left_h| take(&mut urgency, Ok(left_h), FRICTION, FRICTION, 1));
        assert_eq!(states, [N, W, W, C, C, W, N]);
        let mut patient = Urgency::default();
        let [once, twice] = [(); 2].map(|()| take(&mut patient, Ok(5.0), FRICTION, FRICTION, 2));
        assert_eq!((once, twice), (N, C));
        // Levels of 0 are off.
        let forecast = forecast(Ok(0.0), FRICTION);
        let left = Left {
            ends_by: None,
            forecast: &forecast,
            shown: [true; FaultId::COUNT],
        };
        assert_eq!(Urgency::default().update(&left, &RulConfig::default(), |_| 1), N);
    }

    #[test]
    fn a_forecast_that_ends_takes_its_state_along_unless_the_trend_is_new() {
        let (few, jumped) = (NoTrend::TooFew { got: 3 }, NoTrend::Jumped { got: 3 });
        for none in [NoTrend::NoGrowth, NoTrend::TooFar { observed_h: 50.0 }] {
            let mut urgency = Urgency::default();
            let lives = [Ok(5.0), Ok(5.0), Err(few), Err(jumped), Err(none), Err(few), Err(none)];
            let states = lives.map(|life| take(&mut urgency, life, FRICTION, FRICTION, 2));
            assert_eq!(states, [N, C, C, C, C, C, N], "{none}");
        }
    }

    #[test]
    fn only_windows_that_show_the_fault_that_ends_the_life_count() {
        let mut urgency = Urgency::default();
        for _ in 0..9 {
            assert_eq!(take(&mut urgency, Ok(5.0), FRICTION, BACKLASH, 2), N);
        }
        let [_, twice] = [(); 2].map(|()| take(&mut urgency, Ok(5.0), FRICTION, FRICTION, 2));
        assert_eq!(twice, C);
        for life in [Ok(500.0), Err(NoTrend::NoGrowth)] {
            for _ in 0..9 {
                assert_eq!(take(&mut urgency, life, FRICTION, BACKLASH, 2), C);
            }
        }
    }

    #[test]
    fn a_replaced_part_takes_its_own_forecast_along() {
        let mut urgency = Urgency::default();
        assert_eq!(take(&mut urgency, Ok(5.0), BACKLASH, BACKLASH, 1), C);
        urgency.forget(&[FaultId::ALL[FRICTION]]);
        assert_eq!(urgency.state(), C);
        urgency.forget(&[FaultId::ALL[BACKLASH]]);
        assert_eq!(urgency.state(), N);
    }
}
