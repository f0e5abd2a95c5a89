//! Dry friction after Borello: stuck below the static torque, a constant opposing torque when moving, and never a
//! reversal without a stop. The gear's losses under load are part of it.

use crate::fault::FaultVector;
use crate::params::TransmissionParams;
use crate::real::Real;

/// Friction and load torques of one transmission in its present state of wear, at the motor shaft, Nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DryFriction<R> {
    /// Load torque T_l / n; positive when it opposes positive motion.
    load: R,
    /// Opposing torque when moving in the positive direction: T_d plus the gear's loss.
    moving_positive: R,
    /// Opposing torque when moving in the negative direction.
    moving_negative: R,
    /// Torque up to which the shaft stays stuck: T_s plus the gear's loss with the load opposing.
    stuck: R,
    /// Torque over which a shaft that comes to rest hesitates to pass through it ([`DryFriction::long_step`]).
    hesitation: R,
}

impl DryFriction<f64> {
    /// Friction with wear k1 under the output load torque `load_torque`, Nm (positive opposes positive motion).
    ///
    /// T_d and T_s grow by `1 + 2 k1`. The gear adds `(1/η_o − 1) |T_l/n|` while the load opposes the motion and
    /// `(1 − η_a) |T_l/n|` while it aids; at rest the opposing value is added to T_s. k1 does not scale this part.
    #[must_use]
    pub fn new(transmission: &TransmissionParams, fault: &FaultVector, load_torque: f64) -> Self {
        let load = load_torque / transmission.gear_ratio;
        let opposing = (1.0 / transmission.efficiency_opposing - 1.0) * libm::fabs(load);
        let aiding = (1.0 - transmission.efficiency_aiding) * libm::fabs(load);
        let dynamic = transmission.friction_dynamic * fault.friction_factor();
        let stuck = transmission.friction_static * fault.friction_factor() + opposing;
        let (positive, negative) = if load > 0.0 {
            (opposing, aiding)
        } else {
            (aiding, opposing)
        };
        Self {
            load,
            moving_positive: dynamic + positive,
            moving_negative: dynamic + negative,
            stuck,
            hesitation: 0.0,
        }
    }
}

impl DryFriction<f64> {
    /// The same with a brake that drags by `torque`, Nm, moving or not.
    #[must_use]
    #[cfg(feature = "reference")]
    pub(crate) fn with_drag(self, torque: f64) -> Self {
        Self {
            moving_positive: self.moving_positive + torque,
            moving_negative: self.moving_negative + torque,
            stuck: self.stuck + torque,
            ..self
        }
    }

    /// The same for a torque that is given as its mean, and swings about that by `swing`, Nm: a peak is enough to break away.
    ///
    /// The static torque that the mean has to exceed is lower by the swing; never below the dynamic one, at which the shaft would
    /// stop again. Derived here.
    #[must_use]
    pub(crate) fn under_swinging_torque(self, swing: f64) -> Self {
        Self {
            stuck: (self.stuck - swing).max(self.moving_positive.max(self.moving_negative)),
            hesitation: HESITATION * swing,
            ..self
        }
    }
}

/// Share of the swing over which a stop and a passage through rest go over into one another. By the smoothness of the
/// cost: with a quarter of it descents still stop at jumps, and with two and a half times as much no error moves beyond the second
/// digit.
const HESITATION: f64 = 0.2;

