//! Transmission free play: from motor angle to output angle through a dead zone.

use crate::real::Real;

/// Output angle after a motion of the motor, rad.
///
/// `centre` is the output angle without play (θ_m / n), rad; `half_width` is b/2, rad. The output rests until an edge of the
/// dead zone reaches it, and then moves with this edge. The law neglects the load at the output.
///
/// ```
/// assert_eq!(ema_models::follow_through_play(0.0, 0.4, 0.5), 0.0); // inside the dead zone: at rest
/// assert_eq!(ema_models::follow_through_play(0.0, 2.0, 0.5), 1.5); // moved by the edge
/// ```
#[inline(always)]
#[must_use]
pub fn follow_through_play<R: Real>(theta_out: R, centre: R, half_width: R) -> R {
    theta_out.max(centre - half_width).min(centre + half_width)
}
