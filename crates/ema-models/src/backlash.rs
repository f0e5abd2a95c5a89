//! Transmission free play: the output follows the motor through a dead zone.

use crate::real::Real;

/// Output angle after the motor has moved, rad.
///
/// `centre` is the output angle the motor would give without play (θ_m / n), `half_width` is b/2. The output stays
/// where it is until the dead zone's edge takes it along. A loaded output keeps the same model, a declared
/// simplification.
///
/// ```
/// assert_eq!(ema_models::follow_through_play(0.0, 0.4, 0.5), 0.0); // still inside the play
/// assert_eq!(ema_models::follow_through_play(0.0, 2.0, 0.5), 1.5); // taken along by the edge
/// ```
#[inline(always)]
#[must_use]
pub fn follow_through_play<R: Real>(theta_out: R, centre: R, half_width: R) -> R {
    theta_out.max(centre - half_width).min(centre + half_width)
}
