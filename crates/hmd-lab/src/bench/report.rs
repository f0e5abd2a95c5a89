//! What `hmd bench` prints.

use serde::Serialize;

/// Result of `hmd bench`.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// The actuator type.
    pub actuator: &'static str,
    /// Form of the monitor, the one that the accuracy figures are of.
    pub monitor: &'static str,
    /// Its integration step, µs.
    pub step_us: f64,
    /// Length of the window, s.
    pub window_s: f64,
    /// Its samples per second.
    pub sample_rate_hz: f64,
    /// The instruction set in use.
    pub instruction_set: &'static str,
    /// Monitors side by side in one batch, single precision.
    pub lanes: usize,
    /// Evaluations per second of one core, one monitor at a time in double precision.
    pub scalar_f64_per_s: f64,
    /// The same with each instruction set that the processor has.
    pub instruction_sets: Vec<SetFigure>,
    /// One linearisation, the point and a step along each unknown in double precision, ms.
    pub linearisation_ms: f64,
    /// By number of threads.
    pub threads: Vec<ThreadFigure>,
    /// One evaluation by the window's length.
    pub by_window: Vec<EvaluationFigure>,
    /// One evaluation by the sample rate, at the same length.
    pub by_sample_rate: Vec<EvaluationFigure>,
    /// One identification on all threads by the population of its genetic algorithm.
    pub by_population: Vec<PopulationFigure>,
    /// One window of each actuator on all threads.
    pub by_actuators: Vec<ActuatorsFigure>,
}

/// Evaluations of one core with one instruction set.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SetFigure {
    /// Its name.
    pub name: &'static str,
    /// Evaluations per second.
    pub evaluations_per_s: f64,
    /// That over the scalar's.
    pub over_scalar_f64: f64,
}

/// What a number of threads does.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ThreadFigure {
    /// Their number.
    pub threads: usize,
    /// Evaluations per second.
    pub evaluations_per_s: f64,
    /// That over one thread's.
    pub over_one: f64,
    /// Time of one identification by itself, ms.
    pub identification_ms: f64,
    /// Identifications per second of many windows.
    pub identifications_per_s: f64,
}

/// Cost of one evaluation in a batch on one core.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct EvaluationFigure {
    /// Length of the window, s.
    pub window_s: f64,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Time of one evaluation, µs.
    pub evaluation_us: f64,
}

/// Cost of one identification.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PopulationFigure {
    /// Individuals of the genetic algorithm.
    pub population: usize,
    /// Monitor runs of one identification.
    pub evaluations: u64,
    /// Its time, ms.
    pub identification_ms: f64,
}

/// Cost of one window of each of several actuators.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ActuatorsFigure {
    /// Number of actuators.
    pub actuators: usize,
    /// Time until the window of each is identified, ms.
    pub all_ms: f64,
}
