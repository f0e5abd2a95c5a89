//! Health state by the remaining useful life.

use ema_models::FaultId;
use serde::{Deserialize, Serialize};

use super::{LifeEnd, ReplacedPart};
use crate::config::RulConfig;
use crate::health::HealthState;
use crate::rul::{Forecast, NoTrend};

/// How far beyond a level the hours left must be before the state improves, as a factor.
const HYSTERESIS: f64 = 1.2;

/// State by the 10 % quantile of the hours left: worsens after as many windows in a row as the fault that ends the life
/// needs by its damage, improves beyond the hysteresis, and after as many windows in a row by which that fault does not grow or its end is
/// out of reach. A window that shows nothing of the fault changes nothing. While a damage lies above its trend, a trend has just begun anew by a
/// jump, or that of the fault has too few estimates, nothing improves: the forecasts of other faults only raise.
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
    /// Whether nothing improves until the part is replaced or the unit is commissioned; older files had none.
    #[serde(default)]
    held: bool,
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
            let stays = self.held || self.is_open(left.forecast);
            match left.forecast.actuator {
                Ok(life) => self.take_hours(life.hours.p10, fault, stays, config, persistence(fault)),
                Err(_) if stays => {}
                Err(_) => self.take_none(persistence(fault)),
            }
        }
        self.state()
    }

    /// Whether what ended the life may do so still, and its trend does not tell yet. A trend that jumped may be that of any fault: together
    /// they end the life, too.
    fn is_open(&self, forecast: &Forecast) -> bool {
        let has_jumped =
            |life: &Result<_, NoTrend>| matches!(life, Err(NoTrend::Jumped { .. } | NoTrend::AboveTrend { .. }));
        let has_few = |fault: FaultId| matches!(forecast.faults[fault.index()], Err(NoTrend::TooFew { .. }));
        forecast.faults.iter().any(has_jumped) || self.fault().is_some_and(has_few)
    }

    /// `stays`: the state may worsen alone.
    fn take_hours(&mut self, left_h: f64, fault: Option<FaultId>, stays: bool, config: &RulConfig, persistence: u32) {
        let before = self.reached;
        self.beyond = 0;
        let levels = [config.warning_h, config.critical_h];
        for (below, level) in self.below.iter_mut().zip(levels) {
            *below = if left_h < level { below.saturating_add(1) } else { 0 };
        }
        let worse = self.below.iter().filter(|&&below| below >= persistence).count();
        self.reached = before.max(worse);
        // A state that another fault has brought is about that fault still.
        if stays && before > 0 && self.reached == before {
            return;
        }
        self.fault = fault.map(FaultId::index);
        while !stays && self.reached > 0 && left_h >= HYSTERESIS * levels[self.reached - 1] {
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

    /// Forgets the forecasts that a new part makes void; whether it does.
    pub(super) fn forget(&mut self, part: ReplacedPart) -> bool {
        let end = LifeEnd {
            by_function: self.fault.is_none(),
            fault: self.fault(),
        };
        let is_void = end.is_of(Some(part));
        if is_void {
            *self = Self::default();
        }
        is_void
    }

    /// Keeps the state from improving: what it rests on is void.
    pub(super) fn hold(&mut self) {
        self.held = self.reached > 0;
    }

    /// The forecasts decide again.
    pub(super) fn release(&mut self) {
        self.held = false;
    }

    /// State after the last window.
    pub(super) fn state(&self) -> HealthState {
        [HealthState::Unknown, HealthState::Warning, HealthState::Critical][self.reached]
    }

    fn fault(&self) -> Option<FaultId> {
        self.fault.map(|fault| FaultId::ALL[fault])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rul::{Quantiles, RemainingLife};

    const FRICTION: usize = 0;
    const BACKLASH: usize = 1;

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

    /// Friction, then backlash alone: whether each has hours left.
    fn take_both(urgency: &mut Urgency, friction: Result<f64, NoTrend>, backlash: Result<f64, NoTrend>) -> HealthState {
        let [of_friction, of_backlash] = [forecast(friction, FRICTION), forecast(backlash, BACKLASH)];
        let is_friction =
            of_friction.actuator.is_ok() && (of_backlash.actuator.is_err() || friction.ok() < backlash.ok());
        let first = if is_friction { &of_friction } else { &of_backlash };
        let mut both = first.clone();
        both.faults[FRICTION] = of_friction.faults[FRICTION];
        both.faults[BACKLASH] = of_backlash.faults[BACKLASH];
        let left = Left {
            ends_by: both.dominant,
            forecast: &both,
            shown: [true; FaultId::COUNT],
        };
        urgency.update(&left, &config(), |_| 1)
    }

    #[test]
    fn a_jump_leaves_the_state_to_no_other_fault() {
        let (jumped, none) = (NoTrend::Jumped { got: 4 }, NoTrend::NoGrowth);
        let mut urgency = Urgency::default();
        let windows = [
            (Ok(5.0), Ok(500.0)),
            (Err(jumped), Ok(500.0)),
            (Err(jumped), Ok(50.0)),
            (Err(jumped), Err(none)),
            (Err(none), Ok(50.0)),
            // Another fault raises the state all the same, and it is then about that one.
            (Err(jumped), Ok(5.0)),
            (Err(none), Ok(500.0)),
        ];
        let states = windows.map(|(friction, backlash)| take_both(&mut urgency, friction, backlash));
        assert_eq!(states, [C, C, C, C, W, C, N]);
        // The fault that has jumped was not the first to end.
        let mut urgency = Urgency::default();
        let windows = [(Ok(9.0), Ok(5.0)), (Ok(50.0), Err(jumped)), (Ok(50.0), Err(none))];
        let states = windows.map(|(friction, backlash)| take_both(&mut urgency, friction, backlash));
        assert_eq!(states, [C, C, W]);
        // All together ended the life.
        let mut urgency = Urgency::default();
        let mut function = forecast(Ok(5.0), FRICTION);
        for life in [Ok(5.0), Err(jumped)] {
            function.faults[FRICTION] = forecast(life, FRICTION).faults[FRICTION];
            function.actuator = function.faults[FRICTION];
            let left = Left {
                ends_by: None,
                forecast: &function,
                shown: [true; FaultId::COUNT],
            };
            assert_eq!(urgency.update(&left, &config(), |_| 1), C);
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
        urgency.forget(ReplacedPart::Motor);
        assert_eq!(urgency.state(), C);
        urgency.forget(ReplacedPart::Gearbox);
        assert_eq!(urgency.state(), N);
    }
}
