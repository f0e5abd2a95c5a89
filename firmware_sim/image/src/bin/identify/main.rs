//! One identification on the processor, with what it costs, as `name value` lines on the debugger's console.
//!
//! The window is the source file that `HMD_TARGET_CASE` names (`tests/examples/target_case.rs` writes it);
//! `cargo xtask target` builds, runs and judges this.
#![no_std]
#![no_main]

mod board;

use core::hint::black_box;

use board::Clock;
use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use ema_models::Form::ThreePhase;
use ema_models::{
    ActuatorParams, Calibration, Conditions, ControllerParams, Coordinates, MotorDeviation, MotorKnowledge,
    MotorParams, Prior, Ripple, Scale, SensorParams, Signals, TransmissionParams,
};
use ema_wire::{ActuatorId, Mode, Sample};
use firmware_image::{Identification, RecordedWindow};

/// Phase currents, mA; motor and output counts; setpoint, µrad.
type Word = (i16, i16, i16, i32, i32, i32);

include!(env!("HMD_TARGET_CASE"));

/// A sample before it is recorded.
const NOTHING: Sample = Sample {
    actuator: match ActuatorId::new(0) {
        Some(actuator) => actuator,
        None => panic!("there is an actuator 0"),
    },
    seq: 0,
    time_us: 0,
    i_a_ma: 0,
    i_b_ma: 0,
    i_c_ma: 0,
    motor_counts: 0,
    output_counts: 0,
    setpoint: 0,
    mode: Mode::Idle,
};

/// Passes of the loop that the count of instructions is checked with.
const PASSES: u32 = 1_000_000;

#[entry]
fn main() -> ! {
    let clock = Clock::start();
    match run(clock) {
        Some(()) => debug::exit(debug::EXIT_SUCCESS),
        None => debug::exit(debug::EXIT_FAILURE),
    }
    loop {
        core::hint::spin_loop();
    }
}

fn run(clock: Clock) -> Option<()> {
    let (_, counted) = clock.count(|| board::pass(PASSES));
    hprintln!("loop_expected {}", board::INSTRUCTIONS_PER_PASS * PASSES);
    hprintln!("loop_counted {}", counted);

    let mut samples = [NOTHING; WINDOW.len()];
    record(&mut samples);
    let (window, counted) = clock.count(|| RecordedWindow::new(&IDENTIFICATION.params, &samples, REST));
    let window = window?;
    hprintln!("prepare_instructions {}", counted);

    let healthy = Coordinates(core::array::from_fn(|p| if p == 7 { 0.5 } else { 0.0 }));
    monitor_steps(clock, &window, &healthy)?;
    let (cost, counted) = clock.count(|| IDENTIFICATION.cost(&window, black_box(&healthy)));
    black_box(cost);
    hprintln!("cost_instructions {}", counted);
    let (sums, counted) = clock.count(|| IDENTIFICATION.normal_equations(&window, black_box(&healthy), 2e-2));
    black_box(sums);
    hprintln!("linearisation_instructions {}", counted);

    let (found, counted) = clock.count(|| IDENTIFICATION.identify(&window));
    hprintln!("identify_instructions {}", counted);
    for (p, x) in found.at.0.iter().enumerate() {
        hprintln!("x{} {:016x}", p, x.to_bits());
    }
    hprintln!("cost {:016x}", found.cost.to_bits());
    hprintln!("linearisations {}", found.linearisations);
    hprintln!("runs {}", found.runs);

    hprintln!("window_bytes {}", size_of_val(&samples));
    hprintln!("case_bytes {}", size_of_val(&WINDOW));
    hprintln!("flash_bytes {}", board::flash_bytes());
    hprintln!("static_bytes {}", board::static_bytes());
    hprintln!("stack_bytes {}", board::stack_bytes());
    Some(())
}

/// Fills the window in RAM, as a recorder does.
#[inline(never)]
fn record(into: &mut [Sample]) {
    for (n, (slot, word)) in into.iter_mut().zip(&WINDOW).enumerate() {
        let (i_a_ma, i_b_ma, i_c_ma, motor_counts, output_counts, setpoint) = *word;
        *slot = Sample {
            seq: n as u16,
            time_us: (500 * n) as u16,
            i_a_ma,
            i_b_ma,
            i_c_ma,
            motor_counts,
            output_counts,
            setpoint,
            mode: Mode::Position,
            ..*slot
        };
    }
}

/// The monitor alone, on what is made ready for it once a sample.
#[inline(never)]
fn monitor_steps(clock: Clock, window: &RecordedWindow<'_>, at: &Coordinates) -> Option<()> {
    let monitor = IDENTIFICATION.monitor(&Scale::new(&IDENTIFICATION.params).unknowns(at));
    let mut state = monitor.start(window.initial(), &window.compared().next()?);
    let (_, nothing) = clock.count(|| ());
    let (mut total, mut steps) = (0, 0);
    for drive in window.drives() {
        let counted = &drive.counted[..window.controls()];
        let (_, count) = clock.count(|| {
            monitor.run_sample_period_with(&mut state, window.initial(), drive.setpoint, counted, drive.theta_m);
        });
        total += count - nothing;
        steps += ema_models::STEPS_PER_CONTROL * window.controls() as u32;
    }
    black_box(monitor.output(&state));
    hprintln!("monitor_instructions {}", total);
    hprintln!("monitor_steps {}", steps);
    Some(())
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    debug::exit(debug::EXIT_FAILURE);
    loop {
        core::hint::spin_loop();
    }
}
