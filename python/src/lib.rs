//! What the Python package `hmd` calls: the program's own code, with the interpreter's lock released while it computes.
//!
//! The Python side (`package/hmd/__init__.py`) holds the documentation and the types; here are thin functions that take
//! plain values and give back text and Arrow streams.

mod arrow;
mod assessed;
mod error;
mod fit_problem;
mod logs;
mod verbs;

use pyo3::prelude::*;

/// The compiled half of the package.
#[pymodule]
mod _hmd {
    #[pymodule_export]
    use super::arrow::ArrowTable;
    #[pymodule_export]
    use super::assessed::{AssessedWindow, identify, replay};
    #[pymodule_export]
    use super::error::{ConfigError, Error, UsageError};
    #[pymodule_export]
    use super::fit_problem::FitProblem;
    #[pymodule_export]
    use super::logs::{
        config_identity, configured_serial_numbers, has_map, logs_in, read_raw, read_records, serial_numbers,
    };
    #[pymodule_export]
    use super::verbs::run;

    /// Names of k1 to k8.
    #[pymodule_export]
    const FAULT_PARAMETERS: [&str; ema_models::FAULT_COUNT] = ema_models::FaultVector::NAMES;

    /// Version of the program.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
