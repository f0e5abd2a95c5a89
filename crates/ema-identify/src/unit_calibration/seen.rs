//! Conditions and motions of the windows from which a unit was learnt, and whether a later window is outside them.

use core::f64::consts::TAU;
use core::fmt;
use std::vec::Vec;

use ema_models::{ActuatorParams, BACK_EMF_PER_KELVIN, Scale, SensedSample, Setpoint};
use serde::{Deserialize, Serialize};

use crate::relations::WindingTemp;

/// Conditions and motion of one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Winding temperature, °C, where it is measured.
    pub winding_temp_deg_c: Option<f64>,
    /// Load torque at the output, Nm, where it is measured.
    pub load_torque: Option<f64>,
    /// Largest distance of the output from where it was at first, rad.
    pub travel: f64,
    /// Root-mean-square of the current vector, A: phase amplitude.
    pub current_rms: f64,
    /// Electrical angle of the rotor at the first sample, rad.
    pub rotor_angle: f64,
    /// Whether the motor turned furthest in the positive direction.
    pub is_forward: bool,
    /// Whether the motor speed was commanded.
    pub is_speed_mode: bool,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Steps of currents, A, of the motor's angle, and of the output's, counts; 0 where none is known.
    pub steps: [f64; 3],
    /// Whether the output angle is measured; else it is that of the motor behind a rigid gear.
    pub has_output_angle: bool,
    /// Time for which the set point stands beyond a sample period while it moves, s.
    pub setpoint_held_s: f64,
}

impl Motion {
    /// The motion of a window.
    #[must_use]
    pub fn of(params: &ActuatorParams, samples: &[SensedSample]) -> Self {
        let first = samples.first().map_or(0, |sample| sample.output_counts);
        // i_α² + i_β² = ⅔ Σ i_j².
        let squared = |sample: &SensedSample| 2.0 / 3.0 * sample.currents.iter().map(|i| i * i).sum::<f64>();
        let squares: f64 = samples.iter().map(squared).sum();
        let counts = samples.iter().map(|sample| sample.output_counts.abs_diff(first)).max();
        Self {
            winding_temp_deg_c: None,
            load_torque: None,
            current_rms: (squares / samples.len().max(1) as f64).sqrt(),
            travel: counts.unwrap_or(0) as f64 * params.sensors.output_lsb(),
            rotor_angle: samples.first().map_or(0.0, |sample| {
                let per_turn = params.sensors.motor_counts_per_rev;
                let turns = params.motor.pole_pairs * sample.motor_counts as f64 / per_turn;
                TAU * (turns - turns.floor())
            }),
            is_forward: samples
                .iter()
                .map(|sample| sample.motor_counts.saturating_sub(samples[0].motor_counts))
                .max_by_key(|turned| turned.unsigned_abs())
                .is_some_and(|turned| turned > 0),
            is_speed_mode: samples
                .iter()
                .any(|sample| matches!(sample.setpoint, Setpoint::Speed(_))),
            sample_rate_hz: params.sensors.sample_rate,
            steps: [0.0; 3],
            has_output_angle: true,
            setpoint_held_s: 0.0,
        }
    }
}

/// Ranges of the conditions and motions that a unit was learnt from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seen {
    /// Winding temperature, °C; without it none was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub winding_temp_deg_c: Option<[f64; 2]>,
    /// Load torque at the output, Nm; without it none was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load_torque_nm: Option<[f64; 2]>,
    /// Travel of the output in a window, rad.
    pub travel_rad: [f64; 2],
    /// Root-mean-square of the current vector in a window, A.
    pub current_rms_a: [f64; 2],
    /// Whether windows with commanded position were among them.
    pub position_mode: bool,
    /// Whether windows with commanded speed were among them.
    pub speed_mode: bool,
    /// Sampling rate, Hz; older files had none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_rate_hz: Option<f64>,
    /// Steps of currents, A, of the motor's angle, and of the output's, counts; 0 where none is known. Older files have the smallest
    /// differences between values.
    #[serde(default)]
    pub steps: [f64; 3],
    /// Whether no output angle was measured.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub no_output_angle: bool,
    /// Longest time for which the set point of a window stands beyond a sample period while it moves, s; without it the set point moves with
    /// every sample, or the file is older.
    #[serde(default, skip_serializing_if = "is_none")]
    pub setpoint_held_s: f64,
    /// Twelfths of an electrical turn in or near which the rotor stood at the beginning of a window that goes backward, and of one that goes forward;
    /// without it a window may begin anywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor_sectors: Option<[[bool; SECTORS]; 2]>,
}

/// Whether a time is none.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
fn is_none(time: &f64) -> bool {
    *time <= 0.0
}

/// Sectors of an electrical turn, and how many of them are many.
const SECTORS: usize = 12;
const MANY_SECTORS: usize = 5;

