//! Which flanks of its play the motor drives the output with, as far as the load leaves that to the motion.

use super::measured::{MOVING, MeasuredWindow};
use super::output_load::OutputLoad;
use crate::recorded_sample::RecordedSample;

/// Motion that shows a flank though a load holds the output in other places, in healthy widths b₀: a play worn by a tenth is as wide.
const SHOWN_WIDTHS: f64 = 10.0;

/// How far the motor drives in a window, rad at the output.
///
/// A load beyond the dry friction presses the output against one flank, and it may follow the motor through every reversal there,
/// however wide the play is. Motion away from that flank shows nothing of the other one. Where the load is smaller, or is driven
/// against, each direction has its flank. Derived here.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Flanks {
    /// Backwards and forwards, with the output at the flank of that direction.
    driven: [f64; 2],
    /// Backwards and forwards, with the output held at the other flank.
    held: [f64; 2],
    /// Motion that shows a flank.
    least: f64,
}

impl Flanks {
    /// Of a window with this load; `holding` is the torque at the output beyond which a load holds it, Nm.
    #[inline(never)]
    pub(super) fn of<S: RecordedSample>(window: &MeasuredWindow<'_, S>, load: &OutputLoad, holding: f64) -> Self {
        let params = window.params();
        let per_speed = 1.0 / (params.sensors.sample_rate * params.transmission.gear_ratio);
        let mut flanks = Self {
            least: SHOWN_WIDTHS * params.transmission.backlash,
            ..Self::default()
        };
        for n in window.inner().filter(|&n| window.is_measured(n)) {
            let speed = window.central_speed(n);
            if libm::fabs(speed) < MOVING {
                continue;
            }
            let opposing = libm::copysign(1.0, speed) * load.at(window.travelled(n));
            let of_flank = if opposing > -holding {
                &mut flanks.driven
            } else {
                &mut flanks.held
            };
            of_flank[usize::from(speed > 0.0)] += libm::fabs(speed) * per_speed;
        }
        flanks
    }

    /// Whether the window shows both.
    pub(super) fn are_shown(&self) -> bool {
        (0..2).all(|direction| self.driven[direction] >= self.held[direction].min(self.least))
    }

    /// Whether the load may hold the output in a part of the motion.
    pub(super) fn may_be_held(&self) -> bool {
        self.held[0] + self.held[1] > self.least
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use std::vec::Vec;

    use ema_models::{ActuatorParams, SensedSample, Setpoint};

    use super::*;

    /// Dry friction of `bench` at the output, Nm.
    const HOLDING: f64 = 15.0;

    /// A window that moves from one output angle to the next, rad, at 1 rad/s.
    fn flanks(angles: &[f64], load: OutputLoad) -> Flanks {
        let params = ActuatorParams::bench();
        let per_sample = 1.0 / params.sensors.sample_rate;
        let mut at = angles[0];
        let mut samples: Vec<SensedSample> = Vec::new();
        for &to in angles {
            while (to - at).abs() > 0.5 * per_sample {
                at += per_sample.copysign(to - at);
                samples.push(SensedSample {
                    seq: 0,
                    currents: [0.0; 3],
                    motor_counts: (at * params.transmission.gear_ratio / params.sensors.motor_lsb()).round() as i64,
                    output_counts: (at / params.sensors.output_lsb()).round() as i64,
                    setpoint: Setpoint::Idle,
                });
            }
        }
        Flanks::of(&MeasuredWindow::new(&params, &samples, &[]), &load, HOLDING)
    }

    #[test]
    fn a_constant_load_beyond_friction_shows_one_flank() {
        for (constant, shown) in [(20.0, false), (5.0, true), (0.0, true)] {
            let load = OutputLoad { constant, spring: 0.0 };
            let long = flanks(&[0.0, 0.2, 0.0], load);
            assert_eq!(long.are_shown(), shown, "{constant}");
            assert_eq!(long.may_be_held(), !shown, "{constant}");
            assert_eq!(flanks(&[0.0, 0.2, 0.19], load).are_shown(), shown, "{constant}");
            let other_side = OutputLoad {
                constant: -constant,
                ..load
            };
            assert_eq!(flanks(&[0.0, 0.2, 0.0], other_side).are_shown(), shown, "{constant}");
        }
    }

    #[test]
    fn a_spring_shows_both_flanks_where_the_motion_comes_back_to_its_rest() {
        let spring = OutputLoad {
            constant: 0.0,
            spring: 300.0,
        };
        assert!(!flanks(&[0.0, 0.2, 0.15, 0.2], spring).are_shown());
        assert!(flanks(&[0.0, 0.2, 0.0], spring).are_shown());
        assert!(flanks(&[-0.1, 0.1, -0.1], spring).may_be_held());
        // From the other side: its rest is where the motion ends.
        let tensioned = OutputLoad {
            constant: -60.0,
            ..spring
        };
        assert!(!flanks(&[0.0, 0.1, 0.0], tensioned).are_shown());
        assert!(flanks(&[0.0, 0.2, 0.1], tensioned).are_shown());
    }
}
