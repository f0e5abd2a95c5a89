//! Windows assessed: of logs (`replay`), and of samples in arrays (`identify`).

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;
use ema_models::{SensedSample, Setpoint};
use hmd::commands::recordings::{Wanted, recordings};
use hmd::commands::replay::check_output;
use hmd::commands::{check_files, load_config};
use hmd::replay::{Observer, Replay};
use hmd_core::actuator_stream::cut_windows;
use hmd_core::assess::{self, Assessor};
use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::record::HealthLine;
use hmd_core::sample::{MeasuredConditions, SampleRate};
use hmd_core::window::TimedSample;
use hmd_report::export::{Origin, TableKind, distinct_names, health_row};
use hmd_storage::calibration_file::load_models;
use hmd_storage::event_file::load_events;
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;

use crate::arrow::{ArrowTable, Batches};
use crate::error::{misuse, raised};

/// Assessed windows, and notices about them.
// The name in Python is public there.
#[pyclass(frozen, name = "Judged")]
pub(crate) struct AssessedWindow {
    /// The lines of `hmd replay --json`.
    #[pyo3(get)]
    lines: Vec<String>,
    /// What an operator should read.
    #[pyo3(get)]
    notices: Vec<String>,
    /// What was lost, in a sentence; none if nothing was.
    #[pyo3(get)]
    loss: Option<String>,
    /// A row for each line, as `hmd export` writes it.
    #[pyo3(get)]
    table: Py<ArrowTable>,
}

/// Collects the records of a replay.
struct CollectedRecords {
    lines: Vec<String>,
    notices: Vec<String>,
    rows: Batches,
    /// Serial numbers of the actuators by name.
    serial_numbers: BTreeMap<String, String>,
    /// Names of the logs by path.
    names: BTreeMap<PathBuf, String>,
    /// The logs so far: stamp of the first frame, ns, and name.
    begun: Vec<(u64, String)>,
}

impl CollectedRecords {
    fn new() -> Self {
        Self {
            lines: Vec::new(),
            notices: Vec::new(),
            rows: Batches::new(TableKind::Health.heads()),
            serial_numbers: BTreeMap::new(),
            names: BTreeMap::new(),
            begun: Vec::new(),
        }
    }

    /// Names the units of a configuration, and the logs.
    fn note_origin(&mut self, config: &Config, logs: &[PathBuf]) {
        let serial_of = |actuator: &ActuatorConfig| Some((actuator.name.clone(), actuator.serial_number.clone()?));
        self.serial_numbers = config.actuators().iter().filter_map(serial_of).collect();
        self.names = logs.iter().cloned().zip(distinct_names(logs)).collect();
    }

    fn take(&mut self, assessed: &assess::AssessedWindow) {
        self.lines
            .push(HealthLine::from((&assessed.health, &assessed.rul)).to_json());
        let serial_number = self.serial_numbers.get(&assessed.health.actuator);
        let origin = Origin {
            serial_number: serial_number.map_or("", String::as_str),
            file: self.log_at(assessed.health.t_start_ns),
        };
        self.rows.row(health_row(&assessed.health, &assessed.rul, origin));
    }

    /// The log that a window began in: the newest that had begun by then. Empty for samples in arrays.
    fn log_at(&self, t_start_ns: u64) -> &str {
        let begun = self.begun.iter().rev().find(|(first_ns, _)| *first_ns <= t_start_ns);
        begun.or(self.begun.first()).map_or("", |(_, name)| name)
    }

    fn into_assessed(mut self, py: Python<'_>, loss: Option<String>) -> PyResult<AssessedWindow> {
        Ok(AssessedWindow {
            lines: self.lines,
            notices: self.notices,
            loss,
            table: Py::new(py, self.rows.finish()?)?,
        })
    }
}

impl Observer for CollectedRecords {
    fn log_begins(&mut self, log: &Path, stamp_ns: u64) {
        let name = self.names.get(log).cloned().unwrap_or_default();
        self.begun.push((stamp_ns, name));
    }

    fn assessed(&mut self, assessed: &assess::AssessedWindow) -> io::Result<()> {
        self.take(assessed);
        Ok(())
    }

    fn notice(&mut self, message: &str) {
        self.notices.push(message.to_owned());
    }

    fn progress(&mut self, _: u64) {}
}

/// Computes on threads of its own, which a fork later cannot hang on; without the interpreter's lock.
pub(crate) fn compute<T: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce() -> anyhow::Result<T> + Send,
) -> PyResult<T> {
    let computed = py.detach(|| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.context("cannot start threads")?.install(work)
    });
    computed.map_err(raised)
}

/// The configuration of a file and all that it names, or the defaults; and what an operator should read of them.
fn checked_config(path: Option<&PathBuf>, notices: &mut Vec<String>) -> anyhow::Result<Arc<Config>> {
    let config = load_config(path.map(PathBuf::as_path))?;
    check_files(&config, &mut |notice| notices.push(notice.to_owned()))?;
    Ok(Arc::new(config))
}