fn sector(rotor_angle: f64) -> usize {
    (rotor_angle.rem_euclid(TAU) / TAU * SECTORS as f64) as usize % SECTORS
}

/// Electrical angle by which windows from one position differ at most, rad. Of a `bench` with the effects of a real actuator at 400 Hz, shorts
/// are off by 0.05 to 0.09 from 30° on, six sigmas.
const ANGLE_MARGIN: f64 = 10.0 / 360.0 * TAU;

/// Factor on every sigma of a window for each respect in which it is outside all that was seen.
const UNSEEN_FACTOR: f64 = 2.0;

/// The same where the rotor begins elsewhere. What a model of one spring leaves of a play repeats with the rotor's angle: windows of a
/// `bench` with a resonance at 100 Hz, all commissioned from one angle, show an eccentricity of 2.2 sigmas root-mean-square from others, 6 at
/// most of 48.
const OTHER_ANGLE_FACTOR: f64 = 3.0;

/// In what a window is outside all that was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unseen {
    /// Winding temperature, °C: the range and the window's.
    WindingTemp([f64; 2], f64),
    /// Load torque, Nm.
    LoadTorque([f64; 2], f64),
    /// Travel, rad.
    Travel([f64; 2], f64),
    /// Root-mean-square of the current, A.
    Current([f64; 2], f64),
    /// Its mode.
    Mode,
    /// Sampling rate, Hz: that of commissioning and the window's.
    SampleRate(f64, f64),
    /// Electrical angle of the rotor at its beginning, rad.
    RotorAngle(f64),
    /// Steps of a signal: its name, and how many times as wide as at commissioning they are.
    Steps(&'static str, f64),
}

impl Unseen {
    /// Factor on every sigma.
    #[must_use]
    pub fn factor(&self) -> f64 {
        match self {
            Self::RotorAngle(_) => OTHER_ANGLE_FACTOR,
            _ => UNSEEN_FACTOR,
        }
    }
}

/// Standard deviation of the torque for each ampere for each kelvin from the temperatures of commissioning, 1/K: samarium-cobalt loses 0.04 %,
/// neodymium 0.12 %, and 0.1 % are taken; magnets follow the winding late.
const MAGNET_SIGMA_PER_KELVIN: f64 = 3e-4;

/// Temperatures that a motor without a sensor may be off by from those of commissioning, K: most of −40 to 120 °C about a room's.
const UNKNOWN_TEMPERATURE_K: f64 = 90.0;

/// Temperature beyond the range that changes little, K.
const TEMPERATURE_MARGIN_K: f64 = 15.0;

/// Load beyond the range that changes little, as a share of what the motor can lift.
const LOAD_MARGIN: f64 = 0.05;

/// Travel and current within a factor of this to the range are the same motion.
const MOTION_FACTOR: f64 = 2.0;

/// Sampling rates within this share of each other are one: steps and derivatives are alike.
pub const RATE_MARGIN: f64 = 0.02;

/// Factor on the steps of a signal from which on they are other ones.
const COARSER: f64 = 3.0;

/// Travel beyond the range of the same motion, as a share.
const TRAVEL_MARGIN: f64 = 0.01;

impl Seen {
    /// The ranges of several windows.
    #[must_use]
    pub fn of(windows: &[Motion]) -> Self {
        let range = |values: Vec<f64>| {
            let least = values.iter().copied().reduce(f64::min)?;
            Some([least, values.iter().copied().fold(least, f64::max)])
        };
        Self {
            winding_temp_deg_c: range(windows.iter().filter_map(|window| window.winding_temp_deg_c).collect()),
            load_torque_nm: range(windows.iter().filter_map(|window| window.load_torque).collect()),
            travel_rad: range(windows.iter().map(|window| window.travel).collect()).unwrap_or_default(),
            current_rms_a: range(windows.iter().map(|window| window.current_rms).collect()).unwrap_or_default(),
            position_mode: windows.iter().any(|window| !window.is_speed_mode),
            speed_mode: windows.iter().any(|window| window.is_speed_mode),
            sample_rate_hz: windows.first().map(|window| window.sample_rate_hz),
            steps: core::array::from_fn(|signal| {
                let steps = windows.iter().map(|window| window.steps[signal]);
                steps.filter(|step| *step > 0.0).reduce(f64::min).unwrap_or(0.0)
            }),
            no_output_angle: !windows.iter().any(|window| window.has_output_angle),
            setpoint_held_s: windows.iter().map(|window| window.setpoint_held_s).fold(0.0, f64::max),
            rotor_sectors: None,
        }
    }

