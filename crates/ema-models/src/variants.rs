//! Monitors of one window that differ in parameters, unknowns and torques on the shaft, side by side in lanes.

use crate::comparison::{COST_LANES, Comparison};
use crate::dispatch::{InstructionSet, LaneTypes, LaneWork};
use crate::friction::DryFriction;
use crate::lanes::Lanes;
use crate::monitor::Monitor;
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::signals::{SIGNAL_COUNT, Signals};
use crate::unknowns::Unknowns;

/// Disturbance torques that a [`MonitorVariant`] can have at once.
pub const DISTURBANCE_COUNT: usize = 17;

/// Each disturbance during the sample period after one sample, Nm at the motor shaft per unit; positive opposes positive motion.
pub type Disturbances = [f64; DISTURBANCE_COUNT];

/// Changes of the load during a window that a [`MonitorVariant`] can have at once.
pub const LOAD_CHANGE_COUNT: usize = 2;

/// What acts on the shaft during the sample period after one sample, beside motor, friction and the load of the unknowns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShaftTorques {
    /// Disturbances without loss in the gear.
    pub disturbances: Disturbances,
    /// Each change of the load, Nm at the motor shaft per unit before the gear's loss; positive opposes positive motion.
    pub load_changes: [f64; LOAD_CHANGE_COUNT],
}

/// Sizes of what acts on the shaft.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShaftSizes {
    /// Size of each disturbance.
    pub disturbances: Disturbances,
    /// Size of each change of the load.
    pub load_changes: [f64; LOAD_CHANGE_COUNT],
}

/// One monitor of a window.
#[derive(Clone, Copy, Debug)]
pub struct MonitorVariant {
    monitor: Monitor<f64>,
    sizes: ShaftSizes,
    /// Shares that the gear takes of a load against and with the motion.
    loss_shares: [f64; 2],
}

/// Residuals of one sample: for each signal, that of each lane.
pub type LaneResiduals = [[f64; COST_LANES]; SIGNAL_COUNT];

impl Comparison<'_> {
    /// The monitor of an actuator of these parameters, on a DC link of `v_dc`, V, under torques of these sizes.
    #[must_use]
    pub fn variant(
        &self,
        params: &ActuatorParams,
        v_dc: f64,
        unknowns: &Unknowns,
        sizes: ShaftSizes,
    ) -> MonitorVariant {
        let unknowns = self.conditions.at_temperature(unknowns);
        MonitorVariant {
            monitor: Monitor::new(params, self.calibration, v_dc, &unknowns).with_feedback(self.feedback),
            sizes,
            loss_shares: params.transmission.gear_loss_shares(),
        }
    }

    /// Calls `visit` with index and unweighted residuals of each measured sample for one monitor.
    pub fn residuals_of_variant(
        &self,
        variant: &MonitorVariant,
        torques: &[ShaftTorques],
        visit: impl FnMut(usize, Signals<f64>),
    ) {
        let shaft = Shaft {
            disturbances: variant.sizes.disturbances,
            load_changes: variant.sizes.load_changes,
            loss_shares: variant.loss_shares,
        };
        let of_sample = |n: usize| shaft.at(variant.monitor.friction(), torques.get(n));
        self.run_under(
            &variant.monitor,
            of_sample,
            |torque, disturbance| torque - disturbance,
            visit,
        );
    }

    /// Calls `visit` with index and unweighted residuals of each measured sample for monitors side by side; without a row of `torques` a
    /// sample has none.
    pub fn residuals_of_variants(
        &self,
        variants: &[MonitorVariant; COST_LANES],
        torques: &[ShaftTorques],
        visit: &mut dyn FnMut(usize, &LaneResiduals),
    ) {
        InstructionSet::best().run(VariantResiduals {
            comparison: self,
            variants,
            torques,
            visit,
        });
    }
}

/// [`Comparison::residuals_of_variants`] as [`LaneWork`].
struct VariantResiduals<'a> {
    comparison: &'a Comparison<'a>,
    variants: &'a [MonitorVariant; COST_LANES],
    torques: &'a [ShaftTorques],
    visit: &'a mut dyn FnMut(usize, &LaneResiduals),
}

