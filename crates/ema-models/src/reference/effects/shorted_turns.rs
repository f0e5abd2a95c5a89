//! Shorted turns that carry a current of their own.
//!
//! The fault vector says which share σ = 1 − N_j of the turns of phase j is shorted. Without this effect these turns are
//! missing; with it a resistance R_f bridges them.

use crate::params::{MotorParams, REFERENCE_STEP};

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

/// Shorted turns of one phase, with the rest of the phase: its current i_j flows through N of the turns, i_f through σ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ShortedPhase {
    /// σ = 1 − N.
    pub(crate) share: f64,
    /// σ R, Ω.
    r: f64,
    /// R_f, Ω.
    bridge: f64,
    /// σ² L / Δt, Ω.
    l_over_dt: f64,
    /// Mutual inductance over the step, c N σ L / Δt, Ω.
    mutual_over_dt: f64,
}

/// The shorted turns over one step as seen by the rest of their phase.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenByPhase {
    /// Voltage over the phase at a constant i_j, V.
    pub(crate) voltage: f64,
    /// Further voltage per change of i_j over the step, Ω.
    pub(crate) impedance: f64,
    /// Change of i_f at a constant i_j, A.
    constant: f64,
    /// Change of i_f per change of i_j.
    slope: f64,
}

impl SeenByPhase {
    /// Change of i_f over the step for a change of i_j, A.
    pub(crate) fn change(&self, di_phase: f64) -> f64 {
        self.constant + self.slope * di_phase
    }
}

impl ShortedPhase {
    /// The shorted turns of a phase with this share of intact turns; `None` without a short.
    pub(crate) fn new(turns: &ShortedTurns, motor: &MotorParams, intact: f64) -> Option<Self> {
        let share = 1.0 - intact;
        (share > 0.0).then_some(Self {
            share,
            r: share * motor.r_s,
            bridge: turns.resistance,
            l_over_dt: share * share * motor.l_s / REFERENCE_STEP,
            mutual_over_dt: turns.coupling * intact * share * motor.l_s / REFERENCE_STEP,
        })
    }

    /// One step of 1 µs, solved for the change of i_f (backward Euler, since the leakage of the shorted turns is small):
    ///
    /// `0 = σR i_f + R_f (i_f − i_j) + σ²L di_f/dt + c N σ L di_j/dt + σ e_j`, and the rest of the phase sees
    /// `c N σ L di_f/dt + R_f (i_j − i_f)`. `emf` is the back-EMF e_j of the full phase, V; `saturation` the factor on all
    /// inductances.
    pub(crate) fn step(&self, i_phase: f64, i_short: f64, emf: f64, saturation: f64) -> SeenByPhase {
        let mutual = saturation * self.mutual_over_dt - self.bridge;
        let per_own = 1.0 / (self.r + self.bridge + saturation * self.l_over_dt);
        let constant = ((self.bridge * i_phase - self.share * emf) - (self.r + self.bridge) * i_short) * per_own;
        let slope = -mutual * per_own;
        SeenByPhase {
            voltage: self.bridge * (i_phase - i_short) + mutual * constant,
            impedance: self.bridge + mutual * slope,
            constant,
            slope,
        }
    }
}
