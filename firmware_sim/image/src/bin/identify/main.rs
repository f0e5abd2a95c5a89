//! Identifications on the processor, with what they cost, as `name value` lines on the debugger's console.
//!
//! The windows are in the source file that `HMD_TARGET_CASES` names (`tests/examples/target_cases.rs` writes it);
//! `cargo xtask target` builds and runs this and compares what it prints with what the host finds.
#![no_std]
#![no_main]

mod board;

use core::hint::black_box;

use board::Clock;
use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use ema_identify::calibration::{Mismatch, SignalTable};
use ema_identify::relations::{
    BalanceCoefficients, BalanceShape, Baseline, CommissionedRelations, Compliance, HealthyResidual, MeasuredWindow,
};
use ema_identify::{
    ActuatorKnowledge, MonitoredWindow, RecordedWindow, SampleDrive, StreamedWindow, identify_recorded,
};
use ema_models::Form::ThreePhase;
use ema_models::{
    ActuatorParams, Calibration, Conditions, ControllerParams, Coordinates, FaultVector, InitialState, Monitor,
    MonitorState, MotorDeviation, MotorKnowledge, MotorParams, Real, Ripple, Scale, SensorParams, TransmissionParams,
};
use ema_wire::Mode::{self, Position};
use firmware_image::{EstimateLines, RelationsLines, StoredSample};

/// One recorded window, and what is known of its actuator.
struct Case {
    name: &'static str,
    actuator: ActuatorKnowledge,
    conditions: Conditions,
    /// Samples before the trigger.
    rest: usize,
    words: &'static [Word],
}

/// Phase currents, mA; motor and output counts; setpoint and its mode.
type Word = ([i16; 3], i32, i32, i32, Mode);

// `CASES`; `LONGEST`, the samples of the longest window; `UNIT`, what was learnt of the first window's unit.
include!(env!("HMD_TARGET_CASES"));

/// A sample before it is recorded.
const NOTHING: StoredSample = StoredSample {
    currents_ma: [0; 3],
    mode: Mode::Idle,
    motor_counts: 0,
    output_counts: 0,
    setpoint: 0,
};

/// Passes of the loop that the count of instructions is checked with.
const PASSES: u32 = 1_000_000;

#[entry]
fn main() -> ! {
    let clock = Clock::start();
    match by_relations(clock).and_then(|()| by_monitor(clock)) {
        Some(()) => debug::exit(debug::EXIT_SUCCESS),
        None => debug::exit(debug::EXIT_FAILURE),
    }
    loop {
        core::hint::spin_loop();
    }
}

/// Estimates the first window by the relations of its unit.
#[inline(never)]
fn by_relations(clock: Clock) -> Option<()> {
    let case = CASES.first()?;
    let mut samples = [NOTHING; LONGEST];
    let samples = samples.get_mut(..case.words.len())?;
    record(samples, case.words);
    let window = MeasuredWindow::new(&case.actuator.params, samples, &[]);
    let (estimate, counted) = clock.count(|| UNIT.estimate(&window));
    hprintln!("relations_instructions {}", counted);
    let (name, estimate) = (case.name, &estimate);
    hprintln!("{}", RelationsLines { name, estimate });
    Some(())
}

