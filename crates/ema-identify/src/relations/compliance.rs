//! A compliant transmission as the motor sees it.
//!
//! Motor and load are two masses with a spring K and a damper D between them. The motor shaft gives the transmission
//! `T − J_m θ_m'' − …`, and the load takes it behind a twist of that over `K + D s`. Multiplied by the load's denominator, so that
//! nothing is divided by a small number at its resonance, the balance of the motor shaft becomes, s being the derivative,
//!
//! `(1 + q s + s²/ω_a²) (T − C ω − …) = J (1 + q s + s²/ω_r²) θ_m'' + load side`,
//!
//! `ω_a² = K/J_l` (motor locked), `ω_r² = K J/(J_m J_l)` (motor free), `q = D/K`. It is local in time, and for given numbers linear in
//! what it was linear in before: the two factors become a part of the kernel. What the load side bears changes slowly, so that it may
//! take either factor. Within the play nothing is transmitted and the equation does not hold; with a healthy play those rows add to the
//! residual. Derived here.

/// A transmission's spring and damper between two masses.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct Compliance {
    /// `J_l/K = 1/ω_a²`, s²; 0 for a rigid transmission.
    pub locked: f64,
    /// `J_m J_l/(J K) = 1/ω_r²`, s².
    pub free: f64,
    /// `D/K`, s.
    pub lag: f64,
}

impl Compliance {
    /// One rigid mass.
    pub const RIGID: Self = Self {
        locked: 0.0,
        free: 0.0,
        lag: 0.0,
    };

    /// Whether motor and load are one mass.
    #[must_use]
    pub fn is_rigid(&self) -> bool {
        *self == Self::RIGID
    }

    /// Of the resonance with both masses free, Hz, its damping ratio, and the load's share of the inertia.
    #[must_use]
    pub fn new(resonance_hz: f64, damping_ratio: f64, load_share: f64) -> Self {
        let omega = core::f64::consts::TAU * resonance_hz;
        let free = 1.0 / (omega * omega);
        Self {
            locked: free / (1.0 - load_share),
            free,
            lag: 2.0 * damping_ratio / omega,
        }
    }
}

impl Default for Compliance {
    fn default() -> Self {
        Self::RIGID
    }
}
