//! Coefficients of the torque balance of a unit or of a type.

use super::balance_shape::BalanceShape;
use super::kernel::Kernel;
use super::terms::{TERM_COUNT, Term};

/// Coefficients of the torque balance that all windows of one unit share, in the order of [`Term`].
///
/// The balance has no absolute scale of torque: `N_A + N_B + N_C = 3`, and J, T_d, C are relative to the type's k. Load and
/// spring are zero, because each window has its own.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct BalanceCoefficients {
    /// The coefficients.
    pub values: [f64; TERM_COUNT],
    /// Constants of the terms.
    pub shape: BalanceShape,
    /// Root-mean-square residual of the windows from which they were learnt, Nm.
    pub residual_rms: f64,
    /// Half width of the kernel, s.
    pub half_width_s: f64,
    /// Whether the errors of the rows are those of the motor angle, as jittering sample instants make them, instead of torques.
    pub angle_errors: bool,
}

impl BalanceCoefficients {
    /// Coefficient of a term.
    #[must_use]
    pub fn of(&self, term: Term) -> f64 {
        self.values[term as usize]
    }

    /// Largest difference between the turns of the phases, as a share, beyond what current sensors of a healthy motor leave: an error of
    /// the balance at the rotor angles of the commissioning windows, as of few samples in an electrical turn. Windows of the same motion
    /// have it too, others have another one.
    pub(super) fn hidden_asymmetry(&self) -> f64 {
        let largest = [Term::TurnsA, Term::TurnsB, Term::TurnsC].map(|term| libm::fabs(self.of(term) - 1.0));
        let largest = largest.into_iter().fold(0.0, f64::max);
        (largest - SENSOR_ASYMMETRY).max(0.0)
    }

    /// The kernel of its rows at a sample rate, Hz.
    pub(super) fn kernel(&self, sample_rate: f64) -> Kernel {
        Kernel::new(self.half_width_s, sample_rate, &self.shape.compliance)
    }
}

/// Difference between the turns of the phases, as a share, by gains of current sensors of 1 % and by their noise.
const SENSOR_ASYMMETRY: f64 = 0.03;
