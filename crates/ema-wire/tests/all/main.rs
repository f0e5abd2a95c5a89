//! Tests of the crate from outside.

mod assembler;
mod bus_load;
mod common;
mod dictionary;
mod roundtrip;
mod serial;
mod values;
