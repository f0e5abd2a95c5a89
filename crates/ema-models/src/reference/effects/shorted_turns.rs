//! Shorted turns that carry a current of their own.
//!
//! The fault vector says which share σ = 1 − N_j of the turns of phase j is shorted. Without this effect these turns are
//! missing; with it a resistance R_f bridges them.

/// Bridge over the shorted turns, the same in each phase with a short.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShortedTurns {
    /// Resistance R_f of the bridge, Ω; 0 for a bolted short.
    pub resistance: f64,
    /// Coupling c between the shorted and the other turns of a phase.
    pub coupling: f64,
}

impl Default for ShortedTurns {
    /// A bolted short with c = 0.9.
    fn default() -> Self {
        Self {
            resistance: 0.0,
            coupling: 0.9,
        }
    }
}
