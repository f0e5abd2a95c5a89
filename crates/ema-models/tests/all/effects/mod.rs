//! Effects of real actuators: each against a closed form that the test derives, and nothing changed while all are off.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod controller;
mod deviations;
mod drive;
mod energy;
mod identity;
mod mechanics;
mod motor;
mod page;
mod rig;
mod samples;
mod sensors;
