//! Dry friction (Borello's model) with the losses of the gear under load: from motor torque and speed to the next speed.
//!
//! The shaft rests below the static torque, a constant torque opposes its motion, and a reversal passes through a stop.

use crate::fault::FaultVector;
use crate::params::TransmissionParams;
use crate::real::Real;

/// Friction and load torques of one transmission under a fault vector, at the motor shaft, Nm. The default has neither.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DryFriction<R> {
    /// Load torque T_l / n; positive when it opposes positive motion.
    load: R,
    /// Friction torque at positive speed: T_d plus the loss of the gear.
    moving_positive: R,
    /// Friction torque at negative speed.
    moving_negative: R,
    /// Breakaway torque: T_s plus the loss of the gear under an opposing load.
    breakaway: R,
    /// Torque range over which a stop turns gradually into a passage through zero speed ([`DryFriction::long_step`]).
    stop_transition: R,
}

impl DryFriction<f64> {
    /// Friction under the fault k1 and a load torque at the output, Nm (positive opposes positive motion).
    ///
    /// T_d and T_s are multiplied by `1 + 2 k1`. The gear adds `(1/η_o − 1) |T_l/n|` while the load opposes the motion and
    /// `(1 − η_a) |T_l/n|` while it aids; the former is also added to T_s. k1 does not scale the losses of the gear.
    #[must_use]
    pub fn new(transmission: &TransmissionParams, fault: &FaultVector, load_torque: f64) -> Self {
        Self::under_load(
            transmission.gear_loss_shares(),
            load_torque / transmission.gear_ratio,
            transmission.friction_dynamic * fault.friction_factor(),
            transmission.friction_static * fault.friction_factor(),
        )
    }

    /// Friction with the dry torques `dynamic` and `breakaway`, Nm, and the gear's loss under a load torque at the motor shaft,
    /// Nm, of which the gear takes these shares ([`TransmissionParams::gear_loss_shares`]).
    #[must_use]
    pub(crate) fn under_load(
        [opposing_share, aiding_share]: [f64; 2],
        load: f64,
        dynamic: f64,
        breakaway: f64,
    ) -> Self {
        let opposing = opposing_share * libm::fabs(load);
        let aiding = aiding_share * libm::fabs(load);
        let (positive, negative) = if load > 0.0 {
            (opposing, aiding)
        } else {
            (aiding, opposing)
        };
        Self {
            load,
            moving_positive: dynamic + positive,
            moving_negative: dynamic + negative,
            breakaway: breakaway + opposing,
            stop_transition: 0.0,
        }
    }
}

impl DryFriction<f64> {
    /// The friction with an additional brake of Coulomb torque `torque`, Nm.
    #[must_use]
    #[cfg(feature = "reference")]
    pub(crate) fn with_brake_torque(self, torque: f64) -> Self {
        Self {
            moving_positive: self.moving_positive + torque,
            moving_negative: self.moving_negative + torque,
            breakaway: self.breakaway + torque,
            ..self
        }
    }

    /// The friction for a drive torque that is given as its mean and pulsates about it by `amplitude`, Nm.
    ///
    /// A peak of the torque is enough to break the shaft away, so the breakaway torque for the mean is lower by the amplitude.
    /// It is not lower than the friction torque in motion, at which the shaft would stop again. Derived here.
    #[must_use]
    pub(crate) fn under_pulsating_torque(self, amplitude: f64) -> Self {
        Self {
            breakaway: (self.breakaway - amplitude).max(self.moving_positive.max(self.moving_negative)),
            stop_transition: STOP_TRANSITION * amplitude,
            ..self
        }
    }
}

/// Torque range of the transition between a stop and a passage through zero speed, relative to the amplitude of the torque.
///
/// Chosen for the smoothness of the cost: with a quarter of this range, descents still stop at discontinuities; with 2.5 times
/// the range, no error of an estimate changes beyond its second digit.
const STOP_TRANSITION: f64 = 0.2;

