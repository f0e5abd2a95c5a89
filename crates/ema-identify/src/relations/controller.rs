//! Position gain of one window from the differentiated PI law of the speed loop.
//!
//! `T = K_p e + K_i ∫e`, `e = G_p g (θ_cmd − θ_out) − ω_m`, differentiated once, so that the integral's start is no unknown:
//! `T' = g (K_p e₁' + K_i e₁) − h (K_p ω' + K_i ω)` with `e₁ = G_p (θ_cmd − θ_out)`. T is `G_T i_q` as measured. The ratio
//! `g/h` is the gain factor `0.5 + k8`. The scale of the torque h is that of the commissioned unit, 1 where current sensors and K_p are
//! those of the type: the control deviation, whose counts change between the samples, and the ripple of the current draw a free h towards
//! zero, to 0.75 in one motion and 0.95 in another, and the ratio with it. The current follows its reference late, more so in fast
//! motion: `τ T''` on the left is the third unknown, without which the ratio of one motion differs from that of another. Offsets of the
//! currents are the fourth and fifth. A set point that takes effect δ after it is logged adds `−g δ G_p (K_p θ_cmd'' + K_i θ_cmd')`, which in
//! steady motion looks like another gain: `setpoint_delay` has it as the sixth unknown. Derived here from the control law.

use ema_models::dq_from_abc;
use nalgebra::{SVector, Vector1};

use super::compliance::Compliance;
use super::elements::{Needed, Reading};
use super::jackknife::Jackknife;
use super::kept::Kept;
use super::kernel::{Kernel, MAX_SPAN};
use super::measured::MeasuredWindow;
use super::normal_equations::{NormalEquations, Solution};
use super::overlap::Overlap;
use super::residual::Residual;
use super::sliding::Sliding;
use crate::recorded_sample::RecordedSample;

/// Largest speed reference at the nominal gain, as a share of ω_max: with the largest gain factor of 1.5 it stays below the
/// limit.
const SPEED_SHARE: f64 = 0.65;

/// Unknowns: g, h, the lag τ, the offsets of the currents along α and β, A, and g δ, of a set point that takes effect δ after it is logged.
pub(super) const LAW_COUNT: usize = 6;

/// Places of the unknowns.
pub(super) const GAIN: usize = 0;
pub(super) const SCALE: usize = 1;
const OFFSETS: [usize; 2] = [3, 4];
pub(super) const GAIN_DELAY: usize = 5;

/// One standard deviation of an offset, as a share of I_max: three times that of a usual sensor. Larger ones are found before (`hmd-core`).
const OFFSET_SHARE: f64 = 0.01;

/// One standard deviation of the scale of the torque of a unit: the gain of its current sensors, and K_p.
const SCALE_SIGMA: f64 = 0.02;

/// What is known of the law beside the window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LawKnowledge {
    /// Scale of the torque h; `None` where the window has to show it.
    pub(super) scale: Option<f64>,
    /// Time from the logged set point to its effect, s; `None` where the window has to show it.
    pub(super) delay_s: Option<f64>,
}

/// Ratio `g/h` of a window and residual of the law, Nm/s, with a kernel of this half width, s.
#[inline(never)]
pub(super) fn gain_ratio<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    half_width_s: f64,
    known: LawKnowledge,
) -> Result<(Reading, Residual), Needed> {
    let kernel = Kernel::new(half_width_s, window.params().sensors.sample_rate, &Compliance::RIGID);
    if !window.inner().any(|n| window.position_error(n).is_some()) {
        return Err(Needed::PositionMode);
    }
    let mut rows = LawRows::new(window, &kernel, 1, known);
    let law = Law::new(&mut rows).ok_or(Needed::UnsaturatedControl)?;
    ratio(&mut rows, &law).ok_or(Needed::UnsaturatedControl)
}

/// Scale of the torque that a window shows by itself, drawn towards zero; `None` where it shows none.
#[cfg(feature = "std")]
pub(super) fn free_scale<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    half_width_s: f64,
    delay_s: f64,
) -> Option<f64> {
    let kernel = Kernel::new(half_width_s, window.params().sensors.sample_rate, &Compliance::RIGID);
    let known = LawKnowledge {
        scale: None,
        delay_s: Some(delay_s),
    };
    let mut rows = LawRows::new(window, &kernel, 1, known);
    Some(Law::new(&mut rows)?.solution.x[SCALE])
}

/// The law of one window, solved.
pub(super) struct Law {
    pub(super) equations: NormalEquations<LAW_COUNT>,
    pub(super) solution: Solution<LAW_COUNT>,
    /// Change of the ratio by the scale of the torque.
    ratio_per_scale: f64,
}

