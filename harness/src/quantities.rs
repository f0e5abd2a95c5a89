//! Raw numbers and units.

use crate::{MANY, for_any};
use ema_wire::bus_load::{Stuffing, classic_frame_bits};
use ema_wire::{ActuatorId, quantity as q};

/// Currents, temperatures and loads come back from their units; the code for "not measured" is not made.
///
/// All 16-bit values; exhaustive.
#[test]
fn signed_quantities_come_back() {
    for raw in i16::MIN..=i16::MAX {
        assert_eq!(q::current_ma(q::current_a(raw)), raw);
        assert_eq!(q::winding_temp_dc(q::winding_temp_deg_c(raw)), raw);
        assert_eq!(q::load_torque_dnm(q::load_torque_nm(raw)), raw.max(-i16::MAX));
    }
}

/// Link voltages come back.
///
/// All 16-bit values; exhaustive.
#[test]
fn link_voltages_come_back() {
    for raw in 0..=u16::MAX {
        assert_eq!(q::dc_link_dv(q::dc_link_v(raw)), raw);
    }
}

/// Setpoints come back.
///
/// Any 32-bit value.
#[test]
fn setpoints_come_back() {
    for_any!(MANY, |raw: i32| {
        assert_eq!(q::position_setpoint_urad(q::position_setpoint_rad(raw)), raw);
        assert_eq!(q::speed_setpoint_mrad_s(q::speed_setpoint_rad_s(raw)), raw);
    });
}

/// The middle of an encoder count is in that count.
///
/// All 24-bit values; exhaustive.
#[test]
fn encoder_angles_come_back() {
    for counts in -(1i64 << 23)..1 << 23 {
        let middle = (q::output_angle_rad(counts) + q::output_angle_rad(counts + 1)) / 2.0;
        assert_eq!(i64::from(q::output_counts(middle)), counts);
    }
}

/// The middle of a resolver count is in that count.
///
/// Any 32-bit value.
#[test]
fn resolver_angles_come_back() {
    for_any!(MANY, |counts: i32| {
        let counts = i64::from(counts);
        let middle = (q::motor_angle_rad(counts) + q::motor_angle_rad(counts + 1)) / 2.0;
        assert_eq!(i64::from(q::motor_counts(middle)), counts);
    });
}

/// Every number has a raw value: it saturates, rises with the number, and is zero for what is none.
///
/// Any two doubles, infinities and NaN too.
#[test]
fn numbers_saturate() {
    for_any!(MANY, |bits: (u64, u64)| {
        let (a, b) = (f64::from_bits(bits.0), f64::from_bits(bits.1));
        for number in [a, b] {
            let raw = [
                q::current_ma(number),
                q::winding_temp_dc(number),
                q::load_torque_dnm(number),
            ];
            assert!(!number.is_nan() || raw == [0; 3], "{number}");
            assert!(q::load_torque_dnm(number) != i16::MIN);
            let _ = (q::motor_counts(number), q::output_counts(number));
        }
        if a <= b {
            assert!(q::current_ma(a) <= q::current_ma(b), "{a} {b}");
            assert!(q::dc_link_dv(a) <= q::dc_link_dv(b), "{a} {b}");
            assert!(q::position_setpoint_urad(a) <= q::position_setpoint_urad(b), "{a} {b}");
        }
    });
}

/// Sixteen numbers are actuators.
///
/// All 8-bit values; exhaustive.
#[test]
fn actuator_numbers() {
    for index in 0..=u8::MAX {
        assert_eq!(
            ActuatorId::new(index).map(ActuatorId::index),
            (index < 16).then_some(index)
        );
        assert_eq!(ActuatorId::try_from(index).is_ok(), index < 16);
    }
}

/// Longer frames take longer, stuffing makes none shorter.
///
/// All lengths of a classic frame; exhaustive.
#[test]
fn lengths_of_frames_on_the_bus() {
    let bits = |bytes| [Stuffing::None, Stuffing::Nominal, Stuffing::Worst].map(|how| classic_frame_bits(bytes, how));
    for bytes in 0..=8 {
        assert!(bits(bytes).is_sorted());
        assert!(bytes == 0 || bits(bytes - 1).iter().zip(bits(bytes)).all(|(less, more)| *less < more));
    }
}
