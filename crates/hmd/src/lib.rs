//! Placeholder.

pub mod config;
pub mod frame;
pub mod ingest;
pub mod record;
pub mod sink;
pub mod calibrate;
pub mod calibration;
pub mod evaluate;
pub mod identify;
pub mod simulated;