impl Law {
    /// Solves the law; `None` where too few rows are without limits.
    #[inline(never)]
    pub(super) fn new<S: RecordedSample>(rows: &mut LawRows<'_, S>) -> Option<Self> {
        let known = rows.known;
        let mut equations = NormalEquations::new();
        rows.each(|row| {
            if let Some((row, d_torque)) = row {
                equations.add(row, *d_torque);
            }
        });
        let span = rows.kernel.span;
        if equations.rows < MIN_INDEPENDENT * span {
            return None;
        }
        let free = equations.solve()?;
        // Neighbouring rows share a kernel.
        let variance = free.residual_rms * free.residual_rms * span as f64;
        let sigma = OFFSET_SHARE * rows.window.params().motor.i_max;
        for offset in OFFSETS {
            equations.ata[(offset, offset)] += variance / (sigma * sigma);
        }
        let mut solution = equations.solve()?;
        let of_scale = solution.inverse.column(SCALE) / solution.inverse[(SCALE, SCALE)];
        if let Some(scale) = known.scale {
            let weight = FIXED * equations.ata[(SCALE, SCALE)];
            equations.ata[(SCALE, SCALE)] += weight;
            equations.aty[SCALE] += weight * scale;
            equations.yy += weight * scale * scale;
            solution = equations.solve()?;
        }
        let (g, h) = (solution.x[GAIN], solution.x[SCALE]);
        Some(Self {
            equations,
            solution,
            ratio_per_scale: of_scale[GAIN] / h - g / (h * h),
        })
    }

    /// Variance of the ratio by the scale of the torque, where that is taken as known.
    fn variance_of_scale(&self, known: LawKnowledge) -> f64 {
        let sigma = known
            .scale
            .map_or(0.0, |scale| SCALE_SIGMA * scale * self.ratio_per_scale);
        sigma * sigma
    }
}

/// Weight of a known unknown, as a multiple of the information of all rows.
const FIXED: f64 = 1e6;

/// A row of the law: factors of the unknowns, and T', Nm/s.
pub(super) type LawRow = ([f64; LAW_COUNT], f64);

/// Rows of the law, one for each block of so many inner samples, whose means the kernel smooths.
pub(super) struct LawRows<'a, S> {
    pub(super) window: &'a MeasuredWindow<'a, S>,
    pub(super) kernel: &'a Kernel,
    block: usize,
    known: LawKnowledge,
    kept: Kept<Option<LawRow>>,
}

impl<'a, S: RecordedSample> LawRows<'a, S> {
    /// Of blocks of so many samples.
    pub(super) fn new(
        window: &'a MeasuredWindow<'a, S>,
        kernel: &'a Kernel,
        block: usize,
        known: LawKnowledge,
    ) -> Self {
        Self {
            window,
            kernel,
            block,
            known,
            kept: Kept::new(window.len() / block),
        }
    }

    /// Passes each row; `None` unless neither speed nor torque is at its limit under the kernel that ends there.
    pub(super) fn each(&mut self, mut pass: impl FnMut(Option<&LawRow>)) {
        let (window, block, delay_s) = (self.window, self.block, self.known.delay_s);
        let weights = law_weights(window, self.kernel);
        let torque_gain = window.params().motor.torque_gain();
        let mut ring = Sliding::<QUANTITIES>::new(self.kernel.span);
        let (begin, blocks) = (window.inner().start, window.inner().len() / block);
        for place in 0..blocks {
            let make = || {
                let Some(mean) = mean_quantities(window, begin + place * block, block) else {
                    ring.clear();
                    return None;
                };
                ring.push(mean);
                let of_unknowns = |[reference, omega, lag, sin, cos, command, d_torque]: [f64; QUANTITIES]| {
                    let (known, unknown) = delay_s.map_or((0.0, -command), |delay_s| (-delay_s * command, 0.0));
                    // i_q = −i_α sin θ_e + i_β cos θ_e.
                    let offsets = [-torque_gain * sin, torque_gain * cos];
                    (
                        [reference + known, -omega, -lag, offsets[0], offsets[1], unknown],
                        d_torque,
                    )
                };
                ring.is_full()
                    .then(|| of_unknowns(ring.weighted_sums(&weights, KERNEL_OF)))
            };
            self.kept.with(place, make, |row| pass(row.as_ref()));
        }
    }
}

