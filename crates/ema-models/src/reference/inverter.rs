//! Power electronics: one hysteresis comparator per phase.

/// Three hysteresis comparators, each switching its phase between +V_dc/2 and −V_dc/2.
#[derive(Clone, Copy, Debug, Default)]
pub struct Inverter {
    high: [bool; 3],
}

impl Inverter {
    /// Phase voltages against the DC link's midpoint, V.
    ///
    /// A phase goes high when its current error `i_ref − i` rises above `+half_band`, low when it falls below
    /// `−half_band`, and stays as it is in between.
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
