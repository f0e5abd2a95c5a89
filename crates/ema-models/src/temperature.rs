//! What the winding temperature does to a motor: copper resists more, magnets weaken.

/// Temperature at which a motor's parameters hold, °C.
pub const REFERENCE_TEMPERATURE_DEG_C: f64 = 20.0;

/// Rise of the phase resistance, 1/K: copper.
pub const RESISTANCE_PER_KELVIN: f64 = 3.9e-3;

/// Change of the back-EMF coefficient, 1/K: between samarium-cobalt (about -0.04 %) and neodymium magnets (-0.12 %).
pub const BACK_EMF_PER_KELVIN: f64 = -1.0e-3;

/// Factors on resistance and back-EMF coefficient at a temperature, °C; linear about 20 °C. The magnets are taken to be as
/// warm as the winding.
///
/// ```
/// let [resistance, back_emf] = ema_models::temperature_factors(120.0);
/// assert!((resistance - 1.39).abs() < 1e-12 && (back_emf - 0.9).abs() < 1e-12);
/// ```
#[must_use]
pub fn temperature_factors(temperature_deg_c: f64) -> [f64; 2] {
    let rise = temperature_deg_c - REFERENCE_TEMPERATURE_DEG_C;
    [1.0 + RESISTANCE_PER_KELVIN * rise, 1.0 + BACK_EMF_PER_KELVIN * rise]
}