impl<R: Real> DryFriction<R> {
    /// The same friction in another number type, one field at a time.
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(R) -> S) -> DryFriction<S> {
        DryFriction {
            load: f(self.load),
            moving_positive: f(self.moving_positive),
            moving_negative: f(self.moving_negative),
            breakaway: f(self.breakaway),
            stop_transition: f(self.stop_transition),
        }
    }

    /// The friction under a load larger by `change`, Nm at the motor shaft, in a gear that takes these shares of a load
    /// ([`TransmissionParams::gear_loss_shares`]).
    ///
    /// A share of the whole load is lost, not of the change.
    #[must_use]
    #[inline(always)]
    pub(crate) fn with_load_change(self, [opposing, aiding]: [R; 2], change: R) -> Self {
        let load = self.load + change;
        let [positive, negative] = gear_losses([opposing, aiding], load);
        let [positive_before, negative_before] = gear_losses([opposing, aiding], self.load);
        let moving_positive = self.moving_positive + (positive - positive_before);
        let moving_negative = self.moving_negative + (negative - negative_before);
        let breakaway = self.breakaway + opposing * (load.abs() - self.load.abs());
        Self {
            load,
            moving_positive,
            moving_negative,
            // As after `under_pulsating_torque`.
            breakaway: breakaway.max(moving_positive.max(moving_negative)),
            ..self
        }
    }

    /// Speed after one step of `J dω/dt = T_drive − T_l/n − T_dry`, rad/s.
    ///
    /// `drive` is the motor torque minus the viscous torque, Nm; `dt_over_j` the time step divided by the inertia. A shaft at
    /// rest moves only if the torque exceeds the breakaway torque; a step that would reverse the motion ends at rest.
    ///
    /// ```
    /// use ema_models::{ActuatorParams, DryFriction, FaultVector};
    /// let friction = DryFriction::new(&ActuatorParams::bench().transmission, &FaultVector::NOMINAL, 0.0);
    /// assert_eq!(friction.step(0.0, 0.29, 0.01), 0.0); // below T_s = 0.30 Nm: at rest
    /// assert!(friction.step(0.0, 0.31, 0.01) > 0.0);
    /// assert_eq!(friction.step(0.001, 0.0, 0.01), 0.0); // stops without reversal
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
        let stays = at_rest & net.abs().le(self.breakaway);
        R::select(stays | reversed, zero, moved)
    }

    /// Speed after one long step, with stop and breakaway at instants inside the step, rad/s.
    ///
    /// The speed depends continuously on every torque, which [`DryFriction::step`] achieves only for short steps. Derived here:
    ///
    /// - A shaft at rest breaks away when a running mean of the torque exceeds the breakaway torque; each step halves the weight
    ///   of the torques before. `deficit` is the torque that the mean lacked at the end of the step before, Nm (the transition
    ///   range while the shaft moves). The mean is assumed to rise linearly, so it reaches the breakaway torque at a share of the
    ///   step, and the shaft moves for the rest of the step. The torque itself is not used, because the controller holds it for
    ///   several steps: it would break the shaft away at the start of a step or not at all.
    /// - A step that passes through zero speed continues in the direction of the torque for the rest of the step, at most as
    ///   long as a shaft at rest would move.
    #[inline(always)]
    pub(crate) fn long_step(&self, omega: R, drive: R, dt_over_j: R, deficit: &mut R) -> R {
        let zero = R::zero();
        let net = drive - self.load;
        let at_rest = omega.le(zero) & zero.le(omega);
        let against = |direction: R| R::select(direction.lt(zero), -self.moving_negative, self.moving_positive);
        let braked = (net - against(omega)) * dt_over_j;
        let onward = omega + braked;
        if R::known_true(zero.lt(onward * omega)) {
            *deficit = self.stop_transition;
            return onward;
        }
        let started = (net - against(net)) * dt_over_j;
        let gained = R::select(at_rest, started, braked);
        let moved = omega + gained;
        let reversed = (moved * omega).lt(zero);
        let excess = R::splat(0.5) * (net.abs() - self.breakaway - *deficit);
        let share = excess / (excess + *deficit);
        let left = R::select(reversed, (moved / gained).min(share), share);
        let rests = at_rest | reversed;
        *deficit = R::select(rests, (-excess).max(zero), self.stop_transition);
        R::select(rests, R::select(zero.lt(excess), started * left, zero), moved)
    }
}

