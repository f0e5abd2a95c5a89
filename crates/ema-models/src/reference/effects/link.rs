//! DC link that is not stiff.

/// Effects of the supply on the DC link voltage: `V = V_dc − R_link i_dc + V_w sin 2π f_w t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkEffects {
    /// Resistance R_link of the supply, Ω. The link's capacitor smooths i_dc with a time constant of 1 ms.
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