impl<R: Real> DryFriction<R> {
    /// The same friction in another number type, one field at a time.
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(R) -> S) -> DryFriction<S> {
        DryFriction {
            load: f(self.load),
            moving_positive: f(self.moving_positive),
            moving_negative: f(self.moving_negative),
            stuck: f(self.stuck),
            hesitation: f(self.hesitation),
        }
    }

    /// Speed after one step of `J dω/dt = T_drive − T_l/n − T_dry`, rad/s.
    ///
    /// `drive` is the motor torque less the viscous part, `dt_over_j` the step over the inertia. From rest the shaft
    /// moves only if the torque exceeds the static one; a step that would reverse the motion ends at rest.
    ///
    /// ```
    /// use ema_models::{ActuatorParams, DryFriction, FaultVector};
    /// let friction = DryFriction::new(&ActuatorParams::bench().transmission, &FaultVector::NOMINAL, 0.0);
    /// assert_eq!(friction.step(0.0, 0.29, 0.01), 0.0); // below T_s = 0.30 Nm: stuck
    /// assert!(friction.step(0.0, 0.31, 0.01) > 0.0);
    /// assert_eq!(friction.step(0.001, 0.0, 0.01), 0.0); // stops, does not turn round
    /// ```
    #[inline(always)]
    #[must_use]
    pub fn step(&self, omega: R, drive: R, dt_over_j: R) -> R {
        let zero = R::zero();
        let net = drive - self.load;
        let at_rest = omega.le(zero) & zero.le(omega);
        let direction = R::select(at_rest, net, omega);
        let dry = R::select(direction.lt(zero), -self.moving_negative, self.moving_positive);
        let moved = omega + (net - dry) * dt_over_j;
        let reversed = (moved * omega).lt(zero);
        let stuck = at_rest & net.abs().le(self.stuck);
        R::select(stuck | reversed, zero, moved)
    }

    /// The same for long steps, with the instants inside the step at which the shaft stops and breaks away.
    ///
    /// A shaft at rest breaks away when the mean of this step's torque and those before passes the static one, each step's
    /// counting half of what was before; `slack` is what that mean lacked at the end of the step before, Nm (the hesitation when
    /// moving). Risen evenly, it passes at a share of the step, and the shaft moves for what is left of it. The mean, and not the
    /// torque itself, because a torque that stands still for several steps, as the controller's does, would break away at once
    /// or not at all. A step that passes through rest goes on in the direction of the torque for what is left of it, at most as
    /// long as if it had rested. So speed depends continuously on every torque, which [`DryFriction::step`] leaves to the
    /// shortness of the step. Derived here.
    #[inline(always)]
    pub(crate) fn long_step(&self, omega: R, drive: R, dt_over_j: R, slack: &mut R) -> R {
        let zero = R::zero();
        let net = drive - self.load;
        let at_rest = omega.le(zero) & zero.le(omega);
        let against = |direction: R| R::select(direction.lt(zero), -self.moving_negative, self.moving_positive);
        let braked = (net - against(omega)) * dt_over_j;
        let onward = omega + braked;
        if R::holds(zero.lt(onward * omega)) {
            *slack = self.hesitation;
            return onward;
        }
        let started = (net - against(net)) * dt_over_j;
        let gained = R::select(at_rest, started, braked);
        let moved = omega + gained;
        let reversed = (moved * omega).lt(zero);
        let excess = R::splat(0.5) * (net.abs() - self.stuck - *slack);
        let share = excess / (excess + *slack);
        let left = R::select(reversed, (moved / gained).min(share), share);
        let rests = at_rest | reversed;
        *slack = R::select(rests, (-excess).max(zero), self.hesitation);
        R::select(rests, R::select(zero.lt(excess), started * left, zero), moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Lanes64;
    use crate::params::ActuatorParams;

    fn bench(load_torque: f64) -> DryFriction<f64> {
        DryFriction::new(
            &ActuatorParams::bench().transmission,
            &FaultVector::NOMINAL,
            load_torque,
        )
    }

    #[test]
    fn an_opposing_load_costs_one_over_the_efficiency() {
        // 65 Nm at the output: 0.65 Nm at the motor, 1.0 Nm with the gear's loss, and T_d = 0.15 Nm.
        let omega = bench(65.0).step(10.0, 1.15, 1e-3);
        assert!((omega - 10.0).abs() < 1e-12, "{omega}");
    }

    #[test]
    fn an_aiding_load_gives_only_its_efficiency() {
        // −100 Nm aids positive motion: 1 Nm at the motor, of which 0.51 arrives; 0.15 goes into dry friction.
        let omega = bench(-100.0).step(10.0, 0.15 - 0.51, 1e-3);
        assert!((omega - 10.0).abs() < 1e-12, "{omega}");
    }

    /// Speed of a shaft under a torque that falls through rest and the static torque, in steps of `dt`, s; the torque stands still
    /// for `held` steps each.
    fn swept(steps: impl Fn(f64, f64, f64, &mut f64) -> f64, dt: f64, held: u32, offset: f64) -> f64 {
        let (mut omega, mut slack) = (0.5, 0.0);
        for n in 0..(0.2 / dt) as u32 {
            let middle = f64::from(n / held * held) + 0.5 * f64::from(held);
            omega = steps(omega, offset - 1.2 * middle * dt, dt / 2e-3, &mut slack);
        }
        omega
    }

    #[test]
    fn a_long_step_stops_and_breaks_away_inside_itself() {
        let friction = bench(0.0);
        // In plain steps the shaft breaks away one step sooner or later: (T_s − T_d) dt / J = 0.075 rad/s.
        let one_step = 0.075;
        let plain = |dt, held, offset| swept(|w, t, h, _| friction.step(w, t, h), dt, held, offset);
        for held in [1, 2] {
            let long = |offset| swept(|w, t, h, slack| friction.long_step(w, t, h, slack), 1e-3, held, offset);
            let (mut jump, mut plain_jump) = (0.0_f64, 0.0_f64);
            for n in 0..100 {
                let (offset, next) = (-0.1 - 2e-5 * f64::from(n), -0.1 - 2e-5 * f64::from(n + 1));
                // The running mean is behind by a step, and by half the time for which the torque stands still.
                let late = (1.05 + 0.5 * f64::from(held)) * one_step;
                assert!((long(offset) - plain(1e-6, 1, offset)).abs() < late, "held {held}");
                jump = jump.max((long(next) - long(offset)).abs());
                plain_jump = plain_jump.max((plain(1e-3, held, next) - plain(1e-3, held, offset)).abs());
            }
            assert!(
                jump < 0.2 * one_step && plain_jump > 0.6 * one_step,
                "held {held}: {jump} {plain_jump}"
            );
        }
    }

    /// A second lane that rests makes the first one go the long way, too.
    #[test]
    fn the_shortcut_of_a_moving_shaft_changes_no_bit() {
        let friction = bench(65.0).under_swinging_torque(0.05);
        let lanes = friction.map(|x| Lanes64([x; 2]));
        let levels = [0.0, -0.0, 1e-9, -2e-3, 0.03, -0.4, 1.0, -20.0];
        for omega in levels {
            for drive in levels {
                for before in [0.0, 0.02] {
                    let (mut slack, mut slacks) = (before, Lanes64([before; 2]));
                    let short = friction.long_step(omega, drive, 0.05, &mut slack);
                    let beside = Lanes64([omega, 0.0]);
                    let long = lanes.long_step(beside, Lanes64([drive; 2]), Lanes64([0.05; 2]), &mut slacks);
                    let bits = |x: [f64; 2]| x.map(f64::to_bits);
                    let (long, short) = ([long.0[0], slacks.0[0]], [short, slack]);
                    assert_eq!(bits(long), bits(short), "{omega} {drive} {before}");
                }
            }
        }
    }

    #[test]
    fn peaks_break_away_but_never_below_the_dynamic_torque() {
        let still = |friction: DryFriction<f64>, torque: f64| {
            let (mut omega, mut slack) = (0.0, 0.0);
            for _ in 0..100 {
                omega = friction.long_step(omega, torque, 1e-3, &mut slack);
            }
            omega == 0.0
        };
        // T_s = 0.30 Nm, T_d = 0.15 Nm.
        assert!(still(bench(0.0), 0.299) && !still(bench(0.0), 0.301));
        let swinging = bench(0.0).under_swinging_torque(0.05);
        assert!(still(swinging, 0.249) && !still(swinging, 0.251));
        let wildly = bench(0.0).under_swinging_torque(0.5);
        assert!(still(wildly, 0.149) && !still(wildly, 0.151));
    }

    #[test]
    fn wear_scales_both_torques_but_not_the_gear_loss() {
        let mut worn = FaultVector::NOMINAL;
        worn.friction = 1.0;
        let t = ActuatorParams::bench().transmission;
        let f = DryFriction::new(&t, &worn, 65.0);
        assert!((f.moving_positive - (0.45 + 0.35)).abs() < 1e-12);
        assert!((f.stuck - (0.90 + 0.35)).abs() < 1e-12);
    }
}