/// Losses of a gear under a load, in positive and in negative motion, Nm.
// No closure: one that is called twice is not inlined, and then has no vector instructions.
#[inline(always)]
fn gear_losses<R: Real>([opposing, aiding]: [R; 2], load: R) -> [R; 2] {
    let opposes_positive = R::zero().lt(load);
    let size = load.abs();
    [
        R::select(opposes_positive, opposing, aiding) * size,
        R::select(opposes_positive, aiding, opposing) * size,
    ]
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
    fn an_opposing_load_is_divided_by_the_efficiency() {
        // 65 Nm at the output: 0.65 Nm at the motor, 1.0 Nm with the gear's loss, and T_d = 0.15 Nm.
        let omega = bench(65.0).step(10.0, 1.15, 1e-3);
        assert!((omega - 10.0).abs() < 1e-12, "{omega}");
    }

    #[test]
    fn an_aiding_load_is_multiplied_by_the_efficiency() {
        // −100 Nm aids positive motion: 1 Nm at the motor, of which 0.51 Nm remain; dry friction takes 0.15 Nm.
        let omega = bench(-100.0).step(10.0, 0.15 - 0.51, 1e-3);
        assert!((omega - 10.0).abs() < 1e-12, "{omega}");
    }

    /// Final speed of a shaft under a falling torque that stops it and breaks it away, in steps of `dt`, s; the torque is constant
    /// over `held` steps.
    fn final_speed(steps: impl Fn(f64, f64, f64, &mut f64) -> f64, dt: f64, held: u32, offset: f64) -> f64 {
        let (mut omega, mut deficit) = (0.5, 0.0);
        for n in 0..(0.2 / dt) as u32 {
            let middle = f64::from(n / held * held) + 0.5 * f64::from(held);
            omega = steps(omega, offset - 1.2 * middle * dt, dt / 2e-3, &mut deficit);
        }
        omega
    }

    #[test]
    fn a_long_step_stops_and_breaks_away_within_the_step() {
        let friction = bench(0.0);
        // In plain steps the instant of breakaway varies by one step: (T_s − T_d) dt / J = 0.075 rad/s.
        let one_step = 0.075;
        let plain = |dt, held, offset| final_speed(|w, t, h, _| friction.step(w, t, h), dt, held, offset);
        for held in [1, 2] {
            let long = |offset| final_speed(|w, t, h, d| friction.long_step(w, t, h, d), 1e-3, held, offset);
            let (mut jump, mut plain_jump) = (0.0_f64, 0.0_f64);
            for n in 0..100 {
                let (offset, next) = (-0.1 - 2e-5 * f64::from(n), -0.1 - 2e-5 * f64::from(n + 1));
                // The running mean lags by one step, and by half the time over which the torque is constant.
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

    /// A second lane at rest excludes the shortcut for both lanes.
    #[test]
    fn the_shortcut_of_a_moving_shaft_gives_the_same_bits() {
        let friction = bench(65.0).under_pulsating_torque(0.05);
        let lanes = friction.map(|x| Lanes64([x; 2]));
        let levels = [0.0, -0.0, 1e-9, -2e-3, 0.03, -0.4, 1.0, -20.0];
        for omega in levels {
            for drive in levels {
                for before in [0.0, 0.02] {
                    let (mut deficit, mut deficits) = (before, Lanes64([before; 2]));
                    let short = friction.long_step(omega, drive, 0.05, &mut deficit);
                    let beside = Lanes64([omega, 0.0]);
                    let long = lanes.long_step(beside, Lanes64([drive; 2]), Lanes64([0.05; 2]), &mut deficits);
                    let bits = |x: [f64; 2]| x.map(f64::to_bits);
                    let (long, short) = ([long.0[0], deficits.0[0]], [short, deficit]);
                    assert_eq!(bits(long), bits(short), "{omega} {drive} {before}");
                }
            }
        }
    }

    #[test]
    fn torque_peaks_lower_the_breakaway_torque_to_the_dynamic_torque_at_most() {
        let still = |friction: DryFriction<f64>, torque: f64| {
            let (mut omega, mut deficit) = (0.0, 0.0);
            for _ in 0..100 {
                omega = friction.long_step(omega, torque, 1e-3, &mut deficit);
            }
            omega == 0.0
        };
        // T_s = 0.30 Nm, T_d = 0.15 Nm.
        assert!(still(bench(0.0), 0.299) && !still(bench(0.0), 0.301));
        let pulsating = bench(0.0).under_pulsating_torque(0.05);
        assert!(still(pulsating, 0.249) && !still(pulsating, 0.251));
        let strongly = bench(0.0).under_pulsating_torque(0.5);
        assert!(still(strongly, 0.149) && !still(strongly, 0.151));
    }

    #[test]
    fn a_changed_load_is_that_load_from_the_start() {
        let shares = ActuatorParams::bench().transmission.gear_loss_shares();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        for pulsation in [0.0, 0.05, 0.5] {
            for from in [-65.0, 0.0, 30.0] {
                for to in [-100.0, -1.0, 0.0, 65.0] {
                    let [before, expected] = [from, to].map(|load| bench(load).under_pulsating_torque(pulsation));
                    let found = before.with_load_change(shares, (to - from) / 100.0);
                    assert!(
                        close(found.load, expected.load)
                            && close(found.moving_positive, expected.moving_positive)
                            && close(found.moving_negative, expected.moving_negative)
                            && close(found.breakaway, expected.breakaway),
                        "{found:?} {expected:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn wear_scales_both_torques_but_not_the_gear_loss() {
        let mut worn = FaultVector::NOMINAL;
        worn.friction = 1.0;
        let t = ActuatorParams::bench().transmission;
        let f = DryFriction::new(&t, &worn, 65.0);
        assert!((f.moving_positive - (0.45 + 0.35)).abs() < 1e-12);
        assert!((f.breakaway - (0.90 + 0.35)).abs() < 1e-12);
    }
}
