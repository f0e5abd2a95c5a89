//! Physics of the monitor without the reference model: rest, steady states, symmetries, voltage limit, convergence.

use core::f64::consts::TAU;
use ema_models::{
    ActuatorParams, Calibration, ComparedSample, FaultVector, Feedback, Form, InitialState, Monitor, MonitorState,
    MotorDeviation, Origin, Output, PaperShape, Ripple, Setpoint, Unknowns, steps_per_control,
};

const FORMS: [Form; 3] = [
    Form::ThreePhase,
    Form::OneAxis,
    Form::Paper(PaperShape { k_fs: 100.0, k_e: 0.5 }),
];

fn close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (got - expected).abs() <= tolerance,
        "{what}: {got}, expected {expected} ± {tolerance}"
    );
}

/// A monitor with its state.
struct Run {
    monitor: Monitor<f64>,
    state: MonitorState<f64>,
    initial: InitialState,
}

impl Run {
    fn new(params: &ActuatorParams, form: Form, fault: &FaultVector, load_torque: f64, initial: InitialState) -> Self {
        let unknowns = Unknowns {
            fault: *fault,
            load_torque,
            integral: 0.0,
            motor: MotorDeviation::default(),
        };
        let monitor = Monitor::new(params, &without_ripple(form), params.motor.v_dc, &unknowns)
            .with_feedback(Feedback::Simulated);
        // The output is in the middle of count 0 and the drive is off, so the integral is zero.
        let first = ComparedSample {
            theta_out: 0.5 * params.sensors.output_lsb(),
            ..ComparedSample::default()
        };
        Self {
            monitor,
            state: monitor.start(&initial, &first),
            initial,
        }
    }

    /// Output after each of `samples` sample periods.
    fn run(&mut self, samples: usize, setpoint: Setpoint) -> Vec<Output<f64>> {
        // With simulated feedback, the samples give only the setpoint.
        let sample = ComparedSample {
            setpoint,
            ..ComparedSample::default()
        };
        (0..samples)
            .map(|_| {
                self.monitor
                    .run_sample_period(&mut self.state, &self.initial, &sample, &sample);
                self.monitor.output(&self.state)
            })
            .collect()
    }
}

/// A monitor without the mean effect of the hysteresis band, which `accuracy.rs` tests.
fn without_ripple(form: Form) -> Calibration {
    let mut calibration = Calibration::uncorrected(form);
    calibration.ripple = Ripple::NONE;
    calibration
}

#[test]
fn rest_stays_at_rest() {
    let params = ActuatorParams::bench();
    for form in FORMS {
        let mut run = Run::new(&params, form, &FaultVector::NOMINAL, 30.0, InitialState::default());
        for output in run.run(400, Setpoint::Position(0.0)) {
            assert!(
                output.omega_m.abs() < 1e-15 && output.theta_m.abs() < 1e-15,
                "{output:?}"
            );
            assert!(output.i_q.abs() < 1e-12, "{output:?}");
        }
    }
}

#[test]
fn steady_current_carries_friction_viscous_loss_and_load() {
    let params = ActuatorParams::bench();
    let losses = 0.15 + 1e-3 * 100.0;
    for form in FORMS {
        for (load, at_motor) in [(0.0, 0.0), (40.0, 0.40 / 0.65), (-40.0, -0.40 * 0.51)] {
            let mut run = Run::new(&params, form, &FaultVector::NOMINAL, load, InitialState::default());
            let last = run.run(4000, Setpoint::Speed(100.0))[3999];
            close(last.omega_m, 100.0, 1e-6, "speed");
            close(last.i_q, (losses + at_motor) / 1.350, 1e-6, "i_q");
            close(last.i_d, 0.0, 1e-6, "i_d");
        }
    }
}

#[test]
fn all_forms_agree_for_a_healthy_motor_while_the_voltage_suffices() {
    // The shapes of a healthy motor are 1, so one axis and three phases are equivalent while the voltage suffices. It does not
    // in the first 0.2 ms of the ramp, while the current rises from zero.
    let params = ActuatorParams::bench();
    let outputs = FORMS.map(|form| {
        let mut run = Run::new(&params, form, &FaultVector::NOMINAL, 0.0, InitialState::default());
        run.run(600, Setpoint::Speed(20.0))
    });
    for n in 0..600 {
        for other in &outputs[1..] {
            close(outputs[0][n].i_q, other[n].i_q, 0.02, "i_q");
            close(outputs[0][n].theta_m, other[n].theta_m, 2e-3, "theta_m");
        }
    }
}

#[test]
fn whole_turns_of_the_origin_do_not_change_the_signals() {
    let params = ActuatorParams::bench();
    let fault = FaultVector::from_array([0.1, 0.2, 0.3, 0.0, 0.0, 0.4, 0.7, 0.6]);
    let from = |theta_e: f64| {
        let initial = InitialState {
            origin: Origin {
                theta_e,
                play_centre: 1e-4,
            },
            ..InitialState::default()
        };
        Run::new(&params, Form::ThreePhase, &fault, 0.0, initial).run(600, Setpoint::Position(0.2))
    };
    for (a, b) in from(0.7).iter().zip(&from(0.7 + 4.0 * TAU)) {
        close(a.theta_m, b.theta_m, 1e-8, "theta_m");
        close(a.i_q, b.i_q, 1e-6, "i_q");
    }
}

