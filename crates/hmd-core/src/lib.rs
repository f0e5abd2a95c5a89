//! From bus frames to health and remaining useful life: everything between a source and a recording, without files or clocks.
//!
//! The data path, in order: [`demux`] gives each [`frame`] to its actuator and decodes it ([`actuator_stream`]; a bus with a layout
//! of its own by its [`dbc`], a drive by its [`drive_bus`], a log of measured signals by its [`log_map`]); [`window`] cuts actuations out of the samples; [`assess`] identifies each window and decides on
//! [`health`]; [`history`] holds what is known of an actuator from window to window, and [`rul`] predicts how long it lasts;
//! [`commissioning`] calibrates one unit by windows of it, [`learning`] by its first ones, and [`type_of_units`] a type by units; [`record`] has the messages that leave, [`newest`] what the recordings of a unit say of it now. [`pipeline`] counts everything on the way. [`config`] holds the settings, from
//! text. Time comes with the frames, randomness from a seed.

#[cfg(test)]
extern crate self as hmd_core;

pub mod actuator_stream;
pub mod assess;
pub mod bus_state;
pub mod catalogue;
pub mod commissioning;
pub mod config;
pub mod config_warnings;
pub mod counted;
pub mod dbc;
pub mod deadline;
pub mod demux;
pub mod drive_bus;
mod fallen;
pub mod frame;
pub mod functional_check;
pub mod health;
pub mod history;
pub mod last_window;
pub mod learning;
pub mod levels_text;
pub mod log_map;
pub mod metadata_checksum;
pub mod metrics;
mod motion;
pub mod newest;
pub mod outbox;
pub mod outliers;
pub mod pipeline;
pub mod record;
pub mod rul;
pub mod sample;
pub mod seed;
pub mod sensor_checks;
pub mod sensor_health;
mod setpoint_hold;
pub mod setting;
mod step_width;
pub mod talker;
pub mod timestamp;
pub mod type_of_units;
pub mod window;
pub mod windows_in_a_row;
