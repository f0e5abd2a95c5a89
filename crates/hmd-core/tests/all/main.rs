//! Tests of the crate from outside.

mod config;
mod drives_of_a_bus;
mod rul;
mod window;
mod window_properties;
mod windower;
