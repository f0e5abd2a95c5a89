//! Width of the play of one window, from the measured motor angle against the counts of the output encoder.
//!
//! The output angle follows `θ_m/n` through a play of width b ([`follow_through_play`]); the width whose output leaves least of
//! the counts is found by a search over one number. The zeros of both counters need not agree: a constant difference is
//! free. The motion counts from the instant at which the output has moved by two counts, because then the motor is known to
//! push at the flank of that direction. Within the play a rigid output rests; behind a compliant gear it coasts. Derived here.

use ema_models::follow_through_play;

use super::compliance::Compliance;
use super::elements::{Needed, Reading};
use super::flanks::Flanks;
use super::kernel::{HALF_WIDTHS_S, Kernel};
use super::measured::MeasuredWindow;
use super::residual::{HealthyResidual, Residual};
use crate::recorded_sample::RecordedSample;

/// Largest width of the search, in healthy widths b₀; the worst fault is 100.
const MAX_WIDTHS: f64 = 120.0;

/// Widths of the first, coarse search.
const COARSE: usize = 41;

/// Widths of it that are followed in one pass over the window.
const SIDE_BY_SIDE: usize = 7;

/// Steps of the golden section between the neighbours of the best coarse width.
const GOLDEN_STEPS: usize = 22;

/// Output counts by which the output moves before it counts as pushed.
const PUSHED_COUNTS: i64 = 2;

/// How the output behaves within the play.
#[derive(Clone, Copy)]
enum Within {
    /// It rests: its inertia counts as the motor's.
    Rests,
    /// It coasts, decelerated by its own friction, rad/s² at the output.
    Coasts(f64),
}

/// Decelerations that are tried, relative to that of the whole actuator by its dry friction.
const DECELERATIONS: [f64; 3] = [0.7, 1.3, 2.6];

/// Relative residual above which the output may coast.
const COASTING: f64 = 1.5;

/// The play of a window.
#[derive(Clone, Copy)]
pub(super) struct Play {
    /// Its width, rad at the output.
    pub(super) width: Reading,
    /// Residual of the output angle, rad.
    pub(super) residual: Residual,
    /// Standard deviation as a share of the width, besides its own, where that is the reach of an output that bounces in the play or is
    /// pushed across; else 0.
    pub(super) reach_share: f64,
}

/// The play of a window.
///
/// A rigid gear's output rests in the play. Where that leaves more than `healthy` windows do, a load inertia behind a compliant
/// gear may coast through it: `deceleration` is that of the actuator by dry friction, rad/s² at the output. `reach_share` is the standard
/// deviation of a reach as a share of the play, of a gear that bends; a reach is a width only where the window shows both `flanks`.
/// `is_hit`: the torque balance leaves more than in healthy windows, as where flanks hit each other.
#[inline(never)]
pub(super) fn play_width<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    healthy: &HealthyResidual,
    deceleration: f64,
    reach_share: Option<f64>,
    is_hit: bool,
    flanks: &Flanks,
) -> Result<Play, Needed> {
    let start = pushed(window).ok_or(Needed::LongerMotion)?;
    let mut best = width_of(window, start, Within::Rests);
    let worse =
        |found: &Result<(Reading, Residual), Needed>| found.map_or(0.0, |(_, residual)| healthy.relative(residual));
    if worse(&best) > COASTING {
        for share in DECELERATIONS {
            let coasting = width_of(window, start, Within::Coasts(share * deceleration));
            if coasting.is_ok() && worse(&coasting) < worse(&best) {
                best = coasting;
            }
        }
    }
    let bounces = worse(&best) > COASTING;
    let (width, residual) = best?;
    let followed = Play {
        width,
        residual,
        reach_share: 0.0,
    };
    if !is_hit && reach_share.is_none() {
        return Ok(followed);
    }
    let reached = Reach::of(window, start);
    let difference = reached.usual - width.value;
    if let Some(share) = reach_share
        && (bounces || difference > window.params().sensors.output_lsb())
    {
        let is_width = flanks.are_shown() || reached.ends_at_flanks();
        let play = Play {
            width: reached.width(),
            residual: Residual::default(),
            reach_share: share,
        };
        return is_width.then_some(play).ok_or(Needed::Reversal);
    }
    // The output coasts and overshoots: that draws both widths away from the play, in different ways, and stands in the residual.
    let relative = healthy.relative(residual).max(1.0);
    let more = residual.rms * libm::sqrt(1.0 - 1.0 / (relative * relative));
    let sigma = libm::hypot(libm::hypot(width.sigma, difference), more);
    Ok(Play {
        width: Reading { sigma, ..width },
        ..followed
    })
}

