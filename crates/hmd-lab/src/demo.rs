//! The demonstration of `hmd demo`: a simulated actuator is commissioned, then wears out, and the pipeline assesses one actuation
//! every 100 hours.
//!
//! In: an MCAP writer and a seed. Out: what was learnt of the unit, then the assessed windows, one after the other; frames and
//! records of these go to the writer. The unit has a vector drive and differs from its data sheet as real ones do ([`EFFECTS`]).

use std::io::{self, Seek, Write};
use std::sync::Arc;

use ema_identify::unit_calibration::UnitCalibration;
use ema_models::reference::{Actuations, CurrentSensing, Drive, EffectError, Effects, Scenario};
use ema_models::{FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Models, WindowCounts};
use hmd_core::commissioning::{CommissioningError, calibrate_unit};
use hmd_core::config::{ActuatorConfig, Config};
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

/// Healthy actuations from which the unit is learnt.
pub const COMMISSIONING: u32 = 10;

/// In what the unit differs from its data sheet: parameters within their tolerances, dead time of the drive, a spring at the
/// output, cogging, errors of the resolver and of the current sensors.
pub const EFFECTS: [(&str, f64); 14] = [
    ("dead_time_s", 1.5e-6),
    ("resistance_deviation", 0.06),
    ("inductance_deviation", -0.08),
    ("back_emf_deviation", 0.03),
    ("inertia_deviation", 0.05),
    ("viscous_deviation", 0.4),
    ("dynamic_friction_deviation", 0.2),
    ("play_deviation", 0.4),
    ("spring_nm_per_rad", 60.0),
    ("cogging_nm", 0.1),
    ("resolver_error_1_rad", 2.9e-3),
    ("resolver_error_2_rad", 2.0e-3),
    ("current_offset_a_a", 0.03),
    ("current_gain_b", 0.008),
];

/// Configuration of the demonstration, with the unit's calibration in the file of this name. The frames show half a second of every
/// hundred hours, so hours are counted by the time stamps. A part that has less than this left is due for repair.
#[must_use]
pub fn config_text(calibration: &str) -> String {
    format!(
        "[[actuator]]
id = 0
calibration = {calibration:?}

[type.bench.drive]
kind = \"vector\"

[rul]
hours = \"elapsed\"
warning_h = 500
critical_h = 200
"
    )
}

/// Why the demonstration ended early.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The interface or the actuator is refused.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// An effect is refused.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The unit cannot be commissioned.
    #[error(transparent)]
    Commissioning(#[from] CommissioningError),
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
    unit: SimulatedUnit,
    pipeline: Pipeline,
    assessor: Assessor,
    /// Number of the next actuation.
    next: u64,
}

impl<W: Write + Seek> Demo<W> {
    /// Starts with this configuration, that of [`config_text`], an empty file and the calibration of [`commissioned`] with the same
    /// seed.
    ///
    /// # Errors
    /// [`DemoError`].
    pub fn new(
        writer: McapWriter<W>,
        config: &Arc<Config>,
        calibration: &UnitCalibration,
        seed: u64,
    ) -> Result<Self, DemoError> {
        let models = Models::load(config, &|_| Ok(calibration.emit()))?;
        Ok(Self {
            writer,
            names: bus_names()?,
            unit: SimulatedUnit::new(config, seed)?,
            pipeline: Pipeline::new(config.clone()),
            assessor: Assessor::new(config.clone(), models, seed),
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
        for frame in traffic(&self.unit.scenario(self.next), self.unit.id(), start_ns) {
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
        self.writer.write(at, &assessed.sensors)?;
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

/// The unit's calibration by [`COMMISSIONING`] healthy actuations before its first hour.
///
/// # Errors
/// [`DemoError`].
pub fn commissioned(config: &Arc<Config>, seed: u64) -> Result<UnitCalibration, DemoError> {
    let unit = SimulatedUnit::new(config, seed)?;
    let names = bus_names()?;
    let mut pipeline = Pipeline::new(config.clone());
    for frame in traffic(&unit.healthy(), unit.id(), EPOCH_NS) {
        pipeline.push(&frame, &names);
    }
    pipeline.finish();
    let mut jobs = pipeline.take_windows();
    let of_type = Models::load_types(config, &|_| Err(io::Error::from(io::ErrorKind::Unsupported)))?;
    let assessor = Assessor::new(config.clone(), of_type, seed);
    let learnt = calibrate_unit(&assessor, config.health().levels(), &mut jobs, seed, &|_| ())?;
    Ok(learnt.calibration)
}

fn bus_names() -> Result<BusNames, BusError> {
    let mut names = BusNames::new();
    names.intern("can0")?;
    Ok(names)
}

/// The unit that is simulated.
struct SimulatedUnit {
    actuator: ActuatorConfig,
    effects: Effects,
    seed: u64,
}

impl SimulatedUnit {
    fn new(config: &Config, seed: u64) -> Result<Self, EffectError> {
        let actuator = config.actuators()[0].clone();
        let mut effects = Effects {
            drive: Drive::of_type(&actuator.drive),
            ..Effects::default()
        };
        for (name, value) in EFFECTS {
            effects.set(name, value)?;
        }
        Ok(Self {
            actuator,
            effects,
            seed,
        })
    }

    fn id(&self) -> ActuatorId {
        self.actuator.id
    }

    /// The healthy actuations.
    fn healthy(&self) -> Scenario {
        self.actuations(COMMISSIONING, FaultVector::NOMINAL, mix(self.seed, &[ACTUATIONS]))
    }

    /// One actuation of the unit as worn as it is then.
    fn scenario(&self, n: u64) -> Scenario {
        self.actuations(1, worn(n), mix(self.seed, &[n]))
    }

    fn actuations(&self, count: u32, fault: FaultVector, seed: u64) -> Scenario {
        Scenario {
            effects: self.effects,
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: 0.02,
            },
            actuations: Actuations {
                rest: 0.1,
                count,
                ..Actuations::single(Profile::Mixed)
            },
            ..Scenario::new(self.actuator.params, fault, seed)
        }
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
