//! Health monitoring of electromechanical actuators: from bus frames to health records.
//!
//! The data path, in order: [`ingest`] turns a source into timed [`frame`]s; [`front`] decodes them ([`channel`], a bus
//! with a layout of its own by its [`dbc`]) and cuts
//! actuation windows ([`window`]); [`judge`] identifies each window ([`ema_identify`]) and
//! decides on [`health`] and on how long it will last ([`mod@rul`]); [`recorder`] writes the [`record`]s through [`sink`]. [`replay`] drives the [`pipeline`] from files,
//! [`daemon`] from live sources. [`simulate`] makes traffic from the reference model, [`calibrate`] and [`evaluate`] measure
//! the monitor against it, [`mod@bench`] how fast it is. [`top`] shows how all actuators stand, by their records.

// Both panic where the stream cannot be written: `commands::say` and `commands::warn` do not.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod bench;
pub mod bus_state;
pub mod calibrate;
pub mod calibration;
pub mod catalogue;
pub mod channel;
pub mod commands;
pub mod config;
pub mod daemon;
pub mod dbc;
pub mod definition;
pub mod evaluate;
pub mod export;
pub mod frame;
pub mod front;
pub mod function;
pub mod health;
pub mod ingest;
pub mod judge;
pub mod life;
pub mod metrics;
pub mod outliers;
pub mod pipeline;
pub mod record;
pub mod recorder;
pub mod recover;
mod regular;
pub mod replay;
pub mod report;
pub mod rul;
pub mod same_file;
pub mod seal;
pub mod seed;
#[cfg(feature = "serve")]
pub mod serve;
pub mod setting;
pub mod simulate;
pub mod simulated;
pub mod sink;
pub mod store;
pub mod top;
pub mod unit;
pub mod utc;
pub mod window;
