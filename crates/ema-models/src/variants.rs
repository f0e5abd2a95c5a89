//! Monitors of one window that differ in parameters, unknowns and disturbances of the shaft, side by side in lanes.

use crate::dispatch::{InstructionSet, LaneTypes, LaneWork};
use crate::lanes::Lanes;
use crate::monitor::Monitor;
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::residual::{COST_LANES, Comparison, SIGNAL_COUNT, Signals};
use crate::unknowns::Unknowns;

/// Disturbance torques that a [`MonitorVariant`] can have at once.
pub const DISTURBANCE_COUNT: usize = 20;

/// Each disturbance during the sample period after one sample, Nm at the motor shaft per unit; positive opposes positive motion.
pub type Disturbances = [f64; DISTURBANCE_COUNT];

/// One monitor of a window.
#[derive(Clone, Copy, Debug)]
pub struct MonitorVariant {
    monitor: Monitor<f64>,
    /// Size of each disturbance.
    disturbance: Disturbances,
}

/// Residuals of one sample: for each signal, that of each lane; zero where the sample was not measured.
pub type LaneResiduals = [[f64; COST_LANES]; SIGNAL_COUNT];

impl Comparison<'_> {
    /// The monitor of an actuator of these parameters, on a DC link of `v_dc`, V, under disturbances of these sizes.
    #[must_use]
    pub fn variant(
        &self,
        params: &ActuatorParams,
        v_dc: f64,
        unknowns: &Unknowns,
        disturbance: Disturbances,
    ) -> MonitorVariant {
        let unknowns = self.conditions.at_temperature(unknowns);
        MonitorVariant {
            monitor: Monitor::new(params, self.calibration, v_dc, &unknowns).with_feedback(self.feedback),
            disturbance,
        }
    }

    /// Calls `visit` with index and unweighted residuals of each measured sample for one monitor.
    pub fn residuals_of_variant(
        &self,
        variant: &MonitorVariant,
        disturbances: &[Disturbances],
        visit: impl FnMut(usize, Signals<f64>),
    ) {
        let torque = |n: usize| sum_of_disturbances(&variant.disturbance, disturbances.get(n));
        self.run_under(
            &variant.monitor,
            torque,
            |torque, disturbance| torque - disturbance,
            visit,
        );
    }

    /// Unweighted residuals of monitors side by side, one row per sample. `disturbances` and `residuals` have as many rows as the
    /// window has samples; samples beyond the shorter are left out.
    pub fn residuals_of_variants(
        &self,
        variants: &[MonitorVariant; COST_LANES],
        disturbances: &[Disturbances],
        residuals: &mut [LaneResiduals],
    ) {
        InstructionSet::best().run(VariantResiduals {
            comparison: self,
            variants,
            disturbances,
            residuals,
        });
    }
}

/// [`Comparison::residuals_of_variants`] as [`LaneWork`].
struct VariantResiduals<'a> {
    comparison: &'a Comparison<'a>,
    variants: &'a [MonitorVariant; COST_LANES],
    disturbances: &'a [Disturbances],
    residuals: &'a mut [LaneResiduals],
}

impl LaneWork for VariantResiduals<'_> {
    type Output = ();

    #[inline(always)]
    fn run<N: LaneTypes>(self) {
        let monitors = self.variants.map(|variant| variant.monitor);
        let monitor = Monitor::side_by_side(&monitors, N::Double::from_lanes);
        let sizes: [N::Double; DISTURBANCE_COUNT] =
            core::array::from_fn(|d| N::Double::from_lanes(self.variants.map(|variant| variant.disturbance[d])));
        let disturbance = |n: usize| sum_of_disturbances(&sizes, self.disturbances.get(n));
        let residuals = self.residuals;
        residuals.fill([[0.0; COST_LANES]; SIGNAL_COUNT]);
        self.comparison.run_under(
            &monitor,
            disturbance,
            |torque, disturbance| torque - disturbance,
            |n, of_sample| {
                if let Some(row) = residuals.get_mut(n) {
                    for (slot, residual) in row.iter_mut().zip(of_sample.to_array()) {
                        *slot = residual.to_lanes();
                    }
                }
            },
        );
    }
}

/// Torque of all disturbances of these sizes, Nm; none without a row.
#[inline(always)]
fn sum_of_disturbances<R: Real>(sizes: &[R; DISTURBANCE_COUNT], row: Option<&Disturbances>) -> R {
    let mut torque = R::zero();
    if let Some(row) = row {
        for (size, per_unit) in sizes.iter().zip(row) {
            torque = torque + *size * R::splat(*per_unit);
        }
    }
    torque
}

/// Columns of a [`GramRow`].
pub const GRAM_COLUMNS: usize = 56;

/// One equation of a least-squares problem: derivatives of its residual, the residual, and zeros up to the length.
pub type GramRow = [f64; GRAM_COLUMNS];

/// Adds `Σ row rowᵀ` to the lower triangle of `sums`.
pub fn add_gram(rows: &[GramRow], sums: &mut [GramRow; GRAM_COLUMNS]) {
    InstructionSet::best().run(Gram { rows, sums });
}

/// [`add_gram`] as [`LaneWork`].
struct Gram<'a> {
    rows: &'a [GramRow],
    sums: &'a mut [GramRow; GRAM_COLUMNS],
}

impl LaneWork for Gram<'_> {
    type Output = ();

    #[inline(always)]
    fn run<N: LaneTypes>(self) {
        for row in self.rows {
            for (p, sum) in self.sums.iter_mut().enumerate() {
                // Whole registers: some of the upper triangle is summed as well.
                let end = (p / 4 + 1) * 4;
                let factor = row[p];
                for (sum, value) in sum[..end].iter_mut().zip(&row[..end]) {
                    *sum += factor * value;
                }
            }
        }
    }
}
