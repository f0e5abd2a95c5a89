//! What resolver and encoder together tell of the output angle: the play between them, and the angle within each count.

use crate::backlash::follow_through_play;
use crate::fault::FaultVector;
use crate::monitor::Origin;
use crate::params::ActuatorParams;
use crate::recording::ComparedSample;

/// Widths tried in each of the searches, each of which looks closer around the last one's best.
const WIDTHS: usize = 33;
const SEARCHES: usize = 3;

/// Fills in [`ComparedSample::theta_read`]: the output angle that the play which explains the counts best gives, within
/// the count that was read.
///
/// The width is found by itself, from the two angles alone, so that the instants at which the controller saw a count
/// change do not move while the faults are searched: that would make the cost uneven.
pub(crate) fn read_output(params: &ActuatorParams, origin: &Origin, samples: &mut [ComparedSample]) {
    let half_lsb = 0.5 * params.sensors.output_lsb();
    let (mut best, mut reach) = (0.5, 0.5);
    for _ in 0..SEARCHES {
        let middle = best;
        let mut least = f64::INFINITY;
        for n in 0..WIDTHS {
            let width = middle + reach * (2.0 * n as f64 / (WIDTHS - 1) as f64 - 1.0);
            if !(0.0..=1.0).contains(&width) {
                continue;
            }
            let mut sum = 0.0;
            follow(params, origin, samples, width, |sample, theta_out| {
                let r = sample.theta_out - theta_out;
                sum += r * r;
            });
            if sum < least {
                (least, best) = (sum, width);
            }
        }
        reach /= (WIDTHS - 1) as f64 / 2.0;
    }
    follow(params, origin, samples, best, |sample, theta_out| {
        sample.theta_read = theta_out
            .max(sample.theta_out - half_lsb)
            .min(sample.theta_out + 0.999 * half_lsb);
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
