//! The compared signals of a window, and their weights.

use crate::samples::ComparedSample;

/// Number of compared signals.
pub const SIGNAL_COUNT: usize = 5;

/// One number per compared signal: `i_d`, `i_q`, motor angle, motor speed, output angle.
///
/// The three phase currents are compared in the rotor frame, which is equivalent: at any angle
/// `Σ r_j² = 3/2 (r_d² + r_q²)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signals<T> {
    /// Direct current, A.
    pub i_d: T,
    /// Quadrature current, A.
    pub i_q: T,
    /// Motor angle, rad.
    pub theta_m: T,
    /// Motor speed, rad/s.
    pub omega_m: T,
    /// Output angle, rad.
    pub theta_out: T,
}

impl Signals<f64> {
    /// The measured signals of a sample.
    #[inline(always)]
    #[must_use]
    pub fn from_sample(sample: &ComparedSample) -> Self {
        Self {
            i_d: sample.i_d,
            i_q: sample.i_q,
            theta_m: sample.theta_m,
            omega_m: sample.omega_m,
            theta_out: sample.theta_out,
        }
    }
}

impl<T: Copy> Signals<T> {
    /// The signals in another number type.
    #[inline(always)]
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(T) -> S) -> Signals<S> {
        Signals {
            i_d: f(self.i_d),
            i_q: f(self.i_q),
            theta_m: f(self.theta_m),
            omega_m: f(self.omega_m),
            theta_out: f(self.theta_out),
        }
    }

    /// As an array, in the order of the fields.
    #[must_use]
    pub fn to_array(self) -> [T; SIGNAL_COUNT] {
        [self.i_d, self.i_q, self.theta_m, self.omega_m, self.theta_out]
    }

    /// From an array, in the order of the fields.
    #[must_use]
    pub fn from_array(a: [T; SIGNAL_COUNT]) -> Self {
        Self {
            i_d: a[0],
            i_q: a[1],
            theta_m: a[2],
            omega_m: a[3],
            theta_out: a[4],
        }
    }
}

/// Weight of each signal: the inverse of its expected residual (1/A, 1/rad, s/rad); 0 omits the signal.
pub type Weights = Signals<f64>;

impl Weights {
    /// Only the quadrature current, as in \[P\].
    pub const CURRENT_ONLY: Self = Self {
        i_d: 0.0,
        i_q: 1.0,
        theta_m: 0.0,
        omega_m: 0.0,
        theta_out: 0.0,
    };
}