/// Assesses logs.
#[pyfunction]
pub(crate) fn replay(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    config: Option<PathBuf>,
    output: Option<PathBuf>,
    seed: u64,
    threads: usize,
) -> PyResult<AssessedWindow> {
    if logs.is_empty() {
        return Err(misuse("expected a log, found none"));
    }
    let (records, loss) = compute(py, threads, || {
        let logs = recordings(&logs, Wanted::Logs)?;
        let mut records = CollectedRecords::new();
        let config = checked_config(config.as_ref(), &mut records.notices)?;
        if let Some(output) = &output {
            check_output(output, &logs, &config)?;
        }
        records.note_origin(&config, &logs);
        let replay = Replay {
            logs: &logs,
            output: output.as_deref(),
            config,
            seed,
        };
        let summary = replay.run(&mut records)?;
        summary.check(&logs, &replay.config)?;
        Ok((records, summary.loss()))
    })?;
    records.into_assessed(py, loss)
}

/// Samples of one actuator, a value of each column for each sample.
#[derive(FromPyObject)]
pub(crate) struct Columns {
    #[pyo3(item)]
    seq: PyBuffer<i64>,
    #[pyo3(item)]
    t_ns: PyBuffer<i64>,
    #[pyo3(item)]
    i_a_a: PyBuffer<f64>,
    #[pyo3(item)]
    i_b_a: PyBuffer<f64>,
    #[pyo3(item)]
    i_c_a: PyBuffer<f64>,
    #[pyo3(item)]
    motor_counts: PyBuffer<i64>,
    #[pyo3(item)]
    output_counts: PyBuffer<i64>,
    /// 0 idle, 1 position, 2 speed.
    #[pyo3(item)]
    mode: PyBuffer<i64>,
    #[pyo3(item)]
    setpoint: PyBuffer<f64>,
}

impl Columns {
    fn samples(&self, py: Python<'_>) -> PyResult<Vec<TimedSample>> {
        let (seq, t_ns) = (self.seq.to_vec(py)?, self.t_ns.to_vec(py)?);
        let currents = [&self.i_a_a, &self.i_b_a, &self.i_c_a].map(|column| column.to_vec(py));
        let [i_a, i_b, i_c] = currents;
        let (i_a, i_b, i_c) = (i_a?, i_b?, i_c?);
        let (motor, output) = (self.motor_counts.to_vec(py)?, self.output_counts.to_vec(py)?);
        let (mode, setpoint) = (self.mode.to_vec(py)?, self.setpoint.to_vec(py)?);
        let lengths = [
            t_ns.len(),
            i_a.len(),
            i_b.len(),
            i_c.len(),
            motor.len(),
            output.len(),
            mode.len(),
            setpoint.len(),
        ];
        if let Some(found) = lengths.iter().find(|length| **length != seq.len()) {
            return Err(misuse(format!(
                "columns: expected {} values in each, found {found}",
                seq.len()
            )));
        }
        let unsigned = |name: &str, n: usize, value: i64| {
            u64::try_from(value).map_err(|_| misuse(format!("{name}[{n}]: expected a number from 0, found {value}")))
        };
        let sample = |n: usize| {
            let seq = unsigned("seq", n, seq[n])?;
            let sensed = SensedSample {
                seq,
                currents: [i_a[n], i_b[n], i_c[n]],
                motor_counts: motor[n],
                output_counts: output[n],
                setpoint: match mode[n] {
                    1 => Setpoint::Position(setpoint[n]),
                    2 => Setpoint::Speed(setpoint[n]),
                    _ => Setpoint::Idle,
                },
            };
            Ok(TimedSample {
                seq,
                stamp_ns: unsigned("t_ns", n, t_ns[n])?,
                sensed,
            })
        };
        (0..seq.len()).map(sample).collect()
    }
}

/// What was measured beside the samples.
#[derive(FromPyObject)]
pub(crate) struct Measured {
    #[pyo3(item)]
    dc_link_v: Option<f64>,
    #[pyo3(item)]
    winding_temp_c: Option<f64>,
    #[pyo3(item)]
    load_torque_nm: Option<f64>,
}

/// Cuts samples into windows and assesses them, as those of a log are.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the Python side names them")]
pub(crate) fn identify(
    py: Python<'_>,
    columns: Columns,
    rate_hz: f64,
    measured: Measured,
    actuator: &str,
    config: Option<PathBuf>,
    seed: u64,
    threads: usize,
) -> PyResult<AssessedWindow> {
    let samples = columns.samples(py)?;
    let rate = SampleRate {
        hz: rate_hz,
        uncertainty: 0.0,
        is_measured: true,
    };
    let conditions = MeasuredConditions {
        dc_link_v: measured.dc_link_v,
        winding_temp_deg_c: measured.winding_temp_c,
        load_torque_nm: measured.load_torque_nm,
    };
    let mut records = CollectedRecords::new();
    let config = checked_config(config.as_ref(), &mut records.notices).map_err(raised)?;
    let Some(known) = config.actuator_named(actuator).cloned().map(Arc::new) else {
        return Err(misuse(format!(
            "actuator: expected one of the configuration, found {actuator:?}"
        )));
    };
    let records = compute(py, threads, move || {
        let (jobs, notices) = cut_windows(&config, &known, rate, conditions, samples);
        records.notices.extend(notices.into_iter().map(|notice| notice.message));
        let events = load_events(&config)?;
        let mut assessor = Assessor::new(config.clone(), load_models(&config)?, seed);
        assessor.histories().set_events(events);
        for job in jobs {
            records.take(&assessor.assess(job)?);
        }
        Ok(records)
    })?;
    records.into_assessed(py, None)
}
