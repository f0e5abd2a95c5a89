//! The motor beyond sinusoidal back-EMF and constant inductance.

use crate::frames::abc_from_alpha_beta;

/// Back-EMF harmonics and saturation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorEffects {
    /// 5th harmonic h₅ relative to the fundamental; its part of phase j is `−h₅ sin 5(θ_e − 2πj/3)`.
    pub harmonic_5: f64,
    /// 7th harmonic h₇ relative to the fundamental; its part of phase j is `−h₇ sin 7(θ_e − 2πj/3)`.
    pub harmonic_7: f64,
    /// Share s of the inductance that is lost at I_max: `L_j(i) = L_j (1 − s (i/I_max)²)`, constant beyond I_max.
    pub saturation: f64,
}

impl MotorEffects {
    /// Adds the harmonics to the back-EMF shapes of three full phases at the electrical angle with this sine and cosine.
    ///
    /// `5 (θ_e − 2πj/3) = 5 θ_e + 2πj/3` and `7 (θ_e − 2πj/3) = 7 θ_e − 2πj/3`, up to whole turns: the 5th harmonic revolves
    /// backwards. An eccentric rotor modulates only the fundamental.
    pub(crate) fn add_harmonics(&self, shapes: &mut [f64; 3], (sin, cos): (f64, f64)) {
        if libm::fabs(self.harmonic_5) + libm::fabs(self.harmonic_7) <= 0.0 {
            return;
        }
        let times = |(s, c): (f64, f64), (t, d): (f64, f64)| (s * d + c * t, c * d - s * t);
        let double = times((sin, cos), (sin, cos));
        let (sin_5, cos_5) = times(times(double, double), (sin, cos));
        let (sin_7, cos_7) = times((sin_5, cos_5), double);
        let added = abc_from_alpha_beta([
            -self.harmonic_5 * sin_5 - self.harmonic_7 * sin_7,
            -self.harmonic_5 * cos_5 + self.harmonic_7 * cos_7,
        ]);
        for (shape, added) in shapes.iter_mut().zip(added) {
            *shape += added;
        }
    }

    /// Inductance relative to that without current, at a phase current relative to I_max.
    pub(crate) fn inductance_factor(&self, current: f64) -> f64 {
        1.0 - self.saturation * (current * current).min(1.0)
    }
}
