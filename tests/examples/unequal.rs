//! What unequal phases add to the shortfall of the current at low voltage: `cargo run --release -p hmd-tests --example unequal`.
//!
//! The reference's phases and comparators at constant speed and constant reference of the current. Prints the table of
//! `docs/design/monitor.md`: the torque that is missing, as a current in half bands, beyond that of three equal phases.

use ema_models::reference::{Inverter, Phases};
use ema_models::{ActuatorParams, FaultVector, REFERENCE_STEP, Real, Winding, phase_shapes};

/// Turns that each phase has left.
const TURNS: [[f64; 3]; 11] = [
    [1.0, 1.0, 0.9],
    [1.0, 1.0, 0.7],
    [1.0, 1.0, 0.5],
    [1.0, 1.0, 0.4],
    [1.0, 1.0, 0.25],
    [1.0, 0.8, 0.5],
    [1.0, 0.7, 0.5],
    [1.0, 0.5, 0.5],
    [1.0, 0.8, 0.8],
    [0.9, 0.9, 0.9],
    [0.5, 0.5, 0.5],
];

/// Speeds of the sweep, rad/s.
const SPEEDS: [f64; 3] = [5.0, 10.0, 20.0];

/// Reference of the quadrature current, A.
const CURRENT: f64 = 0.4;

/// Electrical turns that are averaged, after the first milliseconds.
const ELECTRICAL_TURNS: f64 = 6.0;
const SETTLING: f64 = 2e-3;

fn main() {
    println!("| turns left | `bench` | `servo28` |");
    println!("|---|---|---|");
    let actuators = [ActuatorParams::bench(), ActuatorParams::servo28()];
    let equal = actuators.map(|params| shortfall(&params, [1.0; 3]));
    for turns in TURNS {
        let [a, b, c] = turns;
        let [bench, servo28] = [0, 1].map(|n: usize| shortfall(&actuators[n], turns) - equal[n]);
        println!("| {a}, {b}, {c} | {bench:.2} | {servo28:.2} |");
    }
}

/// Mean over the speeds of the current that the torque lacks, in half bands.
fn shortfall(params: &ActuatorParams, turns: [f64; 3]) -> f64 {
    let [a, b, c] = turns.map(|n| 1.0 - n);
    let fault = FaultVector::from_array([0.0, 0.0, a, b, c, 0.0, 0.5, 0.5]);
    let mean_turns = turns.iter().sum::<f64>() / 3.0;
    let lacking = SPEEDS.map(|speed| lacking_at(params, &Winding::new(&fault), speed));
    lacking.iter().sum::<f64>() / SPEEDS.len() as f64 / mean_turns / params.controller.hysteresis
}

/// Mean of ⅔ Σ of back-EMF shape times error of the current, A, at one speed.
fn lacking_at(params: &ActuatorParams, winding: &Winding<f64>, speed: f64) -> f64 {
    let motor = &params.motor;
    let phases = Phases::new(motor, winding.turns);
    let mut inverter = Inverter::default();
    let mut i = [0.0; 3];
    let (mut sum, mut count) = (0.0, 0.0);
    let turning = motor.pole_pairs * speed;
    let end = SETTLING + ELECTRICAL_TURNS * std::f64::consts::TAU / turning;
    let mut step = 0_u64;
    while step as f64 * REFERENCE_STEP < end {
        let t = step as f64 * REFERENCE_STEP;
        let sin_cos = (turning * t).sin_cos_poly();
        let reference = phase_shapes(sin_cos).map(|s| CURRENT * s);
        let shapes = winding.emf_shapes(sin_cos);
        let v = inverter.switch(reference, i, params.controller.hysteresis, motor.v_dc);
        let di = phases.derivative(v, shapes.map(|s| motor.k * speed * s), i);
        for j in 0..3 {
            i[j] += di[j] * REFERENCE_STEP;
        }
        if t > SETTLING {
            sum += (0..3).map(|j| shapes[j] * (reference[j] - i[j])).sum::<f64>() * 2.0 / 3.0;
            count += 1.0;
        }
        step += 1;
    }
    sum / count
}