    /// Winding temperature of a window for the relations, by its reading, °C; without one as warm as at commissioning, and `None` where that
    /// was without readings.
    #[must_use]
    pub fn winding_temp(&self, read: Option<f64>) -> Option<WindingTemp> {
        let [low, high] = self.winding_temp_deg_c?;
        let commissioned = 0.5 * (low + high);
        Some(WindingTemp {
            now: read.unwrap_or(commissioned),
            commissioned,
        })
    }

    /// One standard deviation of the torque for each ampere in a window of this temperature, 1: magnets are not all alike, nor always as warm
    /// as the winding.
    #[must_use]
    pub fn magnet_sigma(&self, read: Option<f64>) -> f64 {
        let off = self.winding_temp(read).map_or(0.0, |temp| temp.now - temp.commissioned);
        MAGNET_SIGMA_PER_KELVIN * off.abs()
    }

    /// Largest share by which the torque for each ampere may have changed since commissioning, where the winding temperature of then or of a
    /// window is not known; 0 where both are.
    #[must_use]
    pub fn torque_change_max(&self, read: Option<f64>) -> f64 {
        if read.is_some() && self.winding_temp_deg_c.is_some() {
            0.0
        } else {
            (BACK_EMF_PER_KELVIN * UNKNOWN_TEMPERATURE_K).abs()
        }
    }

    /// The same with the sectors of the rotor, which matter behind a spring, and where the motor makes a part of a turn from sample to sample;
    /// windows from many show in their scatter what depends on it.
    #[must_use]
    pub fn with_sectors(self, windows: &[Motion]) -> Self {
        let (mut begun, mut sectors) = ([false; SECTORS], [[false; SECTORS]; 2]);
        for window in windows {
            begun[sector(window.rotor_angle)] = true;
            for near in [window.rotor_angle - ANGLE_MARGIN, window.rotor_angle + ANGLE_MARGIN] {
                sectors[usize::from(window.is_forward)][sector(near)] = true;
            }
        }
        let are_many = begun.iter().filter(|begun| **begun).count() >= MANY_SECTORS;
        Self {
            rotor_sectors: (!are_many).then_some(sectors),
            ..self
        }
    }

    /// Whether a window moves as those did: in one of their modes, as far as they. Windows of one command differ by a tenth of the margin,
    /// also with a load or worn parts.
    #[must_use]
    pub fn is_same_motion(&self, window: &Motion) -> bool {
        let [least, most] = self.travel_rad;
        let as_far = (least * (1.0 - TRAVEL_MARGIN)..=most * (1.0 + TRAVEL_MARGIN)).contains(&window.travel);
        as_far && self.is_mode_seen(window)
    }

    /// Whether a window was sampled at another rate than those.
    #[must_use]
    pub fn is_other_rate(&self, window: &Motion) -> bool {
        self.sample_rate_hz
            .is_some_and(|seen| (window.sample_rate_hz / seen - 1.0).abs() > RATE_MARGIN)
    }

    fn is_mode_seen(&self, window: &Motion) -> bool {
        if window.is_speed_mode {
            self.speed_mode
        } else {
            self.position_mode
        }
    }

    /// In what a window is outside the ranges.
    #[must_use]
    pub fn unseen(&self, window: &Motion, params: &ActuatorParams) -> Vec<Unseen> {
        let outside = |[min, max]: [f64; 2], margin: f64, value: f64| value < min - margin || value > max + margin;
        let mut unseen = Vec::new();
        if let (Some(range), Some(found)) = (self.winding_temp_deg_c, window.winding_temp_deg_c)
            && outside(range, TEMPERATURE_MARGIN_K, found)
        {
            unseen.push(Unseen::WindingTemp(range, found));
        }
        let load_margin = LOAD_MARGIN * Scale::new(params).load_unit();
        if let (Some(range), Some(found)) = (self.load_torque_nm, window.load_torque)
            && outside(range, load_margin, found)
        {
            unseen.push(Unseen::LoadTorque(range, found));
        }
        let is_other = |[min, max]: [f64; 2], value: f64| value < min / MOTION_FACTOR || value > max * MOTION_FACTOR;
        if is_other(self.travel_rad, window.travel) {
            unseen.push(Unseen::Travel(self.travel_rad, window.travel));
        }
        if is_other(self.current_rms_a, window.current_rms) {
            unseen.push(Unseen::Current(self.current_rms_a, window.current_rms));
        }
        if !self.is_mode_seen(window) {
            unseen.push(Unseen::Mode);
        }
        if let Some(seen) = self.sample_rate_hz
            && self.is_other_rate(window)
        {
            unseen.push(Unseen::SampleRate(seen, window.sample_rate_hz));
        }
        let names = ["currents", "motor angle", "output angle"];
        for ((name, seen), found) in names.into_iter().zip(self.steps).zip(window.steps) {
            let factor = found / seen;
            if factor.is_finite() && factor > COARSER {
                unseen.push(Unseen::Steps(name, factor));
            }
        }
        let here = sector(window.rotor_angle);
        if self
            .rotor_sectors
            .is_some_and(|seen| !seen[usize::from(window.is_forward)][here])
        {
            unseen.push(Unseen::RotorAngle(window.rotor_angle));
        }
        unseen
    }
}

