//! Estimation of the output angle within its encoder count, from the motor angle and the backlash.
//!
//! Input are motor and output angles of a window, output are the backlash that explains them and the angle at each sample.

use crate::backlash::follow_through_play;
use crate::fault::FaultVector;
use crate::params::ActuatorParams;
use crate::samples::{ComparedSample, Origin};

/// Number of widths that each search compares.
const WIDTHS: usize = 33;
/// Number of searches; each refines the range around the best width of the one before.
const SEARCHES: usize = 4;

/// Sets [`ComparedSample::theta_out_estimate`] of the samples of a window, and returns the backlash.
pub(crate) fn estimate_output_angles(params: &ActuatorParams, origin: &Origin, samples: &mut [ComparedSample]) -> f64 {
    let mut estimator = OutputAngleEstimator::new(params, origin, || samples.iter().map(AngleReading::from));
    for sample in samples {
        sample.theta_out_estimate = estimator.next_angle(AngleReading::from(&*sample));
    }
    estimator.backlash()
}

/// Motor and output angle at one sample.
#[derive(Clone, Copy, Debug)]
pub struct AngleReading {
    /// Motor angle, rad.
    pub theta_m: f64,
    /// Output angle at the middle of its count, rad.
    pub theta_out: f64,
    /// Whether the sample was measured.
    pub measured: bool,
}

impl From<&ComparedSample> for AngleReading {
    fn from(sample: &ComparedSample) -> Self {
        Self {
            theta_m: sample.theta_m,
            theta_out: sample.theta_out,
            measured: sample.measured,
        }
    }
}

/// Estimates [`ComparedSample::theta_out_estimate`] sample by sample.
///
/// The estimate is the output angle that follows from the motor angle and the backlash, limited to the measured count. The
/// width of the backlash is the one that explains the counts best, which keeps the output angle within each of them; of
/// several, it is the middle one. The width follows from the two angles alone and not from the fault vector, because the
/// instants at which the controller observes a change of the count must not move during the search: the cost would be uneven.
#[derive(Clone, Copy, Debug)]
pub struct OutputAngleEstimator {
    backlash: f64,
    gear_ratio: f64,
    play_centre: f64,
    half_play: f64,
    half_lsb: f64,
    theta_out: Option<f64>,
}

impl OutputAngleEstimator {
    /// Estimates the width of the backlash; each call of `readings` iterates over the samples of the window from the first.
    #[must_use]
    pub fn new<I: Iterator<Item = AngleReading>>(
        params: &ActuatorParams,
        origin: &Origin,
        readings: impl Fn() -> I,
    ) -> Self {
        let half_lsb = 0.5 * params.sensors.output_lsb();
        // The resolution of the resolver adds to that of the encoder.
        let allowed = half_lsb + params.sensors.motor_lsb() / params.transmission.gear_ratio;
        let with_width = |width| {
            let worn = FaultVector {
                backlash: width,
                ..FaultVector::NOMINAL
            };
            Self {
                backlash: width,
                gear_ratio: params.transmission.gear_ratio,
                play_centre: origin.play_centre,
                half_play: 0.5 * params.transmission.backlash * worn.backlash_factor(),
                half_lsb,
                theta_out: None,
            }
        };
        let (mut best, mut reach) = (0.5, 0.5);
        for _ in 0..SEARCHES {
            let step = 2.0 * reach / (WIDTHS - 1) as f64;
            let first = best - reach;
            let (mut least, mut narrowest, mut widest) = (f64::INFINITY, best, best);
            for n in 0..WIDTHS {
                let width = (first + step * n as f64).clamp(0.0, 1.0);
                let mut estimator = with_width(width);
                let mut sum = 0.0;
                for reading in readings() {
                    let theta_out = estimator.follow_play(&reading);
                    if reading.measured {
                        let outside = (libm::fabs(reading.theta_out - theta_out) - allowed).max(0.0);
                        sum += outside * outside;
                    }
                    // No further sample makes it less.
                    if sum > least {
                        break;
                    }
                }
                if sum < least {
                    (least, narrowest, widest) = (sum, width, width);
                } else if sum <= least {
                    widest = width;
                }
            }
            best = 0.5 * (narrowest + widest);
            reach = 0.5 * (widest - narrowest) + step;
        }
        with_width(best)
    }

    /// Backlash that explains the counts best, as the fault parameter k2.
    #[must_use]
    pub fn backlash(&self) -> f64 {
        self.backlash
    }

    /// Estimated output angle at the next sample, rad; without a measured count, the angle that follows from the backlash.
    pub fn next_angle(&mut self, reading: AngleReading) -> f64 {
        let theta_out = self.follow_play(&reading);
        if reading.measured {
            theta_out
                .max(reading.theta_out - 0.999 * self.half_lsb)
                .min(reading.theta_out + 0.999 * self.half_lsb)
        } else {
            theta_out
        }
    }

    /// Output angle at the next sample that follows from the backlash, rad.
    fn follow_play(&mut self, reading: &AngleReading) -> f64 {
        let centre = self.play_centre + reading.theta_m / self.gear_ratio;
        let before = self.theta_out.unwrap_or(reading.theta_out);
        let theta_out = follow_through_play(before, centre, self.half_play);
        self.theta_out = Some(theta_out);
        theta_out
    }
}