/// Means of the quantities over so many samples; `None` where those of one are.
fn mean_quantities<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    first: usize,
    count: usize,
) -> Option<[f64; QUANTITIES]> {
    let mut mean = [0.0; QUANTITIES];
    for n in (first..).take(count) {
        for (mean, measured) in mean.iter_mut().zip(law_quantities(window, n)?) {
            *mean += measured / count as f64;
        }
    }
    Some(mean)
}

/// Quantities of a sample that the kernel smooths.
const QUANTITIES: usize = LAW_COUNT + 1;

/// Kernels of the law: of what stands in it by itself and by its derivative, of what does so by both derivatives, and first and second derivative.
const KERNELS: usize = 4;

/// The kernel of each quantity.
const KERNEL_OF: [usize; QUANTITIES] = [0, 0, 3, 2, 2, 1, 2];

/// Weights of the kernels of the law by place.
fn law_weights<S: RecordedSample>(window: &MeasuredWindow<'_, S>, kernel: &Kernel) -> [[f64; KERNELS]; MAX_SPAN] {
    let controller = &window.params().controller;
    core::array::from_fn(|m| {
        let (smooth, first, second) = (kernel.smooth[m], kernel.first[m], kernel.second[m]);
        let law = |d: f64, value: f64| controller.k_p * d + controller.k_i * value;
        [law(first, smooth), law(second, first), first, second]
    })
}

/// Speed reference, speed, both rad/s, torque that the controller asks for, whatever the motor makes of it, Nm, sine and cosine of the
/// electrical angle, what the set point has of the reference since the first sample, rad/s, and the torque again; `None` where speed or
/// torque is at its limit or the sample was not measured.
fn law_quantities<S: RecordedSample>(window: &MeasuredWindow<'_, S>, n: usize) -> Option<[f64; QUANTITIES]> {
    let params = window.params();
    let g_p = params.controller.g_p;
    let reference = g_p * window.position_error(n)?;
    let command = g_p * (window.commanded_angle(n)? - window.commanded_angle(0)?);
    let now = window.instant(n);
    let [_, quadrature] = dq_from_abc(now.i, now.sin_cos_e);
    let limited = window.speed_reference(n) >= SPEED_SHARE || window.is_current_limited(quadrature);
    if limited || !window.is_measured(n) {
        return None;
    }
    let torque = params.motor.torque_gain() * quadrature;
    let (sin, cos) = now.sin_cos_e;
    Some([reference, window.central_speed(n), torque, sin, cos, command, torque])
}

/// Kernels whose rows do not overlap, at least, for a ratio.
const MIN_INDEPENDENT: usize = 4;

/// Ratio of the first two unknowns and its standard deviation; `None` where the rows do not show it.
#[inline(never)]
fn ratio<S: RecordedSample>(rows: &mut LawRows<'_, S>, law: &Law) -> Option<(Reading, Residual)> {
    let Law {
        equations, solution, ..
    } = law;
    let kernel = rows.kernel;
    let mut overlap = Overlap::<LAW_COUNT>::new(&kernel.first, kernel.span);
    let no_noise = SVector::zeros();
    let mut groups = Jackknife::<LAW_COUNT, 1>::new(rows.window.len(), equations, solution, &no_noise);
    let of = |x: &SVector<f64, LAW_COUNT>| Vector1::new(x[GAIN] / x[SCALE]);
    let mut n = 0;
    rows.each(|row| {
        overlap.add(row.map(|(row, _)| row));
        if let Some((row, d_torque)) = row {
            groups.add(n, (row, *d_torque), of);
        }
        n += 1;
    });
    let covariance = overlap.covariance(equations, solution);
    let (g, h) = (solution.x[GAIN], solution.x[SCALE]);
    let gradient = gradient_of_ratio(&solution.x);
    let variance = gradient.dot(&(covariance * gradient)).max(groups.variance(of)[0]);
    let reading = Reading {
        value: g / h,
        sigma: libm::sqrt(variance + law.variance_of_scale(rows.known)),
    };
    let residual = Residual {
        rms: solution.residual_rms,
        independent: (equations.rows / kernel.span) as f64,
    };
    (reading.value.is_finite() && reading.sigma.is_finite()).then_some((reading, residual))
}

/// Gradient of g/h.
pub(super) fn gradient_of_ratio(x: &SVector<f64, LAW_COUNT>) -> SVector<f64, LAW_COUNT> {
    let (g, h) = (x[GAIN], x[SCALE]);
    let mut gradient = SVector::zeros();
    (gradient[GAIN], gradient[SCALE]) = (1.0 / h, -g / (h * h));
    gradient
}
