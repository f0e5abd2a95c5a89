//! What the programs for the controller share with those that check them: the form in which the controller keeps a recorded
//! sample, and that in which it prints an estimate.
//!
//! Identification itself is `ema-identify`, the same as on the host. Built without features this is a library for any
//! machine; feature `image` adds the programs for the processor itself, which `cargo xtask target` builds and runs.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

use core::fmt;

use ema_identify::relations::RelationsEstimate;
use ema_identify::{Estimate, RecordedSample};
use ema_models::{FAULT_COUNT, SensedSample, Setpoint};
use ema_wire::{Mode, Sample, quantity};

/// One sample as the controller records it: those words of a [`Sample`] that identification needs, 20 bytes.
///
/// ```
/// assert_eq!(size_of::<firmware_image::StoredSample>(), 20);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredSample {
    /// Phases A, B and C, mA.
    pub currents_ma: [i16; 3],
    /// What the setpoint means.
    pub mode: Mode,
    /// Resolver, 65 536 counts per motor turn.
    pub motor_counts: i32,
    /// Encoder, 20 000 counts per output turn.
    pub output_counts: i32,
    /// Position mode: 1 µrad at the output; speed mode: 1 mrad/s at the motor; idle: ignored.
    pub setpoint: i32,
}

impl From<&Sample> for StoredSample {
    fn from(sample: &Sample) -> Self {
        Self {
            currents_ma: [sample.i_a_ma, sample.i_b_ma, sample.i_c_ma],
            mode: sample.mode,
            motor_counts: sample.motor_counts,
            output_counts: sample.output_counts,
            setpoint: sample.setpoint,
        }
    }
}

impl RecordedSample for StoredSample {
    fn sensed(&self, seq: u64) -> SensedSample {
        SensedSample {
            seq,
            currents: self.currents_ma.map(quantity::current_a),
            motor_counts: i64::from(self.motor_counts),
            output_counts: i64::from(self.output_counts),
            setpoint: match self.mode {
                Mode::Idle => Setpoint::Idle,
                Mode::Position => Setpoint::Position(quantity::position_setpoint_rad(self.setpoint)),
                Mode::Speed => Setpoint::Speed(quantity::speed_setpoint_rad_s(self.setpoint)),
            },
        }
    }
}

/// Every number of an estimate, one `name/number value` line each; doubles as their bits in hexadecimal, `-` for none.
#[derive(Clone, Copy, Debug)]
pub struct EstimateLines<'a> {
    /// Name of the window.
    pub name: &'a str,
    /// What was found.
    pub estimate: &'a Estimate,
}

impl fmt::Display for EstimateLines<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, estimate } = self;
        for (p, k) in (1..).zip(estimate.fault.to_array()) {
            writeln!(f, "{name}/k{p} {:016x}", k.to_bits())?;
        }
        let unknowns = &estimate.unknowns;
        for (number, value) in [
            ("load_torque", unknowns.load_torque),
            ("integral", unknowns.integral),
            ("resistance", unknowns.motor.resistance),
            ("back_emf", unknowns.motor.back_emf),
            ("back_emf_off", estimate.back_emf_off),
            ("cost", estimate.cost),
            ("residual_rms", estimate.residual_rms_a),
        ] {
            writeln!(f, "{name}/{number} {:016x}", value.to_bits())?;
        }
        for (p, sigma) in (1..).zip(estimate.sigma) {
            match sigma {
                Some(sigma) => writeln!(f, "{name}/sigma{p} {:016x}", sigma.to_bits())?,
                None => writeln!(f, "{name}/sigma{p} -")?,
            }
        }
        for (p, k) in (1..).zip(
            estimate
                .competing_optimum
                .map_or([None; FAULT_COUNT], |k| k.to_array().map(Some)),
        ) {
            match k {
                Some(k) => writeln!(f, "{name}/competing{p} {:016x}", k.to_bits())?,
                None => writeln!(f, "{name}/competing{p} -")?,
            }
        }
        for (number, value) in [
            ("cut", estimate.cut),
            ("locked", estimate.locked),
            ("other_motor", estimate.other_motor),
            ("unmodelled", estimate.is_unmodelled()),
        ] {
            writeln!(f, "{name}/{number} {value}")?;
        }
        write!(f, "{name}/evaluations {}", estimate.evaluations)
    }
}

/// Faults and standard deviations that the relations of a unit find, in the form of [`EstimateLines`].
#[derive(Clone, Copy, Debug)]
pub struct RelationsLines<'a> {
    /// Name of the window.
    pub name: &'a str,
    /// What was found.
    pub estimate: &'a RelationsEstimate,
}

impl fmt::Display for RelationsLines<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, estimate } = self;
        for (p, k) in (1..).zip(estimate.k) {
            writeln!(f, "{name}/relations/k{p} {:016x}", k.to_bits())?;
        }
        for (p, sigma) in (1..).zip(estimate.sigma) {
            match sigma {
                Some(sigma) => writeln!(f, "{name}/relations/sigma{p} {:016x}", sigma.to_bits())?,
                None => writeln!(f, "{name}/relations/sigma{p} -")?,
            }
        }
        for (relation, share) in estimate.residual_share.iter().enumerate() {
            writeln!(f, "{name}/relations/residual{relation} {:016x}", share.to_bits())?;
        }
        write!(f, "{name}/relations/rows {}", estimate.torque_rows)
    }
}
