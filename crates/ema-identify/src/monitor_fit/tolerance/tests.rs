//! A window with nuisances: its derivatives and its residuals.

use std::vec::Vec;

use ema_models::{
    ActuatorParams, Calibration, ComparedSample, Comparison, Conditions, FaultVector, Feedback, InitialState,
    MotorKnowledge, Prior, Recording, SIGNAL_COUNT, Scale, Setpoint, Tolerances, UNKNOWN_COUNT, Weights,
};

use super::basis::Basis;
use super::derivatives::{Derivatives, is_slow};
use super::problem::{Buffers, DIMENSION, Point, Problem};
use crate::monitor_fit::coarse_time::coarse_in_time;

const SAMPLES: usize = 80;

/// Shows a short window's problem, with derivatives of coarse time, and a point of it.
fn with_problem(visit: impl FnOnce(&Problem<'_>, &Point)) {
    let params = ActuatorParams::bench();
    let calibration = Calibration::default();
    let samples: [ComparedSample; SAMPLES] = core::array::from_fn(|n| {
        let t = n as f64 / params.sensors.sample_rate;
        ComparedSample {
            setpoint: Setpoint::Position(0.05),
            measured: true,
            i_d: 0.1,
            i_q: 3.0 - 40.0 * t,
            theta_m: 800.0 * t * t,
            omega_m: 1600.0 * t,
            theta_out: 800.0 * t * t / params.transmission.gear_ratio,
            ..ComparedSample::default()
        }
    });
    let comparison = Comparison {
        recording: Recording {
            samples: &samples,
            drive: &samples,
            initial: InitialState::default(),
        },
        params: &params,
        calibration: &calibration,
        conditions: Conditions {
            load_torque: None,
            v_dc: params.motor.v_dc,
            winding_temp_deg_c: None,
        },
        weights: Weights {
            i_d: 10.0,
            i_q: 10.0,
            theta_m: 100.0,
            omega_m: 1.0,
            theta_out: 1000.0,
        },
        feedback: Feedback::Measured,
        prior: Prior {
            load_torque: 1.0,
            integral: 1.0,
            motor: MotorKnowledge::default(),
        },
    };
    let tolerances = Tolerances::USUAL;
    let basis = Basis::new(&comparison, &tolerances);
    let buffers = Buffers::default();
    let coarse = coarse_in_time(&params);
    let problem = Problem::new(comparison, &coarse, &basis, &tolerances, 1e-3, &buffers);
    let start = Scale::new(&params).coordinates(&comparison.unknowns_with_fault(FaultVector::NOMINAL));
    let mut at: Point = core::array::from_fn(|p| start.0.get(p).copied().unwrap_or(0.3));
    at[0] = 0.2;
    visit(&problem, &at);
}

#[test]
fn slow_derivatives_of_the_same_point_are_those_of_a_whole_linearisation() {
    with_problem(|problem, at| {
        let whole = Derivatives::at(problem, at, None);
        let near = Derivatives::at(problem, at, Some(&whole));
        let column = |p: usize| whole.columns()[p];
        let rows = |found: &Derivatives<'_>| {
            (0..SIGNAL_COUNT)
                .flat_map(|s| found.of_signal(s).to_vec())
                .collect::<Vec<_>>()
        };
        let (whole_rows, near_rows) = (rows(&whole), rows(&near));
        let shown = |p: usize| whole_rows.iter().any(|row| row[column(p)].abs() > 0.0);
        assert!((UNKNOWN_COUNT..DIMENSION).filter(|&p| is_slow(p) && shown(p)).count() > 20);
        assert_eq!(whole_rows, near_rows);
        assert_eq!(whole.products(), near.products());
    });
}

#[test]
fn residuals_are_corrected_to_those_of_fine_time_at_the_anchor_and_close_to_it() {
    with_problem(|problem, at| {
        let of = |problem: &Problem<'_>, at: &Point| {
            let mut found = Vec::new();
            problem.residuals(at, |_, residuals| found.push(residuals));
            found
        };
        let corrected = problem.corrected();
        corrected.anchor(at);
        let mut near = *at;
        near[0] += 0.01;
        let far = |a: &[[f64; SIGNAL_COUNT]], b: &[[f64; SIGNAL_COUNT]]| {
            let pairs = a.iter().flatten().zip(b.iter().flatten());
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>()
        };
        let (at_anchor, fine) = (of(&corrected, at), of(problem, at));
        assert!(far(&at_anchor, &fine) < 1e-20);
        let (beside, fine_beside) = (of(&corrected, &near), of(problem, &near));
        let (error, change) = (far(&beside, &fine_beside), far(&fine_beside, &fine));
        assert!(change > 0.0 && error < 0.04 * change, "squares: {error} of {change}");
    });
}
