//! Prints one run of the healthy reference model as CSV, for comparison with an independent model.
//!
//! `cargo run -p ema-models --features std --example oracle > run.csv`, then `fixtures/reference/oracle_motulator.py run.csv`.
//! The bench motor starts at full torque to 150 rad/s and brakes to 60 rad/s, under an opposing load of 20 Nm. There is a row
//! at every change of the inverter's levels and every 100 µs: time, the three levels from this time on, and the state at this
//! time. The first argument sets the step in µs (default 1), to show the convergence. The breakaway torque equals the dynamic
//! friction torque, so that the independent model needs no stiction.

#[cfg(feature = "std")]
fn main() {
    use ema_models::reference::{Reference, ReferenceState};
    use ema_models::{ActuatorParams, FaultVector, Real, Setpoint, Winding, dq_from_abc};

    let mut params = ActuatorParams::bench();
    params.transmission.friction_static = params.transmission.friction_dynamic;
    let (m, t) = (params.motor, params.transmission);
    let load = 20.0;
    let at_motor = load / t.gear_ratio;
    let dry = t.friction_dynamic + (1.0 / t.efficiency_opposing - 1.0) * at_motor;
    println!(
        "# pole_pairs={} r_s={} l_s={} k={} j={} c={} v_dc={} i_max={} load={at_motor} dry={dry} k_p={} k_i={} period={}",
        m.pole_pairs,
        m.r_s,
        m.l_s,
        m.k,
        m.j,
        m.c,
        m.v_dc,
        m.i_max,
        params.controller.k_p,
        params.controller.k_i,
        params.controller.period
    );
    println!("t_us,level_a,level_b,level_c,setpoint_rad_s,i_d_a,i_q_a,rotor_speed_rad_s,rotor_angle_rad,torque_nm");

    let step_us: f64 = std::env::args()
        .nth(1)
        .map_or(1.0, |arg| arg.parse().expect("a step in µs"));
    let per_row = (100.0 / step_us).round() as u32;
    let reference = Reference::with_step(&params, &params, &FaultVector::NOMINAL, load, 1e-6 * step_us);
    let winding = Winding::new(&FaultVector::NOMINAL);
    let mut state = ReferenceState::at_rest(0.0, 0.0);
    let mut levels = [f64::NAN; 3];
    for step in 0..800 * per_row {
        let omega = if step < 400 * per_row { 150.0 } else { 60.0 };
        let t_us = f64::from(step) * step_us;
        let before = state;
        reference.step(&mut state, Setpoint::Speed(omega));
        if step % per_row == 0 || levels.iter().zip(state.v).any(|(a, b)| a.to_bits() != b.to_bits()) {
            levels = state.v;
            let sin_cos = (m.pole_pairs * before.theta_m).sin_cos_poly();
            let [i_d, i_q] = dq_from_abc(before.i, sin_cos);
            let shapes = winding.emf_shapes(sin_cos);
            let torque: f64 = (0..3).map(|j| m.k * shapes[j] * before.i[j]).sum();
            let [a, b, c] = levels.map(|v| u8::from(v > 0.0));
            println!(
                "{t_us},{a},{b},{c},{omega},{i_d:.9},{i_q:.9},{:.9},{:.9},{torque:.9}",
                before.omega_m, before.theta_m
            );
        }
    }
}

#[cfg(not(feature = "std"))]
fn main() {
    eprintln!("the reference needs `--features std`");
}
