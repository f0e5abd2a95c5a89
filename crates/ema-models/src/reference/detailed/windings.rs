//! Electrical step of three phases with saturation and shorted turns, in star connection.

use crate::params::MotorParams;
use crate::reference::effects::{Effects, MotorEffects, ShortedPhase};

/// Electrical parameters of one motor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Windings {
    turns: [f64; 3],
    /// N_j R, Ω.
    r: [f64; 3],
    /// N_j² L, H.
    l: [f64; 3],
    per_i_max: f64,
    motor: MotorEffects,
    shorted: [Option<ShortedPhase>; 3],
}

impl Windings {
    /// The windings of a motor with these winding turns ratios.
    pub(super) fn new(motor: &MotorParams, turns: [f64; 3], effects: &Effects) -> Self {
        Self {
            turns,
            r: turns.map(|n| n * motor.r_s),
            l: turns.map(|n| n * n * motor.l_s),
            per_i_max: 1.0 / motor.i_max,
            motor: effects.motor,
            shorted: turns.map(|n| {
                effects
                    .shorted_turns
                    .and_then(|turns| ShortedPhase::new(&turns, motor, n))
            }),
        }
    }

    /// Current that links all turns of each phase as much as its turns' currents do: `N i_j + σ i_f`, A.
    pub(super) fn linked(&self, i: [f64; 3], i_short: [f64; 3]) -> [f64; 3] {
        core::array::from_fn(|j| {
            let rest = self.turns[j] * i[j];
            match &self.shorted[j] {
                None => rest,
                Some(shorted) => rest + shorted.share * i_short[j],
            }
        })
    }

    /// One step of the currents: `v_j − v_n = N R i_j + N² L di_j/dt + N e_j` and what the shorted turns add.
    ///
    /// `emf` are the back-EMFs e_j of full phases, V. Resistances are taken at the end of the step (backward Euler); the star
    /// point's potential v_n follows from Σ Δi_j = 0.
    pub(super) fn step(&self, v: [f64; 3], emf: [f64; 3], i: &mut [f64; 3], i_short: &mut [f64; 3], dt: f64) {
        let (mut driving, mut admittance, mut seen) = ([0.0; 3], [0.0; 3], [None; 3]);
        let (mut weighted, mut weights) = (0.0, 0.0);
        for j in 0..3 {
            let saturation = self.motor.inductance_factor(i[j] * self.per_i_max);
            let mut impedance = self.r[j] + saturation * self.l[j] / dt;
            driving[j] = v[j] - self.turns[j] * emf[j] - self.r[j] * i[j];
            if let Some(shorted) = &self.shorted[j] {
                let turns = shorted.step(i[j], i_short[j], emf[j], saturation, dt);
                driving[j] -= turns.voltage;
                impedance += turns.impedance;
                seen[j] = Some(turns);
            }
            admittance[j] = 1.0 / impedance;
            weighted += driving[j] * admittance[j];
            weights += admittance[j];
        }
        let v_n = weighted / weights;
        for j in 0..3 {
            let change = (driving[j] - v_n) * admittance[j];
            i[j] += change;
            if let Some(turns) = &seen[j] {
                i_short[j] += turns.change(change);
            }
        }
    }
}
