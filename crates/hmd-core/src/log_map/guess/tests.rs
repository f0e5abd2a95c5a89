//! Names as logs have them.

use super::*;

/// What a name with a unit is guessed to be; an empty unit is none.
fn quantity(name: &str, unit: &str) -> Option<Quantity> {
    guess(name, unit).map(|guess| guess.quantity)
}

fn guess(name: &str, unit: &str) -> Option<Guess> {
    Quantity::guess(name, Some(unit).filter(|unit| !unit.is_empty()))
}

#[test]
fn usual_names_are_recognised_and_units_decide() {
    assert_eq!(quantity("I_A", "A"), Some(Quantity::Of(Role::CurrentA)));
    assert_eq!(quantity("i.u", ""), Some(Quantity::Of(Role::CurrentA)));
    assert_eq!(quantity("I_A", "V"), None);
    assert_eq!(quantity("Motor_Angle", "deg"), Some(Quantity::Of(Role::MotorPosition)));
    assert_eq!(quantity("motor_winding", "degC"), Some(Quantity::Of(Role::WindingTemp)));
    assert_eq!(quantity("SpeedDemand", "rpm"), Some(Quantity::Of(Role::CommandSpeed)));
    assert_eq!(quantity("elapsed", "ms"), None);
    assert_eq!(quantity("Iq_act", "A"), Some(Quantity::CurrentQ));
    assert_eq!(quantity("I1", "Amps"), Some(Quantity::Of(Role::CurrentA)));
    assert_eq!(quantity("Time", "sec"), Some(Quantity::Time));
    assert_eq!(quantity("Pos Motor", "Deg"), Some(Quantity::Of(Role::MotorPosition)));
}

#[test]
fn names_of_several_words_and_groups_are_recognised() {
    let of = |role: Role| Some(Quantity::Of(role));
    for (name, unit, expected) in [
        ("Phase U current", "mA", of(Role::CurrentA)),
        ("PhaseCurrentB", "A", of(Role::CurrentB)),
        ("motor.i_w", "A", of(Role::CurrentC)),
        ("FOC.Id", "A", Some(Quantity::CurrentD)),
        ("FOC.Iq", "", Some(Quantity::CurrentQ)),
        ("ia_ma", "", of(Role::CurrentA)),
        ("LoadAngle", "deg", of(Role::OutputPosition)),
        ("LoadTorque", "Nm", of(Role::LoadTorque)),
        ("Flap_deg", "", of(Role::OutputPosition)),
        ("enc_motor", "", of(Role::MotorPosition)),
        ("motor_enable", "", None),
        ("phase", "deg", None),
        ("Flap_cmd_deg", "", of(Role::CommandPosition)),
        ("theta_cmd", "", of(Role::CommandPosition)),
        ("Sollwinkel", "", of(Role::CommandPosition)),
        ("speed_cmd", "", None),
        ("Ausgangswinkel", "", of(Role::OutputPosition)),
        ("Inv_CurV", "", of(Role::CurrentB)),
        ("L_Ia", "", of(Role::CurrentA)),
        ("R_Ic", "A", of(Role::CurrentC)),
        ("left_motor_angle_deg", "", of(Role::MotorPosition)),
    ] {
        assert_eq!(quantity(name, unit), expected, "{name} [{unit}]");
    }
}

#[test]
fn a_name_may_end_with_its_unit() {
    let guess = |name: &str| Quantity::guess(name, None).map(|guess| (guess.quantity, guess.unit));
    let with = |quantity, unit: &str| Some((quantity, Some(unit.to_owned())));
    assert_eq!(guess("time_s"), with(Quantity::Time, "s"));
    assert_eq!(guess("iq_A"), with(Quantity::CurrentQ, "A"));
    assert_eq!(guess("t_ns"), with(Quantity::Time, "ns"));
    assert_eq!(guess("winding_temp_c"), with(Quantity::Of(Role::WindingTemp), "C"));
    assert_eq!(guess("dc_link_v"), with(Quantity::Of(Role::DcLink), "V"));
    assert_eq!(guess("load_torque_nm"), with(Quantity::Of(Role::LoadTorque), "Nm"));
    assert_eq!(guess("i_a_a"), with(Quantity::Of(Role::CurrentA), "A"));
    assert_eq!(
        guess("output_counts"),
        with(Quantity::Of(Role::OutputPosition), "counts")
    );
    assert_eq!(guess("i_d_mA"), with(Quantity::CurrentD, "mA"));
    assert_eq!(guess("motor_angle_deg"), with(Quantity::Of(Role::MotorPosition), "deg"));
    assert_eq!(
        guess("speed_demand_rad_s"),
        with(Quantity::Of(Role::CommandSpeed), "rad/s")
    );
    assert_eq!(
        guess("I_A"),
        Some((Quantity::Of(Role::CurrentA), None)),
        "phase A, not ampere"
    );
    assert_eq!((guess("some_thing"), guess("_"), guess("é_°")), (None, None, None));
}

