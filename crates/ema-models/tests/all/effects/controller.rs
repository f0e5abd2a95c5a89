//! Setpoint rate, speed filter, delay.

use core::f64::consts::TAU;

use super::rig::{Rig, close, coasting, effects, locked, proportional};
use ema_models::reference::DetailedReference;
use ema_models::{ActuatorParams, FaultVector, Setpoint};

#[test]
fn a_limited_setpoint_moves_the_output_at_its_rate() {
    let params = ActuatorParams::bench();
    let mut rig = Rig::new(&params, &[("setpoint_rate_rad_s", 0.5)]);
    let setpoint = Setpoint::Position(0.25);
    rig.settle(0.25, setpoint);
    // 0.5 rad/s at the output is 50 rad/s at the motor.
    let speed = rig.mean(0.1, setpoint, |s| s.shaft.omega_m);
    close(speed, 50.0, 0.25, "motor speed, rad/s");
    rig.settle(0.4, setpoint);
    close(rig.state.shaft.theta_out, 0.25, 1e-3, "output angle, rad");
}

#[test]
fn a_limited_setpoint_begins_at_the_present_position() {
    // Far from zero, at rest and after speed mode: the limit leaves from where the output is, at 0.5 rad/s.
    let params = ActuatorParams::bench();
    for before in [Setpoint::Idle, Setpoint::Speed(0.0)] {
        let mut rig = Rig::with_fault(&params, &FaultVector::NOMINAL, 200.0, &[("setpoint_rate_rad_s", 0.5)]);
        rig.settle(0.05, before);
        rig.run(0.1, Setpoint::Position(2.0), |_, s| {
            close(s.shaft.theta_out, 2.0, 1e-3, "output angle, rad");
        });
        rig.settle(0.2, Setpoint::Position(2.2));
        assert!(rig.state.shaft.theta_out < 2.101, "{}", rig.state.shaft.theta_out);
        rig.settle(0.4, Setpoint::Position(2.2));
        close(rig.state.shaft.theta_out, 2.2, 1e-3, "output angle, rad");
    }
}

#[test]
fn a_limited_speed_setpoint_accelerates_at_its_rate() {
    let params = ActuatorParams::bench();
    let mut rig = Rig::new(&params, &[("speed_setpoint_rate_rad_s2", 400.0)]);
    rig.settle(0.1, Setpoint::Speed(100.0));
    let early = rig.state.shaft.omega_m;
    rig.settle(0.1, Setpoint::Speed(100.0));
    close(rig.state.shaft.omega_m - early, 40.0, 0.4, "gain of speed in 0.1 s");
}

#[test]
fn the_filtered_speed_lags_by_the_time_constant() {
    // At a constant acceleration a, a difference over T shows the speed of T/2 ago, and a first-order filter y += α (x − y) with
    // α = 1 − e^(−2πfT) lags by a T (1 − α)/α = a T/(e^(2πfT) − 1); together about a/2πf.
    for frequency in [300.0, 1000.0] {
        let params = coasting();
        // A controller that knows a motor with torque, so that its output shows the speed it knows.
        let mut controller = proportional();
        controller.controller.k_p = 0.01;
        let torque = 20.0;
        let values = [("speed_filter_hz", frequency), ("unmeasured_load_nm", -torque)];
        let mut rig = Rig::new(&params, &values);
        rig.plant = DetailedReference::new(
            &params,
            &controller,
            &FaultVector::NOMINAL,
            0.0,
            20.0,
            &effects(&values),
        );
        let acceleration = torque / 100.0 / params.motor.j;
        let setpoint = Setpoint::Speed(0.0);
        rig.settle(0.05, setpoint);
        // The reference holds −K_p ω/G_T for a control period, half of which passes on average.
        let gain = controller.controller.k_p / controller.motor.torque_gain();
        let lag = rig.mean(0.05, setpoint, |s| s.shaft.omega_m + s.shaft.i_ref / gain) - 50e-6 * acceleration;
        let expected = 50e-6 + 100e-6 / ((TAU * frequency * 100e-6).exp() - 1.0);
        close(lag / acceleration, expected, 2e-6, "lag, s");
        close(expected, 1.0 / (TAU * frequency), 6e-6, "time constant, s");
    }
}

#[test]
fn a_delay_shifts_the_current_reference_by_whole_control_periods() {
    let references = |delay: f64| {
        let mut rig = Rig::new(&locked(), &[("control_delay_periods", delay), ("cogging_nm", 1e-9)]);
        let mut references = Vec::new();
        for n in 0..200 {
            let setpoint = Setpoint::Speed(5.0 * (0.1 * f64::from(n)).sin());
            rig.run(100e-6, setpoint, |_, s| references.push(s.shaft.i_ref));
        }
        references
    };
    let at_once = references(0.0);
    for periods in [1, 3] {
        let late = references(periods as f64);
        let steps = 100 * periods;
        assert!(late[..steps].iter().all(|i| i.abs() <= 0.0));
        assert_eq!(late[steps..], at_once[..at_once.len() - steps], "{periods} periods");
    }
}
