//! What resolver and encoder together tell of the output angle: the play between them, and the angle within each count.

use crate::backlash::follow_through_play;
use crate::fault::FaultVector;
use crate::monitor::Origin;
use crate::params::ActuatorParams;
use crate::recording::ComparedSample;

/// Widths tried in each of the searches, each of which looks closer around the last one's best.
const WIDTHS: usize = 33;
const SEARCHES: usize = 4;

/// Fills in [`ComparedSample::theta_read`]: the output angle that the play which explains the counts best gives, within
/// the count that was read; where none was read, the angle alone.
///
/// A width explains the counts if it keeps the output inside each of them; of those that do, the middle one is taken.
/// It is found by itself, from the two angles alone, so that the instants at which the controller saw a count
/// change do not move while the faults are searched: that would make the cost uneven.
pub(crate) fn read_output(params: &ActuatorParams, origin: &Origin, samples: &mut [ComparedSample]) {
    let half_lsb = 0.5 * params.sensors.output_lsb();
    // The resolver's own step stands between the two.
    let allowed = half_lsb + params.sensors.motor_lsb() / params.transmission.gear_ratio;
    let (mut best, mut reach) = (0.5, 0.5);
    for _ in 0..SEARCHES {
        let step = 2.0 * reach / (WIDTHS - 1) as f64;
        let first = best - reach;
        let (mut least, mut narrowest, mut widest) = (f64::INFINITY, best, best);
        for n in 0..WIDTHS {
            let width = (first + step * n as f64).clamp(0.0, 1.0);
            let mut sum = 0.0;
            follow(params, origin, samples, width, |sample, theta_out| {
                if sample.measured {
                    let outside = (libm::fabs(sample.theta_out - theta_out) - allowed).max(0.0);
                    sum += outside * outside;
                }
            });
            if sum < least {
                (least, narrowest, widest) = (sum, width, width);
            } else if sum <= least {
                widest = width;
            }
        }
        best = 0.5 * (narrowest + widest);
        reach = 0.5 * (widest - narrowest) + step;
    }
    follow(params, origin, samples, best, |sample, theta_out| {
        sample.theta_read = if sample.measured {
            theta_out
                .max(sample.theta_out - half_lsb)
                .min(sample.theta_out + 0.999 * half_lsb)
        } else {
            theta_out
        };
    });
}

/// Output angle sample by sample for a play of normalised width k2.
fn follow(
    params: &ActuatorParams,
    origin: &Origin,
    samples: &mut [ComparedSample],
    width: f64,
    mut visit: impl FnMut(&mut ComparedSample, f64),
) {
    let worn = FaultVector {
        backlash: width,
        ..FaultVector::NOMINAL
    };
    let half_play = 0.5 * params.transmission.backlash * worn.backlash_factor();
    let mut theta_out = samples.first().map_or(0.0, |s| s.theta_out);
    for sample in samples {
        let centre = origin.play_centre + sample.theta_m / params.transmission.gear_ratio;
        theta_out = follow_through_play(theta_out, centre, half_play);
        visit(sample, theta_out);
    }
}
