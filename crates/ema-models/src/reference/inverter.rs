//! Inverter with one hysteresis comparator per phase: from current references and currents to phase voltages.

/// Three hysteresis comparators, each switching its phase between +V_dc/2 and −V_dc/2.
#[derive(Clone, Copy, Debug, Default)]
pub struct Inverter {
    high: [bool; 3],
}

impl Inverter {
    /// Phase voltages relative to the midpoint of the DC link, V.
    ///
    /// A phase switches to +V_dc/2 when its current deviation `i_ref − i` exceeds `half_band`, to −V_dc/2 when it falls below
    /// `−half_band`, and does not switch in between.
    pub fn switch(&mut self, i_ref: [f64; 3], i: [f64; 3], half_band: f64, v_dc: f64) -> [f64; 3] {
        core::array::from_fn(|j| {
            let error = i_ref[j] - i[j];
            if error > half_band {
                self.high[j] = true;
            } else if error < -half_band {
                self.high[j] = false;
            }
            if self.high[j] { 0.5 * v_dc } else { -0.5 * v_dc }
        })
    }
}
