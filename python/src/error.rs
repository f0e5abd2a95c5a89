//! Errors: the sentence that the command would print, in an exception of the kind of its exit code.

use hmd::commands::{BAD_CONFIG, USAGE, code_of, sentence};
use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::PyException;

create_exception!(
    hmd,
    Error,
    PyException,
    "What `hmd` would end with 1 for: a log that cannot be read or has nothing to assess."
);
create_exception!(
    hmd,
    ConfigError,
    Error,
    "A bad configuration, or a file that it names (exit code 78)."
);
create_exception!(hmd, UsageError, Error, "Arguments that make no sense (exit code 2).");

/// The exception of an error.
pub(crate) fn raised(error: impl Into<anyhow::Error>) -> PyErr {
    let error = error.into();
    let text = sentence(&error);
    match code_of(&error) {
        BAD_CONFIG => ConfigError::new_err(text),
        USAGE => UsageError::new_err(text),
        _ => Error::new_err(text),
    }
}

/// Arguments that make no sense.
pub(crate) fn misuse(text: impl Into<String>) -> PyErr {
    UsageError::new_err(text.into())
}
