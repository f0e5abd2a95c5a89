//! Time from the logged set point to its effect, by the law of the speed loop.
//!
//! A set point that takes effect δ after it is logged gives `e₁ = G_p (θ_cmd(t − δ) − θ_out)`. In steady motion δ changes e₁ as another
//! gain does; where the motion starts, turns and ends it does not. To first order `e₁(t − δ) ≈ e₁ − δ G_p θ_cmd'`, so that g δ is one more
//! unknown of the law (`controller`). Only a wide kernel keeps the noise of the differentiated current small beside θ_cmd''; what is
//! sampled faster than its half width needs is averaged over blocks of samples. Derived here.

use nalgebra::SVector;

use super::compliance::Compliance;
use super::controller::{GAIN, GAIN_DELAY, LAW_COUNT, Law, LawKnowledge, LawRows, SCALE, gradient_of_ratio};
use super::elements::Reading;
use super::kernel::{HALF_WIDTHS_S, Kernel};
use super::measured::MeasuredWindow;
use super::overlap::Overlap;
use crate::recorded_sample::RecordedSample;

/// What a window shows of the time of its set point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetpointDelay {
    /// Time from the logged set point to its effect, s: positive where the set point is logged early. To first order: exact where it is
    /// below the kernel's half width.
    pub delay_s: Reading,
    /// Change of the gain ratio g/h by each second of delay, 1/s.
    pub gain_per_s: f64,
    /// The gain ratio g/h with this delay.
    pub gain: f64,
}

/// Largest standard deviation of a delay that is shown, s: half the kernel's half width.
const SIGMA_MAX_S: f64 = 6e-3;

/// Blocks of samples on either side of the kernel, at most: as many as resolve it.
const HALF_WIDTH_BLOCKS: f64 = 12.0;

/// The time of the set point in a window whose law has this scale of the torque, where that is known; `None` where too few rows are without
/// limits, or the set point does not change in them.
#[must_use]
#[inline(never)]
pub fn setpoint_delay<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    torque_scale: Option<f64>,
) -> Option<SetpointDelay> {
    let [.., half_width_s] = HALF_WIDTHS_S;
    let rate = window.params().sensors.sample_rate;
    let block = libm::ceil(half_width_s * rate / HALF_WIDTH_BLOCKS - 1e-9).max(1.0);
    let kernel = Kernel::new(half_width_s, rate / block, &Compliance::RIGID);
    let known = LawKnowledge {
        scale: torque_scale,
        delay_s: None,
    };
    let mut rows = LawRows::new(window, &kernel, block as usize, known);
    let Law {
        equations, solution, ..
    } = Law::new(&mut rows)?;
    let mut overlap = Overlap::<LAW_COUNT>::new(&kernel.first, kernel.span);
    rows.each(|row| overlap.add(row.map(|(row, _)| row)));
    let covariance = overlap.covariance(&equations, &solution);
    let (g, g_delay) = (solution.x[GAIN], solution.x[GAIN_DELAY]);
    let mut of_delay = SVector::<f64, LAW_COUNT>::zeros();
    (of_delay[GAIN], of_delay[GAIN_DELAY]) = (-g_delay / (g * g), 1.0 / g);
    let of_gain = gradient_of_ratio(&solution.x);
    // The gain ratio that fits best, by the delay that is given.
    let toward_delay = solution.inverse * of_delay;
    let found = SetpointDelay {
        delay_s: Reading {
            value: g_delay / g,
            sigma: libm::sqrt(of_delay.dot(&(covariance * of_delay))),
        },
        gain_per_s: -of_gain.dot(&toward_delay) / of_delay.dot(&toward_delay),
        gain: g / solution.x[SCALE],
    };
    let is_finite = found.delay_s.value.is_finite() && found.gain_per_s.is_finite() && found.gain.is_finite();
    (is_finite && found.delay_s.sigma < SIGMA_MAX_S).then_some(found)
}
