//! Residuals of a monitor, measured minus modelled, sample by sample.

use crate::monitor::Output;
use crate::real::Real;
use crate::signals::Signals;

/// Residuals of one monitor (or several, in lanes), sample by sample.
///
/// The residual of the speed is the difference of two residuals of the angle, about 1 ms and at least one sample apart,
/// divided by that time, so that measured and modelled speed are means over the same time at any sampling rate. It is zero
/// where the earlier angle was not measured.
#[derive(Clone, Copy, Debug)]
pub struct ResidualState<R> {
    per_span: R,
    span: usize,
    /// Residuals of the angle at the last samples, a ring buffer, and the index of the next one.
    angles: [R; LONGEST_SPAN],
    place: usize,
}

impl<R: Real> ResidualState<R> {
    /// The state before the first sample; `sample_rate` in Hz.
    #[must_use]
    #[inline(always)]
    pub fn new(sample_rate: f64) -> Self {
        let span = speed_span(sample_rate);
        Self {
            per_span: R::splat(sample_rate / span as f64),
            span,
            angles: [R::zero(); LONGEST_SPAN],
            place: 0,
        }
    }

    /// Samples over which speed is measured.
    #[must_use]
    #[inline(always)]
    pub fn span(&self) -> usize {
        self.span
    }

    /// Unweighted residuals of the next sample; `earlier` is true if the sample one span before it exists and was measured.
    #[inline(always)]
    pub fn next(&mut self, measured: &Signals<R>, output: &Output<R>, earlier: bool) -> Signals<R> {
        let theta_m = measured.theta_m - output.theta_m;
        let omega_m = if earlier {
            (theta_m - self.angles[self.place]) * self.per_span
        } else {
            R::zero()
        };
        self.angles[self.place] = theta_m;
        self.place = (self.place + 1) % self.span;
        Signals {
            i_d: measured.i_d - output.i_d,
            i_q: measured.i_q - output.i_q,
            theta_m,
            omega_m,
            theta_out: measured.theta_out - output.theta_out,
        }
    }
}

/// Samples over which the residual of the speed is taken, at a sample rate, Hz.
#[must_use]
#[inline(always)]
pub fn speed_span(sample_rate: f64) -> usize {
    (libm::round(sample_rate * SPEED_SPAN) as usize).clamp(1, LONGEST_SPAN)
}

/// Time over which speed is measured, s.
const SPEED_SPAN: f64 = 1e-3;
/// Largest number of samples; above 8 kHz the time is shorter.
const LONGEST_SPAN: usize = 8;
