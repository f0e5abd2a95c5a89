//! What resolver and encoder together tell of the output angle: the play between them, and the angle within each count.

use crate::backlash::follow_through_play;
use crate::fault::FaultVector;
use crate::params::ActuatorParams;
use crate::samples::{ComparedSample, Origin};

/// Widths tried in each of the searches, each of which looks closer around the last one's best.
const WIDTHS: usize = 33;
const SEARCHES: usize = 4;

/// Fills in [`ComparedSample::theta_read`].
pub(crate) fn read_output(params: &ActuatorParams, origin: &Origin, samples: &mut [ComparedSample]) {
    let mut reader = OutputReader::new(params, origin, || samples.iter().map(Reading::from));
    for sample in samples {
        sample.theta_read = reader.read(Reading::from(&*sample));
    }
}

/// What is known of motor and output angle at one sample.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Motor angle, rad.
    pub theta_m: f64,
    /// Output angle at the middle of its count, rad.
    pub theta_out: f64,
    /// Whether it was measured.
    pub measured: bool,
}

impl From<&ComparedSample> for Reading {
    fn from(sample: &ComparedSample) -> Self {
        Self {
            theta_m: sample.theta_m,
            theta_out: sample.theta_out,
            measured: sample.measured,
        }
    }
}

/// Finds [`ComparedSample::theta_read`] sample by sample: the output angle that the play which explains the counts best
/// gives, within the count that was read; where none was read, the angle alone.
///
/// A width explains the counts if it keeps the output inside each of them; of those that do, the middle one is taken.
/// It is found by itself, from the two angles alone, so that the instants at which the controller saw a count
/// change do not move while the faults are searched: that would make the cost uneven.
#[derive(Clone, Copy, Debug)]
pub struct OutputReader {
    gear_ratio: f64,
    play_centre: f64,
    half_play: f64,
    half_lsb: f64,
    theta_out: Option<f64>,
}

impl OutputReader {
    /// Finds the play; `readings` goes through the window's samples from the first, as often as it is called.
    #[must_use]
    pub fn new<I: Iterator<Item = Reading>>(
        params: &ActuatorParams,
        origin: &Origin,
        readings: impl Fn() -> I,
    ) -> Self {
        let half_lsb = 0.5 * params.sensors.output_lsb();
        // The resolver's own step stands between the two.
        let allowed = half_lsb + params.sensors.motor_lsb() / params.transmission.gear_ratio;
        let of_width = |width| {
            let worn = FaultVector {
                backlash: width,
                ..FaultVector::NOMINAL
            };
            Self {
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
                let mut reader = of_width(width);
                let mut sum = 0.0;
                for reading in readings() {
                    let theta_out = reader.follow(&reading);
                    if reading.measured {
                        let outside = (libm::fabs(reading.theta_out - theta_out) - allowed).max(0.0);
                        sum += outside * outside;
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
        of_width(best)
    }

    /// The next sample's output angle, rad.
    pub fn read(&mut self, reading: Reading) -> f64 {
        let theta_out = self.follow(&reading);
        if reading.measured {
            theta_out
                .max(reading.theta_out - self.half_lsb)
                .min(reading.theta_out + 0.999 * self.half_lsb)
        } else {
            theta_out
        }
    }

    /// The next sample's output angle for the play alone.
    fn follow(&mut self, reading: &Reading) -> f64 {
        let centre = self.play_centre + reading.theta_m / self.gear_ratio;
        let before = self.theta_out.unwrap_or(reading.theta_out);
        let theta_out = follow_through_play(before, centre, self.half_play);
        self.theta_out = Some(theta_out);
        theta_out
    }
}
