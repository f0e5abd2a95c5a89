//! Settings of a monitor: form of the motor model, source of its angles, calibration, operating conditions.

use super::Ripple;
use crate::unknowns::Unknowns;
use crate::winding::PaperShape;

/// Form of the motor model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// One equivalent phase with the shape functions of \[P\] eqs. 10 and 11 on resistance, back-EMF and torque.
    Paper(PaperShape),
    /// One equivalent phase with the derived shapes of resistance, inductance and back-EMF.
    OneAxis,
    /// Three averaged phases with the voltage limit of the inverter; unequal phases couple both axes.
    ThreePhase,
}

/// Source of the angles of the monitor's transmission and position loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Feedback {
    /// The simulated angles: the closed loop of \[P\]. Errors of the monitor accumulate, and the counts of the encoder make the
    /// cost uneven.
    Simulated,
    /// The measured angles: the motor angle drives the transmission, and the output counts drive the position loop, so that each
    /// element is compared by itself. Between two samples the output follows the motion of the motor; its position within a
    /// count is an estimate ([`theta_out_estimate`](crate::ComparedSample::theta_out_estimate)).
    #[default]
    Measured,
}

/// Parameters of the monitor of one actuator type that the calibration against the reference determines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Form of the motor model, with the coefficients of its shape functions.
    pub form: Form,
    /// Factor on the back-EMF coefficient k.
    pub back_emf: f64,
    /// Factor on the torque gain.
    pub torque: f64,
    /// Mean effect of the hysteresis band (three-phase form).
    pub ripple: Ripple,
    /// Time constant with which direct and quadrature current follow their references, s (three-phase form): 0 for comparators,
    /// about `1/(2π f)` for the current control of a vector drive with bandwidth f.
    pub current_time_constant: f64,
}

impl Calibration {
    /// A monitor of this form with the derived coefficients, without correction.
    #[must_use]
    pub fn uncorrected(form: Form) -> Self {
        Self {
            form,
            back_emf: 1.0,
            torque: 1.0,
            ripple: Ripple::default(),
            current_time_constant: 0.0,
        }
    }
}

impl Default for Calibration {
    fn default() -> Self {
        Self::uncorrected(Form::ThreePhase)
    }
}

/// Operating conditions of one window that are not faults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Measured load torque at the output, Nm; positive opposes positive motion. `None` without a sensor.
    pub load_torque: Option<f64>,
    /// DC link voltage, V.
    pub v_dc: f64,
    /// Measured winding temperature, °C. `None` without a sensor: the monitor then assumes 20 °C, and the effect of the
    /// difference is a part of the motor's unknown deviation.
    pub winding_temp_deg_c: Option<f64>,
}

impl Conditions {
    /// The unknowns with the motor's deviation at the measured temperature; `unknowns` has the deviation at 20 °C.
    #[must_use]
    pub fn at_temperature(&self, unknowns: &Unknowns) -> Unknowns {
        Unknowns {
            motor: match self.winding_temp_deg_c {
                Some(temperature) => unknowns.motor.at_temperature(temperature),
                None => unknowns.motor,
            },
            ..*unknowns
        }
    }
}
