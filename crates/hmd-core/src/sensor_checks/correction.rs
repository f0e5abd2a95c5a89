//! A window without its mistake.

use std::ops::RangeInclusive;

use ema_models::{Setpoint, abc_from_alpha_beta, alpha_beta_from_abc};

use crate::outbox::WindowJob;

/// Voltages that a link may have, as shares of the nominal one.
pub(super) const LINK_POSSIBLE: RangeInclusive<f64> = 0.55..=1.45;

/// How a mistake is taken out of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Correction {
    /// These two phase currents are exchanged.
    Swap(usize, usize),
    /// Each current loses its offset, A, then is divided by its gain.
    Currents {
        /// Offsets.
        offset: [f64; 3],
        /// Gains.
        gain: [f64; 3],
    },
    /// The currents are those of so many samples later.
    Later(isize),
    /// The motor angle is that of so many samples later; where it is, the window ends as much earlier.
    MotorAngle {
        /// Samples.
        late: isize,
        /// Whether the currents were logged in the rotor's frame, so that they turn with it.
        turns_currents: bool,
    },
    /// The resolver's counts lose this many.
    ResolverZero(i64),
    /// The resolver counts the other way.
    ResolverReversed,
    /// The encoder's counts lose this many.
    EncoderZero(i64),
    /// The encoder counts the other way.
    EncoderReversed,
    /// The motor has this many pole pairs.
    PolePairs(f64),
    /// The gear ratio is this one.
    GearRatio(f64),
    /// The set point is divided by this.
    Setpoint(f64),
    /// The set point is that of so many samples before; where it is that of later ones, the window ends as much earlier.
    SetpointBefore(isize),
    /// The load counts as not measured.
    NoLoad,
    /// The winding temperature counts as not measured.
    NoTemperature,
    /// The DC link has this voltage, V.
    Link(f64),
}

/// Phase currents whose space vector is turned by an electrical angle, rad.
fn turned_by(currents: [f64; 3], angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    let mean = currents.iter().sum::<f64>() / 3.0;
    let [alpha, beta] = alpha_beta_from_abc(currents);
    abc_from_alpha_beta([alpha * cos - beta * sin, alpha * sin + beta * cos]).map(|current| current + mean)
}

impl Correction {
    /// Takes the mistake out of a window.
    pub fn apply(self, job: &mut WindowJob) {
        let samples = &mut job.window.samples;
        match self {
            Self::Swap(one, other) => samples.iter_mut().for_each(|sample| sample.currents.swap(one, other)),
            Self::Currents { offset, gain } => {
                for sample in samples {
                    for phase in 0..3 {
                        sample.currents[phase] = (sample.currents[phase] - offset[phase]) / gain[phase];
                    }
                }
            }
            Self::Later(by) => {
                let currents: Vec<[f64; 3]> = samples.iter().map(|sample| sample.currents).collect();
                for (n, sample) in samples.iter_mut().enumerate() {
                    let from = n.checked_add_signed(by).and_then(|n| currents.get(n));
                    sample.currents = *from.unwrap_or(&sample.currents);
                }
            }
            Self::MotorAngle { late, turns_currents } => {
                let (angles, rad_per_count) = (
                    samples.iter().map(|sample| sample.motor_counts).collect::<Vec<i64>>(),
                    job.params.motor.pole_pairs * job.params.sensors.motor_lsb(),
                );
                for (n, sample) in samples.iter_mut().enumerate() {
                    let counts = angles.get(n.saturating_add_signed(late)).copied();
                    let counts = counts.unwrap_or(sample.motor_counts);
                    if turns_currents {
                        let turned = counts.saturating_sub(sample.motor_counts) as f64 * rad_per_count;
                        sample.currents = turned_by(sample.currents, turned);
                    }
                    sample.motor_counts = counts;
                }
                let left = samples.len().saturating_add_signed(late.saturating_neg().min(0));
                samples.truncate(left);
                let filled = &mut job.window.filled;
                let of_angle: Vec<usize> = filled.iter().filter_map(|n| n.checked_add_signed(-late)).collect();
                filled.extend(of_angle);
                filled.sort_unstable();
                filled.dedup();
                filled.retain(|&filled| filled < left);
                job.window.trigger = job.window.trigger.min(left.saturating_sub(1));
            }
            Self::ResolverZero(counts) => {
                for sample in samples {
                    sample.motor_counts = sample.motor_counts.saturating_sub(counts);
                }
            }
            Self::ResolverReversed => {
                for sample in samples {
                    sample.motor_counts = sample.motor_counts.saturating_neg();
                }
            }
            Self::EncoderReversed => {
                for sample in samples {
                    sample.output_counts = sample.output_counts.saturating_neg();
                }
            }
            Self::EncoderZero(counts) => {
                for sample in samples {
                    sample.output_counts = sample.output_counts.saturating_sub(counts);
                }
            }
            Self::PolePairs(pole_pairs) => job.params.motor.pole_pairs = pole_pairs,
            Self::GearRatio(gear_ratio) => job.params.transmission.gear_ratio = gear_ratio,
            Self::Setpoint(factor) => {
                for sample in samples {
                    sample.setpoint = sample.setpoint.map(|value| value / factor);
                }
            }
            Self::SetpointBefore(by) => {
                let setpoints: Vec<Setpoint> = samples.iter().map(|sample| sample.setpoint).collect();
                for (n, sample) in samples.iter_mut().enumerate() {
                    let from = n.saturating_add_signed(by.saturating_neg());
                    sample.setpoint = setpoints.get(from).copied().unwrap_or(sample.setpoint);
                }
                samples.truncate(samples.len().saturating_add_signed(by.min(0)));
                let left = samples.len();
                job.window.filled.retain(|&filled| filled < left);
                job.window.trigger = job.window.trigger.saturating_add_signed(by).min(left.saturating_sub(1));
            }
            Self::NoLoad => job.conditions.load_torque_nm = None,
            Self::NoTemperature => job.conditions.winding_temp_deg_c = None,
            Self::Link(voltage) => job.conditions.dc_link_v = Some(voltage),
        }
    }
}
