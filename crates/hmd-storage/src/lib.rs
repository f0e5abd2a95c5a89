//! What `hmd` keeps on disk: MCAP recordings, folders of segments, configuration, calibration, history and event files.

#[cfg(test)]
#[path = "../../hmd-core/src/frame/any_frame.rs"]
mod any_frame;
pub mod calibration_file;
pub mod clock;
pub mod config_file;
pub mod event_file;
pub mod held_lock;
pub mod history_file;
pub mod mcap;
pub mod mcap_writer;
pub mod metrics_file;
pub mod output_file;
mod quoted;
pub mod recorder;
pub mod recover;
pub mod regular_file;
pub mod retry_delay;
pub mod same_file;
pub mod schema_copy;
pub mod segment_store;
pub mod serial_numbers;

/// Whether an error of the system is a lack of room, which may come.
fn is_full(cause: &std::io::Error) -> bool {
    matches!(
        cause.kind(),
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded
    )
}

pub use quoted::{no_formula, number_cell, printable, quoted};