/// Share of the samples beyond either end of the range that the output reaches, usually and rarely.
const BEYOND: f64 = 0.02;
const RARELY_BEYOND: f64 = 0.005;

/// What the output reaches rarely, relative to what it reaches usually, from which the ends of that are no flanks: it flies off the one that
/// the load holds it at and falls back. Bench units with 20 Nm or 300 Nm/rad, at 100 and 150 Hz: 1.1 to 1.4 between two flanks, 1.6 to 2.8 at
/// one.
const FALLS_BACK: f64 = 1.5;

/// Standard deviation of a reach as a share of the play: the load overshoots the flanks by its twist, or reaches them rarely. On the
/// entry `compliance` of the suite `robust`, three units: −10 to +8 %.
pub(super) const REACH_SHARE: f64 = 0.07;

/// The same of a gear that may bend by as much as its play is wide: two units with a resonance at 90 Hz, +20 to +24 %.
pub(super) const REACH_SHARE_BENDING: f64 = 0.15;

/// Range in which the output lies against the motor angle, rad: where both its ends are flanks, the width of the play.
#[derive(Clone, Copy)]
struct Reach {
    usual: f64,
    rare: f64,
    lsb: f64,
}

impl Reach {
    fn of<S: RecordedSample>(window: &MeasuredWindow<'_, S>, start: Start) -> Self {
        let lsb = window.params().sensors.output_lsb();
        let samples = || (start.sample..window.inner().end).filter(|&n| window.is_measured(n));
        let all = samples().count() as f64;
        let (low, high) = samples()
            .map(|n| window.behind_gear(n))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| {
                (low.min(at), high.max(at))
            });
        // By bisection: there is no room to sort the samples.
        let quantile = |share: f64| {
            let (mut low, mut high) = (low, high);
            for _ in 0..GOLDEN_STEPS {
                let middle = 0.5 * (low + high);
                let below = samples().filter(|&n| window.behind_gear(n) < middle).count() as f64;
                if below < share * all {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            0.5 * (low + high)
        };
        // Counts alone spread over one of them.
        let [usual, rare] =
            [BEYOND, RARELY_BEYOND].map(|beyond| (quantile(1.0 - beyond) - quantile(beyond) - lsb).max(0.0));
        Self { usual, rare, lsb }
    }

    /// Whether the output turns at both ends, as at flanks.
    fn ends_at_flanks(&self) -> bool {
        self.rare < FALLS_BACK * self.usual
    }

    /// The width of the play.
    fn width(&self) -> Reading {
        Reading {
            value: self.usual,
            sigma: 0.5 * self.lsb,
        }
    }
}

fn width_of<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    start: Start,
    within: Within,
) -> Result<(Reading, Residual), Needed> {
    let params = window.params();
    let span = Kernel::new(HALF_WIDTHS_S[0], params.sensors.sample_rate, &Compliance::RIGID).span;
    let mismatch = |width: f64| follow(window, start, width, within).mismatch();
    let step = MAX_WIDTHS * params.transmission.backlash / (COARSE - 1) as f64;
    let mut best = (f64::INFINITY, 0.0);
    for first in (0..COARSE).step_by(SIDE_BY_SIDE) {
        let widths: [f64; SIDE_BY_SIDE] = core::array::from_fn(|n| step * (first + n) as f64);
        let followed = follow_each(window, start, widths, within);
        for (followed, width) in followed.iter().zip(widths).take(COARSE - first) {
            let left = followed.mismatch();
            if left < best.0 {
                best = (left, width);
            }
        }
    }
    let width = golden_section((best.1 - step).max(0.0), best.1 + step, mismatch);

    let followed = follow(window, start, width, within);
    if followed.flanks.iter().any(|&samples| samples < span) {
        return Err(Needed::Reversal);
    }
    // Curvature over one count, below which the mismatch is rough.
    let lsb = params.sensors.output_lsb();
    let (centre, at) = (width.max(lsb), followed.mismatch());
    let curvature = (mismatch(centre - lsb) + mismatch(centre + lsb) - 2.0 * mismatch(centre)) / (lsb * lsb);
    let variance = 2.0 * at / followed.samples * span as f64 / curvature;
    if curvature > 0.0 && variance.is_finite() {
        let reading = Reading {
            value: width,
            sigma: libm::sqrt(variance),
        };
        let residual = Residual {
            rms: libm::sqrt(at / followed.samples),
            independent: followed.samples / span as f64,
        };
        Ok((reading, residual))
    } else {
        Err(Needed::Reversal)
    }
}