impl fmt::Display for Unseen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::WindingTemp([min, max], found) => {
                write!(f, "winding at {found:.0} °C, commissioned at {min:.0} to {max:.0} °C")
            }
            Self::LoadTorque([min, max], found) => {
                write!(f, "load {found:.1} Nm, commissioned with {min:.1} to {max:.1} Nm")
            }
            Self::Travel([min, max], found) => {
                write!(f, "travel {found:.3} rad, commissioned with {min:.3} to {max:.3} rad")
            }
            Self::Current([min, max], found) => {
                write!(f, "current {found:.2} A rms, commissioned with {min:.2} to {max:.2} A")
            }
            Self::Mode => write!(f, "a mode that commissioning has not seen"),
            Self::SampleRate(seen, found) => write!(f, "{found:.1} samples/s, commissioned at {seen:.1}"),
            Self::Steps(name, factor) => write!(f, "{name} in steps {factor:.0} times as wide as at commissioning"),
            Self::RotorAngle(found) => {
                let found = found.to_degrees();
                write!(
                    f,
                    "begins at {found:.0}° electrical, commissioned from other angles in this direction"
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_unseen_in_what_is_outside_the_ranges() {
        let params = ActuatorParams::bench();
        let usual = Motion {
            winding_temp_deg_c: Some(20.0),
            load_torque: None,
            travel: 0.25,
            current_rms: 3.0,
            rotor_angle: 0.1,
            is_forward: true,
            is_speed_mode: false,
            sample_rate_hz: 2000.0,
            steps: [1e-3, 1.0, 1.0],
            has_output_angle: true,
            setpoint_held_s: 0.0,
        };
        let seen = Seen::of(&[
            usual,
            Motion {
                current_rms: 4.0,
                ..usual
            },
        ]);
        assert_eq!(
            seen.unseen(
                &Motion {
                    load_torque: Some(50.0),
                    ..usual
                },
                &params
            ),
            []
        );
        for (window, expected) in [
            (
                Motion {
                    winding_temp_deg_c: Some(60.0),
                    ..usual
                },
                Unseen::WindingTemp([20.0, 20.0], 60.0),
            ),
            (Motion { travel: 0.1, ..usual }, Unseen::Travel([0.25, 0.25], 0.1)),
            (
                Motion {
                    sample_rate_hz: 400.0,
                    ..usual
                },
                Unseen::SampleRate(2000.0, 400.0),
            ),
            (
                Motion {
                    current_rms: 9.0,
                    ..usual
                },
                Unseen::Current([3.0, 4.0], 9.0),
            ),
            (
                Motion {
                    is_speed_mode: true,
                    ..usual
                },
                Unseen::Mode,
            ),
            (
                Motion {
                    steps: [0.05, 0.0, 2.0],
                    ..usual
                },
                Unseen::Steps("currents", 50.0),
            ),
        ] {
            assert_eq!(seen.unseen(&window, &params), [expected]);
        }
        for (travel, is_speed_mode, expected) in [
            (0.25, false, true),
            (0.252, false, true),
            (0.255, false, false),
            (0.25, true, false),
        ] {
            let window = Motion {
                travel,
                is_speed_mode,
                ..usual
            };
            assert_eq!(seen.is_same_motion(&window), expected, "{travel} {is_speed_mode}");
        }
    }

    #[test]
    fn behind_a_spring_a_window_begins_where_commissioning_did() {
        let params = ActuatorParams::bench();
        let at = |rotor_angle: f64| Motion {
            rotor_angle,
            ..Motion::of(&params, &[])
        };
        let windows = [at(0.1), at(0.2)];
        let anywhere = Seen::of(&windows);
        let seen = anywhere.with_sectors(&windows);
        for near in [0.0, 0.5, 6.2] {
            assert_eq!(seen.unseen(&at(near), &params), [], "{near}");
        }
        assert_eq!(seen.unseen(&at(0.8), &params), [Unseen::RotorAngle(0.8)]);
        assert_eq!(seen.unseen(&at(3.0), &params), [Unseen::RotorAngle(3.0)]);
        let forward = Motion {
            is_forward: true,
            ..at(0.1)
        };
        assert_eq!(seen.unseen(&forward, &params), [Unseen::RotorAngle(0.1)]);
        assert_eq!(anywhere.unseen(&at(3.0), &params), []);
        let many: Vec<Motion> = (0..6).map(|n| at(f64::from(n))).collect();
        assert_eq!(anywhere.with_sectors(&many).rotor_sectors, None);
    }
}
