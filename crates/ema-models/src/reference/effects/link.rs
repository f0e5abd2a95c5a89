//! DC link that is not stiff.

use crate::real::Real;

/// Effects of the supply on the DC link voltage: `V = V_dc − R_link i_dc + V_w sin 2π f_w t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkEffects {
    /// Resistance R_link of the supply, Ω. The link's capacitor smooths i_dc with a time constant of 1 ms. A
    /// brake chopper keeps regenerated power from lifting the link above 2 V_dc.
    pub resistance: f64,
    /// Amplitude V_w of the ripple, V.
    pub ripple: f64,
    /// Frequency f_w of the ripple, Hz.
    pub ripple_frequency: f64,
}

impl Default for LinkEffects {
    /// Stiff. When a ripple is set, it has 300 Hz, that of a six-pulse rectifier at 50 Hz.
    fn default() -> Self {
        Self {
            resistance: 0.0,
            ripple: 0.0,
            ripple_frequency: 300.0,
        }
    }
}

/// Time constant with which the link's capacitor smooths the current, s.
const SMOOTHING: f64 = 1e-3;

/// Smallest voltage of the link, as a share of the nominal one.
const FLOOR: f64 = 0.05;

/// Largest voltage to which regenerated power lifts the link, as a share of the nominal one: a brake chopper takes the rest.
const CEILING: f64 = 2.0;

impl LinkEffects {
    /// Voltage at a time, s, for the smoothed current of the link, A, in V.
    pub(crate) fn voltage(&self, v_dc: f64, current: f64, t: f64) -> f64 {
        let mut v = (v_dc - self.resistance * current).min(CEILING * v_dc);
        if self.ripple > 0.0 {
            v += self.ripple * (core::f64::consts::TAU * self.ripple_frequency * t).sin_cos_poly().0;
        }
        v.max(FLOOR * v_dc)
    }

    /// Whether the voltage depends on the current.
    pub(crate) fn sags(&self) -> bool {
        self.resistance > 0.0
    }

    /// Smoothed current after a step with the instantaneous current `now`, A.
    pub(crate) fn smoothed(&self, current: f64, now: f64, dt: f64) -> f64 {
        current + (now - current) * (dt / SMOOTHING)
    }
}
