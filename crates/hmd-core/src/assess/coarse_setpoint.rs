//! The gain of the position loop where the set point is logged seldom.

use ema_identify::OBSERVABLE_SIGMA;
use ema_identify::unit_calibration::Seen;
use ema_models::{ActuatorParams, FaultId};

use super::by_unit::Assessed;
use crate::outbox::WindowJob;
use crate::setpoint_hold::{gain_per_s, held_s, time_sigma};

/// One standard deviation of k8 by set points that are held for this long, s.
pub(crate) fn gain_sigma(params: &ActuatorParams, held_s: f64) -> f64 {
    gain_per_s(params) * time_sigma(held_s)
}

/// An estimate with what the set point of its window, or of the windows that its unit was learnt from, leaves open of the gain.
pub(super) fn with_coarse_setpoint(mut assessed: Assessed, job: &WindowJob, seen: Option<&Seen>) -> Assessed {
    let own_s = held_s(&job.window.samples, job.params.sensors.sample_rate);
    let seen_s = seen.map_or(0.0, |seen| seen.setpoint_held_s);
    let sigma = gain_sigma(&job.params, own_s.max(seen_s));
    let gain = FaultId::Gain.parameter();
    let estimate = &mut assessed.estimate;
    estimate.sigma[gain] = estimate.sigma[gain].map(|own| own.hypot(sigma));
    if FaultId::Gain.damage_per_change() * sigma > OBSERVABLE_SIGMA {
        (estimate.observable[gain], estimate.sigma[gain]) = (false, None);
        let (held_s, then) = if own_s < seen_s {
            (seen_s, " at commissioning")
        } else {
            (own_s, "")
        };
        assessed.reasons.push(format!(
            "the set point stands for {:.0} ms at a time{then}: controller gain is not observable",
            1e3 * (held_s + 1.0 / job.params.sensors.sample_rate)
        ));
    }
    assessed
}
