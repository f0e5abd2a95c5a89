//! What begins the windows of an actuator, and what its samples say of motion that begins none.

use ema_models::{ActuatorParams, SensedSample, Setpoint};

use crate::config::ActuatorConfig;
use crate::sensor_checks::{MotionsWithoutWindow, UnseenMotion};
use crate::window::{TimedSample, WindowConfig};

/// Change of the motor's counts that is no motion: the noise of a sensor at rest.
const STILL_COUNTS: u64 = 1;

/// What begins the windows of an actuator.
#[derive(Debug)]
pub(super) enum BegunBy {
    /// Its set point.
    SetPoint(UnseenMotion),
    /// Motion itself.
    Motion {
        without_window: MotionsWithoutWindow,
        /// Motor counts of the sample before.
        counts: Option<i64>,
    },
}

impl BegunBy {
    pub(super) fn of(actuator: &ActuatorConfig, params: &ActuatorParams, config: &WindowConfig) -> Self {
        let trigger_rad = config.trigger_position_rad;
        if actuator.has_set_point() {
            Self::SetPoint(UnseenMotion::new(params, trigger_rad))
        } else {
            Self::Motion {
                without_window: MotionsWithoutWindow::new(params, trigger_rad, config.rest_ms),
                counts: None,
            }
        }
    }

    /// Whether the actuator operates at a sample: its mode is other than idle; without set point, the motor moves.
    pub(super) fn is_operating(&mut self, sample: &SensedSample) -> bool {
        match self {
            Self::SetPoint(_) => sample.setpoint != Setpoint::Idle,
            Self::Motion { counts, .. } => counts
                .replace(sample.motor_counts)
                .is_some_and(|before| before.abs_diff(sample.motor_counts) > STILL_COUNTS),
        }
    }

    /// Takes a sample that the windowing has got; the notice of motion without a window, where there is one now. `is_cut`: a window ends
    /// with it.
    pub(super) fn push(
        &mut self,
        actuator: &ActuatorConfig,
        sample: &TimedSample,
        is_in_window: bool,
        is_cut: bool,
    ) -> Option<String> {
        let sentence = match self {
            Self::SetPoint(unseen) => {
                if is_cut {
                    unseen.end();
                }
                unseen.push(&sample.sensed)
            }
            Self::Motion { without_window, .. } => without_window.push(sample.seq, &sample.sensed, is_in_window),
        };
        sentence.map(|sentence| self.notice(actuator, &sentence))
    }

    /// End of the traffic, which ends a window or none; the same.
    pub(super) fn finish(&mut self, actuator: &ActuatorConfig, is_cut: bool) -> Option<String> {
        let sentence = match self {
            Self::SetPoint(unseen) => {
                if is_cut {
                    unseen.end();
                }
                unseen.finish()
            }
            Self::Motion { without_window, .. } => without_window.finish(),
        };
        sentence.map(|sentence| self.notice(actuator, &sentence))
    }

    /// The set point of a drive is what was overheard.
    fn notice(&self, actuator: &ActuatorConfig, sentence: &str) -> String {
        let is_overheard = matches!(self, Self::SetPoint(_)) && actuator.drive_bus.is_some();
        let hint = if is_overheard {
            "; the set point of a drive is overheard: without it, set_point = false begins windows by motion"
        } else {
            ""
        };
        format!("{}: {sentence}{hint}", actuator.name)
    }
}
