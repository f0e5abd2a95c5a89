//! The demonstration of `hmd demo`: a simulated actuator wears out, and the pipeline assesses one actuation every 100 hours.
//!
//! In: an MCAP writer and a seed. Out: the assessed windows, one after the other; frames and records go to the writer.

use std::io::{Seek, Write};
use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Models, WindowCounts};
use hmd_core::config::Config;
use hmd_core::frame::{BusError, BusNames};
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_core::seed::mix;
use hmd_storage::mcap_writer::{McapCounts, McapWriteError, McapWriter};

use crate::simulate::{EPOCH_NS, traffic};

/// Actuations shown, evenly over the life.
pub const ACTUATIONS: u64 = 24;

/// Flight hours between two of them.
pub const HOURS_BETWEEN: u64 = 100;

/// Configuration of the demonstration. The frames show half a second of every hundred hours, so hours are counted by the
/// time stamps. A part that has less than this left is due for repair.
pub const CONFIG: &str = "[rul]
hours = \"elapsed\"
warning_h = 500
critical_h = 200
";

/// Why the demonstration ended early.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The interface or the actuator is refused.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A window cannot be assessed.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// The output cannot be written.
    #[error(transparent)]
    Write(#[from] McapWriteError),
}

/// What went through the demonstration.
#[derive(Clone, Copy, Debug)]
pub struct DemoCounts {
    /// Frames received.
    pub frames: u64,
    /// Windows.
    pub windows: WindowCounts,
    /// What was written.
    pub written: McapCounts,
}

/// The demonstration in progress.
pub struct Demo<W: Write + Seek> {
    writer: McapWriter<W>,
    names: BusNames,
    actuator: ActuatorId,
    pipeline: Pipeline,
    assessor: Assessor,
    seed: u64,
    /// Number of the next actuation.
    next: u64,
}

impl<W: Write + Seek> Demo<W> {
    /// Starts with this configuration, that of [`CONFIG`], and an empty file.
    ///
    /// # Errors
    /// [`DemoError`].
    pub fn new(
        writer: McapWriter<W>,
        config: &Arc<Config>,
        actuator: ActuatorId,
        seed: u64,
    ) -> Result<Self, DemoError> {
        let mut names = BusNames::new();
        names.intern("can0")?;
        Ok(Self {
            writer,
            names,
            actuator,
            pipeline: Pipeline::new(config.clone()),
            assessor: Assessor::new(config.clone(), Models::without_files(config)?, seed),
            seed,
            next: 0,
        })
    }

    /// Simulates, records and assesses the next actuation: its flight hours and its windows; `None` after the last.
    ///
    /// # Errors
    /// [`DemoError`].
    pub fn next_actuation(&mut self) -> Result<Option<(u64, Vec<AssessedWindow>)>, DemoError> {
        if self.next == ACTUATIONS {
            return Ok(None);
        }
        let hours = self.next * HOURS_BETWEEN;
        let start_ns = EPOCH_NS + hours * 3_600_000_000_000;
        for frame in traffic(&scenario(self.next, self.seed), self.actuator, start_ns) {
            self.writer.write_frame(&frame, &self.names)?;
            self.pipeline.push(&frame, &self.names);
        }
        self.pipeline.finish();
        self.next += 1;
        let windows: Result<_, _> = self
            .pipeline
            .take_windows()
            .into_iter()
            .map(|job| self.assess(job))
            .collect();
        Ok(Some((hours, windows?)))
    }

    fn assess(&mut self, job: WindowJob) -> Result<AssessedWindow, DemoError> {
        let assessed = self.assessor.assess(job)?;
        let at = assessed.health.t_start_ns;
        self.writer.write(at, &assessed.window)?;
        self.writer.write(at, &assessed.health)?;
        self.writer.write(at, &assessed.rul)?;
        self.writer.flush_window()?;
        Ok(assessed)
    }

    /// Ends the file with the status record.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> Result<DemoCounts, DemoError> {
        let (frames, windows) = (self.pipeline.frames().received, self.assessor.counts());
        let status = self.pipeline.status(&self.names, windows);
        self.writer.write(self.pipeline.last_stamp_ns(), &status)?;
        let (_, written) = self.writer.finish()?;
        Ok(DemoCounts {
            frames,
            windows,
            written,
        })
    }
}

/// One actuation of the actuator as worn as it is then.
fn scenario(n: u64, seed: u64) -> Scenario {
    Scenario {
        sensing: CurrentSensing {
            quantised: true,
            noise_rms: 0.02,
        },
        actuations: Actuations {
            rest: 0.1,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(ActuatorParams::bench(), worn(n), mix(seed, &[n]))
    }
}

/// The wear shown: friction grows steadily, backlash faster and faster, and one phase begins to short near the end.
fn worn(n: u64) -> FaultVector {
    let life = n as f64 / (ACTUATIONS - 1) as f64;
    FaultVector {
        friction: 0.75 * life,
        backlash: 0.25 * life.powi(3),
        short_b: 0.4 * (life - 0.7).max(0.0),
        ..FaultVector::NOMINAL
    }
}
