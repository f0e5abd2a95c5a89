//! Result of a benchmark, and its tables as `hmd bench` prints them.

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

impl BenchReport {
    /// The figures as Markdown tables.
    #[must_use]
    pub fn tables(&self) -> String {
        let mut text = format!(
            "{} monitor of {}, step {} us, window {} s at {} Hz; {}, {} monitors side by side\n",
            self.monitor,
            self.actuator,
            self.step_us,
            self.window_s,
            self.sample_rate_hz,
            self.instruction_set,
            self.lanes
        );
        text += "\n| one core | evaluations/s | over scalar f64 |\n|---|---|---|\n";
        text += &format!("| scalar f64 | {:.0} | 1.0 |\n", self.scalar_f64_per_s);
        for set in &self.instruction_sets {
            text += &format!(
                "| {} | {:.0} | {:.1} |\n",
                set.name, set.evaluations_per_s, set.over_scalar_f64
            );
        }
        text += &format!("\nOne linearisation: {:.2} ms\n", self.linearisation_ms);
        text += "\n| threads | evaluations/s | over one | one identification, ms | identifications/s |\n|---|---|---|---|---|\n";
        for f in &self.threads {
            text += &format!(
                "| {} | {:.0} | {:.2} | {:.1} | {:.0} |\n",
                f.threads, f.evaluations_per_s, f.over_one, f.identification_ms, f.identifications_per_s
            );
        }
        text += "\n| window, s | sample rate, Hz | one evaluation on one core, us |\n|---|---|---|\n";
        for f in self.by_window.iter().chain(&self.by_sample_rate) {
            text += &format!("| {} | {} | {:.1} |\n", f.window_s, f.sample_rate_hz, f.evaluation_us);
        }
        text += "\n| population | evaluations | one identification on all threads, ms |\n|---|---|---|\n";
        for f in &self.by_population {
            text += &format!(
                "| {} | {} | {:.1} |\n",
                f.population, f.evaluations, f.identification_ms
            );
        }
        text += "\n| actuators | one window of each on all threads, ms |\n|---|---|\n";
        for f in &self.by_actuators {
            text += &format!("| {} | {:.1} |\n", f.actuators, f.all_ms);
        }
        text.truncate(text.trim_end().len());
        text
    }
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
