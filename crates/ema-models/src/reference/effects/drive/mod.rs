//! Kinds of power electronics: hysteresis comparators, or a vector drive with pulse-width modulation.
//!
//! In: currents, rotor angle and speed, current reference, link voltage. Out: phase voltages of each step. The vector drive
//! switches: a step's voltage is the mean over its edges, whose instants are exact.

mod current_loop;
mod pwm;

pub(crate) use current_loop::{DriveInput, VectorControl, VectorState};

/// Kind of the power electronics and their current control.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Drive {
    /// One hysteresis comparator per phase ([`Inverter`](crate::reference::Inverter)).
    #[default]
    Hysteresis,
    /// Current control in the rotor frame with pulse-width modulation.
    Vector(VectorDrive),
}

impl Drive {
    /// Name of the kind: `hysteresis` or `vector`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hysteresis => "hysteresis",
            Self::Vector(_) => "vector",
        }
    }

    /// The kind of this name with its usual parameters.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "hysteresis" => Some(Self::Hysteresis),
            "vector" => Some(Self::Vector(VectorDrive::default())),
            _ => None,
        }
    }

    /// Changes parameters of the vector drive; a hysteresis drive becomes a vector drive with its usual parameters first.
    pub fn change_vector(&mut self, change: impl FnOnce(&mut VectorDrive)) {
        let mut drive = match *self {
            Self::Hysteresis => VectorDrive::default(),
            Self::Vector(drive) => drive,
        };
        change(&mut drive);
        *self = Self::Vector(drive);
    }
}

/// Vector drive: two PI current controllers, once per PWM period, whose voltages are applied one period later by a
/// centre-aligned carrier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VectorDrive {
    /// Carrier frequency 1/T_p, Hz.
    pub pwm_frequency: f64,
    /// Bandwidth ω_c / 2π of the current control, Hz: K_p = ω_c L, K_i = ω_c R.
    pub bandwidth: f64,
    /// Dead time t_d between the two switches of a leg, s.
    pub dead_time: f64,
    /// Share of the dead time's mean voltage that the drive adds to its reference.
    pub dead_time_compensation: f64,
    /// Share of −ω_e L i_q and ω_e L i_d + k ω_m that the drive adds to its d and q voltage.
    pub decoupling: f64,
    /// Largest demagnetising current −i_d that the drive commands when the voltage does not suffice, A.
    pub field_weakening: f64,
}

impl Default for VectorDrive {
    /// 20 kHz, 800 Hz, no dead time, full decoupling, i_d* = 0.
    fn default() -> Self {
        Self {
            pwm_frequency: 20e3,
            bandwidth: 800.0,
            dead_time: 0.0,
            dead_time_compensation: 0.0,
            decoupling: 1.0,
            field_weakening: 0.0,
        }
    }
}
