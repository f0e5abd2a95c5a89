//! What a data sheet says of the power electronics of an actuator type.

/// Kind of the power electronics and of their current control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveKind {
    /// One hysteresis comparator per phase.
    #[default]
    Hysteresis,
    /// Current control in the rotor frame with pulse-width modulation.
    Vector,
}

impl DriveKind {
    /// Both kinds by name.
    pub const NAMES: [(&'static str, Self); 2] = [("hysteresis", Self::Hysteresis), ("vector", Self::Vector)];

    /// Name of the kind.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hysteresis => "hysteresis",
            Self::Vector => "vector",
        }
    }
}

/// Drive of an actuator type. What is not known is `None`; the parameters belong to the vector drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveParams {
    /// Kind.
    pub kind: DriveKind,
    /// Carrier frequency 1/T_p, Hz.
    pub pwm_frequency: Option<f64>,
    /// Bandwidth of the current control, Hz.
    pub current_bandwidth: Option<f64>,
    /// Dead time between the two switches of a leg, s, as far as the drive does not compensate it.
    pub dead_time: Option<f64>,
    /// Share of the rotational voltages that the drive adds to its own, 0 to 1.
    pub decoupling: Option<f64>,
}

impl DriveParams {
    /// The drive of a built-in type: `servo270` has a vector drive, 16 kHz, 700 Hz, dead time fully compensated, with decoupling;
    /// every other type hysteresis comparators. All values declared here.
    #[must_use]
    pub fn of_built_in(type_name: &str) -> Self {
        match type_name {
            "servo270" => Self {
                kind: DriveKind::Vector,
                pwm_frequency: Some(16e3),
                current_bandwidth: Some(700.0),
                dead_time: Some(0.0),
                decoupling: Some(1.0),
            },
            _ => Self::default(),
        }
    }
}