#[test]
fn a_rotated_motor_with_exchanged_phases_is_equivalent() {
    // A short of A at θ_e is a short of B at θ_e + 2π/3 and of C at θ_e + 4π/3.
    let params = ActuatorParams::bench();
    let outputs: [Vec<Output<f64>>; 3] = core::array::from_fn(|j| {
        let mut k = FaultVector::NOMINAL.to_array();
        k[2 + j] = 0.5;
        let initial = InitialState {
            origin: Origin {
                theta_e: 0.4 + TAU / 3.0 * j as f64,
                play_centre: 0.0,
            },
            ..InitialState::default()
        };
        Run::new(&params, Form::ThreePhase, &FaultVector::from_array(k), 0.0, initial).run(600, Setpoint::Position(0.2))
    });
    for n in 0..600 {
        for other in &outputs[1..] {
            close(other[n].theta_m, outputs[0][n].theta_m, 1e-8, "theta_m");
            close(other[n].i_q, outputs[0][n].i_q, 1e-6, "i_q");
            close(other[n].i_d, outputs[0][n].i_d, 1e-6, "i_d");
        }
    }
}

#[test]
fn currents_at_the_voltage_limit_agree_with_the_reference() {
    // Under a load for which V_dc does not suffice at 200 rad/s, i_q is below its reference of 10.7 A and i_d is positive.
    let params = ActuatorParams::bench();
    let mut run = Run::new(
        &params,
        Form::ThreePhase,
        &FaultVector::NOMINAL,
        750.0,
        InitialState::default(),
    );
    run.run(1000, Setpoint::Speed(200.0));
    let outputs = run.run(400, Setpoint::Speed(200.0));
    let mean = |pick: fn(&Output<f64>) -> f64| outputs.iter().map(pick).sum::<f64>() / 400.0;
    let [i_d, i_q, omega] = [mean(|o| o.i_d), mean(|o| o.i_q), mean(|o| o.omega_m)];
    println!("monitor at the voltage limit: i_d {i_d}, i_q {i_q}, omega {omega}");
    // Values of the reference in the same state: tests/all/reference.rs prints 0.99 A, 8.77 A, 151.4 rad/s.
    close(i_d, 0.99, 0.05, "i_d");
    close(i_q, 8.77, 0.03, "i_q");
    close(omega, 151.4, 0.5, "omega_m");
}

/// Signals after 9.5 ms of full torque from rest. The control period sets only the monitor's step, which is half of it: the
/// current reference is at its limit throughout.
fn full_torque(form: Form, fault: &FaultVector, period: f64) -> [f64; 3] {
    let mut params = ActuatorParams::bench();
    params.controller.period = period;
    params.controller.k_p = 4.0;
    let mut run = Run::new(&params, form, fault, 0.0, InitialState::default());
    let last = run.run(19, Setpoint::Speed(200.0))[18];
    [last.i_q, last.omega_m, last.theta_m]
}

#[test]
fn halving_the_step_converges() {
    let fault = FaultVector::from_array([0.0, 0.0, 0.3, 0.0, 0.0, 0.4, 0.7, 0.5]);
    for form in FORMS {
        // Steps of 50, 25 and 12.5 µs against 1 µs; the shipped one is 50 µs.
        let exact = full_torque(form, &fault, 2e-6);
        let deviations = [100e-6, 50e-6, 25e-6].map(|period| {
            let got = full_torque(form, &fault, period);
            [0, 1, 2].map(|k| (got[k] - exact[k]).abs())
        });
        println!("{form:?}: {exact:?}, deviations {deviations:?}");
        for k in 0..3 {
            let bound = [0.02, 0.06, 3e-4][k];
            assert!(deviations[0][k] < bound, "{form:?}, signal {k}: {deviations:?}");
            // At least first order: the instant at which the current reaches its limit lies anywhere within a step.
            assert!(
                deviations[2][k] < 0.6 * deviations[0][k] || deviations[2][k] < 1e-3 * bound,
                "{form:?}, signal {k}: {deviations:?}"
            );
        }
    }
}

#[test]
fn a_motor_that_turns_far_in_a_control_period_takes_more_steps() {
    let signals = |period: f64| {
        let mut params = ActuatorParams::bench();
        params.motor.pole_pairs = 40.0;
        params.sensors.sample_rate = 1000.0;
        params.controller.period = period;
        params.controller.k_p = 4.0;
        assert!(params.checked().is_ok());
        let mut run = Run::new(
            &params,
            Form::ThreePhase,
            &FaultVector::NOMINAL,
            0.0,
            InitialState::default(),
        );
        let last = run.run(14, Setpoint::Speed(200.0))[13];
        (steps_per_control(&params), [last.i_d, last.i_q, last.omega_m])
    };
    // 0.02 and 8 rad a control period at full speed.
    let (few, exact) = signals(20e-6);
    let (many, got) = signals(1e-3);
    println!("{few} steps {exact:?}, {many} steps {got:?}");
    assert_eq!((few, many), (2, 16));
    close(got[0], exact[0], 0.05, "i_d");
    close(got[1], exact[1], 0.1, "i_q");
    close(got[2], exact[2], 2.0, "omega_m");
    let mut beyond = ActuatorParams::bench();
    (beyond.motor.pole_pairs, beyond.controller.period) = (50.0, 1e-3);
    assert_eq!(beyond.checked().map_err(|e| e.field), Err("controller.period"));
    // No control period is short enough for it.
    beyond.controller.omega_max = 5e4;
    let refused = beyond.checked().map_err(|e| e.to_string());
    let expected = "controller.omega_max = 50000: expected a number from 0.01 to 16000";
    assert_eq!(refused, Err(expected.to_owned()));
}
