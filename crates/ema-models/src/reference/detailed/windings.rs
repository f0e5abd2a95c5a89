//! Electrical step of three phases with saturation and shorted turns, in star connection.

use crate::params::{MotorParams, REFERENCE_STEP};
use crate::reference::effects::{Effects, MotorEffects, ShortedPhase};

/// Electrical parameters of one motor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Windings {
    turns: [f64; 3],
    /// N_j R, Ω.
    r: [f64; 3],
    /// N_j² L / Δt, Ω.
    l_over_dt: [f64; 3],
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
            l_over_dt: turns.map(|n| n * n * motor.l_s / REFERENCE_STEP),
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

    /// One step of 1 µs of the currents: `v_j − v_n = N R i_j + N² L di_j/dt + N e_j` and what the shorted turns add.
    ///
    /// `emf` are the back-EMFs e_j of full phases, V. Resistances are taken at the end of the step (backward Euler); the star
    /// point's potential v_n follows from Σ Δi_j = 0.
    pub(super) fn step(&self, v: [f64; 3], emf: [f64; 3], i: &mut [f64; 3], i_short: &mut [f64; 3]) {
        let (mut driving, mut impedance, mut seen) = ([0.0; 3], [0.0; 3], [None; 3]);
        for j in 0..3 {
            let saturation = self.motor.inductance_factor(i[j] * self.per_i_max);
            impedance[j] = self.r[j] + saturation * self.l_over_dt[j];
            driving[j] = v[j] - self.turns[j] * emf[j] - self.r[j] * i[j];
            if let Some(shorted) = &self.shorted[j] {
                let turns = shorted.step(i[j], i_short[j], emf[j], saturation);
                driving[j] -= turns.voltage;
                impedance[j] += turns.impedance;
                seen[j] = Some(turns);
            }
        }
        // Admittances times the product of all impedances: one division instead of three.
        let [a, b, c] = impedance;
        let others = [b * c, c * a, a * b];
        let v_n = (driving[0] * others[0] + driving[1] * others[1] + driving[2] * others[2])
            / (others[0] + others[1] + others[2]);
        let per_product = 1.0 / (a * others[0]);
        for j in 0..3 {
            let change = (driving[j] - v_n) * (others[j] * per_product);
            i[j] += change;
            if let Some(turns) = &seen[j] {
                i_short[j] += turns.change(change);
            }
        }
    }
}
