//! Tests of the crate from outside.

mod rul;
mod window;
mod window_properties;
mod windower;
