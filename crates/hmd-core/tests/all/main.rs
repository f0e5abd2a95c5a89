//! Tests of the crate from outside.

mod config;
mod rul;
mod window;
mod window_properties;
mod windower;
