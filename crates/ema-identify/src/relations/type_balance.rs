//! Shorts, eccentricity, friction and load of one window by the torque balance of its type: where a search by the monitor begins.
//!
//! The balance takes the type's k, J, C and T_d as they are, so the result is as far off as the unit is off its type. It is linear,
//! whereas the current of a monitor follows the turns as `1/N`: from health, a descent to shorts of half the turns takes three times as
//! many steps.

use ema_models::{ActuatorParams, FaultVector};

use super::elements::Element;
use super::measured::MeasuredWindow;
use super::terms::{BalanceShape, TERM_COUNT, Term};
use super::torque_balance::{BalanceCoefficients, Turns, torque_balance};
use crate::monitor_fit::RecordedSample;

/// Half width of the kernel, s: of jittering samples, too.
const HALF_WIDTH_S: f64 = 6e-3;

/// What the balance says of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ByTypeBalance {
    /// Friction, shorts and eccentricity; the other faults are those of health.
    pub(crate) fault: FaultVector,
    /// Load torque at the output, Nm.
    pub(crate) load_torque: f64,
}

/// The faults of a window by the balance of its type; `None` where the motion is too short.
pub(crate) fn by_type_balance<S: RecordedSample>(
    params: &ActuatorParams,
    samples: &[S],
    filled: &[usize],
) -> Option<ByTypeBalance> {
    let window = MeasuredWindow::new(params, samples, filled);
    let found = torque_balance(&window, &of_type(params), 1.0, None, Turns::Healthy);
    let value = |element: Element| found.readings.get(element).ok().map(|reading| reading.value);
    let short = |element: Element| Some((1.0 - value(element)?).clamp(0.0, SHORT_MAX));
    let healthy = FaultVector::NOMINAL;
    let (cos, sin) = (value(Element::EccentricityCos)?, value(Element::EccentricitySin)?);
    let phase = 0.5 * (libm::atan2(sin, cos) / core::f64::consts::PI + 1.0);
    Some(ByTypeBalance {
        fault: FaultVector {
            // T_d (1 + 2 k1).
            friction: value(Element::Friction).map_or(0.0, |scale| (0.5 * (scale - 1.0)).clamp(0.0, 1.0)),
            short_a: short(Element::TurnsA)?,
            short_b: short(Element::TurnsB)?,
            short_c: short(Element::TurnsC)?,
            eccentricity: libm::hypot(cos, sin).min(ECCENTRICITY_MAX),
            eccentricity_phase: phase,
            ..healthy
        },
        load_torque: found.load.constant,
    })
}

/// Largest damage that a search begins at.
const SHORT_MAX: f64 = 0.9;
const ECCENTRICITY_MAX: f64 = 0.9;

/// The balance of a type.
fn of_type(params: &ActuatorParams) -> BalanceCoefficients {
    let mut values = [0.0; TERM_COUNT];
    for (term, value) in [
        (Term::TurnsA, 1.0),
        (Term::TurnsB, 1.0),
        (Term::TurnsC, 1.0),
        (Term::Inertia, params.motor.j),
        (Term::Damping, params.motor.c),
        (Term::DryFriction, params.transmission.friction_dynamic),
        (Term::SetpointHold, 0.5),
        (Term::GearLoss, 1.0),
    ] {
        values[term as usize] = value;
    }
    BalanceCoefficients {
        values,
        shape: BalanceShape::usual(params),
        residual_rms: f64::INFINITY,
        half_width_s: HALF_WIDTH_S,
        angle_errors: false,
    }
}
