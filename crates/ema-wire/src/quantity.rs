//! Conversions between the raw integers of the wire and SI units.
//!
//! | quantity | raw | LSB | range |
//! |---|---|---|---|
//! | phase current | s16 | 1 mA | ±32.767 A |
//! | setpoint, position mode | s32 | 1 µrad at the output shaft | ±2147 rad |
//! | setpoint, speed mode | s32 | 1 mrad/s at the motor shaft | ±2.1e6 rad/s |
//! | DC link voltage | u16 | 0.1 V | 0 … 6553.5 V |
//! | winding temperature | s16 | 0.1 °C | ±3276.7 °C |
//! | load torque at the output | s16 | 0.1 Nm | ±3276.7 Nm, 0x8000 = not measured |
//! | motor angle | s32 counter, wraps | 2π / 65 536 rad | multi-turn |
//! | output angle | s24 counter, wraps | 2π / 20 000 rad | multi-turn |
//!
//! Conversion to the wire rounds to the nearest LSB (ties away from zero) and saturates at the ends of the raw range. NaN
//! becomes 0, because the fields have no code for it: a device checks its sensors before it emits. Angle counters are
//! different: they round down, as an encoder does, and wrap. Conversion from the wire divides by an exact scale, so 123 mA
//! becomes the double nearest to 0.123.
//!
//! ```
//! use ema_wire::quantity::{current_a, current_ma};
//! assert_eq!(current_ma(1.2344), 1234);
//! assert_eq!(current_ma(40.0), i16::MAX); // saturates, never wraps to a negative current
//! assert!((current_a(-10_700) + 10.7).abs() < 1e-12);
//! ```

use core::f64::consts::TAU;

/// Raw current steps in one ampere.
pub const MILLIAMPERES_PER_A: f64 = 1e3;
/// Raw position setpoint steps in one radian at the output shaft.
pub const MICRORADIANS_PER_RAD: f64 = 1e6;
/// Raw speed setpoint steps in one rad/s at the motor shaft.
pub const MILLIRADIANS_PER_RAD: f64 = 1e3;
/// Raw voltage steps in one volt.
pub const DECIVOLTS_PER_V: f64 = 10.0;
/// Raw temperature steps in one kelvin of difference.
pub const DECIDEGREES_PER_K: f64 = 10.0;
/// Raw torque steps in one newton metre.
pub const DECINEWTON_METRES_PER_NM: f64 = 10.0;
/// Resolver counts in one turn of the motor shaft.
pub const MOTOR_COUNTS_PER_REV: f64 = 65_536.0;
/// Encoder counts in one turn of the output shaft (5000 pulses, quadrature).
pub const OUTPUT_COUNTS_PER_REV: f64 = 20_000.0;

/// Phase current in A.
#[must_use]
pub fn current_a(raw_ma: i16) -> f64 {
    f64::from(raw_ma) / MILLIAMPERES_PER_A
}

/// Phase current in mA from A; saturates at ±32.77 A.
#[must_use]
pub fn current_ma(current_a: f64) -> i16 {
    away_by_half(current_a * MILLIAMPERES_PER_A) as i16
}

/// Position setpoint in rad at the output shaft (mode position).
#[must_use]
pub fn position_setpoint_rad(raw_urad: i32) -> f64 {
    f64::from(raw_urad) / MICRORADIANS_PER_RAD
}

/// Position setpoint in µrad from rad at the output shaft; saturates at ±2147 rad.
#[must_use]
pub fn position_setpoint_urad(setpoint_rad: f64) -> i32 {
    away_by_half(setpoint_rad * MICRORADIANS_PER_RAD) as i32
}

/// Speed setpoint in rad/s at the motor shaft (mode speed).
#[must_use]
pub fn speed_setpoint_rad_s(raw_mrad_s: i32) -> f64 {
    f64::from(raw_mrad_s) / MILLIRADIANS_PER_RAD
}

/// Speed setpoint in mrad/s from rad/s at the motor shaft; saturates at ±2.1e6 rad/s.
#[must_use]
pub fn speed_setpoint_mrad_s(setpoint_rad_s: f64) -> i32 {
    away_by_half(setpoint_rad_s * MILLIRADIANS_PER_RAD) as i32
}

/// DC link voltage in V.
#[must_use]
pub fn dc_link_v(raw_dv: u16) -> f64 {
    f64::from(raw_dv) / DECIVOLTS_PER_V
}

/// DC link voltage in 0.1 V from V; saturates at 0 and 6553.5 V.
#[must_use]
pub fn dc_link_dv(dc_link_v: f64) -> u16 {
    away_by_half(dc_link_v * DECIVOLTS_PER_V) as u16
}

/// Winding temperature in °C.
#[must_use]
pub fn winding_temp_deg_c(raw_dc: i16) -> f64 {
    f64::from(raw_dc) / DECIDEGREES_PER_K
}

/// Winding temperature in 0.1 °C from °C; saturates at ±3276.7 °C.
#[must_use]
pub fn winding_temp_dc(winding_temp_deg_c: f64) -> i16 {
    away_by_half(winding_temp_deg_c * DECIDEGREES_PER_K) as i16
}

