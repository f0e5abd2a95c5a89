//! The change of one element since commissioning as a fault parameter, its systematic error, and what a window lacks that does not show it.

use ema_models::ActuatorParams;

use super::elements::{Element, Needed, Reading};

/// The fault parameter that belongs to a reading; for the eccentricity one component of its change.
pub(super) fn change(
    element: Element,
    Reading { value, sigma }: Reading,
    unit: f64,
    params: &ActuatorParams,
) -> Reading {
    let play_per_k2 = 99.0 * params.transmission.backlash;
    let [value, slope] = match element {
        Element::Friction => [0.5 * (value / unit - 1.0), 0.5 / unit],
        Element::Backlash => [(value - unit) / play_per_k2, 1.0 / play_per_k2],
        Element::TurnsA | Element::TurnsB | Element::TurnsC => [1.0 - value / unit, 1.0 / unit],
        Element::EccentricityCos | Element::EccentricitySin => [value - unit, 1.0],
        Element::Gain => [value / unit - 0.5, 1.0 / unit],
    };
    Reading {
        value,
        sigma: sigma * libm::fabs(slope),
    }
}

/// The parameter of an element that has not changed.
pub(super) fn healthy(element: Element) -> f64 {
    if element == Element::Gain { 0.5 } else { 0.0 }
}

/// Systematic error of a change that neither its covariance nor the scatter of healthy windows shows.
pub(super) struct ModelError {
    /// Standard deviation as a share of the change.
    pub(super) share: f64,
    /// Standard deviation whatever the change: what other worn parts add.
    pub(super) floor: f64,
}

impl ModelError {
    /// Systematic errors at a sample rate, Hz.
    ///
    /// Friction: what the torque does between the samples, beyond [`Term::SetpointHold`](super::Term::SetpointHold). Gain: the
    /// differentiated law leaves out current loop, delay and the quantised feedback; twice the root-mean-square error of 1152 windows of the
    /// suite `robust` at 2 kHz. Others: largest bias over the units of
    /// `tests/relations_units.rs`, mixed motion, at 400 Hz to 5 kHz. Turns and eccentricity: the share of the window's torque that its
    /// samples do not show; of turns also the `asymmetry` of the healthy windows that is none of the motor.
    pub(super) fn of(element: Element, sample_rate: f64, unseen: f64, asymmetry: f64) -> Self {
        let slower = 2000.0 / sample_rate;
        let (share, floor) = match element {
            Element::Friction => (0.03 * slower, 0.006 * slower),
            Element::Gain => (0.025 * slower.max(1.0), 0.003 * slower.max(1.0)),
            Element::Backlash => (0.01, 0.001),
            Element::TurnsA | Element::TurnsB | Element::TurnsC => (libm::hypot(0.01, unseen), 0.002 + asymmetry),
            Element::EccentricityCos | Element::EccentricitySin => (libm::hypot(0.01, unseen), 0.002),
        };
        Self { share, floor }
    }
}

/// What a window needs whose estimate of an element is too uncertain.
pub(super) fn needed_for(element: Element) -> Needed {
    match element {
        Element::Friction => Needed::LongerMotion,
        Element::Backlash => Needed::Reversal,
        Element::TurnsA | Element::TurnsB | Element::TurnsC | Element::EccentricityCos | Element::EccentricitySin => {
            Needed::MoreCurrent
        }
        Element::Gain => Needed::UnsaturatedControl,
    }
}
