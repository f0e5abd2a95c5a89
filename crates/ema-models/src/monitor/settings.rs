//! What a monitor is set up with: form, source of its angles, calibration, operating conditions.

use super::Ripple;
use crate::unknowns::Unknowns;
use crate::winding::PaperShape;

/// How the monitor sees the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// One equivalent phase with the shape functions of \[P\] eqs. 10 and 11 on resistance, back-EMF and torque.
    Paper(PaperShape),
    /// One equivalent phase with the derived shapes of resistance, inductance and back-EMF.
    OneAxis,
    /// Three averaged phases with the inverter's voltage limit: both axes, coupled by unequal phases.
    ThreePhase,
}

/// Where the monitor's transmission and position loop take their angles from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Feedback {
    /// From the monitor itself: the paper's closed loop. Its own errors add up, and the encoder's steps make the cost
    /// rugged.
    Simulated,
    /// The transmission is driven by the measured motor angle, and the position loop by the measured output counts:
    /// both are known, so each element is judged by itself. Between two samples the output turns as the motor does; what
    /// was read tells where in its count it is ([`theta_read`](crate::ComparedSample::theta_read)).
    #[default]
    Measured,
}

/// What calibration against the reference may change in a monitor of one type of actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Form of the motor model, with the shapes' coefficients.
    pub form: Form,
    /// Factor on the back-EMF coefficient k.
    pub back_emf: f64,
    /// Factor on the torque gain.
    pub torque: f64,
    /// Mean effect of the hysteresis band (three-phase form).
    pub ripple: Ripple,
}

impl Calibration {
    /// A monitor of the given form as derived, without any correction.
    #[must_use]
    pub fn none(form: Form) -> Self {
        Self {
            form,
            back_emf: 1.0,
            torque: 1.0,
            ripple: Ripple::default(),
        }
    }
}

impl Default for Calibration {
    fn default() -> Self {
        Self::none(Form::ThreePhase)
    }
}

/// Operating conditions of one window that are not faults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Measured load torque at the output, Nm; positive opposes positive motion. `None` where nobody measures it.
    pub load_torque: Option<f64>,
    /// DC link voltage, V.
    pub v_dc: f64,
    /// Measured winding temperature, °C. `None` where nobody measures it: the motor is then taken to be at 20 °C, and how far
    /// it is from that is part of its unknown deviation.
    pub winding_temp_deg_c: Option<f64>,
}

impl Conditions {
    /// Unknowns, whose motor is at 20 °C, with the motor at the measured temperature.
    #[must_use]
    pub fn warmed(&self, unknowns: &Unknowns) -> Unknowns {
        Unknowns {
            motor: match self.winding_temp_deg_c {
                Some(temperature) => unknowns.motor.at_temperature(temperature),
                None => unknowns.motor,
            },
            ..*unknowns
        }
    }
}