/// Identifies all windows by the monitor, and prints how full the memories are.
#[inline(never)]
fn by_monitor(clock: Clock) -> Option<()> {
    let (_, counted) = clock.count(|| board::pass(PASSES));
    hprintln!("loop_expected {}", board::INSTRUCTIONS_PER_PASS * PASSES);
    hprintln!("loop_counted {}", counted);

    let mut samples = [NOTHING; LONGEST];
    for (n, case) in CASES.iter().enumerate() {
        let samples = samples.get_mut(..case.words.len())?;
        record(samples, case.words);
        let (window, counted) = clock.count(|| RecordedWindow::new(&case.actuator.params, samples, case.rest));
        let window = window?;
        hprintln!("{}/prepare_instructions {}", case.name, counted);
        let streamed = StreamedWindow::new(&window, &case.actuator, case.conditions);
        if n == 0 {
            measure_parts(clock, case, &window, &streamed)?;
        }
        let (estimate, counted) = clock.count(|| identify_recorded(&streamed, &case.actuator.mismatch));
        hprintln!("{}/identify_instructions {}", case.name, counted);
        let (name, estimate) = (case.name, &estimate);
        hprintln!("{}", EstimateLines { name, estimate });
    }

    hprintln!("window_bytes {}", size_of_val(&samples));
    hprintln!(
        "case_bytes {}",
        CASES.iter().map(|case| size_of_val(case.words)).sum::<usize>()
    );
    hprintln!("flash_bytes {}", board::flash_bytes());
    hprintln!("static_bytes {}", board::static_bytes());
    hprintln!("stack_bytes {}", board::stack_bytes());
    Some(())
}

/// Fills the window in RAM, as a recorder does.
#[inline(never)]
fn record(into: &mut [StoredSample], words: &[Word]) {
    for (slot, &(currents_ma, motor_counts, output_counts, setpoint, mode)) in into.iter_mut().zip(words) {
        *slot = StoredSample {
            currents_ma,
            mode,
            motor_counts,
            output_counts,
            setpoint,
        };
    }
}

/// What the parts of an identification cost.
#[inline(never)]
fn measure_parts(
    clock: Clock,
    case: &Case,
    window: &RecordedWindow<'_, StoredSample>,
    streamed: &StreamedWindow<'_, StoredSample>,
) -> Option<()> {
    let healthy = Scale::new(&case.actuator.params).coordinates(&streamed.unknowns_with(FaultVector::NOMINAL));
    let single = monitor_instructions::<f32>(clock, case, window, &healthy)?;
    hprintln!("single_instructions {}", single);
    let double = monitor_instructions::<f64>(clock, case, window, &healthy)?;
    hprintln!("double_instructions {}", double);
    let per_sample = ema_models::STEPS_PER_CONTROL as usize * window.controls();
    hprintln!("monitor_steps {}", per_sample * window.len());
    let (cost, counted) = clock.count(|| streamed.cost(black_box(&healthy)));
    black_box(cost);
    hprintln!("cost_instructions {}", counted);
    let (sums, counted) = clock.count(|| streamed.normal_equations(black_box(&healthy), 2e-2));
    black_box(sums);
    hprintln!("linearisation_instructions {}", counted);
    Some(())
}

/// Instructions of the monitor alone over the window, in numbers of type `R`, on what is made ready for it once a sample.
#[inline(never)]
fn monitor_instructions<R: Real>(
    clock: Clock,
    case: &Case,
    window: &RecordedWindow<'_, StoredSample>,
    at: &Coordinates,
) -> Option<u64> {
    let ActuatorKnowledge {
        params, calibration, ..
    } = &case.actuator;
    let unknowns = case.conditions.at_temperature(&Scale::new(params).unknowns(at));
    let monitor = Monitor::new(params, calibration, case.conditions.v_dc, &unknowns).map(R::splat);
    let mut state = monitor.start(window.initial(), &window.compared().next()?);
    let (_, nothing) = clock.count(|| ());
    let mut total = 0;
    window.for_each_drive::<R>(|drive| {
        let counted = &drive.counted[..window.controls()];
        let (_, count) = clock.count(|| over_sample(&monitor, &mut state, (window.initial(), counted), drive));
        total += count - nothing;
    });
    black_box(monitor.output(&state).theta_m);
    Some(total)
}

/// The monitor from one sample to the next, in a function of its own as identification runs it.
#[inline(never)]
fn over_sample<R: Real>(
    monitor: &Monitor<R>,
    state: &mut MonitorState<R>,
    (initial, counted): (&InitialState, &[R]),
    drive: &SampleDrive<R>,
) {
    monitor.run_sample_period_with(state, initial, drive.setpoint, counted, drive.theta_m);
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    debug::exit(debug::EXIT_FAILURE);
    loop {
        core::hint::spin_loop();
    }
}
