//! Logs of measured signals: values over time instead of frames.
//!
//! [`SignalLog`] is one log, whatever its format; [`MappedFrames`] makes the frames of the built-in dictionary of its rows, by the map of
//! an actuator (`[map]`), resampled to the times of the currents where signals have several rates. Each row becomes a CAN FD frame with
//! one sample, behind a status frame where the conditions changed, on the actuator's interface, so that everything behind a reader is the
//! same for every log. How rows become samples: [`hmd_core::log_map::RowDecoder`].

mod course;
mod csv;
mod decoder_panics;
mod ended_once;
mod frames;
mod log;
mod parquet;
mod parquet_columns;
mod parquet_headers;
mod parquet_pages;
mod resampled;

pub use self::parquet::{MAGIC as PARQUET_MAGIC, ParquetLog};
pub use csv::CsvLog;
pub use frames::MappedFrames;
pub use log::{Between, Interpolated, SignalInfo, SignalLog, TextValue, Unusable};