#[test]
fn what_is_computed_of_a_signal_is_not_the_signal() {
    for (name, unit) in [
        ("motor_angle_error", "deg"),
        ("MotorAngleErr_deg", ""),
        ("rotor position deviation", "rad"),
        ("delta_theta_motor", "rad"),
        ("motor_angle_offset", "deg"),
        ("output_pos_max", "deg"),
        ("I_a_rms", "A"),
        ("I_a_ref", "A"),
        ("motor_angle_status", ""),
        ("T_motor_housing", "degC"),
        ("state_of_charge", ""),
    ] {
        assert_eq!(guess(name, unit), None, "{name} [{unit}]");
    }
}

#[test]
fn what_needs_a_scale_and_what_may_be_another_is_doubtful() {
    use Doubt::{Electrical, None as No, OtherSide, Word};
    use Role::{CommandPosition, CommandSpeed, CurrentA, MotorPosition, OutputPosition, WindingTemp};
    for (name, unit, role, doubt) in [
        ("motor position electrical", "deg", MotorPosition, Electrical),
        ("rotor_angle_el", "rad", MotorPosition, Electrical),
        ("rotor_angle_elec_deg", "", MotorPosition, Electrical),
        ("theta_e", "rad", MotorPosition, Electrical),
        ("ElectricalAngle", "", MotorPosition, Electrical),
        ("rotor_angle", "deg el", MotorPosition, Electrical),
        ("e_angle", "rad", MotorPosition, Electrical),
        ("theta_mech", "rad", MotorPosition, Word),
        ("rotor_angle", "rad", MotorPosition, No),
        ("motor_angle_filtered", "rad", MotorPosition, Word),
        ("out_angle", "rad", OutputPosition, No),
        ("OutAngle_deg", "", OutputPosition, No),
        ("enc_out", "rad", OutputPosition, No),
        ("angleout", "deg", OutputPosition, No),
        ("Winkel_Abtrieb", "deg", OutputPosition, No),
        ("elevator_pos", "deg", OutputPosition, No),
        ("actuator position", "deg", OutputPosition, Word),
        ("encoder", "counts", OutputPosition, Word),
        ("motor encoder", "counts", MotorPosition, No),
        ("motor_angle_ref", "deg", CommandPosition, OtherSide),
        ("output_speed_set", "rpm", CommandSpeed, OtherSide),
        ("output_angle_ref", "deg", CommandPosition, No),
        ("T_winding", "degC", WindingTemp, No),
        ("Twdg", "degC", WindingTemp, No),
        ("Zwischenkreis", "V", Role::DcLink, No),
        ("U_Zwischenkreis_ist", "V", Role::DcLink, No),
        ("Klappe", "deg", OutputPosition, No),
        ("Lastmoment", "Nm", Role::LoadTorque, No),
        ("T_motor", "degC", WindingTemp, Word),
        ("Strom_U", "A", CurrentA, No),
        ("I_a_filt", "A", CurrentA, Word),
    ] {
        let found = guess(name, unit).map(|guess| (guess.quantity, guess.doubt));
        assert_eq!(found, Some((Quantity::Of(role), doubt)), "{name} [{unit}]");
    }
    assert_eq!(quantity("Id_fb", "A"), Some(Quantity::CurrentD));
    assert_eq!(quantity("Iq_feedback", "A"), Some(Quantity::CurrentQ));
    assert_eq!(quantity("Iq_cmd", "A"), None);
    let unit = guess("rotor_angle", "deg el").and_then(|guess| guess.unit);
    assert_eq!(unit.as_deref(), Some("deg"));
}