impl LaneWork for VariantResiduals<'_> {
    type Output = ();

    #[inline(always)]
    fn run<N: LaneTypes>(self) {
        let monitors = self.variants.map(|variant| variant.monitor);
        let monitor = Monitor::side_by_side(&monitors, N::Double::from_lanes);
        let lanes =
            |of: &dyn Fn(&MonitorVariant) -> f64| N::Double::from_lanes(self.variants.map(|variant| of(&variant)));
        let shaft = Shaft {
            disturbances: core::array::from_fn(|d| lanes(&|variant| variant.sizes.disturbances[d])),
            load_changes: core::array::from_fn(|c| lanes(&|variant| variant.sizes.load_changes[c])),
            loss_shares: core::array::from_fn(|s| lanes(&|variant| variant.loss_shares[s])),
        };
        let of_sample = |n: usize| shaft.at(monitor.friction(), self.torques.get(n));
        let visit = self.visit;
        self.comparison.run_under(
            &monitor,
            of_sample,
            |torque, disturbance| torque - disturbance,
            |n, residuals| visit(n, &residuals.to_array().map(N::Double::to_lanes)),
        );
    }
}

/// What acts on the shaft of one variant, or of several, one per lane.
struct Shaft<R> {
    disturbances: [R; DISTURBANCE_COUNT],
    load_changes: [R; LOAD_CHANGE_COUNT],
    loss_shares: [R; 2],
}

impl<R: Real> Shaft<R> {
    /// Friction with the changed load, and torque of all disturbances, Nm; without a row nothing changes.
    #[inline(always)]
    fn at(&self, friction: &DryFriction<R>, row: Option<&ShaftTorques>) -> (DryFriction<R>, R) {
        let Some(row) = row else {
            return (*friction, R::zero());
        };
        let change = sum_of(&self.load_changes, &row.load_changes);
        (
            friction.with_load_change(self.loss_shares, change),
            sum_of(&self.disturbances, &row.disturbances),
        )
    }
}

/// Sum of the sizes times what each is per unit.
#[inline(always)]
fn sum_of<R: Real, const N: usize>(sizes: &[R; N], per_unit: &[f64; N]) -> R {
    let mut sum = R::zero();
    for (size, per_unit) in sizes.iter().zip(per_unit) {
        sum = sum + *size * R::splat(*per_unit);
    }
    sum
}

/// Columns of a [`GramRow`].
pub const GRAM_COLUMNS: usize = 56;

/// Derivatives of one residual, and zeros up to the length; in single precision, as finite differences have fewer digits.
pub type GramRow = [f32; GRAM_COLUMNS];

/// Sums of products of the columns.
pub type Gram = [[f64; GRAM_COLUMNS]; GRAM_COLUMNS];

/// Adds `Σ row rowᵀ` to the lower triangle of `sums`.
pub fn add_gram(rows: &[GramRow], sums: &mut Gram) {
    InstructionSet::best().run(AddGram { rows, sums });
}

/// [`add_gram`] as [`LaneWork`].
struct AddGram<'a> {
    rows: &'a [GramRow],
    sums: &'a mut Gram,
}

impl LaneWork for AddGram<'_> {
    type Output = ();

    #[inline(always)]
    fn run<N: LaneTypes>(self) {
        let (blocks, rest) = self.rows.as_chunks::<ROWS_AT_ONCE>();
        for block in blocks {
            add_block(block, self.sums);
        }
        for row in rest {
            add_block(core::array::from_ref(row), self.sums);
        }
    }
}

/// Rows whose products are summed in single precision.
const ROWS_AT_ONCE: usize = 32;

/// Sums in one register of 256 bits.
const SUMS_AT_ONCE: usize = 8;

/// Lines of sums that share the loads of a row.
const LINES_AT_ONCE: usize = 14;

/// Adds the products of some rows.
#[inline(always)]
fn add_block<const ROWS: usize>(block: &[GramRow; ROWS], sums: &mut Gram) {
    for first in (0..GRAM_COLUMNS).step_by(LINES_AT_ONCE) {
        // Whole registers: some of the upper triangle is summed as well.
        for begin in (0..first + LINES_AT_ONCE).step_by(SUMS_AT_ONCE) {
            let mut partial = [[0.0_f32; SUMS_AT_ONCE]; LINES_AT_ONCE];
            for row in block {
                for (line, partial) in partial.iter_mut().enumerate() {
                    let factor = row[first + line];
                    for (n, sum) in partial.iter_mut().enumerate() {
                        *sum += factor * row[begin + n];
                    }
                }
            }
            for (line, partial) in partial.iter().enumerate() {
                for (sum, partial) in sums[first + line][begin..].iter_mut().zip(partial) {
                    *sum += f64::from(*partial);
                }
            }
        }
    }
}