/// Where the motion counts from.
#[derive(Clone, Copy)]
pub(super) struct Start {
    pub(super) sample: usize,
    pub(super) forward: bool,
}

/// The first sample at which the motor is known to push the output.
pub(super) fn pushed<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> Option<Start> {
    let inner = window.inner();
    let rest = window.sensed(inner.clone().next()?).output_counts;
    inner
        .filter(|&n| window.is_measured(n))
        .map(|n| (n, window.sensed(n).output_counts - rest))
        .find_map(|(sample, moved)| {
            (moved.abs() >= PUSHED_COUNTS).then_some(Start {
                sample,
                forward: moved > 0,
            })
        })
}

/// How an output behind a play compares with the counts.
#[derive(Clone, Copy, Default)]
struct Followed {
    samples: f64,
    sum: f64,
    squares: f64,
    /// Samples at which the motor pushes the output backwards and forwards.
    flanks: [usize; 2],
}

impl Followed {
    /// Sum of squared differences about their mean, rad².
    fn mismatch(&self) -> f64 {
        (self.squares - self.sum * self.sum / self.samples.max(1.0)).max(0.0)
    }
}

/// State of an output behind a play.
#[derive(Clone, Copy)]
struct Output {
    /// Half the width of the play, rad.
    half: f64,
    /// Its angle, rad, and its speed while it coasts, rad/s.
    angle: f64,
    speed: f64,
    followed: Followed,
}

fn follow<S: RecordedSample>(window: &MeasuredWindow<'_, S>, start: Start, width: f64, within: Within) -> Followed {
    let [followed] = follow_each(window, start, [width], within);
    followed
}

/// Outputs behind plays of several widths, in one pass over the window.
#[inline(never)]
fn follow_each<S: RecordedSample, const K: usize>(
    window: &MeasuredWindow<'_, S>,
    start: Start,
    widths: [f64; K],
    within: Within,
) -> [Followed; K] {
    let params = window.params();
    let sensors = &params.sensors;
    let first = window.sensed(start.sample);
    let per_motor_count = sensors.motor_lsb() / params.transmission.gear_ratio;
    let mut outputs = widths.map(|width| Output {
        half: 0.5 * width,
        angle: if start.forward { -0.5 * width } else { 0.5 * width },
        speed: 0.0,
        followed: Followed::default(),
    });
    let period = 1.0 / sensors.sample_rate;
    let mut centre_before = 0.0;
    for n in start.sample..window.inner().end {
        let now = window.sensed(n);
        let centre = (now.motor_counts - first.motor_counts) as f64 * per_motor_count;
        let counted = (now.output_counts - first.output_counts) as f64 * sensors.output_lsb();
        let is_measured = window.is_measured(n);
        for output in &mut outputs {
            let before = output.angle;
            output.angle = match within {
                Within::Rests => follow_through_play(before, centre, output.half),
                Within::Coasts(deceleration) => {
                    let slowed = libm::fabs(output.speed).min(deceleration * period);
                    output.speed -= libm::copysign(slowed, output.speed);
                    let free = before + output.speed * period;
                    let pushed = free.clamp(centre - output.half, centre + output.half);
                    if libm::fabs(pushed - free) > 0.0 {
                        output.speed = (centre - centre_before) / period;
                    }
                    pushed
                }
            };
            let followed = &mut output.followed;
            followed.flanks[1] += usize::from(output.angle > before);
            followed.flanks[0] += usize::from(output.angle < before);
            if is_measured {
                let difference = counted - output.angle;
                followed.samples += 1.0;
                followed.sum += difference;
                followed.squares += difference * difference;
            }
        }
        centre_before = centre;
    }
    outputs.map(|output| output.followed)
}

/// Place of the least value of a function between two bounds, where it has one.
fn golden_section(mut low: f64, mut high: f64, cost: impl Fn(f64) -> f64) -> f64 {
    const SHARE: f64 = 0.618_033_988_749_894_9;
    let (mut left, mut right) = (high - SHARE * (high - low), low + SHARE * (high - low));
    let (mut at_left, mut at_right) = (cost(left), cost(right));
    for _ in 0..GOLDEN_STEPS {
        if at_left <= at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - SHARE * (high - low);
            at_left = cost(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + SHARE * (high - low);
            at_right = cost(right);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::golden_section;

    #[test]
    fn golden_section_finds_the_bottom() {
        let found = golden_section(0.0, 1.0, |x| (x - 0.3) * (x - 0.3));
        assert!((found - 0.3).abs() < 1e-4, "{found}");
    }
}
