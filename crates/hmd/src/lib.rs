//! The program `hmd`: health monitoring of electromechanical actuators, from a bus or a recording to health records.
//!
//! The data path is that of the library crates: `hmd_ingest` turns a source into timed frames, `hmd_core` decodes them,
//! cuts actuation windows, identifies each (`ema_identify`) and assesses health and remaining useful life, `hmd_storage`
//! writes the records. Here are the two drivers of that path, [`replay`] for files and [`daemon`] for live sources, and one
//! file for each verb ([`commands`]). Feature `full` adds the verbs that no aircraft needs.

// Both panic where the stream cannot be written: `commands::say` and `commands::warn` do not.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod commands;
pub mod daemon;
mod local_server;
mod recorded_use;
pub mod replay;
#[cfg(feature = "full")]
pub mod serve;
pub mod unit_windows;