const _: () = assert!(GRAM_COLUMNS.is_multiple_of(SUMS_AT_ONCE) && GRAM_COLUMNS.is_multiple_of(LINES_AT_ONCE));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Setpoint;
    use crate::monitor::{Calibration, Conditions, Feedback};
    use crate::prior::Prior;
    use crate::recording::Recording;
    use crate::samples::{ComparedSample, InitialState};
    use crate::signals::Weights;
    use crate::unknowns::MotorKnowledge;
    use crate::{FaultVector, MotorDeviation};

    const SAMPLES: usize = 60;

    /// A step of the setpoint, and sensors that show nothing.
    fn sample() -> ComparedSample {
        ComparedSample {
            setpoint: Setpoint::Position(0.05),
            measured: true,
            ..ComparedSample::default()
        }
    }

    #[test]
    fn lanes_give_the_bits_of_a_single_monitor_and_only_a_disturbance_changes_them() {
        let params = ActuatorParams::bench();
        let calibration = Calibration::default();
        let samples = [sample(); SAMPLES];
        let comparison = Comparison {
            recording: Recording {
                samples: &samples,
                drive: &samples,
                initial: InitialState::default(),
            },
            params: &params,
            calibration: &calibration,
            conditions: Conditions {
                load_torque: Some(0.0),
                v_dc: params.motor.v_dc,
                winding_temp_deg_c: None,
            },
            weights: Weights::CURRENT_ONLY,
            feedback: Feedback::Measured,
            prior: Prior {
                load_torque: 1.0,
                integral: 1.0,
                motor: MotorKnowledge::default(),
            },
        };
        let unknowns = Unknowns {
            fault: FaultVector::NOMINAL,
            load_torque: 0.0,
            integral: 0.0,
            motor: MotorDeviation::default(),
        };
        let mut sizes = ShaftSizes::default();
        let undisturbed = comparison.variant(&params, params.motor.v_dc, &unknowns, sizes);
        sizes.disturbances[3] = 0.1;
        sizes.load_changes[1] = 0.1;
        let disturbed = comparison.variant(&params, params.motor.v_dc, &unknowns, sizes);
        let mut row = ShaftTorques::default();
        row.disturbances[3] = 1.0;
        row.load_changes[1] = 1.0;
        let rows = [row; SAMPLES];

        let mut in_lanes = [[[0.0; COST_LANES]; SIGNAL_COUNT]; SAMPLES];
        let mut variants = [undisturbed; COST_LANES];
        variants[1] = disturbed;
        comparison.residuals_of_variants(&variants, &rows, &mut |n, residuals| in_lanes[n] = *residuals);
        let mut alone = [[[0.0; SIGNAL_COUNT]; SAMPLES]; 3];
        comparison.residuals(&unknowns, |n, r| alone[0][n] = r.to_array());
        comparison.residuals_of_variant(&undisturbed, &rows, |n, r| alone[1][n] = r.to_array());
        comparison.residuals_of_variant(&disturbed, &rows, |n, r| alone[2][n] = r.to_array());
        for (n, lanes) in in_lanes.iter().enumerate() {
            for signal in 0..SIGNAL_COUNT {
                let [plain, undisturbed, disturbed] = alone.map(|of| of[n][signal].to_bits());
                assert_eq!(
                    (plain, plain),
                    (undisturbed, lanes[signal][0].to_bits()),
                    "{n}, {signal}"
                );
                assert_eq!(disturbed, lanes[signal][1].to_bits(), "{n}, {signal}");
            }
        }
        // 0.2 Nm against the motion: the shaft of the monitor is behind, its residual larger.
        let last = in_lanes[SAMPLES - 1][2];
        assert!(last[1] > last[0] + 0.01, "{last:?}");
    }

    #[test]
    fn sums_of_products_are_those_of_the_rows() {
        let rows: [GramRow; 3] = core::array::from_fn(|n| core::array::from_fn(|c| (n * 7 + c * 3 % 11) as f32 - 4.0));
        let mut sums = [[0.0; GRAM_COLUMNS]; GRAM_COLUMNS];
        add_gram(&rows, &mut sums);
        for p in 0..GRAM_COLUMNS {
            for q in 0..=p {
                let expected: f64 = rows.iter().map(|row| f64::from(row[p] * row[q])).sum();
                assert!((sums[p][q] - expected).abs() < 1e-9, "{p}, {q}");
            }
        }
    }
}