/// Load torque in Nm at the output shaft.
#[must_use]
pub fn load_torque_nm(raw_dnm: i16) -> f64 {
    f64::from(raw_dnm) / DECINEWTON_METRES_PER_NM
}

/// Load torque in 0.1 Nm from Nm; saturates at ±3276.7 Nm and never returns the code for "not measured".
#[must_use]
pub fn load_torque_dnm(load_torque_nm: f64) -> i16 {
    (away_by_half(load_torque_nm * DECINEWTON_METRES_PER_NM) as i16).max(-i16::MAX)
}

/// Motor angle in rad from unwrapped resolver counts: `theta_m = 2π c / 65 536`, the lower edge of the count.
///
/// ```
/// use ema_wire::quantity::motor_angle_rad;
/// assert!((motor_angle_rad(65_536) - core::f64::consts::TAU).abs() < 1e-15);
/// ```
#[must_use]
pub fn motor_angle_rad(counts: i64) -> f64 {
    counts as f64 * (TAU / MOTOR_COUNTS_PER_REV)
}

/// Resolver counts of a motor angle: `floor(theta_m 65 536 / 2π)`, wrapped to the s32 of the wire.
#[must_use]
pub fn motor_counts(theta_m: f64) -> i32 {
    floor(theta_m * (MOTOR_COUNTS_PER_REV / TAU)) as i32
}

/// Output angle in rad from unwrapped encoder counts: `theta_out = 2π c / 20 000`, the lower edge of the count.
#[must_use]
pub fn output_angle_rad(counts: i64) -> f64 {
    counts as f64 * (TAU / OUTPUT_COUNTS_PER_REV)
}

/// Encoder counts of an output angle: `floor(theta_out 20 000 / 2π)`, wrapped to the s24 of the wire.
///
/// ```
/// use ema_wire::quantity::output_counts;
/// assert_eq!(output_counts(0.25), 795);
/// assert_eq!(output_counts(-1e-9), -1); // floor, as an encoder does, not truncation
/// ```
#[must_use]
pub fn output_counts(theta_out: f64) -> i32 {
    wrap_s24(floor(theta_out * (OUTPUT_COUNTS_PER_REV / TAU)))
}

/// Low 24 bits of a counter, sign-extended.
#[must_use]
pub const fn wrap_s24(counts: i64) -> i32 {
    ((counts as i32) << 8) >> 8
}

/// The number plus half an LSB away from zero. The caller's cast then truncates and saturates; it turns NaN into 0.
fn away_by_half(scaled: f64) -> f64 {
    scaled + 0.5_f64.copysign(scaled)
}

/// Largest integer not above `x`; `core` has no `f64::floor`.
fn floor(x: f64) -> i64 {
    let truncated = x as i64;
    // Saturated, where the cast is.
    truncated.saturating_sub(i64::from((truncated as f64) > x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_beyond_all_counters_have_counts() {
        for angle in [f64::NEG_INFINITY, f64::MIN, -1e19, f64::MAX, f64::INFINITY, f64::NAN] {
            let _ = (motor_counts(angle), output_counts(angle));
        }
    }

    #[test]
    fn every_raw_value_is_unchanged_after_conversion_to_si_and_back() {
        for raw in i16::MIN..=i16::MAX {
            assert_eq!(current_ma(current_a(raw)), raw);
            assert_eq!(winding_temp_dc(winding_temp_deg_c(raw)), raw);
            assert_eq!(load_torque_dnm(load_torque_nm(raw)), raw.max(-i16::MAX));
            assert_eq!(dc_link_dv(dc_link_v(raw.cast_unsigned())), raw.cast_unsigned());
        }
        for raw in [i32::MIN, i32::MIN + 1, -999_999, -1, 0, 1, 250_000, i32::MAX] {
            assert_eq!(position_setpoint_urad(position_setpoint_rad(raw)), raw);
            assert_eq!(speed_setpoint_mrad_s(speed_setpoint_rad_s(raw)), raw);
        }
    }

    #[test]
    fn values_beyond_the_range_saturate_and_nan_becomes_zero() {
        assert_eq!(current_ma(f64::INFINITY), i16::MAX);
        assert_eq!(current_ma(f64::NEG_INFINITY), i16::MIN);
        assert_eq!(current_ma(f64::NAN), 0);
        assert_eq!(dc_link_dv(-1.0), 0);
        assert_eq!(load_torque_dnm(-1e9), -i16::MAX);
    }

    #[test]
    fn counters_round_down_and_wrap() {
        assert_eq!(motor_counts(-1e-6), -1);
        assert_eq!(motor_counts(TAU * 1.5), 98_304);
        // 2^31 counts are 32 768 turns, where the raw value becomes negative.
        assert_eq!(motor_counts(TAU * (32_768.0 + 0.5 / 65_536.0)), i32::MIN);
        assert_eq!(wrap_s24(1 << 23), -(1 << 23));
        assert_eq!(wrap_s24(-(1 << 23) - 1), (1 << 23) - 1);
    }
}
